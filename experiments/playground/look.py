"""The page's colours and measures, light and dark."""

ACCENT = "#4f7ea3"
"""Of what can be moved or pressed."""
CSS = """
:root { --paper: #f6f6f3; --card: #ffffff; --ink: #23262b; --soft: #6b7078; --line: #e3e3de;
         }
.body--dark { --paper: #16181b; --card: #1e2125; --ink: #e4e5e7; --soft: #9297a0; --line: #2e3237;
         }
body, .body--dark { background: var(--paper); color: var(--ink); font-family: system-ui, sans-serif; }
.nicegui-content { padding: 0; gap: 0; }
.bar { display: flex; align-items: center; gap: 10px; padding: 10px 20px; width: 100%;
       border-bottom: 1px solid var(--line); background: var(--card); flex-wrap: wrap; }
.bar h1 { font-size: 1rem; font-weight: 600; line-height: 1.4; margin: 0 12px 0 0; }
.bar .grow { flex: 1; }
.desk { display: grid; grid-template-columns: 380px minmax(0, 1fr); width: 100%; }
.knobs { height: calc(100vh - 57px); overflow-y: auto; padding: 8px 8px 40px 20px;
          border-right: 1px solid var(--line); background: var(--card); scrollbar-width: thin; }
.stage { height: calc(100vh - 57px); overflow-y: auto; padding: 18px 22px 40px; }
.knobgroup .q-item { padding: 0; min-height: 36px; font-weight: 600; font-size: .84rem; }
.knobgroup .q-expansion-item__content > * { gap: 0; padding: 0 12px 8px 0; }
.attribute { display: grid; grid-template-columns: minmax(0, 1fr) 3.2rem; width: 100%;
             padding: 4px 0 1px; align-items: center; column-gap: 10px; }
.head { grid-column: 1 / 3; display: flex; justify-content: space-between; gap: 10px; }
.meaning { font-size: .79rem; color: var(--ink); line-height: 1.3; }
.ends { font-size: .79rem; font-variant-numeric: tabular-nums; white-space: nowrap; }
.drawn { font-size: .72rem; color: var(--soft); font-variant-numeric: tabular-nums;
         text-align: right; white-space: nowrap; }
.meaning { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.attribute .q-range { padding: 0 8px; }
.shown { display: grid; grid-template-columns: minmax(0, 2.08fr) minmax(0, 1fr); gap: 4px 14px;
         width: 100%; margin-bottom: 14px; }
.shown .planes { display: grid; gap: 14px; align-content: start; }
.shown.beside { grid-template-columns: 1fr 1fr; }
.shown.beside .planes { grid-template-columns: 1fr 1fr; grid-column: 1 / 3; }
.picture { position: relative; border-radius: 8px; overflow: hidden; background: var(--line); }
.picture img { display: block; width: 100%; height: 100%; object-fit: contain; }
.real, .real img { max-height: 46vh; }
.caption { font-size: .76rem; color: var(--soft); margin: 0; padding: 0; line-height: 1.5; }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(250px, 1fr)); gap: 14px;
          width: 100%; }
.panel { background: var(--card); border: 1px solid var(--line); border-radius: 8px;
         padding: 12px 16px 14px; display: flex; flex-direction: column; gap: 8px; }
.panel h2 { font-size: .84rem; font-weight: 600; line-height: 1.5; margin: 0; }
.fields { display: grid; grid-template-columns: repeat(auto-fit, minmax(72px, 1fr)); gap: 4px 12px; }
.quiet { color: var(--soft); font-size: .76rem; }
.wrong { color: #b3423a; font-size: .8rem; }
.body--dark .wrong { color: #ec8f86; }
.q-notification { background: #9c3f38; color: #ffffff; max-width: 60rem; }
.q-notification .q-btn { color: #ffffff !important; }
.q-btn { text-transform: none; font-weight: 500; }
@media (max-width: 800px) { .desk { grid-template-columns: 1fr; }
  .knobs, .stage { height: auto; border-right: 0; } }
"""
