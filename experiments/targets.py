"""What the nets must be good on: real images for the reward, and others for the reported figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from experiments.config import Config
from experiments.errors import UserError
from experiments.twin import ASSETS, TwinWorld, twin_names, twin_split, twin_world
from scene.workers import WorkerPool
from seg.classes import IGNORE_LABEL, class_table
from seg.data import (
    DataError,
    Entry,
    RealSet,
    list_camvid,
    list_cityscapes,
    list_unlabelled,
    load,
    load_unlabelled,
    subset,
)


class Split(NamedTuple):
    """Both sides of a target at one size."""

    reward: RealSet
    test: RealSet


class Target(NamedTuple):
    """A target; images are read (or rendered) when a size is asked for."""

    name: str  # "twin", "cityscapes" or "camvid"
    real: bool
    table: str  # class table, see ``seg.class_table``
    title: str  # one line for people
    reward_names: tuple[str, ...]
    test_names: tuple[str, ...]
    at: Callable[[int, int], Split]  # (height, width) -> images and labels
    twin: TwinWorld | None = None
    labelled: bool = True  # whether the reward images are


def twin_target(config: Config, workers: WorkerPool) -> Target:
    """The embedded stand-in; see ``twin.py``."""
    _check_table(config, "cityscapes")
    world = twin_world(config.twin_seed)

    def split(name: str, size: tuple[int, int], images: int | None) -> RealSet:
        return twin_split(
            world,
            name,
            size,
            images=images,
            renderer=config.renderer,
            workers=workers,
            assets=min(ASSETS, config.asset_count or ASSETS),
        )

    @lru_cache(maxsize=1)
    def at(height: int, width: int) -> Split:
        return _checked(
            Split(
                split("train", (height, width), config.reward_images),
                split("test", (height, width), config.test_images),
            ),
            config,
        )

    return Target(
        name="twin",
        real=False,
        table="cityscapes",
        title=f"the twin {config.twin_seed}, a stand-in rendered by our own engine: NOT real data",
        reward_names=tuple(n for n, _ in twin_names("train", config.reward_images)),
        test_names=tuple(n for n, _ in twin_names("test", config.test_images)),
        at=at,
        twin=world,
    )


def cityscapes_target(config: Config, workers: WorkerPool) -> Target:
    """Cityscapes from ``--data``, or the twin where there is none."""
    if config.data is None:
        if config.holdout or config.test_split:
            raise UserError("--holdout and --test-split need --data: the twin has no such names")
        if config.unlabelled:
            raise UserError("--unlabelled needs --data: nothing real is like the twin")
        return twin_target(config, workers)
    return _real_target("cityscapes", "val", list_cityscapes, config)


def camvid_target(config: Config, workers: WorkerPool) -> Target:
    """CamVid from ``--data``."""
    if config.data is None:
        raise UserError("CamVid needs its folder: --data DIR (or the variable CAMVID_DIR)")
    return _real_target("camvid", "test", list_camvid, config)


TARGETS = ("twin", "camvid", "cityscapes")
"""Targets by name."""


def named_target(name: str, config: Config, workers: WorkerPool) -> Target:
    """The target of that name.

    Raises:
        UserError: no data where it is needed, or data for the twin.
    """
    if name == "camvid":
        return camvid_target(config, workers)
    if name == "cityscapes" and config.data is None:
        raise UserError("Cityscapes needs its folder: --data DIR; or use --target twin")
    if name == "twin" and config.data is not None:
        raise UserError("--target twin takes no --data; --target camvid or cityscapes does")
    return cityscapes_target(config, workers)


def _real_target(
    name: str, test_split: str, listing: Callable[..., tuple[Entry, ...]], config: Config
) -> Target:
    _check_table(config, name)
    table = class_table(name)
    reward = listing(config.data, "train")
    if config.holdout is not None:
        if config.test_split is not None:
            raise UserError("give --holdout or --test-split, not both")
        sequences = sorted({e.sequence for e in reward})
        test = tuple(e for e in reward if e.sequence == config.holdout)
        reward = tuple(e for e in reward if e.sequence != config.holdout)
        if not test or not reward:
            raise UserError(
                f"--holdout {config.holdout!r} must leave images on both sides; "
                f"the training images have the sequences {', '.join(sequences)}"
            )
        where = f"reported on sequence {config.holdout}"
    else:
        try:
            test = listing(config.data, config.test_split or test_split)
        except DataError as error:
            raise UserError(
                f"{error}; --test-split or --holdout choose other images to report on"
            ) from None
        where = f"reported on split {config.test_split or test_split}"
    test = subset(test, config.test_images, config.seed)
    if config.unlabelled is not None:
        # No label is read, nor is there a place for one.
        nowhere = [Entry(p.stem, "", p, p) for p in list_unlabelled(config.unlabelled)]
        reward = subset(nowhere, config.reward_images, config.seed)
    else:
        reward = subset(reward, config.reward_images, config.seed)
    refuse_overlap([e.name for e in reward], [e.name for e in test])

    @lru_cache(maxsize=1)
    def at(height: int, width: int) -> Split:
        size = (height, width)
        read = load(reward, table, size) if config.unlabelled is None else _void(reward, size)
        return _checked(Split(read, load(test, table, size)), config)

    shared = sorted({e.sequence for e in reward} & {e.sequence for e in test})
    note = f" (sequences {', '.join(shared)} are on both sides)" if shared else ""
    kind = "images" if config.unlabelled is None else "images without labels"
    return Target(
        name=name,
        real=True,
        table=name,
        title=f"{name}, {len(reward)} {kind} for the reward, {where}, {len(test)} images{note}",
        reward_names=tuple(e.name for e in reward),
        test_names=tuple(e.name for e in test),
        at=at,
        labelled=config.unlabelled is None,
    )


def _void(entries: Sequence[Entry], size: tuple[int, int]) -> RealSet:
    """Images without labels as a set whose every pixel is void."""
    images = load_unlabelled([e.image_path for e in entries], size)
    labels = np.full(images.shape[:3], IGNORE_LABEL, np.uint8)
    names, sequences = (tuple(getattr(e, f) for e in entries) for f in ("name", "sequence"))
    return RealSet(names, sequences, images, labels)


def _check_table(config: Config, table: str) -> None:
    for stage in ("reward", "final"):
        found = getattr(config, stage).train.table
        if found != table:
            raise UserError(f"--{stage}.train.table must be {table} for this target, not {found}")


def refuse_overlap(reward_names: list[str], test_names: list[str]) -> None:
    """Raise UserError if an image would both give the reward and be reported on."""
    both = sorted(set(reward_names) & set(test_names))
    if both:
        raise UserError(
            f"{len(both)} images, such as {both[0]}, are among the reward images and the test "
            "images; choose another --test-split or --holdout"
        )


def _checked(split: Split, config: Config) -> Split:
    where = "the twin" if config.data is None else str(config.data)
    for side, images in split._asdict().items():
        needed = side == "test" or config.reward_kind == "miou"
        if needed and np.all(images.labels == IGNORE_LABEL):
            raise UserError(f"{where}: all labels of the {side} images are void")
    return split
