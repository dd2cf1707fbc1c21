"""A target: real images for the reward, and others for the reported figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from experiments.target.twin import TwinWorld
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages
from shell.errors import UserError

SIZES = 2
"""Sizes at which images are kept: that of the rewards and that of the final nets, which take turns."""


Side = Literal["reward", "test", "few", "labelled"]
"""Images of a target: those that give the reward, those that nets are tested on, those that join every
training set and give no reward, and all whose labels may be used before the result is reported."""
Sides = Mapping[Side, LabelledImages]
"""Images of a target at one size; `few` is absent where no image joins every training set."""


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
    at: Callable[[int, int], Sides]  # (height, width) -> images and labels
    twin: TwinWorld | None = None
    labelled: bool = True  # whether the reward images are
    few_names: tuple[str, ...] = ()  # images that join every training set


def with_reward(target: Target, picked: np.ndarray) -> Target:
    """The target with some of its reward images, by index, as if it had no others."""

    @lru_cache(maxsize=SIZES)
    def at(height: int, width: int) -> Sides:
        sides = target.at(height, width)
        reward = sides["reward"].take(picked)
        labelled = sides["labelled"] if "few" in sides else reward
        return {**sides, "reward": reward, "labelled": labelled}

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


def two_sides(reward: LabelledImages, test: LabelledImages, where: str, labelled: bool) -> Sides:
    """The sides of a target with no image that joins every training set.

    Args:
        reward: images that give the reward.
        test: images that nets are tested on.
        where: they are from, for the error.
        labelled: whether the labels of the reward images are needed.

    Raises:
        UserError: no pixel of a side whose labels are needed has one.
    """
    sides: Sides = {"reward": reward, "test": test, "labelled": reward}
    for side in ("reward", "test") if labelled else ("test",):
        if np.all(sides[side].labels == IGNORE_LABEL):  # type: ignore[index]
            raise UserError(f"{where}: all labels of the {side} images are void")
    return sides
