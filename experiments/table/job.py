"""The table's training sets, and the nets trained on them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import presets
from experiments.config import FewConfig, Fidelity, LearntConfig, Preset, TargetName, check_net
from experiments.reward.truth import Truth
from experiments.run.context import Run, Work
from experiments.run.few import about as few_images
from experiments.run.few import images_of
from experiments.run.ladder import training_cost
from experiments.run.nets import Nets, begin, paired_seeds, score_lists, training_sets, with_net
from experiments.study.form import Report, about, nets
from experiments.study.skeleton import Study, learnt_attributes, learnt_from, learnt_work
from experiments.table.report import FORM
from experiments.target.base import Target
from scene.proposal import Streets
from seg.classes import IGNORE_LABEL, class_table
from seg.data.folders import read_folders
from seg.settings import VGG_NETS, NetName
from seg.weights import described
from shell.errors import UserError, refuse_repeats

RENDERED = 3
"""Rows whose training sets are rendered: random, default and learnt attributes."""
OTHERS = ("gta5", "synthia", "kitti")
"""Rows whose training sets others have made; flags and layouts are called the same."""


@dataclass(frozen=True, kw_only=True)
class TableConfig(LearntConfig, FewConfig):
    """One table. Every field is a flag."""

    nets: tuple[NetName, ...] = ("compact",)
    """The nets that are trained."""
    compact: Fidelity
    """The fidelity of the compact net, where that is not the final one's."""
    vgg: Fidelity
    """The fidelity of FCN8s and DeepLabv2, where the final one's net is neither."""
    weights: Path | None = None
    """ImageNet weights that the VGG nets start from (see ``seg.weights``); by default from scratch."""
    gta5: Path | None = None
    """Folder of GTA5, to train on (see ``seg.data.folders``)."""
    synthia: Path | None = None
    """Folder of SYNTHIA RAND-CITYSCAPES."""
    kitti: Path | None = None
    """Folder of KITTI semantics."""
    all_images: bool = False
    """Train on all images of these; by default on as many as a rendered dataset has, a seeded choice."""


def defaults(target: TargetName, preset: Preset) -> TableConfig:
    """The defaults of ``python -m experiments.table``."""
    own = {"nets": ("fcn8s", "deeplabv2")} if preset == "paper" else {}
    return presets.defaults(TableConfig, target, preset, **own)


def check(config: TableConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if not config.nets:
        raise UserError("--nets needs at least one net")
    refuse_repeats("--nets", config.nets)
    if config.weights is not None and not set(config.nets) & set(VGG_NETS):
        raise UserError("--weights are for VGG nets; --nets names none")
    for name in config.nets:
        check_net("--nets", "--nets", fidelity_of(config, name))


def fidelity_of(config: TableConfig, name: NetName) -> Fidelity:
    """The fidelity of a net: the final one if that is its own or it has none, with its recipe."""
    vgg = name in VGG_NETS
    own = config.vgg if vgg else config.compact if name == "compact" else config.final
    if name == config.final.train.net or (vgg and config.final.train.net in VGG_NETS):
        own = config.final
    return with_net(own, name, str(config.weights) if vgg and config.weights else None)


Others = dict[NetName, dict[str, Truth]]
"""Training sets that others have made, by net and name."""


def others(config: TableConfig, target: Target) -> Others:
    """Training sets that others have made, as large as each net's rendered ones; ids of the target's table.

    Raises:
        UserError, DataError: the data are not as they should be.
    """
    read: dict[tuple[int, int, int], dict[str, Truth]] = {}  # nets of one size share them
    found: Others = {}
    for name in config.nets:
        own = fidelity_of(config, name)
        shape = (own.height, own.width, own.images)
        if shape not in read:
            read[shape] = _read(config, target, own)
        found[name] = read[shape]
    return found


def _read(config: TableConfig, target: Target, fidelity: Fidelity) -> dict[str, Truth]:
    limit = None if config.all_images else fidelity.images
    size = (fidelity.height, fidelity.width)
    found = {}
    for layout in OTHERS:
        root = getattr(config, layout)
        if root is not None:
            data = read_folders(root, layout, size, limit, config.seed)
            labels = class_table(target.table).from_train_id[data.labels]
            if np.all(labels == IGNORE_LABEL):
                raise UserError(f"--{layout} {root}: all labels are void")
            found[layout] = Truth(data.images, labels)
    return found


def plan(config: TableConfig, _: Any = None) -> list[Work]:
    """The nets of the table, after those of the search."""
    work, seeds = learnt_work(config), config.seeds
    few = config.few is not None
    given = 1 + few + sum(getattr(config, layout) is not None for layout in OTHERS)
    sets = RENDERED * (1 + few)
    for name in config.nets:
        fidelity = fidelity_of(config, name)
        rendered = f"nets, {sets} rendered sets x {seeds} seeds"
        real = f"nets, {given} sets of images x {seeds} seeds"
        work += [
            Work.at(rendered, sets * seeds, fidelity),
            Work(real, given * seeds, fidelity, training_cost(fidelity)),
        ]
    return work


def scores(run: Run[TableConfig], given: Others) -> Report:
    """Train the nets of the whole table, or what is left of them."""
    config, seeds = run.config, paired_seeds(run)

    def lists(learnt: Streets | None) -> list[Nets]:
        found = []
        for name in config.nets:
            fidelity = fidelity_of(config, name)
            sources = training_sets(run, learnt, fidelity, **given[name])
            found.append(Nets(f"table, {name}", sources, run.recipe(fidelity)))
        return found

    if config.learnt is None:
        begin(run, lists(None), seeds)
    trained = lists(learnt_attributes(run))
    rows: list[dict[str, Any]] = []
    for name, own, outcomes in zip(
        config.nets, trained, score_lists(run, trained, seeds), strict=True
    ):
        fidelity = own.recipe.fidelity
        rows += [
            {
                "net": name,
                "trained_on": row,
                "images": images_of(source, fidelity),
                "size": fidelity.size,
                "steps": fidelity.train.steps,
                "nets": nets(outcomes[row]),
            }
            for row, source in own.sources.items()
        ]
    starts = [described(fidelity_of(config, name).train) for name in config.nets]
    return {
        **about(run, config.final),
        "starts": [start for start in starts if start],
        "learnt_from": learnt_from(config),
        **few_images(run),
        "rows": rows,
    }


STUDY = Study(FORM, plan, scores, check, others)
"""What ``python -m experiments.table`` does."""
