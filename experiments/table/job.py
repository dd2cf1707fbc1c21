"""The table's training sets, and the nets trained on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments import study_report
from experiments.config import Stage, check_weights, refuse_repeats
from experiments.errors import UserError
from experiments.finals import default_proposal, random_proposal
from experiments.ladder import training_cost
from experiments.main import main_of_study
from experiments.reward import Truth
from experiments.study import Work, learnt_attributes, opened, search_work
from experiments.study_config import StudyConfig, check_study, defaults_on
from experiments.study_nets import Source, score_nets
from experiments.table_report import FORM
from scene.command import duration
from seg.classes import IGNORE_LABEL, class_table
from seg.data.folders import read_folders
from seg.recipes import RECIPES
from seg.settings import TrainSettings, check_settings

RENDERED = ("random", "default", "learnt")
"""Rows whose training sets are rendered."""
OTHERS = ("gta5", "synthia", "kitti")
"""Rows whose training sets others have made; flags and layouts are called the same."""


@dataclass(frozen=True, kw_only=True)
class TableConfig(StudyConfig):
    """One table. Every field is a flag."""

    nets: tuple[str, ...] = ("compact",)
    """The nets that are trained: compact, fcn8s, deeplabv2."""
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


def table_config(target: str, preset: str) -> TableConfig:
    """The defaults of ``python -m experiments.table``."""
    config = defaults_on(TableConfig, target, preset)
    if preset == "paper":
        return replace(config, nets=("fcn8s", "deeplabv2"))
    return config


def check(config: TableConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    check_study(config)
    if not config.nets:
        raise UserError("--nets needs at least one net")
    refuse_repeats("--nets", config.nets)
    for name in config.nets:
        try:
            check_settings(stage_of(config, name).train)
        except ValueError as error:
            raise UserError(f"--nets: {error}") from None
        check_weights(stage_of(config, name).train)
    if config.weights is not None and set(config.nets) == {"compact"}:
        raise UserError("--weights are for VGG nets; --nets names none")


def stage_of(config: TableConfig, name: str) -> Stage:
    """The final stage with another net, trained as long.

    The compact net's recipe does not suit VGG nets, nor theirs the compact one: those of ``seg.recipes``
    stand in where --final.train is made for the other kind.
    """
    train = config.final.train
    weights = None if config.weights is None else str(config.weights)
    if name != train.net and "compact" in (name, train.net):
        recipe = RECIPES["scratch" if weights is None else "paper"]
        own = TrainSettings() if name == "compact" else recipe
        train = replace(own, steps=train.steps, table=train.table)
    train = replace(train, net=name)
    if weights is not None and name != "compact":
        train = replace(train, weights=weights)
    return replace(config.final, train=train)


def others(config: TableConfig) -> dict[str, Truth]:
    """Training sets that others have made, by name; labels are ids of the target's table.

    Raises:
        DataError: the data are not as they should be.
    """
    table = class_table(config.final.train.table)
    limit = None if config.all_images else config.final.images
    found = {}
    for layout in OTHERS:
        root = getattr(config, layout)
        if root is not None:
            size = (config.final.height, config.final.width)
            data = read_folders(root, layout, size, limit, config.seed)
            labels = table.from_train_id[data.labels]
            if np.all(labels == IGNORE_LABEL):
                raise UserError(f"--{layout} {root}: all labels are void")
            found[layout] = Truth(data.images, labels)
    return found


def plan(config: TableConfig, sets: Sequence[str]) -> list[Work]:
    """The nets of the table, after those of the search."""
    work = []
    for name in config.nets:
        stage = stage_of(config, name)
        count = len(RENDERED) * config.seeds
        work.append(
            Work.at(f"nets, {len(RENDERED)} rendered sets x {config.seeds} seeds", count, stage)
        )
        count = len(sets) * config.seeds
        each = training_cost(stage)
        what = f"nets, {len(sets)} sets of images x {config.seeds} seeds"
        work.append(Work(what, count, stage, each))
    return [*search_work(config), *work]


def run(config: TableConfig) -> dict[str, Any]:
    """Make the whole table, or what is left of it, and return what ``table.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    given = others(config)  # before anything is written: a data set may be broken
    with opened(config) as study:
        target = study.target
        progress = study.begin(plan(config, [*given, "real"]))
        learnt = learnt_attributes(study, progress)
        own = target.at(config.final.height, config.final.width).reward
        sources: dict[str, Source] = {
            "random": random_proposal(),
            "default": default_proposal(config.default_width),
            "learnt": learnt,
            **given,
            "real": Truth(own.images, own.labels),
        }
        rows = []
        for name in config.nets:
            stage = stage_of(config, name)
            outcomes = score_nets(study, f"table, {name}", sources, stage, progress)
            rows += [
                {
                    "net": name,
                    "trained_on": row,
                    "images": len(source.images) if isinstance(source, Truth) else stage.images,
                    "steps": stage.train.steps,
                    "nets": study_report.nets(outcomes[row]),
                }
                for row, source in sources.items()
            ]
        scores = {**study_report.about(study, config.final), "rows": rows}
        report = study_report.write(FORM, scores, config.out)
        progress.say(FORM.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'table.md'}")
        return report


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_of_study(FORM, table_config, run, description, arguments)
