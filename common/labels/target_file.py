"""Files that describe a target: its images and labels, its classes and its splits.

    images: images/{name}.jpg
    labels: labels/{name}.png
    splits: {train: train.txt, test: test.txt}
    group: "^(.*)__"
    void: [255]
    classes:
      road: {ids: [0], renders: [road]}
      building: {ids: [1, 7], renders: [building, wall, fence]}

Such a file is ``target.yaml`` beside the images, one anywhere, or one of those in ``targets/``. It is
checked against the fields of `TargetFile`; every error names the file, the line and the field.
"""

from __future__ import annotations

import colorsys
import re
import shlex
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, cast

import msgspec
import yaml
from msgspec import Meta

from common.errors import UserError
from common.expression import expression_fault
from common.files import composed, plain_path, read_bytes
from common.interrupt import PROGRAM
from common.labels import classes as engine

FILE = "target.yaml"
"""The name of a target's file beside its images."""
SHIPPED = tuple(sorted(path.stem for path in (Path(__file__).parent / "targets").glob("*.yaml")))
"""Names of the targets whose files come with the package."""
MOST_BYTES, MOST_CLASSES = 1_000_000, 254
"""The most bytes of a target's file."""
DEEPEST = 20
"""The most tables and lists inside one another."""
PLACES = ("split", "group", "name")
"""Names that a pattern may have in braces."""
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
        colours: its RGB colours in label files of colours; pictures use the first.
        names: its names in label files of polygons.
        renders: the engine's classes in it; a class without any is learnt from labels alone.
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
        classes: classes by name; their indices are the ids that nets learn.
        format: format of the label files; by default ids if the classes have some, else colours if they
            have some, else labelme-json.
        void: ids, colours or names of pixels that are ignored.
        splits: one pattern of lists; or for each split its list, its groups, or its share of the images. By
            default the folders at {split} in the pattern of the images; without these all are `TRAIN`.
        group: regular expression that finds the group in an image's name: its first parenthesis, or the
            whole match. By default the text at {group} in the pattern; without it each image is a group.
        fit: how an image of another shape than the size is treated: with a void margin, or with a cut
            around its centre.
        rest: the class of all pixels whose value is in no class and not in `void`, those without a polygon
            included, and of what the engine renders for no class; it needs no values, and comes last if
            `classes` does not name it. By default such values are an error, and pixels
            without a polygon void.
        unlabelled: whether an image at a pattern that has no label is an error, or left out.
        outlines: classes that annotators draw as a whole before the sky, with the width of the widest holes
            as a share of the image's width: renders' labels of these are drawn in the same way
            (`scene.outline`). In the file a share is such as "3 %".
        name: name of the target; by default that of its file.
        source: the file, for errors; it is no field of the file.
    """

    images: str | dict[str, Files]
    labels: str | dict[str, Files]
    classes: dict[Name, TargetClass]
    format: Format | None = None
    # The library mistakes bounds in a union with tuples of a fixed length, so these are checked below.
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
        """Whether the engine renders each class; other classes are learnt from labels alone."""
        return tuple(bool(own.renders) or name == self.rest for name, own in self.classes.items())

    @property
    def of_engine(self) -> tuple[int, ...]:
        """The target's class of each engine class: by default that of the rest, or `classes.VOID`."""
        rest = engine.VOID if self.rest is None else self.class_names.index(self.rest)
        found = {name: k for k, own in enumerate(self.classes.values()) for name in own.renders}
        return tuple(found.get(name, rest) for name in engine.NAMES)

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
        """A different colour of each class for pictures: its own, the engine's, or one of a colour circle."""
        published = {own.name: own.colour for own in engine.CLASSES}
        found: list[Colour] = []
        for k, own in enumerate(self.classes.values()):
            wanted = [*own.colours, *(published[name] for name in own.renders), *_circle(k)]
            found.append(next(colour for colour in wanted if colour not in found))
        return tuple(found)


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
            raise UserError("neither a target nor a folder with its images is named")
        if not data.is_dir():
            raise UserError(f"{data}: no such folder; expected one with images and {FILE}")
        if not (data / FILE).is_file():
            command = shlex.join([PROGRAM, "doctor", str(data), "--write", str(data / FILE)])
            raise UserError(
                f"{data}: no {FILE} in it; {command} proposes one, "
                f"and --target names another file, or one of {', '.join(SHIPPED)}"
            )
        target = data / FILE
    if str(target) in SHIPPED:
        return shipped(str(target))
    if not Path(target).is_file():
        raise UserError(f"--target {target}: no such file, nor is it one of {', '.join(SHIPPED)}")
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
        raise UserError(f"{source} has more than {MOST_BYTES:,} bytes, the most of such a file")
    try:
        # Composing nodes recurses, in C without a check of the stack; events do not.
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                lines.refuse_at(
                    event.start_mark,
                    f"lists or tables are nested more than {DEEPEST} deep; 4 are enough for all fields",
                )
        node = yaml.compose(text, _LOADER)
    except yaml.MarkedYAMLError as error:
        lines.refuse_at(error.problem_mark, f"is no YAML: {error.problem}")
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise UserError(f"{source} is no YAML: {' '.join(str(error).split())}") from None
    plain = lines.plain(node, "") if node is not None else {}
    if not isinstance(plain, dict):
        raise UserError(f"{source}, line 1: expected fields such as 'images: images/{{name}}.jpg'")
    if "source" in plain:
        lines.refuse("source", "no field of a target's file has this name")
    # First entry by entry, since the library does not name the entry of a table with an error.
    for field, kind in (
        ("classes", TargetClass),
        ("splits", Split),
        ("images", Files),
        ("labels", Files),
    ):
        if isinstance(plain.get(field), dict):
            for name, value in plain[field].items():
                lines.checked(value, kind, f"{field}.{name}")
    if isinstance(plain.get("outlines"), dict):
        shares = {
            name: lines.share(value, f"outlines.{name}")
            for name, value in plain["outlines"].items()
        }
        plain["outlines"] = {name: share for name, share in shares.items() if share}
    found = lines.checked(plain, TargetFile, "")
    found = msgspec.structs.replace(
        found,
        name=plain.get("name", _own_name(source)),
        format=found.format or _format(found),
        classes=found.classes if found.rest is None else {**found.classes, **_rest(found)},
        images=_plain(found.images),
        labels=_plain(found.labels),
        splits=_plain(found.splits),
        source=source,
    )
    _check(found, lines)
    return found


