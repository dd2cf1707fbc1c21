"""A target of one's own: a folder of labelled images that a target's file describes, and its parts.

Figures come from images that a net was not trained on: those of a group that is held out, of a published
split, or else of each of k folds over groups, in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.config import Preset
from experiments.target.base import SIZES, Sides, Target, two_sides
from experiments.target.few import CHOICE, spread
from experiments.target.real import REPORTED
from seg.classes import table_text
from seg.data import Entry, LabelledImages, load, refuse_shared
from shell.errors import UserError
from shell.listing import list_all, shared_groups
from shell.target_file import Fit, TargetFile

FOLDS = 5
"""Parts into which images without a split are cut, if there are so many groups."""
AREAS: dict[Preset, int] = {"smoke": 64 * 48, "quick": 240 * 176}
"""Pixels of the images that nets see, about: what two cores train on within a minute, or ten."""
UNIT, SMALLEST = 8, 32
"""Width and height are multiples of the one and no less than the other, the coarsest stride of a trunk."""


Read = Callable[[int, int], LabelledImages]
"""(height, width) -> all images."""


class Parts(NamedTuple):
    """The images of a folder, by what may be done with them."""

    target: TargetFile
    entries: tuple[Entry, ...]  # whose labels may be used
    folds: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    """Of each fold the images that nets are trained on, and those that they are tested on, by index into the
    entries and the held-out images behind them."""
    held_out: tuple[Entry, ...]  # of a split or a group that is only reported on
    all_labels: bool  # whether the net that is left may see the held-out images, too
    where: str  # figures are from, in words
    notes: tuple[str, ...]  # warnings that belong into the report

    @property
    def every(self) -> tuple[Entry, ...]:
        """All images."""
        return (*self.entries, *self.held_out)


def parts_of(
    target: TargetFile, data: Path, holdout: str | None = None, few: int | None = None
) -> Parts:
    """Sort the labelled images of a folder.

    Args:
        target: what its files are.
        data: the folder.
        holdout: the group that figures come from; by default the split that is reported on, ``test`` or
            ``val``, where there is one, else folds over groups.
        few: use the labels of so many images only, spread over groups and time.

    Raises:
        UserError: no such group, fewer images than are asked for, or too few for two parts.
    """
    splits = list_all(target, data)
    notes = [note] if (note := shared_groups(splits)) else []
    reported = REPORTED.get(target.name, "test" if "test" in splits else "val")
    held_out = splits.pop(reported, ()) if len(splits) > 1 else ()
    entries = tuple(entry for own in splits.values() for entry in own)
    where = f"split {reported}"
    if holdout is not None:
        groups = sorted({entry.sequence for entry in entries})
        held_out = tuple(entry for entry in entries if entry.sequence == holdout)
        entries = tuple(entry for entry in entries if entry.sequence != holdout)
        where = f"group {holdout}"
        if not entries or not held_out:
            shown = ", ".join(groups[:12]) + (", ..." if len(groups) > 12 else "")
            raise UserError(
                f"--holdout {holdout} must leave images on both sides; the groups are {shown}"
            )
    if few is not None:
        if not 1 <= few <= len(entries):
            raise UserError(
                f"--few must be 1 to {len(entries)}, as many labelled images as there are, not {few}"
            )
        names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
        entries = tuple(entries[k] for k in spread(names, sequences, few, CHOICE))
    count = len(entries)
    if held_out:
        behind = tuple(range(count, count + len(held_out)))
        folds = [(tuple(range(count)), behind)]
    else:
        tests, told = cut([entry.sequence for entry in entries], data)
        folds = [(tuple(k for k in range(count) if k not in set(own)), own) for own in tests]
        where = f"{len(folds)} folds, each tested on in turn"
        notes += [told] if told else []
    whole = holdout is not None and few is None
    return Parts(target, entries, tuple(folds), held_out, whole, where, tuple(notes))


def cut(groups: Sequence[str], data: Path) -> tuple[list[tuple[int, ...]], str]:
    """Cut images into folds, so that no group is in two of them, and the folds are about as large.

    Images of one group only are cut into stretches of time.

    Args:
        groups: of each image, in the order of group and name.
        data: their folder, for the error.

    Returns:
        The images of each fold, by index; and a warning, if there is one.

    Raises:
        UserError: a single image.
    """
    own: dict[str, list[int]] = {}
    for index, group in enumerate(groups):
        own.setdefault(group, []).append(index)
    if len(groups) < 2:
        raise UserError(
            f"{data}: {len(groups)} labelled image, and figures need another to be tested on; label one more"
        )
    if len(own) == 1:
        stretches = np.array_split(np.arange(len(groups)), min(FOLDS, len(groups)))
        return [tuple(part.tolist()) for part in stretches], (
            f"all {len(groups)} images are of one group, so folds are stretches of time: images at their "
            "ends are alike, and figures are too high for other streets"
        )
    folds: list[list[int]] = [[] for _ in range(min(FOLDS, len(own)))]
    for indices in sorted(own.values(), key=len, reverse=True):  # the largest first
        min(folds, key=len).extend(indices)
    return [tuple(sorted(fold)) for fold in folds], ""


def suitable_size(width: int, height: int, preset: Preset = "quick") -> tuple[int, int]:
    """Width and height for nets: an image's aspect, and no more pixels than it has or the preset affords."""
    scale = min(math.sqrt(AREAS[preset] / (width * height)), 1.0)
    wide, high = (max(round(scale * side / UNIT) * UNIT, SMALLEST) for side in (width, height))
    return wide, high


