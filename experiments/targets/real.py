"""CamVid, Cityscapes and LabelMeFacade on disk."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from common.errors import UserError
from common.labels.listing import HELD_OUT
from common.labels.target_file import TargetFile, shipped
from experiments.config import Config, MainConfig, RewardConfig
from experiments.targets.base import SIZES, Sides, Target, refuse_overlap, two_sides
from seg.classes import IGNORE_LABEL
from seg.data import (
    Entry,
    LabelledImages,
    list_split,
    list_unlabelled,
    load,
    load_unlabelled,
    refuse_shared,
    subset,
)

REPORTED = {"camvid": "test", "cityscapes": "val", "labelmefacade": "test"}
"""The default split for the test."""
MOST_NAMED = 8
"""The title names up to so many sequences on both sides; otherwise it gives their number."""


def reported_split(target: str, splits: Collection[str]) -> str:
    """The split that figures of a target are reported on; it need not be among its splits."""
    return REPORTED.get(target) or next((own for own in HELD_OUT if own in splits), HELD_OUT[0])


def real_target(name: str, config: Config, data: Path) -> Target:
    """A public data set in the folder ``data``.

    Raises:
        UserError: a side has no images, or an image is on both.
        DataError: the data are wrong.
    """
    files = shipped(name)
    reward, test, where = _sides(files, data, config.test_split or REPORTED[name], config)
    # The same for every --seed, so that a study's searches share their target with the main job.
    test = subset(test, config.test_images)
    unlabelled = config.unlabelled if isinstance(config, MainConfig) else None
    if unlabelled is not None:
        # No label is read; the paths are empty.
        reward = tuple(Entry(p.stem, "", p, p) for p in list_unlabelled(unlabelled))
    reward = subset(reward, config.reward_images)
    refuse_overlap([e.name for e in reward], [e.name for e in test])
    # Images for -MMD^2 need no labels, even if there are some.
    scored = not isinstance(config, RewardConfig) or config.reward_kind == "miou"

    @lru_cache(maxsize=SIZES)
    def at(height: int, width: int) -> Sides:
        size = (height, width)
        read = load(reward, files, size) if unlabelled is None else _void(reward, size)
        sides = two_sides(read, load(test, files, size), str(data), scored)
        refuse_shared({"the reward images": sides["reward"], "the test images": sides["test"]})
        return sides

    shared = sorted({e.sequence for e in reward} & {e.sequence for e in test})
    told = f"sequences {', '.join(shared)}"
    if len(shared) > MOST_NAMED:
        told = f"{len(shared)} sequences"
    note = f" ({told} are on both sides)" if shared else ""
    kind = "images" if unlabelled is None else "images without labels"
    return Target(
        name=name,
        real=True,
        table=name,
        title=f"{name}, {len(reward)} {kind} for the reward, {where}, {len(test)} images{note}",
        reward_names=tuple(e.name for e in reward),
        test_names=tuple(e.name for e in test),
        at=at,
        labelled=unlabelled is None,
        reward_sequences=tuple(e.sequence for e in reward),
    )


def _sides(
    files: TargetFile, data: Path, test_split: str, config: Config
) -> tuple[tuple[Entry, ...], tuple[Entry, ...], str]:
    """The reward images, the test images, and the origin of the latter."""
    reward = list_split(files, data, "train")
    if config.holdout is None:
        try:
            test = list_split(files, data, test_split)
        except UserError as error:
            raise UserError(
                f"{error}; --test-split or --holdout choose other images to report on"
            ) from None
        return reward, test, f"reported on split {test_split}"
    if config.test_split is not None:
        raise UserError("give --holdout or --test-split, not both")
    held = tuple(e for e in reward if e.sequence == config.holdout)
    rest = tuple(e for e in reward if e.sequence != config.holdout)
    if not held or not rest:
        raise UserError(
            f"--holdout {config.holdout!r} must leave images on both sides; the training images "
            f"have the sequences {', '.join(sorted({e.sequence for e in reward}))}"
        )
    return rest, held, f"reported on sequence {config.holdout}"


def _void(entries: Sequence[Entry], size: tuple[int, int]) -> LabelledImages:
    """Images without labels as a set with void pixels."""
    images = load_unlabelled([e.image_path for e in entries], size)
    labels = np.full(images.shape[:3], IGNORE_LABEL, np.uint8)
    names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
    return LabelledImages(images, labels, names, sequences)
