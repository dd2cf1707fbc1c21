"""Files that describe a target: its images and labels, its classes and its splits.

    images: images/{name}.jpg
    labels: labels/{name}.png
    splits: {train: train.txt, test: test.txt}
    group: "^(.*)__"
    void: [255]
    classes:
      road: {ids: [0], renders: [road]}
      building: {ids: [1, 7], renders: [building, wall, fence]}

Such a file is ``target.yaml`` in the folder of the images, any other file, or one of those in ``targets/``.
It is checked against the fields of `TargetFile`; every error names the file, the line and the field.
"""

from __future__ import annotations

import colorsys
import re
import shlex
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, cast

import msgspec
import yaml
from msgspec import Meta

from common.command import PROGRAM
from common.errors import UserError, suggestion
from common.files import check_folder, composed, plain_path, read_bytes
from common.labels import classes as engine

FILE = "target.yaml"
"""The name of a target's file in the folder of its images."""
SHIPPED = tuple(sorted(path.stem for path in (Path(__file__).parent / "targets").glob("*.yaml")))
"""Names of the targets whose files come with the package."""
MOST_BYTES, MOST_CLASSES = 1_000_000, 254
"""The most bytes of a target's file, and its most classes."""
DEEPEST = 20
"""The deepest nesting of tables and lists."""
PLACES = ("split", "folder", "group", "name")
"""Placeholders of a pattern, in braces."""
WIDEST = 0.1
"""The largest outline, as a share of an image's width."""
TRAIN = "train"
"""The split of all images that no other share or group takes."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The loader in C if PyYAML has it, which is ten times as fast."""

Id = Annotated[int, Meta(ge=0, le=65535)]
Channel = Annotated[int, Meta(ge=0, le=255)]
Colour = tuple[Channel, Channel, Channel]
Name = Annotated[str, Meta(min_length=1)]
Files = str | tuple[str, ...]
Split = str | Annotated[float, Meta(gt=0, lt=1)] | Annotated[tuple[str, ...], Meta(min_length=1)]
Format = Literal[
    "ids", "ids-first-channel", "colours", "labelme-json", "cityscapes-json", "coco-json"
]
Fit = Literal["pad", "cut"]
Unlabelled = Literal["refuse", "skip"]
Kind = Literal["ids", "colours", "names"]
_KINDS: dict[Format, Kind] = {
    "ids": "ids",
    "ids-first-channel": "ids",
    "colours": "colours",
    "labelme-json": "names",
    "cityscapes-json": "names",
    "coco-json": "names",
}


