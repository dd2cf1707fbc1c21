"""Surveys a folder by its target's file: counts, sizes, classes, groups, and faults."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw

from common.errors import UserError
from common.labels import classes as engine
from common.labels.listing import Entry, list_split, shared_groups, split_names
from common.labels.target_file import TRAIN, TargetFile
from experiments.targets.real import HELD_OUT
from experiments.targets.sizes import suitable_size
from seg.classes import IGNORE_LABEL
from seg.data import LabelReader, load
from seg.data.images import ORIENTATION, check_end, decode, is_deep, read_file, upright

READ = 100
"""The most label files that are read whole."""
HEAD = 65536
"""Number of first bytes by which copies of a file are found, beside its size."""
LOADED = 60
"""The most images whose labels are read at the size for nets."""
SHOWN = 4
"""Number of images that are shown with their labels."""
ALIKE = 0.03
"""Images whose widths over heights differ by this share have one shape."""


class Fault(NamedTuple):
    """A fault, and how to mend it."""

    what: str
    mend: str


class ClassShare(NamedTuple):
    """A class in the labels read."""

    name: str
    share: float  # of the pixels that have a label
    images: float  # share of the images with the class
    row: float  # its mean row, 0 at the top and 1 at the bottom; NaN if it is absent
    renders: tuple[str, ...]
    colour: tuple[int, int, int]


class Survey(NamedTuple):
    """The findings on a folder."""

    counts: dict[str, int]  # images of each split
    groups: dict[str, int]  # of each split
    sizes: list[
        tuple[tuple[int, int], int]
    ]  # (width, height) and their count, the most frequent first
    classes: list[ClassShare]
    void: float  # share of the pixels
    read: int  # number of label files read
    photographs: tuple[int, int]  # (width, height) of most images
    size: tuple[int, int]  # of pictures and of compared outlines
    labelled: list[Entry]  # some for training, or of all splits if none is for testing
    shown: list[Entry]
    faults: list[Fault]
    usable: bool


def survey(target: TargetFile, root: Path) -> Survey:
    """Survey a folder by its target's file; errors become faults."""
    faults: list[Fault] = []
    splits: dict[str, tuple[Entry, ...]] = {}
    usable = True
    for split in split_names(target, root) or (TRAIN,):
        try:
            splits[split] = list_split(target, root, split)
        except UserError as error:
            usable = False
            mend = "put the file there, change the patterns and lists, or write 'unlabelled: skip'"
            faults.append(Fault(str(error), mend))
    entries = [entry for own in splits.values() for entry in own]
    sizes = _sizes(entries, faults)
    classes, void, read, right = _classes(target, entries, faults)
    usable = usable and right and bool(entries)
    _splits(splits, faults)
    usable = _copies(splits, faults) and usable
    _engine(target, faults)
    shapes = {round(np.log(w / h) / ALIKE) for (w, h), _ in sizes}
    if len(shapes) > 1:
        other = "cut" if target.fit == "pad" else "pad"
        done = {"pad": "get void beside them", "cut": "are cut around their centre"}
        faults.append(
            Fault(
                f"images have {len(shapes)} shapes; those of another than the net's {done[target.fit]}",
                f"write 'fit: {other}' in the file if they should {done[other].replace('are', 'be')}",
            )
        )
    photographs = sizes[0][0] if sizes else (480, 360)
    return Survey(
        {split: len(own) for split, own in splits.items()},
        {split: len({e.sequence for e in own}) for split, own in splits.items()},
        sizes,
        classes,
        void,
        read,
        photographs,
        suitable_size(*photographs),
        _spread(
            [e for split, some in splits.items() if split not in HELD_OUT for e in some], LOADED
        )
        or _spread(entries, LOADED),
        _spread(entries, SHOWN),
        merged(faults),
        usable,
    )


def _spread(entries: Sequence[Entry], count: int) -> list[Entry]:
    """Choose a number of entries, spread over all."""
    places = np.linspace(0, len(entries) - 1, min(count, len(entries))).round().astype(int)
    return [entries[k] for k in places]


