"""Assets and images in figures: ``assets.json``, ``assets.md`` and ``assets.png``."""

from __future__ import annotations

from experiments.study.figure import curve, plt, png
from experiments.study.form import (
    Form,
    Report,
    cells,
    failures,
    markdown,
    miou,
    starts,
    statistics,
    target_of,
)

ATTRIBUTES = {
    "random": "random attributes",
    "default": "attributes set by eye",
    "learnt": "learnt attributes",
}
HEAD = (
    "images", "streets", "share of the assets", "mIoU", "95 % interval",
    "the most assets less this", "95 % interval",
)  # fmt: skip


def derive(report: Report) -> Report:
    """The report with means and intervals, and what more assets gain at each number of images."""
    most = max(row["fraction"] for row in report["rows"])
    best = {r["images"]: miou(r["nets"]) for r in report["rows"] if r["fraction"] == most}
    rows = []
    for row in report["rows"]:
        own = statistics(miou(row["nets"]))
        gain = statistics(best[row["images"]], miou(row["nets"]))["gain"]
        more = gain if row["fraction"] != most else None
        rows.append({**row, "mean": own["mean"], "ci95": own["ci95"], "more_assets": more})
    return {**report, "rows": rows}


def text(report: Report) -> str:
    """The table, in Markdown."""
    learnt = report["learnt_from"] if report["attributes"] == "learnt" else ""
    where = f", from {learnt}" if learnt else ""
    lines = [
        f"Target: {report['note']}. Nets on images with {ATTRIBUTES[report['attributes']]}{where}, "
        f"{report['steps']} steps whatever the number of images; mIoU in percent at "
        f"{report['scored_at']} on {report['test_images']} test images, {report['seeds']} paired seeds, "
        f"95 % intervals by Student's t.{starts(report)}",
        "",
        *markdown(HEAD, [_cells(row) for row in report["rows"]]),
        "",
        "The paper's own figure, NOT of this run, has full assets above half assets at every number of "
        "images, about 19 % throughout.",
        *failures(report["rows"]),
    ]
    return "\n".join(lines)


def _cells(row: Report) -> list[str]:
    place = [str(row["images"]), str(row["streets"]), f"{100 * row['fraction']:g} %"]
    return [*place, *cells(row), *cells(row["more_assets"], "+.1f")]


def picture(report: Report) -> bytes:
    """MIoU against the number of images for each share of the assets, as PNG."""
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    fractions = sorted({row["fraction"] for row in report["rows"]}, reverse=True)
    for k, fraction in enumerate(fractions):
        rows = [row for row in report["rows"] if row["fraction"] == fraction]
        # Beside each other, lest the intervals lie on each other.
        places = [row["images"] * (1 + 0.02 * (k - (len(fractions) - 1) / 2)) for row in rows]
        curve(axis, places, rows, f"{100 * fraction:g} % of the assets")
    counts = sorted({row["images"] for row in report["rows"]})
    axis.set_xscale("log")
    axis.set_xticks(counts, [str(count) for count in counts])
    axis.minorticks_off()
    axis.set(xlabel="images of the training set", ylabel="mIoU on the test images, %")
    axis.legend(fontsize=8)
    title = f"{target_of(report)}, {ATTRIBUTES[report['attributes']]}, 95 % intervals"
    figure.suptitle(title, fontsize=10)
    return png(figure)


FORM = Form("assets", derive, text, {"assets.png": picture})
"""The report of ``python -m experiments.assets``."""