def _plain(files: Any) -> Any:
    """The patterns and paths of a field in one form; groups and shares as they are."""
    if isinstance(files, dict):
        return {split: _plain(entry) for split, entry in files.items()}
    return plain_path(files) if isinstance(files, str) else files


def _rest(target: TargetFile) -> dict[str, TargetClass]:
    """The class of the rest, if the others do not name it."""
    assert target.rest is not None
    return {} if target.rest in target.classes else {target.rest: TargetClass()}


def _own_name(source: str) -> str:
    path = Path(source)
    return (path.absolute().parent.name if path.name == FILE else path.stem) or "target"


def _format(target: TargetFile) -> Format:
    formats: tuple[Format, ...] = ("ids", "colours", "labelme-json")
    for own in formats:
        if any(getattr(one, _KINDS[own]) for one in target.classes.values()):
            return own
    return "ids"


class _Lines:
    """The lines of a file's values."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._of: dict[str, int] = {}
        self._seen: set[int] = set()

    def refuse(self, field: str, why: str) -> NoReturn:
        """Raise UserError at a field, such as ``classes.road.ids[0]``."""
        known = field
        while known not in self._of and known:
            known = re.sub(r"(\.[^.\[]*|\[[^\[]*|^[^.\[]*)$", "", known)
        told = f" {field}:" if field else ""
        raise UserError(f"{self._source}, line {self._of.get(known, 1)}:{told} {why}")

    def refuse_at(self, mark: yaml.Mark | None, why: str) -> NoReturn:
        """Raise UserError at a place in the text."""
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise UserError(f"{self._source}{where}: {why}")

    def plain(self, node: yaml.Node, field: str) -> Any:
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
            self.refuse(field, "stands for a part of the file above; write it out")
        self._seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            return [self.plain(value, f"{field}[{k}]") for k, value in enumerate(node.value)]
        found: dict[str, Any] = {}
        for key, value in cast(yaml.MappingNode, node).value:
            if not isinstance(key, yaml.ScalarNode):
                self.refuse_at(key.start_mark, "a name must be a word, not a list or a table")
            name = composed(key.value)
            own = f"{field}.{name}" if field else name
            if name in found:
                self.refuse_at(key.start_mark, f"{own}: stands there twice; once is right")
            found[name] = self.plain(value, own)
            self._of[own] = key.start_mark.line + 1
        return found

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
                field, why = (
                    f"{field}.{unknown[1]}",
                    "is no field; there are "
                    + ", ".join(
                        name for name in getattr(kind, "__struct_fields__", ()) if name != "source"
                    ),
                )
            self.refuse(field.lstrip("."), plain_words(why))


def plain_words(why: str) -> str:
    """The library's message in the words of the format."""
    for theirs, ours in (
        ("Object missing required", "lacks the"), ("`", ""), ("Expected", "expected"), ("got", "not"),
        ("array", "list"), ("object", "table"), ("int", "whole number"), ("float", "number"),
        ("str", "text"), ("null", "nothing"), ("Invalid enum value", "there is no"),
    ):  # fmt: skip
        why = re.sub(rf"\b{theirs}\b" if theirs.isalpha() else re.escape(theirs), ours, why)
    return why