def _sizes(entries: Sequence[Entry], faults: list[Fault]) -> list[tuple[tuple[int, int], int]]:
    """Count the sizes of all images, and find those that cannot be read, are dark, or are turned."""
    sizes: Counter[tuple[int, int]] = Counter()
    dark, turned = [], []
    for entry in entries:
        path = entry.image_path
        try:
            check_end(path)
            with Image.open(path) as picture:
                size, stored = upright(picture), picture.size
                orientation = picture.getexif().get(ORIENTATION, 1)
            sizes[size] += 1
            if is_deep(path):
                largest = int(decode(path, read_file(path), cv2.IMREAD_UNCHANGED).max())
                if 0 < largest < 2**15:
                    dark.append((path, largest))
            if orientation != 1 and size == stored:
                turned.append(path)
        except Exception as error:  # Pillow has many errors
            why = (
                str(error) if str(path) in str(error) else f"{path}: not a readable image ({error})"
            )
            faults.append(Fault(why, "put an intact file there"))
    if dark:
        path, largest = dark[0]
        faults.append(
            Fault(
                f"{len(dark)} images of 16 bits use a part of them, such as {path}, whose largest value is "
                f"{largest}: networks see them dark",
                "stretch the values to 0..65535, or save 8 bits",
            )
        )
    if turned:
        faults.append(
            Fault(
                f"{len(turned)} images, such as {turned[0]}, are turned by their EXIF orientation, and their "
                "size does not show whether their labels are",
                "look at them below; turn the labels, or remove that tag",
            )
        )
    return sizes.most_common()


def _classes(
    target: TargetFile, entries: Sequence[Entry], faults: list[Fault]
) -> tuple[list[ClassShare], float, int, bool]:
    """The classes' shares in some labels, the share of void, the number of files, and if all were right."""
    reader, number = LabelReader(target), len(target.classes)
    pixels, containing = np.zeros(256, np.int64), np.zeros(number)
    rows = np.zeros(number)
    unknown: list[tuple[Path, Counter[str]]] = []
    sample, read, right = _spread(entries, READ), 0, True
    for entry in sample:
        try:
            label, wrong = reader.read(entry.label_path, entry.image_path)
            with Image.open(entry.image_path) as picture:
                size, lying = upright(picture), picture.size
        except (UserError, OSError) as error:
            faults.append(Fault(str(error), "put an intact file there"))
            right = False
            continue
        if size != label.shape[::-1]:
            mend = "labels must have their image's size; resize them by nearest pixel"
            if lying == label.shape[::-1]:
                mend = "the image's EXIF orientation turns it; turn the labels, or remove that tag"
            faults.append(
                Fault(
                    f"{entry.label_path}: {label.shape[1]}x{label.shape[0]} pixels, but its image has "
                    f"{size[0]}x{size[1]}",
                    mend,
                )
            )
            right = False
        if wrong:
            unknown.append((entry.label_path, wrong))
        height = len(label)
        places = np.arange(height)[:, None] * 256 + label
        by_row = np.bincount(places.ravel(), minlength=256 * height).reshape(height, 256)
        counts = by_row.sum(axis=0)
        rows += ((np.arange(height) + 0.5) / height) @ by_row[:, :number]
        pixels += counts
        containing += counts[:number] > 0
        read += 1
    if unknown:
        mend = f"name it in classes or void of {target.source}"
        faults.append(Fault(str(reader.error(unknown)), mend))
        right = False
    labelled = max(int(pixels[:number].sum()), 1)
    palette = target.palette
    found = [
        ClassShare(
            name, pixels[k] / labelled, containing[k] / max(read, 1),
            rows[k] / pixels[k] if pixels[k] else np.nan, own.renders, palette[k],
        )
        for k, (name, own) in enumerate(target.classes.items())
    ]  # fmt: skip
    absent = [own.name for own in found if read and not own.share]
    if absent:
        faults.append(
            Fault(
                f"{', '.join(absent)}: in none of {read} label files",
                "this is right if it is rare; otherwise check its ids",
            )
        )
    return found, pixels[IGNORE_LABEL] / max(int(pixels.sum()), 1), read, right


def _splits(splits: Mapping[str, Sequence[Entry]], faults: list[Fault]) -> None:
    note = shared_groups(splits)
    if note:
        faults.append(Fault(note, "splits by group, such as 'splits: {test: [GROUP]}', share none"))
    groups = Counter(entry.sequence for own in splits.values() for entry in own)
    if len(groups) == 1:
        faults.append(
            Fault(
                "all images are of one group, so no figure holds for a new place",
                "'group' in the file tells drives apart by their names; label a few images of another drive",
            )
        )
    if len(groups) > 1 and len(groups) == sum(groups.values()):
        faults.append(
            Fault(
                "each image is a group of its own: frames of one drive may be on both sides of a split",
                "'group' in the file, or {group} in its patterns, says which belong together",
            )
        )


