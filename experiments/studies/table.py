"""The paper's table 2: networks trained on renders, other data sets and labels, tested on the target.

    sdr-jax study table --target camvid --data DIR --holdout 0006R0
    sdr-jax study table --target camvid --data DIR --gta5 DIR --synthia DIR --nets compact fcn8s
    sdr-jax study table --target twin --preset smoke                     # a minute or two
    sdr-jax study table --rederive runs/a/table.json --out runs/b        # no training

Training sets are SceneX (random streets, the default street, optimised streets), other data sets, and the
labelled images themselves. The search runs first, unless --learnt names the streets of an earlier run; with
its --store, that run's networks are not trained again. The same command resumes a killed run.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

import numpy as np

from common.errors import UserError
from common.labels.listing import list_all
from common.labels.target_file import shipped
from common.memory import refuse_larger
from experiments.config import (
    Fidelity,
    check_net,
    refuse_unstarted,
)
from experiments.config.cli import command
from experiments.config.jobs import TableConfig
from experiments.evaluation.job import Source
from experiments.session.session import Session
from experiments.studies.figure import plt, png
from experiments.tables import row_names
from experiments.tables.form import (
    Column,
    Form,
    Report,
    class_means,
    error_bars,
    estimate,
    failures,
    introduction,
    markdown,
    miou,
    number,
    table,
    target_of,
)
from experiments.tables.nets import with_net
from experiments.tables.skeleton import LEARNT, Answers, Row, attributes, learnt_from, of_rows
from experiments.tables.stats import gain, mean, statistics
from experiments.targets.base import Target
from seg.classes import CITYSCAPES_19, IGNORE_LABEL, SYNTHIA_13, SYNTHIA_16, class_table
from seg.data import LabelledImages, load, subset
from seg.settings import VGG_NETS, NetName
from seg.weights import described

BASELINE, DEFAULT = "random", "default"
"""Rows over which gains are measured."""
RENDERED = (BASELINE, DEFAULT, LEARNT)
"""Rows whose training sets are rendered."""
OTHERS = ("gta5", "synthia", "kitti")
"""Rows of other data sets, which are also the names of flags and layouts."""
TRAINED_ON = {
    **{row: row_names.TRAINED_ON[row] for row in (*RENDERED, *row_names.FEW_ROWS)},
    **{row: row.upper() for row in OTHERS},
    "real": row_names.TRAINED_ON["real"],
}
"""Training sets in the order of the table."""
SUBSETS = {"16": SYNTHIA_16, "13": SYNTHIA_13}
"""Classes over which networks trained on SYNTHIA are compared on labels of Cityscapes."""

PAPER_NOTE = (
    "The paper's own numbers, NOT of this run: networks with ImageNet weights, 20,000 steps, test images at "
    "480x360 (CamVid) or 1024x512 (Cityscapes). Compare the direction of differences, not their size."
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


def check(config: TableConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    for name in config.nets:
        fidelity = fidelity_of(config, name)
        check_net("--nets", "--nets", fidelity)
        refuse_unstarted(config, "--nets", fidelity.train)


def fidelity_of(config: TableConfig, name: NetName) -> Fidelity:
    """Return the fidelity of a network with its recipe: its own, or the final one."""
    vgg = name in VGG_NETS
    fidelity = config.vgg if vgg else config.compact if name == "compact" else config.final
    if name == config.final.train.net or (vgg and config.final.train.net in VGG_NETS):
        fidelity = config.final
    return with_net(fidelity, name, str(config.weights) if config.weights else None)


def others(config: TableConfig, target: Target, fidelity: Fidelity) -> dict[str, LabelledImages]:
    """Read other data sets as training sets, as large as a rendered one, with ids of the target's classes.

    Raises:
        UserError, DataError: the data are wrong.
    """
    limit = None if config.all_images else fidelity.images
    size = (fidelity.height, fidelity.width)
    data_sets = {}
    for layout, root in zip(OTHERS, (config.gta5, config.synthia, config.kitti), strict=True):
        if root is not None:
            files = shipped(layout)
            listed = [entry for split in list_all(files, root).values() for entry in split]
            entries = subset(sorted(listed), limit, config.seed)
            what = f"images of {fidelity.size} (--no-all-images takes {fidelity.images})"
            refuse_larger(
                f"images of --{layout}:", len(entries), lambda n: 4 * n * size[0] * size[1], what
            )
            data = load(entries, files, size)
            labels = class_table(target.table).from_train_id[data.labels]
            if np.all(labels == IGNORE_LABEL):
                raise UserError(f"--{layout} {root}: no pixel has a class of {target.name}")
            data_sets[layout] = LabelledImages(data.images, labels)
    return data_sets


def rows(config: TableConfig, target: Target) -> list[Row]:
    """Make the rows of each network: rendered sets, alone and mixed with labels, and sets of real images."""
    by_shape: dict[tuple[int, int, int], dict[str, LabelledImages]] = {}  # read once for each size
    table_rows = []
    for net in config.nets:
        at = fidelity_of(config, net)
        shape = (at.height, at.width, at.images)
        if shape not in by_shape:
            by_shape[shape] = others(config, target, at)
        few = len(target.few_names)
        real = {row_names.FEW: few} if few else {}
        real |= {name: len(data.images) for name, data in by_shape[shape].items()}
        real["real"] = len(target.reward_names) + few
        mixed = [f"{row_names.FEW}+{name}" for name in RENDERED] if few else []
        for name in sorted([*RENDERED, *mixed, *real], key=[*TRAINED_ON].index):
            images = real.get(name, at.images + few * (name in mixed))
            place = {"net": net, "trained_on": name, "images": images}
            row = Row(
                {**place, "size": at.size, "steps": at.train.steps},
                partial(_source, name, at, by_shape[shape]),
                at,
                what=f"table, {net}",
                name=name,
                after=LEARNT if name.endswith(LEARNT) else "",
                real=name in real,
            )
            table_rows.append(row)
    return table_rows


def _source(
    name: str,
    at: Fidelity,
    data_sets: dict[str, LabelledImages],
    run: Session[TableConfig],
    answers: Answers,
    seed: int,
) -> Source:
    """Make the training set of a row's network."""
    if name in data_sets:
        return data_sets[name]
    if name in (row_names.FEW, "real"):
        return run.images(at, "few" if name == row_names.FEW else "labelled")
    rendered = attributes(run, answers, name.removeprefix(f"{row_names.FEW}+"))
    return rendered if name in RENDERED else run.with_few(at, rendered)


