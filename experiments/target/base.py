"""A target: real images for the reward, and others for the reported figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from experiments.target.twin import TwinWorld
from seg.classes import IGNORE_LABEL
from seg.data import RealSet
from shell.errors import UserError

SIZES = 2
"""Sizes at which images are kept: that of the rewards and that of the final nets, which take turns."""


class Split(NamedTuple):
    """Both sides of a target at one size."""

    reward: RealSet
    test: RealSet
    few: RealSet | None = None  # join every training set, and give no reward
    whole: RealSet | None = None  # those that give the reward and the few, as they are listed

    @property
    def labelled(self) -> RealSet:
        """All images whose labels may be used before the result is reported."""
        return self.reward if self.whole is None else self.whole


class Target(NamedTuple):
    """A target; images are read (or rendered) when a size is asked for."""

    name: str  # of `experiments.config.TargetName`, or "far twin"
    real: bool
    table: (
        str  # class table, see ``seg.class_table``; every net of the run tells these classes apart
    )
    title: str  # one line for people
    reward_names: tuple[str, ...]
    reward_sequences: tuple[str, ...]  # of those images
    test_names: tuple[str, ...]
    at: Callable[[int, int], Split]  # (height, width) -> images and labels
    twin: TwinWorld | None = None
    labelled: bool = True  # whether the reward images are
    few_names: tuple[str, ...] = ()  # images that join every training set


def part_of(images: RealSet, picked: np.ndarray) -> RealSet:
    """Some of the images, by index."""
    names, sequences = (tuple(column[k] for k in picked) for column in images[:2])
    return RealSet(names, sequences, images.images[picked], images.labels[picked])


def with_reward(target: Target, picked: np.ndarray) -> Target:
    """The target with some of its reward images, by index, as if it had no others."""

    @lru_cache(maxsize=SIZES)
    def at(height: int, width: int) -> Split:
        split = target.at(height, width)
        return split._replace(reward=part_of(split.reward, picked))

    return target._replace(
        reward_names=tuple(target.reward_names[k] for k in picked),
        reward_sequences=tuple(target.reward_sequences[k] for k in picked),
        at=at,
    )


def refuse_overlap(reward_names: Sequence[str], test_names: Sequence[str]) -> None:
    """Raise UserError if an image would both give the reward and be reported on."""
    both = sorted(set(reward_names) & set(test_names))
    if both:
        raise UserError(
            f"{len(both)} images, such as {both[0]}, are among the reward images and the test "
            "images; choose another --test-split or --holdout"
        )


def refuse_void(split: Split, where: str, labelled: bool) -> Split:
    """The split itself; raises UserError if no pixel of a side that is scored has a label."""
    for side, images in (("reward", split.reward), ("test", split.test)):
        if (side == "test" or labelled) and np.all(images.labels == IGNORE_LABEL):
            raise UserError(f"{where}: all labels of the {side} images are void")
    return split
