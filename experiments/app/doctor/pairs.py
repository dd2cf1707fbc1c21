"""Finds the images of a folder and their label files by names, as patterns for a target's file."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from common.command import PROGRAM
from common.errors import UserError, counted
from common.files import IMAGES
from common.labels.listing import HELD_OUT, image_matches, matches
from common.labels.target_file import FILE, TRAIN, Format
from seg.data.frames import unreadable_note
from seg.data.images import read_image
from seg.data.labels import FORMATS

MOST_ENDINGS = 4
"""The most kinds of names in one folder, such as a_image.png and a_label.png."""
FEW = 64
"""The most different values of a label file; photographs have more."""
SPLITS = (TRAIN, "training", *HELD_OUT)
CITYSCAPES = re.compile(r"_label(?:Ids|((?:cs)?TrainIds))\.")
"""Label files with the ids of Cityscapes, or with those of its 19 classes (the parenthesis)."""
_MAPS = re.compile(r"depth|dispar|normals?(?![a-z])|flow|instance|panoptic|thermal", re.IGNORECASE)
"""Names of images that hold a number or an object for each pixel."""
_PHOTOGRAPHS = re.compile(r"rgb|ima?ge?|photo|picture|camera|frame|colou?r", re.IGNORECASE)
"""Names of photographs."""


class Layout(NamedTuple):
    """The images and labels of a folder."""

    images: str  # the value of this field of a target's file, in YAML
    labels: str
    places: dict[Path, dict[str, str]]  # of each image at the patterns: the text at their places
    labelled: list[tuple[Path, Path | None]]  # label files; with the image where a file labels many
    unlabelled: list[Path]  # images without a label, in splits that have some
    has_splits: bool  # whether the patterns tell splits apart
    notes: list[str]


class _Pair(NamedTuple):
    """A folder of images and the folder of their labels, as patterns."""

    images: str
    labels: str
    number: int  # of images


class _Part(NamedTuple):
    """Files of one folder whose names have the same start and the same ending."""

    folder: str
    suffix: str
    start: str
    ending: str  # before the suffix
    cores: set[str]  # names between both

    def path(self, root: Path, core: str) -> Path:
        """The path of one of the files."""
        return root / self.folder / self.pattern.replace("{name}", core)

    @property
    def path_pattern(self) -> str:
        """The pattern of their paths."""
        return f"{self.folder}/{self.pattern}"

    @property
    def pattern(self) -> str:
        """The pattern of their names."""
        return f"{self.start}{{name}}{self.ending}{self.suffix}"


class _Sorted(NamedTuple):
    """The files of a folder by what they look like."""

    images: list[_Part]
    labels: list[_Part]
    errors: list[str]  # of files that cannot be read


def quoted(text: str) -> str:
    """A text of YAML in quotes."""
    return "'" + text.replace("'", "''") + "'"


def layout_of_pairs(root: Path, files: Sequence[Path]) -> Layout | None:
    """Find images with a label file each; None if there are none.

    Args:
        root: the folder.
        files: paths of its files below it.

    Raises:
        UserError: two sets of images have the same labels and are equally likely to be the photographs.
    """
    pairs = _pairs(_sorted_parts(root, files)) or _pairs(_sorted_parts(root, files, starts=True))
    if not pairs:
        return None
    best = _best(root, pairs)
    images = dict(image_matches(best.images, best.labels, root))
    labels = dict(matches(best.labels, root))
    notes = [
        f"{counted(pair.number, 'image')} at {pair.images}: left out; another file can describe them"
        for pair in pairs
        if pair != best and {path for path, _ in matches(pair.images, root)} - images.keys()
    ]
    return Layout(
        quoted(best.images),
        quoted(best.labels),
        images,
        [(path, None) for path in sorted(labels)],
        _unlabelled(images, labels.values()),
        "{split}" in best.images,
        notes,
    )


def no_pairs(root: Path, files: Sequence[Path], errors: Sequence[str]) -> UserError:
    """The error of a folder without labels: the first file that cannot be read, or labels like photographs.

    Args:
        root: the folder.
        files: paths of its files below it.
        errors: of files with the labels of many images.
    """
    parts = _sorted_parts(root, files, starts=True)
    for k, part in enumerate(parts.images):
        for other in parts.images[k + 1 :]:
            if _common(part, other):
                core = min(part.cores & other.cores)
                colours, path = min((_colours(p.path(root, core)), p.path(root, core))
                                    for p in (part, other))  # fmt: skip
                return UserError(
                    f"{path}: these look like labels, but have {colours} different colours, as after smooth "
                    "resizing or JPEG compression; save labels as PNG, and resize them to the nearest pixel"
                )
    kinds = Counter(path.suffix.lower() for path in files).most_common(4)
    counts = ", ".join(f"{count} {kind or 'without extension'}" for kind, count in kinds)
    reasons = [*errors, *parts.errors, unreadable_note(root)]
    if reasons[0]:
        return UserError(f"{root}: no labelled images ({counts}): {reasons[0]}")
    command = f"{shlex.join([PROGRAM, 'predict', 'renders19', str(root)])} --out labels"
    hint = f"; to label photographs: {command}" if parts.images and not parts.labels else ""
    return UserError(
        f"{root}: no labelled images ({counts or 'the folder is empty'}); expected image and label of "
        f"the same name, such as images/a.jpg and labels/a.png, or a {FILE} with the patterns of both{hint}"
    )


def looked_at(path: Path) -> tuple[Format, np.ndarray, tuple[str, ...]]:
    """The format of a label file by its content, with its values; polygons have names, too."""
    polygons: tuple[Format, ...] = ("labelme-json", "cityscapes-json")
    first, second = polygons if path.suffix == ".json" else ("ids", "colours")
    try:
        return first, *FORMATS[first](path)
    except UserError as error:
        try:
            return second, *FORMATS[second](path)
        except UserError as other:
            # A file of the second format that is wrong has its list.
            raise (
                other if path.suffix == ".json" and "shapes must be a list" in str(error) else error
            ) from None


def _unlabelled(
    images: Mapping[Path, dict[str, str]], labels: Collection[dict[str, str]]
) -> list[Path]:
    """Images without a label, in splits that have some."""
    labelled = {frozenset(places.items()) for places in labels}
    splits = {places.get("split") for places in labels}
    return [
        path
        for path, places in sorted(images.items())
        if places.get("split") in splits and frozenset(places.items()) not in labelled
    ]


def _sorted_parts(root: Path, files: Sequence[Path], starts: bool = False) -> _Sorted:
    """Sort files by folder, ending and the text around their names into images and labels."""
    buckets: dict[tuple[str, str], list[str]] = {}
    for path in files:
        if path.suffix.lower() in (*IMAGES, ".json"):
            buckets.setdefault((path.parent.as_posix(), path.suffix), []).append(path.stem)
    extended = {} if starts else _extended(buckets.values())
    parts = _Sorted([], [], [])
    for key, stems in buckets.items():
        for part in _parts(*key, stems, starts, extended):
            kind = _kind([part.path(root, core) for core in sorted(part.cores)[:3]], parts.errors)
            if kind:
                (parts.labels if kind == "labels" else parts.images).append(part)
    return parts


def _extended(buckets: Iterable[Sequence[str]]) -> dict[str, str]:
    """Names that others extend, and these others, as with a.jpg and a_mask.png, with what they extend.

    An ending counts where it ends one in `MOST_ENDINGS` names of a folder or more.
    """
    known = {stem for stems in buckets for stem in stems}
    extended: dict[str, str] = {}
    for stems in buckets:
        bases: dict[str, list[tuple[str, str]]] = {}
        for stem in stems:
            for cut in re.finditer(r"[_\-. ]+(?=.*[^\W\d_])", stem):
                if (base := stem[: cut.start()]) in known:
                    bases.setdefault(stem[cut.start() :], []).append((stem, base))
                    break
        for pairs in bases.values():
            if len(pairs) * MOST_ENDINGS >= len(stems):
                for stem, base in pairs:
                    extended |= {stem: base, base: base}
    return extended


def _parts(
    folder: str, suffix: str, stems: Sequence[str], starts: bool, extended: Mapping[str, str]
) -> list[_Part]:
    """Group the files of a folder by their endings, such as _label.

    These are what they add to another file's name; for names without one the text after the last digit, if
    there are few such; with ``starts`` they are grouped by the text before the first digit, too.
    """
    cores: dict[tuple[str, str], set[str]] = {}
    whole: dict[tuple[str, str], set[str]] = {}
    start = r"\D*" if starts else ""
    for stem in stems:
        if stem in extended:
            core = extended[stem]
            whole.setdefault(("", stem.removeprefix(core)), set()).add(core)
            continue
        # Cityscapes has _leftImg8bit.
        parts = re.fullmatch(rf"({start})(.*?)((?:8bit|\D)*)", stem, re.DOTALL)
        assert parts is not None
        cores.setdefault((parts[1], parts[3]), set()).add(parts[2])
    if len(cores) > MOST_ENDINGS or "" in [core for group in cores.values() for core in group]:
        cores = {("", ""): {stem for stem in stems if stem not in extended}}
    for around, group in cores.items():
        whole.setdefault(around, set()).update(group)
    return [_Part(folder, suffix, *around, group) for around, group in whole.items()]


def _kind(sample: Sequence[Path], errors: list[str]) -> str:
    """Whether files look like "labels" or like "images"; empty for neither, and errors then say why."""
    kinds = set()
    for path in sample:
        if path.suffix.lower() in (".jpg", ".jpeg"):
            kinds.add("images")
            continue
        try:
            _, codes, _ = looked_at(path)
        except UserError as error:
            errors.append(str(error))
            continue
        few = path.suffix == ".json" or len(np.unique(codes[::2, ::2])) <= FEW
        kinds.add("labels" if few else "images")
    return kinds.pop() if len(kinds) == 1 else ""


def _pairs(parts: _Sorted) -> list[_Pair]:
    """Patterns of images and labels of the same names, or of the same numbers after different starts."""
    counts: Counter[tuple[str, str]] = Counter()
    for image in parts.images:
        ranked = [
            (
                _common(image, label),
                -bool(_MAPS.search(label.path_pattern)),
                -distance(image.folder, label.folder),
                bool(CITYSCAPES.search(label.pattern)),
                -k,
            )
            for k, label in enumerate(parts.labels)
        ]
        if ranked and (best := max(ranked))[0]:
            counts[_template(image, parts.labels[-best[-1]])] += best[0]
    return _grouped(counts)


def _common(part: _Part, other: _Part) -> int:
    """The number of names that two parts share; 0 if that is less than half of the smaller one."""
    common = len(part.cores & other.cores)
    return common if 2 * common >= min(len(part.cores), len(other.cores)) else 0


def distance(folder: str, other: str) -> int:
    """The number of folders that two paths do not share."""
    return len(set(PurePosixPath(folder).parts) ^ set(PurePosixPath(other).parts))


def _template(image: _Part, label: _Part) -> tuple[str, str]:
    """Patterns, with {split} if both paths name a split."""
    parts, folder = PurePosixPath(image.folder).parts, label.folder
    for word in parts:
        # The labels' folder may be named after it, as trainannot is.
        others = PurePosixPath(folder).parts
        named = [part for part in others if part == word] or [p for p in others if word in p]
        if word.lower() in SPLITS and named:
            parts = tuple("{split}" if part == word else part for part in parts)
            folder = "/".join(p.replace(word, "{split}") if p in named else p for p in others)
            break
    return joined("/".join(parts) or ".", image.pattern), joined(folder, label.pattern)


def joined(folder: str, name: str) -> str:
    """The path of a name in a folder, which may be "."."""
    return name if folder == "." else f"{folder}/{name}"


def _grouped(counts: Counter[tuple[str, str]]) -> list[_Pair]:
    """Merge patterns that differ in a folder, the same for images and labels.

    The patterns get {group} in its place, and {folder} in that of another one.
    """
    for place in ("{group}", "{folder}"):
        merged: Counter[tuple[str, str]] = Counter()
        for (images, labels), count in counts.items():
            merged[_merged(images, labels, counts, place)] += count
        counts = merged
    return _of_any_suffix([_Pair(*both, count) for both, count in counts.items()])


def _of_any_suffix(pairs: Sequence[_Pair]) -> list[_Pair]:
    """Merge pairs whose images differ in their suffix alone, if no label is an image in the same folder."""
    alike: dict[tuple[str, str], list[_Pair]] = {}
    for pair in pairs:
        (images, labels), suffix = pair[:2], PurePosixPath(pair.images).suffix
        same_folder = images.rpartition("/")[0] == labels.rpartition("/")[0]
        if not same_folder or labels.endswith(".json"):
            images = images.removesuffix(suffix)
        alike.setdefault((images, labels), []).append(pair)
    return [
        group[0] if len(group) == 1 else _Pair(*both, sum(pair.number for pair in group))
        for both, group in alike.items()
    ]


def _merged(
    images: str, labels: str, pairs: Iterable[tuple[str, str]], place: str
) -> tuple[str, str]:
    """The patterns with a placeholder for the first folder in which others differ, if there is one."""
    parts, others = images.split("/"), {pair[0] for pair in pairs}
    for k, part in enumerate(parts[:-1]):
        if part.startswith("{") or part not in labels.split("/"):
            continue
        pattern = [*parts[:k], place, *parts[k + 1 :]]
        alike = [
            other for other in others
            if (words := other.split("/")) and len(words) == len(parts)
            and [*words[:k], place, *words[k + 1 :]] == pattern
        ]  # fmt: skip
        if len(alike) > 1:
            label_parts = [place if p == part else p for p in labels.split("/")]
            return "/".join(pattern), "/".join(label_parts)
    return images, labels


def _best(root: Path, pairs: Sequence[_Pair]) -> _Pair:
    """The pair of the photographs: not maps such as depth, then the most, in colour, and named so.

    Raises:
        UserError: another pair with the same labels is as good.
    """

    def rank(pair: _Pair) -> tuple[bool, int, bool, bool]:
        first = min(path for path, _ in matches(pair.images, root))
        try:
            image = read_image(first)
            colour = bool((image != image[..., :1]).any())
        except UserError:  # the survey reports it
            colour = False
        named = _PHOTOGRAPHS.search(pair.images) is not None
        return not _MAPS.search(pair.images), pair.number, colour, named

    if len(pairs) == 1:
        return pairs[0]
    ranks = [rank(pair) for pair in pairs]
    best = pairs[ranks.index(max(ranks))]
    for pair, pair_rank in zip(pairs, ranks, strict=True):
        if pair != best and pair_rank == max(ranks) and pair.labels == best.labels:
            raise UserError(
                f"{root}: images at {best.images} and at {pair.images} have the same labels, {best.labels}; "
                f"write a {FILE} with the pattern of the photographs"
            )
    return best


def _colours(path: Path) -> int:
    """The number of different colours of an image; 0 if it cannot be read."""
    try:
        return len(np.unique(FORMATS["colours"](path).codes))
    except UserError:
        return 0
