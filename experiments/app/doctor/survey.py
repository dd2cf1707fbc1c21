"""Surveys a folder as its target's file describes it: counts, sizes, classes, groups, and faults."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from PIL import Image, ImageDraw

from common.errors import UserError
from common.files import file_digest
from common.labels import classes as engine
from common.labels.listing import Entry, list_split, shared_groups, split_names
from common.labels.target_file import TRAIN, TargetFile
from experiments.targets.real import HELD_OUT
from experiments.targets.sizes import suitable_size
from seg.classes import IGNORE_LABEL
from seg.data import LabelReader, load
from seg.data.images import check_end, decode, is_deep, read_file, read_header
from seg.data.labels import WITHOUT_AREA, count_without_area

Item = TypeVar("Item")
READ = 100
"""The most label files that are read whole."""
HEAD = 65536
"""Only files of one size with the same first bytes, so many, are compared whole."""
LOADED = 60
"""The most images whose labels are read at the size for training."""
SHOWN = 4
"""Number of images that are shown with their labels."""
REPLACE = "replace it with an intact copy"
ALIKE = 0.03
"""Images have one shape if their aspect ratios differ by less than this share."""


class Fault(NamedTuple):
    """A fault, and how to fix it."""

    what: str
    fix: str


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
    ignored: float  # share of the pixels
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
            faults.append(_fault(str(error), "correct the patterns or lists"))
    entries = [entry for split_entries in splits.values() for entry in split_entries]
    sizes = _sizes(entries, faults)
    classes, ignored, read, readable = _classes(target, entries, faults)
    usable = usable and readable and bool(entries)
    _find_group_faults(splits, faults)
    _find_missed_shares(target, splits, faults)
    usable = _find_copies(splits, faults) and usable
    if entries:
        _find_engine_faults(target, faults)
    photographs = sizes[0][0] if sizes else (480, 360)
    width, height = photographs
    reshaped = sum(count for (w, h), count in sizes if abs(np.log(w / h * height / width)) > ALIKE)
    if reshaped:
        other = "cut" if target.fit == "pad" else "pad"
        what = {"pad": "padded with ignored pixels", "cut": "cropped around the centre"}
        faults.append(
            Fault(
                f"images of another aspect ratio than {width}x{height} are {what[target.fit]}: "
                f"{reshaped} of {len(entries)}",
                f"if they should be {what[other]}, write 'fit: {other}' in the file",
            )
        )
    training = [
        entry
        for split, split_entries in splits.items()
        if split.lower() not in HELD_OUT
        for entry in split_entries
    ]
    return Survey(
        {split: len(split_entries) for split, split_entries in splits.items()},
        {
            split: len({e.sequence for e in split_entries})
            for split, split_entries in splits.items()
        },
        sizes,
        classes,
        ignored,
        read,
        photographs,
        suitable_size(*photographs),
        spread(training or entries, LOADED),
        spread(entries, SHOWN),
        merged(faults),
        usable,
    )


def _fault(message: str, fix: str) -> Fault:
    """The fault of an error, which says after a semicolon what would be right; otherwise ``fix`` does."""
    what, _, expected = message.partition("; ")
    return Fault(what, expected or fix)


def spread(items: Sequence[Item], count: int) -> list[Item]:
    """Choose a number of items, or all if they are fewer, evenly spread over all."""
    indices = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[k] for k in indices]


def _sizes(entries: Sequence[Entry], faults: list[Fault]) -> list[tuple[tuple[int, int], int]]:
    """Count the sizes of all images, and find those that are unreadable, dark or rotated."""
    sizes: Counter[tuple[int, int]] = Counter()
    dark, rotated = [], []
    for entry in entries:
        path = entry.image_path
        try:
            check_end(path)
            header = read_header(path)
            sizes[header.size] += 1
            if is_deep(path):
                largest = int(decode(path, read_file(path), cv2.IMREAD_UNCHANGED).max())
                if 0 < largest < 2**15:
                    dark.append((path, largest))
            if header.orientation != 1 and header.size == header.stored:
                rotated.append(path)
        except Exception as error:  # Pillow has many errors
            why = (
                str(error) if str(path) in str(error) else f"{path}: not a readable image ({error})"
            )
            faults.append(_fault(why, REPLACE))
    if dark:
        path, largest = dark[0]
        faults.append(
            Fault(
                f"16-bit images that are too dark for a network: {len(dark)}, such as {path}, whose largest "
                f"value is {largest}",
                "scale the values to 0..65535, or save 8 bits",
            )
        )
    if rotated:
        faults.append(
            Fault(
                f"images rotated by their EXIF orientation: {len(rotated)}, such as {rotated[0]}; sizes do "
                "not show whether their labels are rotated, too",
                "look at the overlays; rotate the labels, or remove the tag from the images",
            )
        )
    return sizes.most_common()


def _classes(
    target: TargetFile, entries: Sequence[Entry], faults: list[Fault]
) -> tuple[list[ClassShare], float, int, bool]:
    """The classes' shares, the share of ignored pixels, the number of labels read, and if all were right."""
    reader, count = LabelReader(target), len(target.classes)
    pixels, images_with = np.zeros(256, np.int64), np.zeros(count)
    row_sums = np.zeros(count)
    unknown: list[tuple[Path, Counter[str]]] = []
    read, right, without_area = 0, True, 0
    for entry in spread(entries, READ):
        try:
            label, unknown_values = reader.read(entry.label_path, entry.image_path)
            header = read_header(entry.image_path)
            if target.format == "labelme-json":
                without_area += count_without_area(entry.label_path)
        except (UserError, OSError) as error:
            faults.append(_fault(str(error), REPLACE))
            right = False
            continue
        size = header.size
        if size != label.shape[::-1]:
            fix = "resize labels to the size of their image, to the nearest pixel"
            if header.stored == label.shape[::-1]:
                fix = "EXIF orientation rotates the image: rotate the label, or remove the tag"
            faults.append(
                Fault(
                    f"{entry.label_path}: {label.shape[1]}x{label.shape[0]} pixels, but its image has "
                    f"{size[0]}x{size[1]}",
                    fix,
                )
            )
            right = False
        if unknown_values:
            unknown.append((entry.label_path, unknown_values))
        height = len(label)
        row_and_class = np.arange(height)[:, None] * 256 + label
        by_row = np.bincount(row_and_class.ravel(), minlength=256 * height).reshape(height, 256)
        counts = by_row.sum(axis=0)
        row_sums += ((np.arange(height) + 0.5) / height) @ by_row[:, :count]
        pixels += counts
        images_with += counts[:count] > 0
        read += 1
    if unknown:
        faults.append(_fault(str(reader.error(unknown)), f"edit {target.source}"))
        right = False
    if without_area:
        faults.append(
            Fault(
                f"shapes without an area ({', '.join(WITHOUT_AREA)}), left out: {without_area} in the {read} "
                "labels read",
                "expected if they mark no class; otherwise draw polygons",
            )
        )
    labelled = max(int(pixels[:count].sum()), 1)
    palette = target.palette
    classes = [
        ClassShare(
            name, pixels[k] / labelled, images_with[k] / max(read, 1),
            row_sums[k] / pixels[k] if pixels[k] else np.nan, values.renders, palette[k],
        )
        for k, (name, values) in enumerate(target.classes.items())
    ]  # fmt: skip
    absent = [row.name for row in classes if read and not row.share]
    if absent:
        faults.append(
            Fault(
                f"{', '.join(absent)}: not found in any of the {read} labels read",
                "expected for rare classes; otherwise check their values",
            )
        )
    return classes, pixels[IGNORE_LABEL] / max(int(pixels.sum()), 1), read, right


