"""The table in figures: ``table.json``, ``table.md`` and ``table.png``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.figure import plt, png
from experiments.study_report import (
    Form,
    class_means,
    interval,
    introduction,
    markdown,
    miou,
    number,
    statistics,
)
from seg.classes import CITYSCAPES_19, SYNTHIA_13, SYNTHIA_16

BASELINE = "random"
"""Gains are measured from it."""
TRAINED_ON = {
    "random": "SceneX, random attributes",
    "default": "SceneX, attributes set by eye",
    "learnt": "SceneX, learnt attributes",
    "gta5": "GTA5",
    "synthia": "SYNTHIA",
    "kitti": "KITTI",
    "real": "the reward images (upper bound)",
}
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


def subset_miou(
    scored: Sequence[dict[str, Any] | None], classes: Sequence[int]
) -> list[float | None]:
    """Every net's mean IoU over some classes, in percent; `seg.metrics.mean_iou` of these classes.

    None where the net failed, or where none of the classes occurs in the truth.
    """
    found: list[float | None] = []
    for net in scored:
        known = [net["class_iou"][k] for k in classes] if net is not None else []
        known = [v for v in known if v is not None]
        found.append(float(np.mean(known)) if known else None)
    return found


def derive(report: dict[str, Any]) -> dict[str, Any]:
    """The report with means, intervals and gains of its nets' scores."""
    classes = report["classes"]
    baselines = {r["net"]: r["nets"] for r in report["rows"] if r["trained_on"] == BASELINE}
    rows = []
    for row in report["rows"]:
        scored, baseline = row["nets"], baselines[row["net"]]
        subsets = {}
        if classes == list(CITYSCAPES_19.classes):
            subsets = {
                name: statistics(subset_miou(scored, ids), subset_miou(baseline, ids))
                for name, ids in SUBSETS.items()
            }
        rows.append(
            {
                **row,
                **statistics(miou(scored), miou(baseline)),
                "over_classes": subsets,
                "class_iou": class_means(scored, classes),
            }
        )
    known = report["target"] in PAPER
    paper = [
        {"trained_on": name, "images": images, "fcn8s": fcn8s, "deeplabv2": deeplabv2}
        for name, (images, fcn8s, deeplabv2) in PAPER.get(report["target"], {}).items()
    ]
    return {
        **report,
        "rows": rows,
        "classes_absent_from_truth": _absent(report),
        "paper": {"note": PAPER_NOTE, "rows": paper} if known else None,
    }


def _absent(report: dict[str, Any]) -> list[str]:
    """Classes that never occur in the truth, and so are left out of every mean."""
    scored = [net for row in report["rows"] for net in row["nets"] if net is not None]
    if not scored:
        return []
    values = scored[0]["class_iou"]
    return [name for name, v in zip(report["classes"], values, strict=True) if v is None]


def text(report: dict[str, Any]) -> str:
    """The tables, in Markdown."""
    absent = report["classes_absent_from_truth"]
    classes = [name for name in report["classes"] if name not in absent]
    subsets = list(report["rows"][0]["over_classes"])
    head = [
        "net",
        "trained on",
        "images",
        "mIoU",
        "95 % interval",
        "gain over random",
        "95 % interval",
    ]
    head += [f"mIoU over {name}" for name in subsets]
    rows = []
    for row in report["rows"]:
        gain = (row["gain"] or {}) if row["trained_on"] != BASELINE else {}
        rows.append(
            [
                row["net"],
                TRAINED_ON[row["trained_on"]],
                str(row["images"]),
                number(row["mean"]),
                interval(row["ci95"]),
                number(gain.get("mean"), "+.1f"),
                interval(gain.get("ci95")),
                *(number(row["over_classes"][name]["mean"]) for name in subsets),
            ]
        )
    lines = [introduction(report), "", *markdown(head, rows), "", "IoU of each class, %:", ""]
    lines += markdown(
        ["net", "trained on", *classes],
        [
            [r["net"], TRAINED_ON[r["trained_on"]], *(number(r["class_iou"][c]) for c in classes)]
            for r in report["rows"]
        ],
    )
    if absent:
        lines += ["", f"Never in the truth, and so in no mean: {', '.join(absent)}."]
    failed = sum(net is None for row in report["rows"] for net in row["nets"])
    if failed:
        lines += ["", f"{failed} nets failed in training and are left out."]
    if report["paper"]:
        lines += ["", report["paper"]["note"], ""]
        lines += markdown(
            ["trained on", "images", "FCN8s", "DeepLabv2"],
            [
                [
                    TRAINED_ON[r["trained_on"]],
                    str(r["images"]),
                    str(r["fcn8s"]),
                    str(r["deeplabv2"]),
                ]
                for r in report["paper"]["rows"]
            ],
        )
    return "\n".join(lines)


def picture(report: dict[str, Any]) -> bytes:
    """MIoU of every training set and net, and the IoU of each class, as PNG."""
    names = list(dict.fromkeys(row["net"] for row in report["rows"]))
    sets = list(dict.fromkeys(row["trained_on"] for row in report["rows"]))
    absent = report["classes_absent_from_truth"]
    classes = [name for name in report["classes"] if name not in absent]
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
        half = [row["mean"] - row["ci95"][0] if row["ci95"] else 0.0 for row in rows]
        axis.barh(places, means, thick, xerr=half, capsize=3, color=f"C{k}", label=net)
        own = axes[0, 1 + k]
        values = np.array([[_value(row["class_iou"][c]) for row in rows] for c in classes])
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
    note = "" if report["real"] else " (not real data)"
    figure.suptitle(f"{report['target']}{note}, {report['seeds']} nets each")
    return png(figure)


def _value(iou: float | None) -> float:
    return np.nan if iou is None else iou


FORM = Form("table", derive, text, picture)
"""The report of ``python -m experiments.table``."""