class TargetClass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One class of a target.

    Attributes:
        ids: its values in label files of ids.
        colours: its RGB colours in label files of colours; label images use the first.
        names: its names in label files of polygons.
        renders: the engine's classes in it; a class without any is trained on labels alone.
    """

    ids: tuple[Id, ...] = ()
    colours: tuple[Colour, ...] = ()
    names: tuple[Name, ...] = ()
    renders: tuple[str, ...] = ()


class TargetFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fields of a target's file.

    Attributes:
        images: pattern of the images' paths below the data's folder; or for each split a pattern or a list.
        labels: the same for the labels; those of many images may be one file of COCO.
        classes: classes by name; their indices are the ids that networks predict.
        format: format of the label files; by default ids if the classes have some, else colours if they
            have some, else labelme-json.
        void: ids, colours or names of ignored pixels.
        splits: one pattern of lists; or for each split its list, its groups, or its share of the images. By
            default the folders at {split} in the pattern of the images; without these all are `TRAIN`.
        group: regular expression that finds the group in an image's name: its first parenthesis, or the
            whole match. By default the text at {group} in the pattern; without it each image is a group.
        fit: how an image of another aspect ratio is treated: padded with ignored pixels, or cropped around
            its centre.
        rest: the class of all pixels whose value is in no class and not in `void`, those without a polygon
            included, and of engine classes that no class contains; it needs no values, and comes last if
            `classes` does not name it. By default such values are an error, and pixels
            without a polygon are ignored.
        unlabelled: whether an image that has no label is an error, or left out.
        outlines: classes that annotators draw without the holes through which the sky shows, with the width
            of the widest holes as a share of the image's width; labels of renders are drawn in the same way
            (`scene.outline`). In the file a share is text such as "3 %".
        name: name of the target; by default that of its file.
        source: the file, for errors; not a field of the file.
    """

    images: str | dict[str, Files]
    labels: str | dict[str, Files]
    classes: dict[Name, TargetClass]
    format: Format | None = None
    # msgspec mistakes bounds in a union with tuples of a fixed length, so these are checked below.
    void: tuple[int | str | tuple[int, ...], ...] = ()
    splits: str | dict[str, Split] = {}
    group: str | None = None
    fit: Fit = "pad"
    rest: Name | None = None
    unlabelled: Unlabelled = "refuse"
    outlines: dict[Name, float] = {}
    name: Name = "target"
    source: str = ""

    @property
    def kind(self) -> Kind:
        """The kind of the label files' values, a field of `TargetClass`."""
        assert self.format is not None
        return _KINDS[self.format]

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the classes in the order of their ids."""
        return tuple(self.classes)

    @property
    def rendered(self) -> tuple[bool, ...]:
        """Whether the engine renders each class; other classes are trained on labels alone."""
        return tuple(bool(c.renders) or name == self.rest for name, c in self.classes.items())

    @property
    def of_engine(self) -> tuple[int, ...]:
        """The target's class of each engine class: by default that of the rest, or `classes.VOID`."""
        rest = engine.VOID if self.rest is None else self.class_names.index(self.rest)
        class_of = {name: k for k, c in enumerate(self.classes.values()) for name in c.renders}
        return tuple(class_of.get(name, rest) for name in engine.NAMES)

    @property
    def engine_outlines(self) -> tuple[engine.Outline, ...]:
        """The outline of each class that has one, in order of ids."""
        return tuple(
            engine.Outline(
                tuple(id for id, k in enumerate(self.of_engine) if k == number), self.outlines[name]
            )
            for number, name in enumerate(self.classes)
            if name in self.outlines
        )

    @property
    def palette(self) -> tuple[Colour, ...]:
        """A different colour of each class for label images: its own, the engine's, or one of a circle."""
        engine_colours = {row.name: row.colour for row in engine.CLASSES}
        palette: list[Colour] = []
        for k, target_class in enumerate(self.classes.values()):
            rendered = (engine_colours[name] for name in target_class.renders)
            candidates = [*target_class.colours, *rendered, *_circle(k)]
            palette.append(next(colour for colour in candidates if colour not in palette))
        return tuple(palette)


def _circle(k: int) -> Iterator[Colour]:
    """Colours that differ well, by steps of the golden angle."""
    for n in range(k, k + 2 * MOST_CLASSES):
        red, green, blue = colorsys.hsv_to_rgb(0.618034 * n % 1, 0.75, 0.95 - 0.25 * (n % 3))
        yield round(255 * red), round(255 * green), round(255 * blue)


def find_target(target: str | Path | None, data: Path | None = None) -> TargetFile:
    """Read a target's file.

    Args:
        target: one of `SHIPPED`, or the path of a file; by default `FILE` in the data's folder.
        data: folder of the images.

    Raises:
        UserError: there is no such file, or it is wrong.
        OSError: it cannot be read.
    """
    if target is None:
        if data is None:
            raise UserError("name a target, or the folder of its images")
        check_folder(data, f"one with images and {FILE}")
        if not (data / FILE).is_file():
            command = shlex.join([PROGRAM, "doctor", str(data), "--write", str(data / FILE)])
            raise UserError(
                f"{data} has no {FILE}; {command} proposes one, "
                f"and --target names another file, or one of {', '.join(SHIPPED)}"
            )
        target = data / FILE
    if str(target) in SHIPPED:
        return shipped(str(target))
    if not Path(target).is_file():
        raise UserError(
            f"--target {target}: no such file; expected a file, or one of {', '.join(SHIPPED)}"
            + suggestion(str(target), SHIPPED)
        )
    return parse_target(read_bytes(Path(target), MOST_BYTES), str(target))


@lru_cache
def shipped(name: str) -> TargetFile:
    """The target of a name in `SHIPPED`."""
    path = Path(__file__).parent / "targets" / f"{name}.yaml"
    return msgspec.structs.replace(parse_target(path.read_bytes(), str(path)), source=name)


