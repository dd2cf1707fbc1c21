"""The paper's table 2: tests nets of different training sets on the target's test images.

    sdr-jax study table --target camvid --data DIR --holdout 0006R0
    sdr-jax study table --target camvid --data DIR --gta5 DIR --synthia DIR --nets compact fcn8s
    sdr-jax study table --target twin --preset smoke                     # a minute or two
    sdr-jax study table --rederive runs/a/table.json --out runs/b        # no net at all

Training sets are SceneX with random attributes, with the hand-set street and with learnt attributes, other
data sets, and the reward images themselves. Attributes are learnt first, unless --learnt names those of an
earlier run; with its --store, that run's nets are not trained again.
The same command continues a killed run.
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
from experiments.tables import few_rows, row_names
from experiments.tables.form import (
    Column,
    Form,
    Report,
    class_means,
    estimate,
    failures,
    half,
    introduction,
    markdown,
    miou,
    number,
    table,
    target_of,
)
from experiments.tables.nets import with_net
from experiments.tables.skeleton import (
    LEARNT,
    Made,
    Row,
    attributes,
    do,
    learnt_from,
    of_rows,
)
from experiments.tables.stats import gain, mean, statistics
from experiments.targets.base import Target
from seg.classes import CITYSCAPES_19, IGNORE_LABEL, SYNTHIA_13, SYNTHIA_16, class_table
from seg.data import LabelledImages, load, subset
from seg.settings import VGG_NETS, NetName
from seg.weights import described

BASELINE, EYE = "random", "default"
"""Rows over which gains are measured."""
RENDERED = (BASELINE, EYE, LEARNT)
"""Rows whose training sets are rendered."""
OTHERS = ("gta5", "synthia", "kitti")
"""Rows of other data sets, which are also the names of flags and layouts."""
TRAINED_ON = {
    **{row: row_names.TRAINED_ON[row] for row in (*RENDERED, *few_rows.ROWS)},
    **{row: row.upper() for row in OTHERS},
    "real": row_names.TRAINED_ON["real"],
}
"""Training sets in the order of the table."""
SUBSETS = {"16": SYNTHIA_16, "13": SYNTHIA_13}
"""Classes over which nets trained on SYNTHIA are compared on labels of Cityscapes."""

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


def check(config: TableConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    for name in config.nets:
        fidelity = fidelity_of(config, name)
        check_net("--nets", "--nets", fidelity)
        refuse_unstarted(config, "--nets", fidelity.train)


def fidelity_of(config: TableConfig, name: NetName) -> Fidelity:
    """The fidelity of a net with its recipe: its own, or the final one."""
    vgg = name in VGG_NETS
    own = config.vgg if vgg else config.compact if name == "compact" else config.final
    if name == config.final.train.net or (vgg and config.final.train.net in VGG_NETS):
        own = config.final
    return with_net(own, name, str(config.weights) if config.weights else None)


def others(config: TableConfig, target: Target, fidelity: Fidelity) -> dict[str, LabelledImages]:
    """Other data sets as training sets, as large as a net's rendered ones, with ids of the target's table.

    Raises:
        UserError, DataError: the data are wrong.
    """
    limit = None if config.all_images else fidelity.images
    size = (fidelity.height, fidelity.width)
    found = {}
    for layout, root in zip(OTHERS, (config.gta5, config.synthia, config.kitti), strict=True):
        if root is not None:
            files = shipped(layout)
            listed = [entry for own in list_all(files, root).values() for entry in own]
            entries = subset(sorted(listed), limit, config.seed)
            of = f"images of {fidelity.size} (--no-all-images takes {fidelity.images})"
            refuse_larger(f"--{layout}", len(entries), lambda n: 4 * n * size[0] * size[1], of)
            data = load(entries, files, size)
            labels = class_table(target.table).from_train_id[data.labels]
            if np.all(labels == IGNORE_LABEL):
                raise UserError(f"--{layout} {root}: all labels are void")
            found[layout] = LabelledImages(data.images, labels)
    return found


def rows(config: TableConfig, target: Target) -> list[Row]:
    """Rows of each net: rendered sets, these beside the few images if there are any, and sets of images."""
    read: dict[tuple[int, int, int], dict[str, LabelledImages]] = {}  # nets of one size share them
    found = []
    for net in config.nets:
        at = fidelity_of(config, net)
        shape = (at.height, at.width, at.images)
        if shape not in read:
            read[shape] = others(config, target, at)
        some = len(target.few_names)
        alone = {few_rows.FEW: some} if some else {}
        alone |= {name: len(own.images) for name, own in read[shape].items()}
        alone["real"] = len(target.reward_names) + some
        beside = [f"{few_rows.FEW}+{name}" for name in RENDERED] if some else []
        for name in sorted([*RENDERED, *beside, *alone], key=[*TRAINED_ON].index):
            images = alone.get(name, at.images + some * (name in beside))
            place = {"net": net, "trained_on": name, "images": images}
            row = Row(
                {**place, "size": at.size, "steps": at.train.steps},
                partial(_source, name, at, read[shape]),
                at,
                what=f"table, {net}",
                name=name,
                after=LEARNT if name.endswith(LEARNT) else "",
                real=name in alone,
            )
            found.append(row)
    return found


def _source(
    name: str,
    at: Fidelity,
    given: dict[str, LabelledImages],
    run: Session[TableConfig],
    made: Made,
    seed: int,
) -> Source:
    """The training set of a row's net."""
    if name in given:
        return given[name]
    if name in (few_rows.FEW, "real"):
        return run.images(at, "few" if name == few_rows.FEW else "labelled")
    rendered = attributes(run, made, name.removeprefix(f"{few_rows.FEW}+"))
    return rendered if name in RENDERED else run.with_few(at, rendered)


def report(run: Session[TableConfig], _: Made, rows: list[Report]) -> Report:
    """Report the mIoU, and the weights from which nets start."""
    config = run.config
    starts = [described(fidelity_of(config, name).train) for name in config.nets]
    return {
        "starts": [start for start in starts if start],
        "learnt_from": learnt_from(config),
        **few_rows.about(run),
        "rows": rows,
    }


def subset_miou(scored: Sequence[Report | None], classes: Sequence[int]) -> list[float | None]:
    """Every net's mean IoU over some classes in percent, as `seg.metrics.mean_iou`.

    It is None if the net failed, or if all of the classes are absent from the ground truth.
    """
    return [None if net is None else mean([net["class_iou"][k] for k in classes]) for net in scored]


def derive(report: Report) -> Report:
    """Add means, intervals and gains of the nets' mIoU to the report."""
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
            "size": row.get("size", report["scored_at"]),  # older reports have none
            "gain_over_default": eye and gain(miou(scored), miou(eye)),
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


NET: Column = ("net", lambda row: row["net"])
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
        "over hand-set",
        lambda row: row["gain_over_default"] if row["trained_on"] not in (BASELINE, EYE) else None,
        "+.1f",
    ),
]


def _present(report: Report) -> list[str]:
    return [c for c in report["classes"] if c not in report["classes_absent_from_truth"]]


def text(report: Report) -> str:
    """The tables, in Markdown."""
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
    """Draw the mIoU of every training set and net, and the IoU of each class, as PNG."""
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
STUDY = of_rows(FORM, rows, report, check)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("table"))
