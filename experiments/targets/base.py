"""A target: images for the reward, and others for the reported figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from common.errors import UserError
from experiments.targets.twin import TwinWorld
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages

SIZES = 2
"""Number of sizes at which images are kept: those of rewards and of final nets, which alternate."""


Side = Literal["reward", "test", "few", "labelled"]
"""Sides of a target: images that give the reward, images for the test, images that join every training set
and give no reward, and all images whose labels may be used before the test."""
Sides = Mapping[Side, LabelledImages]
"""Images of a target's sides at one size; `few` is absent if no image joins every training set."""


class Target(NamedTuple):
    """A target; images are read (or rendered) when a size is requested."""

    name: str  # of `experiments.config.TargetName`, or "far twin"
    real: bool
    table: str  # class table of all nets of the run, see ``seg.class_table``
    title: str  # one line for people
    reward_names: tuple[str, ...]
    reward_sequences: tuple[str, ...]  # of those images
    test_names: tuple[str, ...]
    at: Callable[[int, int], Sides]  # (height, width) -> images and labels
    twin: TwinWorld | None = None
    labelled: bool = True  # whether the reward images have labels
    few_names: tuple[str, ...] = ()  # images that join every training set


def with_reward(target: Target, picked: np.ndarray) -> Target:
    """The target with only some of its reward images, by index."""

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
    """Raise UserError if an image is on both sides."""
    both = sorted(set(reward_names) & set(test_names))
    if both:
        raise UserError(
            f"{len(both)} images, such as {both[0]}, are among the reward images and the test "
            "images; choose another --test-split or --holdout"
        )


def two_sides(reward: LabelledImages, test: LabelledImages, where: str, labelled: bool) -> Sides:
    """Make the sides of a target without images that join every training set.

    Args:
        reward: images that give the reward.
        test: images for the test.
        where: their origin, for the error.
        labelled: whether the labels of the reward images are needed.

    Raises:
        UserError: a side whose labels are needed has no labelled pixel.
    """
    sides: Sides = {"reward": reward, "test": test, "labelled": reward}
    for side in ("reward", "test") if labelled else ("test",):
        if np.all(sides[side].labels == IGNORE_LABEL):  # type: ignore[index]
            names = sides[side].names  # type: ignore[index]
            shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
            raise UserError(
                f"{where}: all labels of the {side} images are void ({shown}); label a pixel of one, or "
                "leave them out"
            )
    return sides