def parse_target(text: bytes | str, source: str) -> TargetFile:
    """Check the text of a target's file.

    Args:
        text: the file's text.
        source: the file's name for errors; without folder and suffix it names the target.

    Raises:
        UserError: the text is wrong; the message names file, line, field and what would be right.
    """
    lines = _Lines(source)
    if len(text) > MOST_BYTES:
        raise UserError(f"{source} has more than {MOST_BYTES:,} bytes, the limit of such a file")
    try:
        # Composing nodes recurses, in C without a check of the stack; parsing events does not.
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                lines.refuse_at(
                    event.start_mark,
                    f"lists or tables are nested more than {DEEPEST} deep; all fields need at most 4",
                )
        node = yaml.compose(text, _LOADER)
    except yaml.MarkedYAMLError as error:
        lines.refuse_at(error.problem_mark, f"not valid YAML: {error.problem}")
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise UserError(f"{source}: not valid YAML: {' '.join(str(error).split())}") from None
    fields = lines.value_of(node, "") if node is not None else {}
    if not isinstance(fields, dict):
        raise UserError(f"{source}, line 1: expected fields such as 'images: images/{{name}}.jpg'")
    if "source" in fields:
        lines.refuse("source", "unknown field")
    # First entry by entry, since msgspec does not name the entry of a table with an error.
    for field, kind in (
        ("classes", TargetClass),
        ("splits", Split),
        ("images", Files),
        ("labels", Files),
    ):
        if isinstance(fields.get(field), dict):
            for name, value in fields[field].items():
                lines.checked(value, kind, f"{field}.{name}")
    if isinstance(fields.get("outlines"), dict):
        shares = {
            name: lines.share(value, f"outlines.{name}")
            for name, value in fields["outlines"].items()
        }
        fields["outlines"] = {name: share for name, share in shares.items() if share}
    target: TargetFile = lines.checked(fields, TargetFile, "")
    target = msgspec.structs.replace(
        target,
        name=fields.get("name", _name_of(source)),
        format=target.format or _format(target),
        classes=target.classes if target.rest is None else {**target.classes, **_rest(target)},
        images=_plain(target.images),
        labels=_plain(target.labels),
        splits=_plain(target.splits),
        source=source,
    )
    _check(target, lines)
    return target


def _plain(files: Any) -> Any:
    """The patterns and paths of a field in one form; groups and shares as they are."""
    if isinstance(files, dict):
        return {split: _plain(entry) for split, entry in files.items()}
    return plain_path(files) if isinstance(files, str) else files


def _rest(target: TargetFile) -> dict[str, TargetClass]:
    """The class of the rest, if the others do not name it."""
    assert target.rest is not None
    return {} if target.rest in target.classes else {target.rest: TargetClass()}


def _name_of(source: str) -> str:
    path = Path(source)
    return (path.absolute().parent.name if path.name == FILE else path.stem) or "target"


def _format(target: TargetFile) -> Format:
    formats: tuple[Format, ...] = ("ids", "colours", "labelme-json")
    for label_format in formats:
        kind = _KINDS[label_format]
        if any(getattr(target_class, kind) for target_class in target.classes.values()):
            return label_format
    return "ids"


class _Lines:
    """The lines of a file's values."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._of: dict[str, int] = {}
        self._seen: set[int] = set()

    def refuse(self, field: str, why: str) -> NoReturn:
        """Raise UserError at a field, such as ``classes.road.ids[0]``."""
        with_line = field
        while with_line not in self._of and with_line:
            with_line = re.sub(r"(\.[^.\[]*|\[[^\[]*|^[^.\[]*)$", "", with_line)
        name = f" {field}:" if field else ""
        raise UserError(f"{self._source}, line {self._of.get(with_line, 1)}:{name} {why}")

    def refuse_at(self, mark: yaml.Mark | None, why: str) -> NoReturn:
        """Raise UserError at a place in the text."""
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise UserError(f"{self._source}{where}: {why}")

    def value_of(self, node: yaml.Node, field: str) -> Any:
        """The plain value of a YAML node; keys are always text as written."""
        self._of[field] = node.start_mark.line + 1
        if isinstance(node, yaml.ScalarNode):
            try:
                value = yaml.SafeLoader("").construct_object(node)  # type: ignore[no-untyped-call]
                return composed(value) if isinstance(value, str) else value
            except (yaml.YAMLError, ValueError) as error:
                why = getattr(error, "problem", None) or error
                self.refuse(field, f"{node.value!r} cannot be read ({why})")
        if id(node) in self._seen:  # a small file of many aliases can stand for an endless one
            self.refuse(field, "is an alias for another part of the file; write it out")
        self._seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            return [self.value_of(value, f"{field}[{k}]") for k, value in enumerate(node.value)]
        table: dict[str, Any] = {}
        for key, value in cast(yaml.MappingNode, node).value:
            if not isinstance(key, yaml.ScalarNode):
                self.refuse_at(key.start_mark, "expected a name, not a list or a table")
            name = composed(key.value)
            inner = f"{field}.{name}" if field else name
            if name in table:
                self.refuse_at(key.start_mark, f"{inner}: appears twice; remove one")
            table[name] = self.value_of(value, inner)
            self._of[inner] = key.start_mark.line + 1
        return table

    def share(self, value: Any, field: str) -> float:
        """Convert a text such as "3 %" to a share of an image's width; raises UserError for any other."""
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*%", value) if isinstance(value, str) else None
        if match is None or float(match[1]) > 100 * WIDEST:
            self.refuse(
                field,
                f"expected 0 to {100 * WIDEST:g} % of the image's width, such as 3 %, not {value}",
            )
        return float(match[1]) / 100

    def checked(self, value: Any, kind: Any, field: str) -> Any:
        """Convert a value to a type; raises UserError at the part that does not fit."""
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError as error:
            why, _, where = str(error).partition(" - at `$")
            field += where.rstrip("`")
            unknown = re.search(r"unknown field `(.*)`", why)
            if unknown:
                names = [n for n in getattr(kind, "__struct_fields__", ()) if n != "source"]
                similar = suggestion(unknown[1], names)
                field = f"{field}.{unknown[1]}"
                why = f"unknown field; expected one of {', '.join(names)}{similar}"
            self.refuse(field.lstrip("."), plain_words(why))