def _copies(splits: Mapping[str, Sequence[Entry]], faults: list[Fault]) -> bool:
    """Find images that are in two splits, or twice in one, by size and first bytes.

    Returns:
        Whether no file is itself in two splits.
    """
    seen: dict[tuple[int, bytes], tuple[str, Path]] = {}
    copies: list[str] = []
    for split, own in splits.items():
        for entry in own:
            with entry.image_path.open("rb") as file:
                key = entry.image_path.stat().st_size, hashlib.sha256(file.read(HEAD)).digest()
            first, path = seen.setdefault(key, (split, entry.image_path))
            if (first, path) != (split, entry.image_path):
                copies.append(f"{entry.image_path} ({split}) is {path} ({first})")
    if copies:
        faults.append(
            Fault(
                f"{len(copies)} images are copies, such as {copies[0]}",
                "leave each once, in one split",
            )
        )
    paths = [entry.image_path for own in splits.values() for entry in own]
    return len({*paths}) == len(paths)


def _engine(target: TargetFile, faults: list[Fault]) -> None:
    rendered = zip(target.classes, target.rendered, strict=True)
    alone = [name for name, has_renders in rendered if not has_renders]
    if alone:
        faults.append(
            Fault(
                f"{', '.join(alone)}: without 'renders', so learnt from labels alone",
                f"'renders' names what the engine has: {', '.join(engine.NAMES)}",
            )
        )
    lost = [
        name for name, own in zip(engine.NAMES, target.of_engine, strict=True) if own == engine.VOID
    ]
    if lost and len(lost) < len(engine.NAMES):
        faults.append(
            Fault(
                f"{', '.join(lost)}: rendered, and void in your classes",
                "this is right if you have no such class; otherwise name it in a class's 'renders'",
            )
        )


def merged(faults: Sequence[Fault]) -> list[Fault]:
    """The faults; four or more with one remedy become one, with their number and the first three."""
    by_remedy: dict[str, list[Fault]] = {}
    for fault in faults:
        by_remedy.setdefault(fault.mend, []).append(fault)
    shown: list[Fault] = []
    for remedy, alike in by_remedy.items():
        first = "; ".join(fault.what for fault in alike[:3])
        many = [Fault(f"{len(alike)} files, such as {first}", remedy)]
        shown += many if len(alike) > 3 else alike
    return shown


def overlays(
    target: TargetFile, entries: Sequence[Entry], size: tuple[int, int]
) -> list[tuple[str, Image.Image]]:
    """Names, and images at a size (width, height) overlaid with their labels, if they can be read."""
    colours = np.full((256, 3), 96, np.uint8)
    colours[: len(target.classes)] = target.palette
    found = []
    for entry in entries:
        try:
            own = load([entry], target, (size[1], size[0]), "pad")
        except UserError:
            continue  # a fault reports it
        mixed = own.images[0].astype(np.uint16) + colours[own.labels[0]]
        found.append((entry.name, Image.fromarray((mixed // 2).astype(np.uint8))))
    return found


def sheet(pictures: Sequence[Image.Image], target: TargetFile) -> Image.Image:
    """Arrange pictures in two columns, with the classes' colours below."""
    width, height = pictures[0].size if pictures else (480, 360)
    rows = (len(pictures) + 1) // 2
    line, columns = 18, max(2 * width // 160, 1)
    key = -(-len(target.classes) // columns) * line + 8
    canvas = Image.new("RGB", (2 * width, rows * height + key), "white")
    for k, picture in enumerate(pictures):
        canvas.paste(picture, (k % 2 * width, k // 2 * height))
    pen = ImageDraw.Draw(canvas)
    for k, (name, colour) in enumerate(zip(target.classes, target.palette, strict=True)):
        x, y = k % columns * 160 + 6, rows * height + 4 + k // columns * line
        pen.rectangle((x, y, x + 12, y + 12), fill=colour)
        pen.text((x + 18, y), name, fill="black")
    return canvas
