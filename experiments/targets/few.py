"""A few labelled images of the reward side, which join every training set instead of giving the reward."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from common.errors import UserError
from experiments.config import Config, FewConfig
from experiments.targets.base import SIZES, Sides, Target
from seg.classes import IGNORE_LABEL, class_table
from seg.data import LabelledImages

STREAM = 5
"""Second word of the seed that chooses images; other streams have others."""
CHOICE = 0
"""Seed of the choice of a target's few images, the same for every --seed."""


def with_few(target: Target, config: Config) -> Target:
    """Move ``--few`` of the target's labelled images from the reward side to every training set.

    Raises:
        UserError: there are fewer, or a side would be empty.
    """
    few = config.few if isinstance(config, FewConfig) else None
    if few is None:
        return target
    names, sequences = target.reward_names, target.reward_sequences
    picked = spread(names, sequences, count_of(few, len(names), target.name), CHOICE)
    others = np.setdiff1d(np.arange(len(names)), picked)

    @lru_cache(maxsize=SIZES)
    def at(height: int, width: int) -> Sides:
        sides = target.at(height, width)
        whole = sides["reward"]
        own = {"reward": whole.take(others), "few": whole.take(picked), "labelled": whole}
        _refuse_void(own["reward"], own["few"], few, target)
        return {**sides, **own}  # type: ignore[dict-item]

    of = Counter(sequences[k] for k in picked)
    told = ", ".join(f"{sequence} {count}" for sequence, count in sorted(of.items()))
    where = told if len(of) <= 8 else f"{len(of)} sequences"
    return target._replace(
        title=f"{target.title}; {len(picked)} of the {len(names)} ({where}) join every training set "
        "instead of giving the reward",
        reward_names=tuple(names[k] for k in others),
        reward_sequences=tuple(sequences[k] for k in others),
        few_names=tuple(names[k] for k in picked),
        at=at,
    )


def count_of(few: int | float, images: int, name: str) -> int:
    """The number of images of ``--few``, which is a number or a share.

    Raises:
        UserError: it is 0, all images, or more.
    """
    count = few if isinstance(few, int) else math.floor(few * images + 0.5)
    there = f"{images} labelled images of {name}"
    if count > images:
        raise UserError(
            f"--few {few} is more than the {there}; {images - 1} leave one for the reward"
        )
    if count == images:
        raise UserError(
            f"--few {few} selects all {there}, and none is left for the reward; "
            f"{images - 1} leave one"
        )
    if count < 1:
        raise UserError(
            f"--few {few} selects none of the {there}; {1 / images:.2g} or more selects one"
        )
    return count


def spread(names: Sequence[str], sequences: Sequence[str], count: int, seed: int) -> np.ndarray:
    """Choose images from each sequence in turn, spread over its time; ascending indices.

    Args:
        names: names of all images, which sort by time within a sequence.
        sequences: the sequence of each image.
        count: number to choose, at most all.
        seed: seed of the choice.
    """
    rng = np.random.default_rng([seed, STREAM])
    order = sorted(range(len(names)), key=lambda k: (sequences[k], names[k]))
    drives = [[k for k in order if sequences[k] == own] for own in sorted(set(sequences))]
    quota = [0] * len(drives)
    turn = rng.permutation(len(drives)).tolist()
    while sum(quota) < count:
        open_ = [k for k in turn if quota[k] < len(drives[k])]
        for k in open_[: count - sum(quota)]:
            quota[k] += 1
    chosen: list[int] = []
    for drive, own in zip(drives, quota, strict=True):
        # One image out of each of `count` equal stretches of time.
        places = (np.arange(own) + rng.random()) * len(drive) / max(own, 1)
        chosen += [drive[int(place)] for place in places]
    return np.sort(np.array(chosen, np.int64))


def _refuse_void(
    reward: LabelledImages, chosen: LabelledImages, few: int | float | None, target: Target
) -> None:
    """Raise UserError for a sequence whose few images show none of the nets' classes."""
    classes = len(class_table(target.table).classes)
    if np.all(reward.labels == IGNORE_LABEL):
        raise UserError(
            f"--few {few}: the {len(reward.labels)} images left for the reward show none of the "
            f"{classes} classes of {target.name}"
        )
    for sequence in sorted(set(chosen.sequences)):
        own = np.array(chosen.sequences) == sequence
        if np.all(chosen.labels[own] == IGNORE_LABEL):
            raise UserError(
                f"--few {few}: the {own.sum()} images chosen of sequence {sequence} show none of the "
                f"{classes} classes of {target.name}; leave them out of the data, or label them"
            )