def _find_group_faults(splits: Mapping[str, Sequence[Entry]], faults: list[Fault]) -> None:
    note = shared_groups(splits)
    if note:
        faults.append(Fault(note, "split by group, as in 'splits: {test: [GROUP]}'"))
    groups = Counter(entry.sequence for entries in splits.values() for entry in entries)
    if len(groups) == 1:
        faults.append(
            Fault(
                "all images are of one group, so results do not carry over to other places",
                "set 'group' if names tell sequences apart, or label a few images from elsewhere",
            )
        )
    if len(groups) > 1 and len(groups) == sum(groups.values()):
        faults.append(
            Fault(
                "each image is a group of its own, so frames of one sequence may be in two splits",
                "if images are frames of sequences, set 'group', or {group} in the patterns",
            )
        )


def _find_missed_shares(
    target: TargetFile, splits: Mapping[str, Sequence[Entry]], faults: list[Fault]
) -> None:
    """Find splits whose size differs from their share of the images by half of it or more."""
    rules = target.splits if isinstance(target.splits, dict) else {}
    total = sum(map(len, splits.values()))
    for split, share in rules.items():
        if isinstance(share, float) and split in splits:
            images = len(splits[split])
            if abs(images - share * total) >= share * total / 2:
                faults.append(
                    Fault(
                        f"{split} has {100 * images / total:.0f} % of the images instead of "
                        f"{100 * share:.0f} %, since groups stay whole",
                        "name the groups of each split, as in 'splits: {test: [GROUP]}'",
                    )
                )