def _check(target: TargetFile, lines: _Lines) -> None:
    """Refuse errors that types alone do not show."""
    if not 2 <= len(target.classes) <= MOST_CLASSES:
        alone = "; 'rest: background' makes a class of all other pixels" * (
            len(target.classes) == 1
        )
        lines.refuse(
            "classes", f"expected 2 to {MOST_CLASSES} classes, not {len(target.classes)}{alone}"
        )
    _check_classes(target, lines)
    rendered = [name for name, has in zip(target.classes, target.rendered, strict=True) if has]
    for name in target.outlines:
        if name not in rendered:
            what = "has no renders" if name in target.classes else "is no class"
            lines.refuse(f"outlines.{name}", f"{what}; outlines are for {', '.join(rendered)}")
    _check_splits(target, lines)
    for field in ("images", "labels"):
        own = getattr(target, field)
        for where, pattern in [(field, own)] if isinstance(own, str) else [
            (f"{field}.{split}", pattern) for split, pattern in own.items() if isinstance(pattern, str)
        ]:  # fmt: skip
            of_many = field == "labels" and target.format == "coco-json"
            _check_pattern(pattern, where, lines, of_many)
    if isinstance(target.images, dict) or isinstance(target.labels, dict):
        if not (isinstance(target.images, dict) and isinstance(target.labels, dict)):
            lines.refuse(
                "labels", "expected the same of images and labels: patterns, or one for each split"
            )
        if set(target.images) != set(target.labels):
            both = ", ".join(sorted(set(target.images) ^ set(target.labels)))
            lines.refuse(
                "labels", f"expected the splits that images have; {both} stands in one of both"
            )
        for split in target.images:
            pair = target.images[split], target.labels[split]
            counts = [len(files) for files in pair if not isinstance(files, str)]
            if len(counts) == 1 or len({*counts}) == 2:
                lines.refuse(
                    f"labels.{split}", "expected a pattern, or as long a list, as of the images"
                )
    if target.group is not None:
        if fault := expression_fault(target.group):
            lines.refuse("group", f"{target.group!r} {fault}")


def _check_classes(target: TargetFile, lines: _Lines) -> None:
    kind = target.kind
    owners: dict[Any, str] = {}
    for k, value in enumerate(target.void):
        if not _is_one(kind, value):
            lines.refuse(f"void[{k}]", f"expected {_ONE[kind]}, since labels are {target.format}")
        if value in owners:
            lines.refuse(f"void[{k}]", f"{_shown(value)} stands there twice; once is right")
        owners[value] = "void"
    rendered: dict[str, str] = {}
    for name, own in target.classes.items():
        field = f"classes.{name}"
        if not getattr(own, kind) and name != target.rest:
            lines.refuse(field, f"lacks {kind}, by which labels of format {target.format} name it")
        for k, value in enumerate(getattr(own, kind)):
            if value in owners:
                lines.refuse(
                    f"{field}.{kind}[{k}]",
                    f"{_shown(value)} is in {owners[value]}, too; one is right",
                )
            owners[value] = name
        for k, engine_class in enumerate(own.renders):
            if engine_class not in engine.NAMES:
                there = ", ".join(engine.NAMES)
                lines.refuse(
                    f"{field}.renders[{k}]",
                    f"the engine has no class {engine_class!r}; it has {there}",
                )
            if engine_class in rendered:
                lines.refuse(
                    f"{field}.renders[{k}]",
                    f"{engine_class!r} is rendered for {rendered[engine_class]}, too; one is right",
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
                "splits", "expected {split} in it, as in '{split}.txt'; or a table of splits"
            )
        _check_path(target.splits, "splits", lines)
        return
    for split, own in target.splits.items():
        if isinstance(own, str):
            _check_path(own, f"splits.{split}", lines)
    kinds = Counter(type(own) for own in target.splits.values())
    if len(kinds) > 1:
        lines.refuse("splits", "expected lists, groups or shares, of one kind for all splits")
    if float in kinds:
        if TRAIN in target.splits:
            lines.refuse(f"splits.{TRAIN}", "has what the other shares leave; give none")
        if sum(cast(Any, target.splits.values())) >= 1:
            lines.refuse(
                "splits", f"the shares leave nothing for {TRAIN}; together they must be below 1"
            )
    if tuple in kinds:
        of: dict[str, str] = {}
        for split, groups in target.splits.items():
            for k, group in enumerate(cast(tuple[str, ...], groups)):
                if group in of:
                    lines.refuse(f"splits.{split}[{k}]", f"group {group!r} is in {of[group]}, too")
                of[group] = split
    if target.splits and isinstance(target.images, dict):
        lines.refuse(
            "splits", "the tables of images and labels say the splits; leave one of both out"
        )


def _check_pattern(pattern: str, field: str, lines: _Lines, of_many: bool) -> None:
    """Refuse a wrong pattern; ``of_many`` says whether one file may hold the labels of many images."""
    places = re.findall(r"\{(.*?)\}", pattern)
    if unknown := [place for place in places if place not in PLACES]:
        known = ", ".join(f"{{{place}}}" for place in PLACES)
        lines.refuse(field, f"{{{unknown[0]}}} stands for nothing; there are {known}")
    if "name" not in places and not of_many:
        lines.refuse(
            field, f"expected {{name}} in it, as in '{field.partition('.')[0]}/{{name}}.png'"
        )
    _check_path(pattern, field, lines)


def _check_path(path: str, field: str, lines: _Lines) -> None:
    if Path(path).is_absolute() or ".." in Path(path).parts:
        lines.refuse(field, "expected a path below the data's folder, without '..'")