def reader(parts: Parts, fit: Fit | None = None) -> Read:
    """Reads all images, once for each size."""

    @lru_cache(maxsize=SIZES)
    def whole(height: int, width: int) -> LabelledImages:
        images = load(parts.every, parts.target, (height, width), fit)
        count = len(parts.entries)
        if parts.held_out:
            ours, theirs = images.between(0, count), images.between(count, len(images.images))
            refuse_shared({"the labelled images": ours, "the held-out images": theirs})
        return images

    return whole


def fold_targets(parts: Parts, data: Path, whole: Read) -> list[Target]:
    """A target for each fold.

    Args:
        parts: of the images.
        data: their folder, for errors.
        whole: reads all of them.
    """

    def target_of(train: tuple[int, ...], test: tuple[int, ...], number: int) -> Target:
        @lru_cache(maxsize=SIZES)
        def at(height: int, width: int) -> Sides:
            images = whole(height, width)
            where = str(data) if len(parts.folds) == 1 else f"{data}, fold {number}"
            return two_sides(images.take(train), images.take(test), where, True)

        return Target(
            name=parts.target.name,
            real=True,
            table=table_text(parts.target),
            title=f"{parts.target.name}, {len(parts.entries)} labelled images, reported on {parts.where}",
            reward_names=tuple(parts.every[k].name for k in train),
            reward_sequences=tuple(parts.every[k].sequence for k in train),
            test_names=tuple(parts.every[k].name for k in test),
            at=at,
        )

    return [target_of(*fold, number) for number, fold in enumerate(parts.folds, 1)]


def all_labelled(parts: Parts, of: Target, data: Path, whole: Read) -> Target:
    """The target whose labelled images are all that the net sees that is left.

    A group that was held out is among them, unless only a few labels are to be used; a split is not.
    """
    own = parts.every if parts.all_labels else parts.entries

    @lru_cache(maxsize=SIZES)
    def at(height: int, width: int) -> Sides:
        images = whole(height, width).between(0, len(own))  # those that were held out are behind
        return two_sides(images, images, str(data), True)

    names, sequences = zip(*((e.name, e.sequence) for e in own), strict=True)
    return of._replace(reward_names=names, reward_sequences=sequences, at=at)
