"""Proposes a target's file for a folder: where its images and labels are, and their possible classes."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import yaml
from PIL import Image

from common.errors import UserError, counted
from common.files import check_folder, files_below, plain_path
from common.labels import classes as engine
from common.labels.listing import list_split, split_names
from common.labels.target_file import FILE, SHIPPED, Format, find_target, shipped
from experiments.app.doctor.coco import layout_of_coco
from experiments.app.doctor.names import names_beside
from experiments.app.doctor.pairs import (
    CITYSCAPES,
    SPLITS,
    layout_of_pairs,
    looked_at,
    no_pairs,
    quoted,
)
from experiments.app.doctor.survey import spread
from scene.classes import CLASS_NAMES, VOID, TrainId
from seg.data.coco import draw_regions
from seg.data.labels import FORMATS, LabelReader

TRAINING_SETS = ("gta5", "synthia")
"""Targets in the package whose layouts are also those of many other folders."""
LOOKED_AT = 60
"""The most images whose labels are read for a proposal."""
GROUPS = (r"^(.*)__", r"^(.*?)[_-]*\d+\D*$", r"^[^_-]+")
"""Expressions for groups of names, in the order of trial."""
VOID_NAMES = {
    "void",
    "unlabeled",
    "unlabelled",
    "ignore",
    "other",
    "unknown",
    "various",
    "background",
}
SYNONYMS = {
    "road": "street drivable lane roadway asphalt", "sidewalk": "pavement footpath walkway",
    "building": "house facade", "wall": "", "fence": "", "pole": "column lamppost",
    "vegetation": "tree bush plant",
    "traffic light": "trafficlight", "traffic sign": "sign trafficsign signsymbol", "terrain": "grass soil",
    "sky": "", "person": "pedestrian people human", "rider": "bicyclist cyclist motorcyclist",
    "car": "vehicle", "truck": "lorry", "bus": "coach", "train": "tram", "motorcycle": "motorbike",
    "bicycle": "bike cycle",
}  # fmt: skip
"""Engine class -> other words for it."""
POLYGONS: dict[Format, str] = {
    "labelme-json": "LabelMe polygons",
    "cityscapes-json": "Cityscapes polygons",
    "coco-json": "COCO polygons or masks",
}
"""Formats that a file names, and their rows in the page's table of labels (docs/howto/target.md)."""
BINARY, IGNORED_255, UNLABELLED_0, COLOURS, INDEXED, CVAT, REST = (
    "a binary mask, 0 and 255",
    "ids from 0, 255 is ignored",
    "ids from 1, 0 is unlabelled (as ADE20K)",
    "RGB colours",
    "a PNG with a palette",
    'CVAT\'s "Segmentation mask 1.1"',
    "one class, the rest is background",
)
"""Other rows of that table."""


class Proposal(NamedTuple):
    """A file, and notes on its guesses."""

    text: str
    notes: list[str]


class _Content(NamedTuple):
    """What some of the labels hold."""

    format: Format
    values: Counter[int]  # pixels of each id or colour
    names: Counter[str]  # pixels of each name; "" for those without a polygon
    palette: dict[int, str]  # the colours of ids that are indices of a palette, as `Names` has them


class _File(NamedTuple):
    """What one label file holds."""

    path: Path
    format: Format
    pixels: dict[int, int]  # of each value
    names: tuple[str, ...]


def propose(root: Path) -> Proposal:
    """Propose a target's file for a folder: its own, that of a known data set, or a guess.

    Raises:
        UserError: no images with labels are found, or the folder's own file is wrong.
    """
    check_folder(root, "one with images and labels")
    if (root / FILE).is_file():
        find_target(None, root)  # refuses a wrong file
        try:
            return Proposal((root / FILE).read_text(encoding="utf-8"), [])
        except UnicodeDecodeError:
            raise UserError(f"{root / FILE} is not UTF-8; save it as UTF-8") from None
    for name in SHIPPED:
        if name not in TRAINING_SETS and _fits(name, root):
            path = Path(engine.__file__).parent / "targets" / f"{name}.yaml"
            text = f"name: {name}\n{path.read_text(encoding='utf-8')}"
            return Proposal(text, [f"the folder has the layout and the values of {name}"])
    return _guess(root)


