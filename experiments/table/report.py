"""The table in figures: ``table.json``, ``table.md`` and ``table.png``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.run import few
from experiments.study.figure import plt, png
from experiments.study.form import (
    Form,
    Report,
    cells,
    class_means,
    failures,
    half,
    introduction,
    markdown,
    miou,
    number,
    target_of,
)
from experiments.study.stats import mean, statistics
from seg.classes import CITYSCAPES_19, SYNTHIA_13, SYNTHIA_16

BASELINE, EYE = "random", "default"
"""Gains are measured from both."""
TRAINED_ON = {
    "random": "SceneX, random attributes",
    "default": "SceneX, attributes set by eye",
    "learnt": "SceneX, learnt attributes",
    **few.TRAINED_ON,
    "gta5": "GTA5",
    "synthia": "SYNTHIA",
    "kitti": "KITTI",
    "real": "the reward images themselves",
}
HEAD = (
    "net", "at", "trained on", "images", "mIoU", "95 % interval", "gain over random", "95 % interval",
    "over by eye", "95 % interval",
)  # fmt: skip
SUBSETS = {"16": SYNTHIA_16, "13": SYNTHIA_13}
"""Classes over which nets trained on SYNTHIA are compared, where labels are those of Cityscapes."""

PAPER_NOTE = (
    "The paper's own numbers, NOT of this run: nets with ImageNet weights, 20,000 steps, test images at "
    "480x360 (CamVid) or 1024x512 (Cityscapes). They say which way differences go, not how high ours "
    "should be."
)
PAPER: dict[str, dict[str, tuple[int, float, float]]] = {
    "camvid": {
        "synthia": (9400, 33.3, 32.6),
        "gta5": (24966, 33.1, 32.6),
        "random": (450, 22.4, 27.8),
        "learnt": (450, 29.6, 31.4),
    },
    "cityscapes": {
        "synthia": (9400, 18.1, 18.3),
        "gta5": (24966, 20.3, 24.2),
        "random": (450, 10.9, 12.3),
        "learnt": (450, 18.6, 18.4),
    },
}
"""Training set -> images, mIoU of FCN8s, of DeepLabv2. Source: table 2."""


def subset_miou(scored: Sequence[Report | None], classes: Sequence[int]) -> list[float | None]:
    """Every net's mean IoU over some classes, in percent; `seg.metrics.mean_iou` of these classes.

    None where the net failed, or where none of the classes occurs in the truth.
    """
    return [None if net is None else mean([net["class_iou"][k] for k in classes]) for net in scored]


def derive(report: Report) -> Report:
    """The report with means, intervals and gains of its nets' scores."""
    classes, known = report["classes"], PAPER.get(report["target"])
    own = {(row["net"], row["trained_on"]): row["nets"] for row in report["rows"]}
    subsets = SUBSETS if classes == list(CITYSCAPES_19.classes) else {}
    rows = []
    for row in report["rows"]:
        scored, baseline, eye = row["nets"], own[row["net"], BASELINE], own.get((row["net"], EYE))
        over = {
            name: statistics(subset_miou(scored, ids), subset_miou(baseline, ids))
            for name, ids in subsets.items()
        }
        found = {
            "size": row.get("size", report["scored_at"]),  # reports of before have none
            "gain_over_default": eye and statistics(miou(scored), miou(eye))["gain"],
            "over_classes": over,
            "class_iou": class_means(scored, classes),
        }
        rows.append({**row, **statistics(miou(scored), miou(baseline)), **found})
    paper = known and [
        {"trained_on": name, **dict(zip(("images", "fcn8s", "deeplabv2"), values, strict=True))}
        for name, values in known.items()
    ]
    absent = [name for name in classes if all(row["class_iou"][name] is None for row in rows)]
    return {
        **report,
        "rows": rows,
        "classes_absent_from_truth": absent,
        "paper": {"note": PAPER_NOTE, "rows": paper} if known else None,
    }


def _present(report: Report) -> list[str]:
    return [c for c in report["classes"] if c not in report["classes_absent_from_truth"]]


