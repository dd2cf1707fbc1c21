"""``report.html``: the run on one page, for people. Figures come from the summary, pictures lie beside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from experiments.main.summary import TRAINED_ON
from experiments.run.few import words
from experiments.study.form import Report, number, starts

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; }
th, td { border-bottom: 1px solid #ddd; padding: .25em .8em; text-align: right; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; }
.twin { background: #fff3cd; padding: .6em 1em; }
"""
PICTURES = {
    "images.png": "The target beside what the nets were trained on",
    "reward.png": "Rewards of the search",
    "attributes.png": "The policy's distribution over the bins of each attribute, update by update",
}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    return "\n".join(["<table>", line(head, "th"), *(line(row, "td") for row in rows), "</table>"])


def _interval(ci95: Sequence[float] | None) -> str:
    return "one seed" if ci95 is None else f"{ci95[0]:.1f} to {ci95[1]:.1f}"


def _percent(value: float | None) -> str:
    return "not in the truth" if value is None else f"{value:.1f}"


def html(summary: Report) -> str:
    """The whole page, from what ``summary.json`` holds."""
    rows = summary["rows"]
    scores = [
        (words(summary, r, TRAINED_ON), number(rows[r]["mean"]), _interval(rows[r]["ci95"]))
        for r in rows
    ] + [
        (f"gain, learnt minus {over}", number(gain["mean"], "+.1f"), _interval(gain["ci95"]))
        for over, gain in (("random", summary["gain"]), ("by eye", summary["gain_over_default"]))
    ]
    classes = [
        (name, *(_percent(rows[r]["per_class"][name]) for r in rows))
        for name in rows["random"]["per_class"]
    ]
    learnt = "\n".join(_component(**row) for row in summary["components"])
    warning = (
        ""
        if summary["real"]
        else "<p class='twin'>The twin: this is not a result on real data.</p>"
    )
    pictures = "\n".join(
        f"<h2>{escape(title)}</h2>\n<img src='pictures/{name}' alt='{escape(title)}' />"
        for name, title in PICTURES.items()
    )
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(summary["note"])}</title>
<style>{STYLE}</style></head><body>
<h1>{escape(summary["note"])}</h1>
{warning}
<p>mIoU in percent on {summary["test_images"]} test images, scored at {escape(summary["scored_at"])}, over
{len(rows["random"]["miou"])} paired seeds, with 95 % intervals. {summary["evaluations"]} rewards on
{summary["reward_images"]} images, {summary["seconds"]["total"] / 60:.0f} minutes, preset
{escape(summary["preset"])}, answer "{escape(summary["chosen_candidate"])}".{escape(starts(summary))}</p>
{_table(("training images", "mIoU", "95 % interval"), scores)}
{pictures}
<h2>IoU of each class</h2>
{_table(("class", *(TRAINED_ON[r] for r in rows)), classes)}
<h2>Learnt attributes</h2>
{learnt}
</body></html>
"""


def _component(share: float, attributes: Report) -> str:
    """The attributes of a share of the streets."""
    rows = [
        (
            name.replace("_", " "),
            *(f"{a['physical'][key]:.4g}" for key in ("centre", "low", "high")),
            a["physical"]["unit"],
            a["meaning"],
        )
        for name, a in attributes.items()
    ]
    of = "" if share == 1 else f"<p>{share:.0%} of the streets:</p>\n"
    return of + _table(("attribute", "centre", "from", "to", "unit", "meaning"), rows)