def _fits(name: str, root: Path) -> bool:
    """Whether a folder has the layout of a known data set, and values in some of its labels."""
    target = shipped(name)
    try:
        reader = LabelReader(target)
        for split in split_names(target, root):
            entries = list_split(target, root, split)
            for entry in entries[:: max(len(entries) // 8, 1)]:
                if reader.read(entry.label_path, entry.image_path)[1]:
                    return False
    except UserError:
        return False
    return bool(split_names(target, root))


def _guess(root: Path) -> Proposal:
    files = [path.relative_to(root) for path in files_below(root)]
    layout = layout_of_pairs(root, files)
    if layout is None:
        layout, errors = layout_of_coco(root, files)
        if layout is None:
            raise no_pairs(root, files, errors)
    notes = [*layout.notes]
    content = _content(layout.labelled)
    lists = _lists(root, {n for path, p in layout.places.items() for n in (path.stem, p["name"])})
    value_names: Mapping[str, str] = {}
    if not content.names:
        pattern = yaml.safe_load(layout.labels)
        keys = [_key(value, content.format) for value in content.values]
        value_names = names_beside(root, layout.labelled[0][0], {*lists.values()})
        of_palette = {
            str(number): value_names[colour]
            for number, colour in content.palette.items()
            if colour in value_names
        }
        value_names = of_palette | value_names or _as_cityscapes(pattern, content.format, keys)
        if not value_names and _are_train_ids(
            [path for path, _ in layout.labelled], content.values
        ):
            value_names = {
                str(number): name for number, name in enumerate(shipped("cityscapes").classes)
            }
            notes.append(
                "the labels seem to hold Cityscapes' train ids, since 10 is at the top of the images and 0 "
                "at the bottom: look at the overlays, and correct the names if they are wrong"
            )
    classes, void = _classes(root, content, value_names, notes)
    lines = [
        _line(f"images: {layout.images}", "{name} is the same for image and label"),
        _line(f"labels: {layout.labels}", _row(layout.labels, content, void)),
    ]
    if content.format in POLYGONS:
        lines.append(f"format: {content.format}")
    splits = {} if layout.has_splits else lists
    if layout.unlabelled and not splits:
        images = f"{counted(len(layout.unlabelled), 'image')} without a label"
        example = layout.unlabelled[0].relative_to(root)
        lines.append(_line("unlabelled: skip", f"leaves out {images}"))
        notes.append(f"{images}, such as {example}: left out")
    if splits:
        table = yaml.safe_dump(splits, default_flow_style=True).strip()
        lines.append(_line(f"splits: {table}", "lists"))
    elif not layout.has_splits:
        notes.append("no list of test images found: all images are for training")
    if not any("group" in places for places in layout.places.values()):
        group = _group([places["name"] for places in layout.places.values()])
        if group:
            lines.append(_line(f"group: {quoted(group)}", "images of one sequence"))
        else:
            notes.append(
                "file names do not show which images are of one sequence: each is a group of its own"
            )
    return Proposal("\n".join([*lines, *classes]) + "\n", notes)


def _line(text: str, comment: str) -> str:
    return f"{text}  # {comment}" if comment else text


def _row(labels: str, content: _Content, void: Sequence[str]) -> str:
    """The row of the page's table of labels that some labels are like; if none, the ignored ids, if any."""
    if content.format in POLYGONS:
        return POLYGONS[content.format]
    if content.format == "colours":
        return CVAT if "SegmentationClass/" in labels else COLOURS
    if content.palette:
        return INDEXED
    if content.values.keys() == {0, 255}:
        return BINARY
    first = min((value for value in content.values if str(value) not in void), default=0)
    rows = {("255", 0): IGNORED_255, ("0", 1): UNLABELLED_0}
    ignored = ", ".join(void)
    return rows.get((ignored, first), f"ids; ignored: {ignored}" if void else "")


def _lists(root: Path, names: Collection[str]) -> dict[str, str]:
    """Find text files beside the folders, or where VOC has them, whose lines are names of images."""

    def names_one(line: str) -> bool:
        """Whether a line is a name, which may have spaces, or an image and its label."""
        paths = PurePosixPath(line), PurePosixPath(line.split()[0])
        return any(path.name in names or path.stem in names for path in paths)

    lists = {}
    voc = [root / "ImageSets/Segmentation" / f"{split}.txt" for split in SPLITS]
    for path in [*sorted(root.glob("*.txt")), *filter(Path.is_file, voc)]:
        try:
            lines = path.read_text(encoding="utf-8-sig").split("\n")
        except (OSError, UnicodeDecodeError):
            continue
        lines = [*filter(None, map(plain_path, lines))]
        if lines and 2 * sum(map(names_one, lines)) > len(lines):
            lists[path.stem] = path.relative_to(root).as_posix()
    # Others, such as trainval.txt, repeat these.
    return {split: path for split, path in lists.items() if split in SPLITS} or lists


def _group(names: Sequence[str]) -> str:
    """The first expression that finds groups of two or more images; empty if none does."""
    for expression in GROUPS:
        groups = Counter(m[m.re.groups] for n in names if (m := re.search(expression, n)))
        if groups and sum(groups.values()) == len(names) and len(groups) * 2 <= len(names):
            if "" not in groups:
                return expression
    return ""


# ---- classes


def _content(labelled: Sequence[tuple[Path, Path | None]]) -> _Content:
    """Count the pixels of each id, colour or name in some of the labels.

    Where one file has colours, grey ones are colours, too.

    Args:
        labelled: label files; with the image where a file labels many.

    Raises:
        UserError: none of the labels can be read.
    """
    content = _Content("ids", Counter(), Counter(), {})
    sample, step = spread(labelled, LOOKED_AT), 2
    files = _read(sample, step)
    # Every other pixel will do where there are several values: the survey reads whole files.
    if len({value for file in files for value in file.pixels}) == 1:
        step = 1
        files = _read(sample, step)
    formats = {file.format for file in files}
    for path, form, pixels, names in files:
        if form == "ids" and "colours" in formats:
            form, (codes, names) = "colours", FORMATS["colours"](path)
            pixels = _counted(codes, step)
        content = content._replace(format=form)
        for value, count in pixels.items():
            if form not in POLYGONS:
                content.values[value] += count
            elif value >= 0:  # others are ignored
                content.names[names[value - 1] if value else ""] += count
    return content._replace(palette=_palette(files[-1].path) if content.format == "ids" else {})


def _read(labelled: Sequence[tuple[Path, Path | None]], step: int) -> list[_File]:
    """Read label files, and count their values on every ``step``-th row and column.

    Raises:
        UserError: none of them can be read.
    """
    files = []
    errors: list[UserError] = []  # the survey reports them if other labels are readable
    for path, image in labelled:
        try:
            form, codes, names = (
                looked_at(path) if image is None else ("coco-json", *draw_regions(path, image))
            )
        except UserError as error:
            errors.append(error)
        else:
            files.append(_File(path, form, _counted(codes, step), names))
    if not files:
        raise errors[0]
    return files


def _counted(codes: np.ndarray, step: int) -> dict[int, int]:
    """Count the pixels of each value on every ``step``-th row and column."""
    values, counts = np.unique(codes[::step, ::step], return_counts=True)
    return dict(zip(values.tolist(), counts.tolist(), strict=True))


def _palette(path: Path) -> dict[int, str]:
    """The colours of the ids in a PNG with a palette; empty for other images."""
    with Image.open(path) as image:
        colours = image.getpalette("RGB") if image.mode == "P" else None
    rows = np.reshape(colours or [], (-1, 3)).tolist()
    return {number: str(colour) for number, colour in enumerate(rows)}


def _classes(
    root: Path, content: _Content, value_names: Mapping[str, str], notes: list[str]
) -> tuple[list[str], list[str]]:
    """The lines of void and classes, and the values of void.

    No proposal has one class alone: what would be void, or the pixels of no polygon, is then the other one.

    Args:
        root: the folder, for errors.
        content: of the labels.
        value_names: names of ids or colours.
        notes: gets a note on each guess.

    Raises:
        UserError: the labels hold a single value.
    """
    values, names = content.values, content.names
    pixels = {name: names[name] for name in sorted(names)} if names else {
        _key(value, content.format): values[value] for value in sorted(values)
    }  # fmt: skip
    total = max(sum(pixels.values()), 1)
    share = {key: f"{100 * count / total:.1f} % of the pixels" for key, count in pixels.items()}
    bare = pixels.pop("", 0)
    shown = {key: key if names else value_names.get(key, "") for key in pixels}
    void = [key for key, name in shown.items() if _is_void(key, name)]
    lines = []
    if len(shown) - len(void) < 2:
        if len(shown) + bool(bare) < 2:
            only = f"only the value {', '.join(shown)}" if shown else "no values"
            raise UserError(f"{root}: the labels have {only}; expected at least two classes")
        notes += [
            f"{key} has {share[key]}, and became a class because only one other was found; if it means "
            "unlabelled, move it to 'void' and name more classes"
            for key in void
        ]
        if bare:
            lines.append(_line("rest: background", REST))
            notes.append(
                f"pixels without a polygon, {share['']}, are the class background ('rest')"
            )
        void = []
    elif bare:
        notes.append(
            f"pixels without a polygon, {share['']}, are ignored; 'rest: background' makes them a class"
        )
    notes += [f"{key} is ignored ({share[key]}); move it to a class if it is one" for key in void]
    keys_of: dict[str, list[str]] = {}
    for key, name in shown.items():
        if key not in void:
            keys_of.setdefault(name or _unnamed(key, shown), []).append(
                quoted(key) if names else key
            )
    field = "names" if names else "ids" if content.format == "ids" else "colours"
    void_values = [quoted(key) if names else key for key in void]
    lines += [_line(f"void: [{', '.join(void_values)}]", "ignored pixels"), "classes:"]
    taken: set[str] = set()
    for name, keys in keys_of.items():
        renders = [engine_class for engine_class in _rendered(name) if engine_class not in taken]
        taken |= {*renders}
        renders_field = f", renders: [{', '.join(renders)}]" if renders else ""
        line = f"  {quoted(name)}: {{{field}: [{', '.join(keys)}]{renders_field}}}"
        unnamed = name not in shown.values()
        comment = "name it, and add renders: [...]" if unnamed else "trained on labels alone"
        lines.append(_line(line, "" if renders else comment))
    if not taken:
        known = f"the engine's classes, for 'renders': {', '.join(engine.NAMES)}"
        lines += [f"# {line}" for line in textwrap.wrap(known, 96)]
        notes.append(
            "the labels do not name their classes: look at the overlays, name them, and add 'renders' where "
            f"the engine has the class: {', '.join(engine.NAMES)}"
        )
    return lines, void


def _unnamed(key: str, shown: Mapping[str, str]) -> str:
    """A name for a value that has none; of two values, as masks have, 0 is the background."""
    if len(shown) == 2 and not any(shown.values()) and any(zero in shown for zero in ZEROS):
        return "background" if key in ZEROS else "foreground"
    return f"class {key.strip('[]').replace(', ', ' ')}"


def _key(value: int, form: Format) -> str:
    return str([value >> 16, value >> 8 & 255, value & 255] if form == "colours" else value)


ZEROS = ("0", "[0, 0, 0]")


def _is_void(key: str, name: str) -> bool:
    phrase = (name or key).lower()
    return phrase in VOID_NAMES or (not name and key in ("255", "65535", "[0, 0, 0]"))


def _as_cityscapes(labels: str, form: Format, keys: Sequence[str]) -> dict[str, str]:
    """Names of ids where label files are called as Cityscapes calls them, or of colours that are its own."""
    classes = shipped("cityscapes").classes
    if form == "colours":
        names = {str([*rgb]): name for name, values in classes.items() for rgb in values.colours}
        return names if 2 * sum(key in names for key in keys) > len(keys) else {}
    ending = CITYSCAPES.search(labels)
    if ending is None:
        return {}
    if ending[1]:
        names = {str(number): name for number, name in enumerate(classes)}
    else:
        names = {str(number): name for name, values in classes.items() for number in values.ids}
    return {key: names.get(key, "void") for key in keys}


def _are_train_ids(labels: Sequence[Path], values: Collection[int]) -> bool:
    """Whether ids look like Cityscapes' train ids: sky above all other classes, road below most."""
    road, sky = int(TrainId.ROAD), int(TrainId.SKY)
    if not {road, sky} <= {*values} <= {*range(len(CLASS_NAMES)), VOID}:
        return False
    rows: dict[int, list[float]] = {}
    for path in spread(labels, LOOKED_AT // 3):
        try:
            codes = looked_at(path)[1]
        except UserError:  # the survey reports it
            continue
        for value in {*np.unique(codes).tolist()} - {VOID}:
            height = float(np.nonzero(codes == value)[0].mean()) / len(codes)
            rows.setdefault(value, []).append(height)
    from_top = sorted(rows, key=lambda value: np.mean(rows[value]))
    return len(from_top) > 5 and from_top[0] == sky and road in from_top[-3:]


def _rendered(name: str) -> list[str]:
    """Engine classes that a name may mean."""
    phrase = re.sub(r"[_-]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)).lower().strip()
    forms = {phrase, phrase.removesuffix("s"), phrase.replace(" ", "")}
    return [
        engine_class
        for engine_class, others in SYNONYMS.items()
        if forms & {engine_class, *others.split()}
    ]
