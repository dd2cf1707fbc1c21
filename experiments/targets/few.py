"""The labelled subset of a target: mixed with every training set, and left out of the search's validation."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from common.errors import UserError
from experiments.config import Config, FewConfig
from experiments.config.config import FitPreset
from experiments.targets.base import Sides, Target, keep_two_sizes
from seg.classes import IGNORE_LABEL, class_table
from seg.data import LabelledImages

STREAM = 5
"""Second word of the seed that chooses images; each stream has its own."""
CHOICE = 0
"""Seed that chooses a target's labelled subset, the same for every --seed."""
FEW = 20
"""With fewer labels than these, they fill a quarter of a batch with renders, otherwise half
(`docs/results.md`)."""


def share_of(labels: int, preset: FitPreset = "quick") -> float:
    """Return the share of labelled images in the first batch with renders, as in `fit`."""
    return 0.25 if labels < FEW or preset == "full" else 0.5


def with_few(target: Target, config: Config) -> Target:
    """Move ``--few`` of the target's labelled images from the validation side to every training set.

    Raises:
        UserError: there are fewer images, or a side would be empty.
    """
    few = config.few if isinstance(config, FewConfig) else None
    if few is None:
        return target
    names, sequences = target.reward_names, target.reward_sequences
    subset = spread(names, sequences, count_of(few, len(names), target.name), CHOICE)
    others = np.setdiff1d(np.arange(len(names)), subset)

    @keep_two_sizes
    def at(height: int, width: int) -> Sides:
        sides = target.at(height, width)
        labelled = sides["reward"]
        parts = {"reward": labelled.take(others), "few": labelled.take(subset)}
        _refuse_ignored(parts["reward"], parts["few"], few, target)
        return {**sides, **parts, "labelled": labelled}  # type: ignore[dict-item]

    counts = Counter(sequences[k] for k in subset)
    listed = ", ".join(f"{sequence} {count}" for sequence, count in sorted(counts.items()))
    shown = listed if len(counts) <= 8 else f"{len(counts)} sequences"
    return target._replace(
        title=f"{target.title}; {len(subset)} of the {len(names)} ({shown}) are mixed with every training "
        "set instead",
        reward_names=tuple(names[k] for k in others),
        reward_sequences=tuple(sequences[k] for k in others),
        few_names=tuple(names[k] for k in subset),
        at=at,
    )


def count_of(few: int | float, images: int, name: str) -> int:
    """Return the number of images of ``--few``, which is a number or a share.

    Raises:
        UserError: it is 0, or not less than all images.
    """
    count = few if isinstance(few, int) else math.floor(few * images + 0.5)
    labelled = f"{images} labelled images of {name}"
    if count > images:
        raise UserError(
            f"--few {few} is more than the {labelled}; {images - 1} leave one for the search"
        )
    if count == images:
        raise UserError(
            f"--few {few} selects all {labelled}, which leaves none for the search; "
            f"{images - 1} leave one"
        )
    if count < 1:
        raise UserError(
            f"--few {few} selects none of the {labelled}; {1 / images:.2g} or more selects one"
        )
    return count


def spread(names: Sequence[str], sequences: Sequence[str], count: int, seed: int) -> np.ndarray:
    """Choose images from each sequence in turn, spread over time; returns ascending indices.

    Args:
        names: names of all images, which sort by time within a sequence.
        sequences: the sequence of each image.
        count: number of images to choose, at most all.
        seed: seed of the choice.
    """
    rng = np.random.default_rng([seed, STREAM])
    order = sorted(range(len(names)), key=lambda k: (sequences[k], names[k]))
    by_sequence = [[k for k in order if sequences[k] == name] for name in sorted(set(sequences))]
    quotas = [0] * len(by_sequence)
    turns = rng.permutation(len(by_sequence)).tolist()
    while sum(quotas) < count:
        unfilled = [k for k in turns if quotas[k] < len(by_sequence[k])]
        for k in unfilled[: count - sum(quotas)]:
            quotas[k] += 1
    indices: list[int] = []
    for images, quota in zip(by_sequence, quotas, strict=True):
        # One image from each of `quota` equal stretches of time.
        places = (np.arange(quota) + rng.random()) * len(images) / max(quota, 1)
        indices += [images[int(place)] for place in places]
    return np.sort(np.array(indices, np.int64))


def _refuse_ignored(
    reward: LabelledImages, subset: LabelledImages, few: int | float | None, target: Target
) -> None:
    """Raise UserError for a sequence whose images in the subset show none of the networks' classes."""
    classes = len(class_table(target.table).classes)
    if np.all(reward.labels == IGNORE_LABEL):
        raise UserError(
            f"--few {few}: the {len(reward.labels)} images left for the search show none of the "
            f"{classes} classes of {target.name}"
        )
    for sequence in sorted(set(subset.sequences)):
        in_sequence = np.array(subset.sequences) == sequence
        if np.all(subset.labels[in_sequence] == IGNORE_LABEL):
            raise UserError(
                f"--few {few}: the {in_sequence.sum()} images chosen of sequence {sequence} show none of "
                f"the {classes} classes of {target.name}; leave them out of the data, or label them"
            )
