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
    mean,
    miou,
    number,
    statistics,
    target_of,
)
from seg.classes import CITYSCAPES_19, SYNTHIA_13, SYNTHIA_16

BASELINE = "random"
"""Gains are measured from it."""
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
    "net", "trained on", "images", "mIoU", "95 % interval", "gain over random", "95 % interval",
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
    baselines = {r["net"]: r["nets"] for r in report["rows"] if r["trained_on"] == BASELINE}
    subsets = SUBSETS if classes == list(CITYSCAPES_19.classes) else {}
    rows = []
    for row in report["rows"]:
        scored, baseline = row["nets"], baselines[row["net"]]
        over = {
            name: statistics(subset_miou(scored, ids), subset_miou(baseline, ids))
            for name, ids in subsets.items()
        }
        found = {"over_classes": over, "class_iou": class_means(scored, classes)}
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
        name = [row["net"], TRAINED_ON[row["trained_on"]]]
        gain = cells(row["gain"] if row["trained_on"] != BASELINE else None, "+.1f")
        over = [number(row["over_classes"][name]["mean"]) for name in subsets]
        rows.append([*name, str(row["images"]), *cells(row), *gain, *over])
        by_class.append([*name, *(number(row["class_iou"][c]) for c in classes)])
    lines = [introduction(report), "", *markdown(head, rows), "", "IoU of each class, %:", ""]
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
    figure, axes = plt.subplots(
        1, 1 + len(names), figsize=(6 + 6 * len(names), 1.5 + 0.3 * max(len(classes), 8)),
        layout="constrained", squeeze=False,
    )  # fmt: skip
    axis = axes[0, 0]
    thick = 0.8 / len(names)
    for k, net in enumerate(names):
        rows = [row for row in report["rows"] if row["net"] == net]
        places = [
            sets.index(row["trained_on"]) + (k - (len(names) - 1) / 2) * thick for row in rows
        ]
        means = [row["mean"] or 0.0 for row in rows]
        bars = [half(row) for row in rows]
        axis.barh(places, means, thick, xerr=bars, capsize=3, color=f"C{k}", label=net)
        own = axes[0, 1 + k]
        values = np.array([[row["class_iou"][c] for row in rows] for c in classes], float)
        image = own.imshow(values, aspect="auto", vmin=0, vmax=100, cmap="viridis")
        for (y, x), value in np.ndenumerate(values):
            color = "white" if value < 60 else "black"
            own.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=color)
        own.set_xticks(range(len(rows)), [row["trained_on"] for row in rows], fontsize=8)
        own.set_yticks(range(len(classes)), classes, fontsize=8)
        own.set_title(f"{net}: IoU of each class, %")
        figure.colorbar(image, ax=own, shrink=0.8)
    axis.set_yticks(range(len(sets)), [TRAINED_ON[name] for name in sets])
    axis.invert_yaxis()
    axis.set(xlabel="mIoU on the test images, %, 95 % intervals", title="training sets")
    if len(names) > 1:
        axis.legend(fontsize=8)
    figure.suptitle(f"{target_of(report)}, {report['seeds']} nets each")
    return png(figure)


FORM = Form("table", derive, text, {"table.png": picture})
"""The report of ``python -m experiments.table``."""