def plain_words(why: str) -> str:
    """A message of msgspec in the words of YAML's users."""
    for term, plain_term in (
        ("Object missing required field", "missing field"), ("`", ""), ("Expected", "expected"),
        ("got", "not"), ("array", "list"), ("object", "table"), ("int", "whole number"), ("float", "number"),
        ("str", "text"), ("null", "nothing"), ("Invalid enum value", "unknown value"),
    ):  # fmt: skip
        why = re.sub(rf"\b{term}\b" if term.isalpha() else re.escape(term), plain_term, why)
    return why


def _check(target: TargetFile, lines: _Lines) -> None:
    """Refuse errors that types alone do not show."""
    if not 2 <= len(target.classes) <= MOST_CLASSES:
        hint = "; 'rest: background' makes a class of all other pixels"
        hint = hint if len(target.classes) == 1 else ""
        lines.refuse(
            "classes", f"expected 2 to {MOST_CLASSES} classes, not {len(target.classes)}{hint}"
        )
    _check_classes(target, lines)
    rendered = [name for name, has in zip(target.classes, target.rendered, strict=True) if has]
    for name in target.outlines:
        if name not in rendered:
            why = "has no 'renders'" if name in target.classes else "not a class"
            expected = f"expected one of {', '.join(rendered)}{suggestion(name, rendered)}"
            lines.refuse(f"outlines.{name}", f"{why}; {expected}")
    _check_splits(target, lines)
    for field in ("images", "labels"):
        files = getattr(target, field)
        for where, pattern in [(field, files)] if isinstance(files, str) else [
            (f"{field}.{split}", pattern) for split, pattern in files.items() if isinstance(pattern, str)
        ]:  # fmt: skip
            of_many = field == "labels" and target.format == "coco-json"
            _check_pattern(pattern, where, lines, of_many)
    if isinstance(target.images, dict) or isinstance(target.labels, dict):
        if not (isinstance(target.images, dict) and isinstance(target.labels, dict)):
            lines.refuse(
                "labels", "images and labels must both be one pattern, or both a table of splits"
            )
        if set(target.images) != set(target.labels):
            names = ", ".join(sorted(set(target.images) ^ set(target.labels)))
            lines.refuse(
                "labels",
                f"images and labels must have the same splits; only one of them has {names}",
            )
        for split in target.images:
            pair = target.images[split], target.labels[split]
            counts = [len(files) for files in pair if not isinstance(files, str)]
            if len(counts) == 1 or len({*counts}) == 2:
                lines.refuse(
                    f"labels.{split}",
                    "expected the same as for the images: a pattern, or a list of the same length",
                )
    if target.group is not None:
        try:
            re.compile(target.group)
        except (re.error, OverflowError, RecursionError) as error:
            lines.refuse("group", f"{target.group!r} is not a regular expression: {error}")


