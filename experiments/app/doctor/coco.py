"""Finds the images of COCO's annotations in a folder, as patterns for a target's file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from common.errors import UserError, counted
from common.files import IMAGES
from common.labels.coco import CocoFile, has_annotations, read_coco_file
from common.labels.listing import matches
from experiments.app.doctor.pairs import SPLITS, Layout, distance, joined, quoted

MOST_FILES = 20
"""The most JSON files of a folder that may hold the labels of many images."""
_SPLIT = re.compile(rf"(?<![a-z])({'|'.join(sorted(SPLITS, key=len, reverse=True))})(?![a-z])")


class _Part(NamedTuple):
    """Annotations with their images."""

    file: Path  # below the root
    pattern: str  # of the images
    images: dict[Path, dict[str, str]]  # at the pattern, with the text at its places
    labelled: set[Path]


def layout_of_coco(root: Path, files: Sequence[Path]) -> tuple[Layout | None, list[str]]:
    """Find annotations of COCO and their images.

    Args:
        root: the folder.
        files: paths of its files below it.

    Returns:
        The layout, or None without such annotations; and the errors of annotations that are wrong.
    """
    annotations, errors = _annotations(root, files)
    images = [path for path in files if path.suffix.lower() in IMAGES]
    parts: list[_Part] = []
    notes: list[str] = []
    for file, content in annotations:
        labelled = {root / path for path in _images_of(file, content, root, images)}
        if not labelled:
            example = f", such as {content.images[0].file_name}" if content.images else ""
            errors.append(f"{root / file}: none of its images{example}, is in {root}")
            continue
        same = [part.file for part in parts if part.labelled & labelled]
        if same:
            notes.append(f"{file} is left out, since {same[0]} labels the same images")
            continue
        if missing := len(content.images) - len(labelled):
            notes.append(f"{counted(missing, 'image')} of {file} not in the folder")
        pattern = _pattern([path.relative_to(root) for path in sorted(labelled)])
        parts.append(_Part(file, pattern, dict(matches(pattern, root)), labelled))
    if not parts:
        return None, errors
    places = {path: words for part in parts for path, words in part.images.items()}
    layout = Layout(
        _field(parts, [part.pattern for part in parts]),
        _field(parts, [part.file.as_posix() for part in parts]),
        places,
        [(root / part.file, path) for part in parts for path in sorted(part.labelled & {*places})],
        sorted(path for part in parts for path in {*part.images} - part.labelled),
        len(parts) > 1,
        notes,
    )
    return layout, errors


def _annotations(
    root: Path, files: Sequence[Path]
) -> tuple[list[tuple[Path, CocoFile]], list[str]]:
    """Files of COCO, those called instances first, and the errors of those that are wrong."""
    candidates = [path for path in files if path.suffix.lower() == ".json"]
    in_folder = Counter(path.parent for path in candidates)
    annotations, errors = [], []
    for path in sorted(candidates, key=lambda path: ("instances" not in path.name, path)):
        if in_folder[path.parent] <= MOST_FILES and has_annotations(root / path):
            try:
                annotations.append((path, read_coco_file(root / path)))
            except UserError as error:
                errors.append(str(error))
    return annotations, errors


def _images_of(file: Path, content: CocoFile, root: Path, images: Sequence[Path]) -> list[Path]:
    """The images of a file; where names are those of images in several folders, of the likeliest one."""
    records = {path: image.id for path in images if (image := content.image_of(root / path))}
    if len({*records.values()}) == len(records):
        return [*records]
    splits = {*_SPLIT.findall(file.as_posix().lower())}
    sizes = Counter(path.parent for path in records)

    def likelihood(folder: Path) -> tuple[bool, int, int]:
        same_split = bool(splits & {*_SPLIT.findall(folder.as_posix().lower())})
        return same_split, -distance(folder.as_posix(), file.parent.as_posix()), sizes[folder]

    best = max(sorted(sizes), key=likelihood)
    return [path for path in records if path.parent == best]


def _pattern(images: Sequence[Path]) -> str:
    """The pattern of images: of their folder, of the folders beside each other, or of that with the most."""
    folders = Counter(path.parent for path in images)
    folder, _ = folders.most_common(1)[0]
    where = folder.as_posix()
    if len(folders) > 1 and len({path.parent for path in folders}) == 1:
        where = joined(folder.parent.as_posix(), "{group}")
    suffixes = {path.suffix for path in images if "{" in where or path.parent == folder}
    return joined(where, "{name}" + (suffixes.pop() if len(suffixes) == 1 else ""))


def _field(parts: Sequence[_Part], values: Sequence[str]) -> str:
    """A value of a target's file: one for all images, or one for each split."""
    if len(parts) == 1:
        return quoted(values[0])
    words = [_SPLIT.findall(f"{part.pattern} {part.file.as_posix()}".lower()) for part in parts]
    names = [
        splits[-1] if splits else part.file.stem for splits, part in zip(words, parts, strict=True)
    ]
    if len({*names}) < len(names):
        names = [part.file.with_suffix("").as_posix().replace("/", "_") for part in parts]
    rows = (f"{quoted(name)}: {quoted(value)}" for name, value in zip(names, values, strict=True))
    return f"{{{', '.join(rows)}}}"