def _find_copies(splits: Mapping[str, Sequence[Entry]], faults: list[Fault]) -> bool:
    """Find images that are in two splits, or twice in one, by their bytes.

    Returns:
        Whether no file is itself in two splits.
    """
    alike: dict[tuple[int, bytes], list[tuple[str, Path]]] = {}
    for split, entries in splits.items():
        for entry in entries:
            with entry.image_path.open("rb") as file:
                key = entry.image_path.stat().st_size, hashlib.sha256(file.read(HEAD)).digest()
            alike.setdefault(key, []).append((split, entry.image_path))
    first_with: dict[str, tuple[str, Path]] = {}
    copies: list[str] = []
    for images in alike.values():
        for split, path in images if len(images) > 1 else ():
            first_split, first = first_with.setdefault(file_digest(path), (split, path))
            if (first_split, first) != (split, path):
                copies.append(f"{path} ({split}) of {first} ({first_split})")
    if copies:
        faults.append(
            Fault(
                f"copies of images: {len(copies)}, such as {copies[0]}",
                "keep one of each, in one split",
            )
        )
    paths = [entry.image_path for entries in splits.values() for entry in entries]
    return len({*paths}) == len(paths)


def _find_engine_faults(target: TargetFile, faults: list[Fault]) -> None:
    rendered = zip(target.classes, target.rendered, strict=True)
    unrendered = [name for name, has_renders in rendered if not has_renders]
    if len(unrendered) == len(target.classes):
        return  # doctor says so in its last line
    if unrendered:
        faults.append(
            Fault(
                f"{', '.join(unrendered)}: no 'renders', so trained on your labels alone",
                f"if the engine has such a class, name it in 'renders': {', '.join(engine.NAMES)}",
            )
        )
    ignored = [
        name
        for name, class_id in zip(engine.NAMES, target.of_engine, strict=True)
        if class_id == engine.VOID
    ]
    if ignored and len(ignored) < len(engine.NAMES):
        faults.append(
            Fault(
                f"{', '.join(ignored)}: rendered, but in none of your classes, so ignored in renders",
                "expected if you have no such class; otherwise name it in the 'renders' of a class",
            )
        )


def merged(faults: Sequence[Fault]) -> list[Fault]:
    """The faults; four or more with one fix become one, with their number and the first three."""
    by_fix: dict[str, list[Fault]] = {}
    for fault in faults:
        by_fix.setdefault(fault.fix, []).append(fault)
    shown: list[Fault] = []
    for fix, alike in by_fix.items():
        first = "; ".join(fault.what for fault in alike[:3])
        summary = [Fault(f"{len(alike)} files, such as {first}", fix)]
        shown += summary if len(alike) > 3 else alike
    return shown


def overlays(
    target: TargetFile, entries: Sequence[Entry], size: tuple[int, int]
) -> list[tuple[str, Image.Image]]:
    """Names, and images at a size (width, height) overlaid with their labels, if they can be read."""
    colours = np.full((256, 3), 96, np.uint8)
    colours[: len(target.classes)] = target.palette
    shown = []
    for entry in entries:
        try:
            labelled = load([entry], target, (size[1], size[0]), "pad")
        except UserError:
            continue  # a fault reports it
        mixed = labelled.images[0].astype(np.uint16) + colours[labelled.labels[0]]
        shown.append((entry.name, Image.fromarray((mixed // 2).astype(np.uint8))))
    return shown


def sheet(pictures: Sequence[Image.Image], target: TargetFile) -> Image.Image:
    """Arrange images in two columns, with the colours of the classes below."""
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