def _check_classes(target: TargetFile, lines: _Lines) -> None:
    kind = target.kind
    owners: dict[Any, str] = {}
    for k, value in enumerate(target.void):
        if not _is_one(kind, value):
            lines.refuse(f"void[{k}]", f"expected {_ONE[kind]}, since labels are {target.format}")
        if value in owners:
            lines.refuse(f"void[{k}]", f"{_shown(value)} appears twice; remove one")
        owners[value] = "void"
    rendered: dict[str, str] = {}
    for name, target_class in target.classes.items():
        field = f"classes.{name}"
        if name == "void":
            lines.refuse(field, "void is the name of ignored pixels; choose another")
        if not getattr(target_class, kind) and name != target.rest:
            lines.refuse(field, f"missing {kind}, its values in labels of format {target.format}")
        for k, value in enumerate(getattr(target_class, kind)):
            if value in owners:
                lines.refuse(
                    f"{field}.{kind}[{k}]",
                    f"{_shown(value)} is also in {owners[value]}; keep one",
                )
            owners[value] = name
        for k, engine_class in enumerate(target_class.renders):
            if engine_class not in engine.NAMES:
                lines.refuse(
                    f"{field}.renders[{k}]",
                    f"the engine has no class {engine_class!r}; it has {', '.join(engine.NAMES)}"
                    + suggestion(engine_class, engine.NAMES),
                )
            if engine_class in rendered:
                lines.refuse(
                    f"{field}.renders[{k}]",
                    f"{engine_class!r} is also in the renders of {rendered[engine_class]}; keep one",
                )
            rendered[engine_class] = name


_ONE = {
    "ids": "a whole number from 0 to 65535",
    "colours": "a colour [red, green, blue] of numbers from 0 to 255",
    "names": "a name",
}


def _is_one(kind: str, value: int | str | tuple[int, ...]) -> bool:
    """Whether a value of ``void`` is of the kind that label files hold."""
    if kind == "ids":
        return isinstance(value, int) and 0 <= value <= 65535
    if kind == "colours":
        return isinstance(value, tuple) and len(value) == 3 and all(0 <= v <= 255 for v in value)
    return isinstance(value, str) and bool(value)


def _shown(value: object) -> str:
    return str(list(value) if isinstance(value, tuple) else value)


def _check_splits(target: TargetFile, lines: _Lines) -> None:
    if isinstance(target.splits, str):
        if "{split}" not in target.splits:
            lines.refuse(
                "splits",
                "expected {split} in the pattern, such as '{split}.txt', or a table of splits",
            )
        _check_path(target.splits, "splits", lines)
        return
    for split, rule in target.splits.items():
        if isinstance(rule, str):
            _check_path(rule, f"splits.{split}", lines)
    kinds = {type(rule) for rule in target.splits.values()}
    if len(kinds) > 1:
        lines.refuse("splits", "expected one kind for all splits: lists, groups or shares")
    if float in kinds:
        if TRAIN in target.splits:
            lines.refuse(f"splits.{TRAIN}", "gets the remaining images; remove its share")
        if sum(cast(Any, target.splits.values())) >= 1:
            lines.refuse(
                "splits", f"the shares leave nothing for {TRAIN}; their sum must be below 1"
            )
    if tuple in kinds:
        split_of: dict[str, str] = {}
        for split, groups in target.splits.items():
            for k, group in enumerate(cast(tuple[str, ...], groups)):
                if group in split_of:
                    why = f"group {group!r} is also in {split_of[group]}; keep one"
                    lines.refuse(f"splits.{split}[{k}]", why)
                split_of[group] = split
    if target.splits and isinstance(target.images, dict):
        lines.refuse("splits", "images and labels are tables of splits already; remove this field")


def _check_pattern(pattern: str, field: str, lines: _Lines, of_many: bool) -> None:
    """Refuse a wrong pattern; ``of_many`` says whether one file may hold the labels of many images."""
    places = re.findall(r"\{(.*?)\}", pattern)
    if unknown := [place for place in places if place not in PLACES]:
        places_text = ", ".join(f"{{{place}}}" for place in PLACES)
        lines.refuse(field, f"unknown placeholder {{{unknown[0]}}}; expected {places_text}")
    if "name" not in places and not of_many:
        lines.refuse(
            field,
            f"expected {{name}} in the pattern, such as '{field.partition('.')[0]}/{{name}}.png'",
        )
    _check_path(pattern, field, lines)


def _check_path(path: str, field: str, lines: _Lines) -> None:
    if Path(path).is_absolute() or ".." in Path(path).parts:
        lines.refuse(field, "expected a path inside the data folder, without '..'")