def text(report: Report) -> str:
    """The tables, in Markdown."""
    absent, classes = report["classes_absent_from_truth"], _present(report)
    subsets = list(report["rows"][0]["over_classes"])
    head = (*HEAD, *(f"mIoU over {name}" for name in subsets))
    rows, by_class = [], []
    for row in report["rows"]:
        trained_on = row["trained_on"]
        name = [row["net"], TRAINED_ON[trained_on]]
        gains = [
            *cells(row["gain"] if trained_on != BASELINE else None, "+.1f"),
            *cells(row["gain_over_default"] if trained_on not in (BASELINE, EYE) else None, "+.1f"),
        ]
        over = [number(row["over_classes"][name]["mean"]) for name in subsets]
        at = [name[0], row["size"], name[1], str(row["images"])]
        rows.append([*at, *cells(row), *gains, *over])
        by_class.append([*name, *(number(row["class_iou"][c]) for c in classes)])
    sizes = " or ".join(dict.fromkeys(row["size"] for row in report["rows"]))
    lines = [
        introduction({**report, "scored_at": sizes}),
        "",
        *markdown(head, rows),
        "",
        "IoU of each class, %:",
        "",
    ]
    lines += markdown(["net", "trained on", *classes], by_class)
    if absent:
        lines += ["", f"Never in the truth, and so in no mean: {', '.join(absent)}."]
    lines += failures(report["rows"])
    if report["paper"]:
        own = [
            [TRAINED_ON[r["trained_on"]], *(str(r[c]) for c in ("images", "fcn8s", "deeplabv2"))]
            for r in report["paper"]["rows"]
        ]
        lines += ["", report["paper"]["note"], ""]
        lines += markdown(["trained on", "images", "FCN8s", "DeepLabv2"], own)
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """MIoU of every training set and net, and the IoU of each class, as PNG."""
    names = list(dict.fromkeys(row["net"] for row in report["rows"]))
    sets = list(dict.fromkeys(row["trained_on"] for row in report["rows"]))
    classes = _present(report)
    down = 1 if len(names) < 3 else 2
    across = -(-(1 + len(names)) // down)
    figure, axes = plt.subplots(
        down, across, figsize=(6 * across, (1.5 + 0.3 * max(len(classes), 8)) * down),
        layout="constrained", squeeze=False,
    )  # fmt: skip
    axis, *others = axes.flat
    for unused in others[len(names) :]:
        unused.set_axis_off()
    thick = 0.8 / len(names)
    for k, net in enumerate(names):
        rows = [row for row in report["rows"] if row["net"] == net]
        places = [
            sets.index(row["trained_on"]) + (k - (len(names) - 1) / 2) * thick for row in rows
        ]
        means = [row["mean"] or 0.0 for row in rows]
        bars = [half(row) for row in rows]
        axis.barh(places, means, thick, xerr=bars, capsize=3, color=f"C{k}", label=net)
        own = others[k]
        values = np.array([[row["class_iou"][c] for row in rows] for c in classes], float)
        image = own.imshow(values, aspect="auto", vmin=0, vmax=100, cmap="viridis")
        for (y, x), value in np.ndenumerate(values):
            color = "white" if value < 60 else "black"
            own.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=color)
        own.set_xticks(range(len(rows)), [row["trained_on"] for row in rows], fontsize=8)
        own.set_yticks(range(len(classes)), classes, fontsize=8)
        own.set_title(f"{net} at {rows[0]['size']}: IoU of each class, %")
        figure.colorbar(image, ax=own, shrink=0.8)
    axis.set_yticks(range(len(sets)), [TRAINED_ON[name] for name in sets])
    axis.invert_yaxis()
    axis.set(xlabel="mIoU on the test images, %, 95 % intervals", title="training sets")
    if len(names) > 1:
        axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=len(names))
    figure.suptitle(f"{target_of(report)}, {report['seeds']} nets each")
    return png(figure)


FORM = Form("table", derive, text, {"table.png": picture})
"""The report of ``python -m experiments.table``."""