def report(run: Session[TableConfig], _: Answers, rows: list[Report]) -> Report:
    """Report the mIoU, and the weights from which networks start."""
    config = run.config
    starts = [described(fidelity_of(config, name).train) for name in config.nets]
    return {
        "starts": [start for start in starts if start],
        "learnt_from": learnt_from(config),
        "rows": rows,
    }


def subset_miou(scored: Sequence[Report | None], classes: Sequence[int]) -> list[float | None]:
    """Compute every network's mean IoU over some classes in percent, as `seg.metrics.mean_iou`.

    It is None if the network failed, or if all of the classes are absent from the ground truth.
    """
    return [None if net is None else mean([net["class_iou"][k] for k in classes]) for net in scored]


def derive(report: Report) -> Report:
    """Add means, intervals and gains of the networks' mIoU to the report."""
    classes, paper = report["classes"], PAPER.get(report["target"])
    scored = {(row["net"], row["trained_on"]): row["nets"] for row in report["rows"]}
    subsets = SUBSETS if classes == list(CITYSCAPES_19.classes) else {}
    rows = []
    for row in report["rows"]:
        nets, baseline = row["nets"], scored[row["net"], BASELINE]
        default = scored.get((row["net"], DEFAULT))
        over = {
            name: statistics(subset_miou(nets, ids), subset_miou(baseline, ids))
            for name, ids in subsets.items()
        }
        rows.append(
            {
                **row,
                **statistics(miou(nets), miou(baseline)),
                "size": row.get("size", report["scored_at"]),  # older reports have none
                "gain_over_default": default and gain(miou(nets), miou(default)),
                "over_classes": over,
                "class_iou": class_means(nets, classes),
            }
        )
    paper_rows = paper and [
        {"trained_on": name, **dict(zip(("images", "fcn8s", "deeplabv2"), values, strict=True))}
        for name, values in paper.items()
    ]
    absent = [name for name in classes if all(row["class_iou"][name] is None for row in rows)]
    return {
        **report,
        "rows": rows,
        "classes_absent_from_truth": absent,
        "paper": {"note": PAPER_NOTE, "rows": paper_rows} if paper else None,
    }


