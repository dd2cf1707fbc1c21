"""A user's own target: a folder of labelled images, described by a target file, and its parts.

Networks are tested on images on which they were not trained: those of a held-out group, of a published split,
or otherwise of each of k folds over groups in turn.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.errors import UserError
from common.files import file_digest
from common.labels.listing import list_all, shared_groups
from common.labels.target_file import Fit, TargetFile
from experiments.targets.base import Sides, Target, keep_two_sizes, two_sides
from experiments.targets.few import CHOICE, spread
from experiments.targets.real import reported_split
from seg.classes import table_text
from seg.data import Entry, LabelledImages, load, refuse_shared
from seg.data.images import read_header

FOLDS = 5
"""Number of folds of images without a split, if there are so many groups."""


def common_size(entries: Sequence[Entry]) -> tuple[int, int]:
    """Return the most frequent width and height (upright); of equally frequent ones the first.

    Raises:
        DataError: the file of an image cannot be read, or has too many pixels.
    """
    sizes = Counter(read_header(entry.image_path).size for entry in entries)
    return sizes.most_common(1)[0][0]


Read = Callable[[int, int], LabelledImages]
"""(height, width) -> all images."""


class Parts(NamedTuple):
    """The images of a folder, by their use."""

    target: TargetFile
    entries: tuple[Entry, ...]  # their labels may be used
    folds: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    """Training and test images of each fold, as indices of the entries and the held-out images after them."""
    held_out: tuple[Entry, ...]  # a split or group to test on only
    all_labels: bool  # whether the saved network may also train on the held-out images
    where: str  # the test images in words
    notes: tuple[str, ...]  # warnings for the report

    @property
    def every(self) -> tuple[Entry, ...]:
        """All images."""
        return (*self.entries, *self.held_out)

    @property
    def model_entries(self) -> tuple[Entry, ...]:
        """The training images of the saved network.

        They include a held-out group, unless only a few labels may be used, but not a split.
        """
        return self.every if self.all_labels else self.entries


def parts_of(
    target: TargetFile, data: Path, holdout: str | None = None, few: int | None = None
) -> Parts:
    """Divide the labelled images of a folder into parts.

    Args:
        target: describes its files.
        data: the folder.
        holdout: the group to test on; by default the split ``test`` or ``val`` if there is one, otherwise
            folds over groups.
        few: number of images whose labels are used, spread over groups and time.

    Raises:
        UserError: there is no such group, there are fewer images, or too few to divide.
    """
    splits = list_all(target, data)
    notes = [note] if (note := shared_groups(splits)) else []
    reported = reported_split(target.name, splits)
    held_out = splits.pop(reported, ()) if len(splits) > 1 else ()
    entries = tuple(entry for split in splits.values() for entry in split)
    where = f"split {reported}"
    if holdout is not None:
        groups = sorted({entry.sequence for entry in entries})
        held_out = tuple(entry for entry in entries if entry.sequence == holdout)
        entries = tuple(entry for entry in entries if entry.sequence != holdout)
        where = f"group {holdout}"
        if not entries or not held_out:
            shown = ", ".join(groups[:12]) + (", ..." if len(groups) > 12 else "")
            reason = "is the only group" if held_out else "is not a group of the training images"
            raise UserError(f"--holdout {holdout} {reason}; the groups are {shown}")
    if few is not None:
        if not 1 <= few <= len(entries):
            raise UserError(
                f"--few must be 1 to {len(entries)}, the number of labelled images, not {few}"
            )
        names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
        entries = tuple(entries[k] for k in spread(names, sequences, few, CHOICE))
    count = len(entries)
    if held_out:
        test = tuple(range(count, count + len(held_out)))
        folds = [(tuple(range(count)), test)]
    else:
        first = first_copies([entry.image_path for entry in entries])
        copies = [k for k, other in enumerate(first) if k != other]
        tests, warning = cut([entry.sequence for entry in entries], data, first)
        folds = [(tuple(k for k in range(count) if k not in set(test)), test) for test in tests]
        where = f"{len(folds)} folds in turn"
        notes += [warning] if warning else []
        if copies:
            copy, original = entries[copies[0]].name, entries[first[copies[0]]].name
            notes.append(
                f"{len(copies)} images are copies of others, such as {copy} of {original}: copies stay in "
                "one fold"
            )
    all_labels = holdout is not None and few is None
    return Parts(target, entries, tuple(folds), held_out, all_labels, where, tuple(notes))


def first_copies(paths: Sequence[Path]) -> list[int]:
    """Return the index of the first file with the same bytes as each file; only files of one size are read.

    Raises:
        OSError: a file cannot be read.
    """
    sizes = [path.stat().st_size for path in paths]
    count = Counter(sizes)
    first: dict[tuple[int, str], int] = {}
    return [
        k if count[size] == 1 else first.setdefault((size, file_digest(path)), k)
        for k, (path, size) in enumerate(zip(paths, sizes, strict=True))
    ]


def _joined(groups: Sequence[str], first: Sequence[int]) -> list[str]:
    """Return the group of each image, with groups that hold copies of one image joined."""
    names = {group: group for group in groups}
    for k, original in enumerate(first):
        merged, kept = names[groups[k]], names[groups[original]]
        if merged != kept:
            names = {group: kept if name == merged else name for group, name in names.items()}
    return [names[group] for group in groups]


def cut(
    groups: Sequence[str], data: Path, first: Sequence[int] | None = None
) -> tuple[list[tuple[int, ...]], str]:
    """Divide images into folds of about equal size; each group, and all copies of an image, stay in one.

    Images of a single group are divided into stretches of time.

    Args:
        groups: the group of each image, in the order of group and name.
        data: their folder, for the error.
        first: the first copy of each image, from `first_copies`; by default all images differ.

    Returns:
        The indices of each fold's images; and a warning, if there is one.

    Raises:
        UserError: there is only one image, or all are copies of one.
    """
    first = range(len(groups)) if first is None else first
    by_group: dict[str, list[int]] = {}
    for index, group in enumerate(_joined(groups, first)):
        by_group.setdefault(group, []).append(index)
    different = sorted({*first})
    if len(different) < 2:
        copies = (
            ""
            if len(groups) == 1
            else f" and {len(groups) - 1} copies of it"
            if len(groups) > 2
            else " and a copy of it"
        )
        raise UserError(
            f"{data}: {len(different)} labelled image{copies}; a network needs another to be tested on: "
            "label one more, or use more than --few 1"
        )
    if len(by_group) == 1:
        stretches = np.array_split(different, min(FOLDS, len(different)))
        parts = [{*part.tolist()} for part in stretches]
        linked = " or linked by copies" if len({*groups}) > 1 else ""
        return [tuple(k for k, other in enumerate(first) if other in part) for part in parts], (
            f"all {len(groups)} images are of one group{linked}, so folds are stretches of time: images at "
            "their ends look alike, and the results are too good for other streets"
        )
    folds: list[list[int]] = [[] for _ in range(min(FOLDS, len(by_group)))]
    for indices in sorted(by_group.values(), key=len, reverse=True):  # the largest first
        min(folds, key=len).extend(indices)
    return [tuple(sorted(fold)) for fold in folds], ""


def reader(parts: Parts, fit: Fit | None = None) -> Read:
    """Make a function that reads all images, once for each size."""

    @keep_two_sizes
    def read(height: int, width: int) -> LabelledImages:
        images = load(parts.every, parts.target, (height, width), fit)
        count = len(parts.entries)
        if parts.held_out:
            labelled, held_out = images.between(0, count), images.between(count, len(images.images))
            refuse_shared({"the labelled images": labelled, "the held-out images": held_out})
        return images

    return read


def fold_targets(parts: Parts, data: Path, read: Read) -> list[Target]:
    """Make a target for each fold.

    Args:
        parts: parts of the images.
        data: their folder, for errors.
        read: reads all of them.
    """

    def target_of(train: tuple[int, ...], test: tuple[int, ...], number: int) -> Target:
        @keep_two_sizes
        def at(height: int, width: int) -> Sides:
            images = read(height, width)
            origin = str(data) if len(parts.folds) == 1 else f"{data}, fold {number}"
            return two_sides(images.take(train), images.take(test), origin)

        return Target(
            name=parts.target.name,
            real=True,
            table=table_text(parts.target),
            title=f"{parts.target.name}, {len(parts.entries)} labelled images, tested on {parts.where}",
            reward_names=tuple(parts.every[k].name for k in train),
            reward_sequences=tuple(parts.every[k].sequence for k in train),
            test_names=tuple(parts.every[k].name for k in test),
            at=at,
        )

    return [target_of(*fold, number) for number, fold in enumerate(parts.folds, 1)]


def all_labelled(parts: Parts, fold: Target, data: Path, read: Read) -> Target:
    """Make the target whose labelled images are all training images of the saved network."""
    entries = parts.model_entries

    @keep_two_sizes
    def at(height: int, width: int) -> Sides:
        images = read(height, width).between(0, len(entries))  # held-out images come after these
        return two_sides(images, images, str(data))

    names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
    return fold._replace(reward_names=names, reward_sequences=sequences, at=at)
