"use strict";
// Draws the plots in the colours of the page, and redraws them when these change.
const root = document.documentElement;
const night = matchMedia("(prefers-color-scheme: dark)");

function storedTheme(value) {  // the reader's choice; a page opened from a file may not be able to store it
  try {
    if (value !== undefined) localStorage.setItem("theme", value);
    return localStorage.getItem("theme");
  } catch { return value; }
}

function colour(name) {  // "@learnt" or "@learnt/0.2"
  const [variable, share] = name.slice(1).split("/");
  const hex = getComputedStyle(root).getPropertyValue("--" + variable).trim();
  if (share === undefined) return hex;
  const parts = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  return `rgba(${parts.join(",")},${share})`;
}

function coloured(value) {
  if (typeof value === "string") return value.startsWith("@") ? colour(value) : value;
  if (Array.isArray(value)) return value.map(coloured);
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item)]));
}

function styled(layout, height) {
  const axis = { gridcolor: "@grid", zerolinecolor: "@line", linecolor: "@line", automargin: true, ticks: "",
    zeroline: false };
  const merged = {
    height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", colorway: ["@learnt"],
    font: { family: getComputedStyle(document.body).fontFamily, size: 12.5, color: "@soft" },
    margin: { l: 8, r: 16, t: 8, b: 8 }, hovermode: "closest", showlegend: false,
    hoverlabel: { bgcolor: "@paper", bordercolor: "@line", font: { color: "@ink" } },
    xaxis: {}, yaxis: {}, ...layout,
    legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", font: { color: "@soft" }, ...layout.legend },
  };
  for (const key of Object.keys(merged)) {
    if (!/^[xy]axis\d*$/.test(key)) continue;
    merged[key] = { ...axis, ...merged[key] };
    if (merged[key].title) merged[key].title = { text: merged[key].title, font: { size: 12.5 }, standoff: 8 };
  }
  return coloured(merged);
}

function draw(figure) {
  const plot = JSON.parse(figure.querySelector("script").textContent);
  const view = plot.views ? plot.views[Number(figure.dataset.view || 0)] : plot;
  const height = parseInt(figure.style.getPropertyValue("--height"), 10);
  const options = { responsive: true, displaylogo: false, displayModeBar: false };
  Plotly.react(figure.querySelector(":scope > div:not(.views)"), coloured(view.data),
    styled(view.layout, height), options);
}

function addButtons(figure) {  // one for each view
  const plot = JSON.parse(figure.querySelector("script").textContent);
  if (!plot.views || plot.views.length < 2) return;
  const bar = document.createElement("div");
  bar.className = "views";
  plot.views.forEach((view, number) => {
    const button = document.createElement("button");
    button.textContent = view.label;
    button.setAttribute("aria-pressed", number === 0);
    button.onclick = () => {
      figure.dataset.view = number;
      for (const other of bar.children) other.setAttribute("aria-pressed", other === button);
      draw(figure);
    };
    bar.append(button);
  });
  figure.prepend(bar);
}

const plots = [...document.querySelectorAll(".plot")];
const button = document.getElementById("theme");

function applyTheme() {
  const theme = storedTheme() || (night.matches ? "dark" : "light");
  root.dataset.theme = theme;
  button.textContent = theme === "dark" ? "Light" : "Dark";
  plots.forEach(draw);
}

button.onclick = () => { storedTheme(root.dataset.theme === "dark" ? "light" : "dark"); applyTheme(); };
night.addEventListener("change", applyTheme);
plots.forEach(addButtons);
applyTheme();
const written = document.getElementById("written");  // only on the page of an unfinished run
if (written) written.textContent = new Date(document.lastModified).toLocaleTimeString();