NET: Column = ("network", lambda row: row["net"])
SET: Column = ("trained on", lambda row: TRAINED_ON[row["trained_on"]])
COLUMNS: list[Column] = [
    NET,
    ("at", lambda row: row["size"]),
    SET,
    ("images", lambda row: str(row["images"])),
    *estimate("mIoU"),
    *estimate(
        "gain over random",
        lambda row: row["gain"] if row["trained_on"] != BASELINE else None,
        "+.1f",
    ),
    *estimate(
        "over default",
        lambda row: (
            row["gain_over_default"] if row["trained_on"] not in (BASELINE, DEFAULT) else None
        ),
        "+.1f",
    ),
]


def _present(report: Report) -> list[str]:
    return [c for c in report["classes"] if c not in report["classes_absent_from_truth"]]


def text(report: Report) -> str:
    """Write the tables in Markdown."""
    absent, classes = report["classes_absent_from_truth"], _present(report)
    subsets = list(report["rows"][0]["over_classes"])
    over = [
        (f"mIoU over {name}", lambda row, name=name: number(row["over_classes"][name]["mean"]))
        for name in subsets
    ]
    by_class = [(name, lambda row, name=name: number(row["class_iou"][name])) for name in classes]
    sizes = " or ".join(dict.fromkeys(row["size"] for row in report["rows"]))
    lines = [
        introduction({**report, "scored_at": sizes}),
        "",
        *table([*COLUMNS, *over], report["rows"]),
        "",
        "IoU of each class, %:",
        "",
    ]
    lines += table([NET, SET, *by_class], report["rows"])
    if absent:
        lines += ["", f"Not in the test labels, and so in no mean: {', '.join(absent)}."]
    lines += failures(report["rows"])
    if report["paper"]:
        paper = [
            [TRAINED_ON[r["trained_on"]], *(str(r[c]) for c in ("images", "fcn8s", "deeplabv2"))]
            for r in report["paper"]["rows"]
        ]
        lines += ["", report["paper"]["note"], ""]
        lines += markdown(["trained on", "images", "FCN8s", "DeepLabv2"], paper)
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Plot the mIoU of every training set and network, and the IoU of each class, as PNG."""
    names = list(dict.fromkeys(row["net"] for row in report["rows"]))
    sets = list(dict.fromkeys(row["trained_on"] for row in report["rows"]))
    classes = _present(report)
    down = 1 if len(names) < 3 else 2
    across = -(-(1 + len(names)) // down)
    figure, axes = plt.subplots(
        down, across, figsize=(6 * across, (1.5 + 0.3 * max(len(classes), 8)) * down),
        layout="constrained", squeeze=False,
    )  # fmt: skip
    axis, *panels = axes.flat
    for unused in panels[len(names) :]:
        unused.set_axis_off()
    thick = 0.8 / len(names)
    for k, net in enumerate(names):
        rows = [row for row in report["rows"] if row["net"] == net]
        places = [
            sets.index(row["trained_on"]) + (k - (len(names) - 1) / 2) * thick for row in rows
        ]
        means = [row["mean"] or 0.0 for row in rows]
        bars = error_bars(rows)
        axis.barh(places, means, thick, xerr=bars, capsize=3, color=f"C{k}", label=net)
        panel = panels[k]
        values = np.array([[row["class_iou"][c] for row in rows] for c in classes], float)
        image = panel.imshow(values, aspect="auto", vmin=0, vmax=100, cmap="viridis")
        for (y, x), value in np.ndenumerate(values):
            color = "white" if value < 60 else "black"
            panel.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=color)
        ticks = [row_names.SHORT.get(row["trained_on"], row["trained_on"]) for row in rows]
        panel.set_xticks(range(len(rows)), ticks, fontsize=8)
        panel.set_yticks(range(len(classes)), classes, fontsize=8)
        panel.set_title(f"{net} at {rows[0]['size']}: IoU of each class, %")
        figure.colorbar(image, ax=panel, shrink=0.8)
    axis.set_yticks(range(len(sets)), [TRAINED_ON[name] for name in sets])
    axis.invert_yaxis()
    axis.set(xlabel="mIoU on the test images, %, 95 % intervals", title="training sets")
    if len(names) > 1:
        axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=len(names))
    figure.suptitle(f"{target_of(report)}, {report['seeds']} networks each")
    return png(figure)


FORM = Form("table", derive, text, {"table.png": picture})
STUDY = of_rows(FORM, rows, report, check)

if __name__ == "__main__":
    sys.exit(command("table"))
