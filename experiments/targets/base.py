"""A target: validation images of the search, and others to test on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from common.errors import UserError
from experiments.targets.twin import TwinWorld
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages

keep_two_sizes = lru_cache(maxsize=2)
"""Keep the images at two sizes: those of rewards and of final networks, which alternate."""
Side = Literal["reward", "test", "few", "labelled"]
"""Sides of a target: validation images of the search (reward), test images, the labelled subset mixed with
every training set (few), and all images whose labels may be used before the test."""
Sides = Mapping[Side, LabelledImages]
"""Images of a target's sides at one size; `few` is absent without a labelled subset."""


class Target(NamedTuple):
    """A target; its images are read (or rendered) once a size is requested."""

    name: str  # of `experiments.config.TargetName`, or "far twin"
    real: bool
    table: str  # class table of all networks of the run, see ``seg.class_table``
    title: str  # one line for people
    reward_names: tuple[str, ...]
    reward_sequences: tuple[str, ...]  # of those images
    test_names: tuple[str, ...]
    at: Callable[[int, int], Sides]  # (height, width) -> images and labels
    twin: TwinWorld | None = None
    few_names: tuple[str, ...] = ()  # images mixed with every training set


def with_reward(target: Target, indices: np.ndarray) -> Target:
    """Keep only some of a target's validation images, by index."""

    @keep_two_sizes
    def at(height: int, width: int) -> Sides:
        sides = target.at(height, width)
        reward = sides["reward"].take(indices)
        labelled = sides["labelled"] if "few" in sides else reward
        return {**sides, "reward": reward, "labelled": labelled}

    return target._replace(
        reward_names=tuple(target.reward_names[k] for k in indices),
        reward_sequences=tuple(target.reward_sequences[k] for k in indices),
        at=at,
    )


def refuse_overlap(reward_names: Sequence[str], test_names: Sequence[str]) -> None:
    """Raise UserError if an image is on both sides."""
    overlap = sorted(set(reward_names) & set(test_names))
    if overlap:
        raise UserError(
            f"{len(overlap)} images, such as {overlap[0]}, are both training and test images; "
            "choose another --test-split or --holdout"
        )


def two_sides(reward: LabelledImages, test: LabelledImages, origin: str) -> Sides:
    """Make the sides of a target without a labelled subset.

    Args:
        reward: validation images of the search.
        test: test images.
        origin: where they come from, for the error.

    Raises:
        UserError: a side has no labelled pixel.
    """
    for kind, images in (("training", reward), ("test", test)):
        if np.all(images.labels == IGNORE_LABEL):
            names = images.names
            shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
            raise UserError(
                f"{origin}: no pixel of the {kind} images has a class ({shown}); label a pixel of one, or "
                "leave them out"
            )
    return {"reward": reward, "test": test, "labelled": reward}
