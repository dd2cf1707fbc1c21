"""Flags from dataclasses: every field is a flag, its docstring is the help; nested fields have dots.

@dataclass(frozen=True)
class Settings:
    steps: Annotated[int, Alias("-n")] = 200
    "Updates."

for field in flags_of(Settings()):
    add_flag(parser.add_argument, field)
settings = fill(Settings(), vars(parser.parse_args(["--steps", "3"])))

Where every field has one default, `command_line` makes the whole parser.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin
from typing import get_type_hints as hints_of

from common.command import Parser, docstring, size
from common.errors import suggestion

Value = TypeVar("Value")
KINDS: dict[type, str] = {int: "a whole number", float: "a number", Path: "a path", str: "a word"}
"""Types of a word on the command line, and their names in messages."""
SHORT = 24
"""Longer lists of choices, in characters, are in the help of a flag, not next to the flag."""


class Alias(NamedTuple):
    """Marks a field whose flag has a second name."""

    flag: str


class Option(NamedTuple):
    """Marks how a field appears on the command line, beyond what its type and docstring say."""

    metavar: str | None = None
    flag: str | None = None  # in place of the field's name
    nargs: str | None = None
    const: Any = None  # the value of the flag without a word
    choices: Collection[str] = ()
    help: str | None = None  # in place of the docstring
    needs: tuple[str, ...] = ()  # it has no effect without one of these flags
    excludes: tuple[str, ...] = ()  # it has no effect with any of these flags


class Word(NamedTuple):
    """Marks a type whose values are one word on the command line."""

    metavar: str
    read: Callable[[str], Any]
    show: Callable[[Any], str]


UNUSED = "no flag"
"""Marks a field that is not a flag of this command."""
REPEATED = "once for each"
"""Marks a tuple whose flag takes one word and is repeated for each member."""
Size = Annotated[tuple[int, int], Word("WxH", size, lambda pixels: "{}x{}".format(*pixels))]
"""Width and height in pixels, such as 640x320."""
ARGUMENT = "no flag but a word in its place"
"""Marks a field that is an argument."""
SWITCH = "no flag turns it off"
"""Marks a bool with one flag, which turns it on."""
ONE_OF = "instead of the others"
"""Marks fields of which a command line may have only one."""


class Field(NamedTuple):
    """A field that is a flag."""

    path: tuple[str, ...]  # names of fields, from the outermost dataclass inwards
    owner: type  # the dataclass that declares it
    kind: Any
    marks: tuple[Any, ...]
    default: Any

    @property
    def flag(self) -> str:
        """The flag, such as ``--reward.train.head-width``."""
        return self.option.flag or "--" + ".".join(self.path).replace("_", "-")

    @property
    def option(self) -> Option:
        """How it appears on the command line."""
        return next((mark for mark in self.marks if isinstance(mark, Option)), Option())


def command_line(
    name: str, kind: type, module: str, groups: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> Parser:
    """Make the parser of a command; its result has the fields of a dataclass.

    Args:
        name: the command's name.
        kind: the dataclass; fields without a default are required.
        module: the module whose docstring is the help's first part.
        groups: title and fields of the groups of options that only ``--help-all`` shows.
    """
    parser, flags = Parser(name, docstring(module)), [*flags_of(kind)]
    one_of = parser.add_mutually_exclusive_group().add_argument
    adders: dict[str, Callable[..., Any]] = {}
    for title, names in groups.items():
        adders |= dict.fromkeys(names, parser.group(title))
    for field in flags:
        default_add = one_of if ONE_OF in field.marks else parser.add_argument
        if field.default is not MISSING:
            parser.set_defaults(**{field.path[0]: field.default})
        add_flag(adders.get(field.path[0], default_add), field)
        parser.relations.append((field.flag, field.option.needs, field.option.excludes))
    return parser


def flags_of(value: Any, path: tuple[str, ...] = ()) -> Iterator[Field]:
    """List the fields of a dataclass, or of an instance with its values, that are flags; nested ones, too."""
    kind: Any = value if isinstance(value, type) else type(value)
    hints = _hints(kind)
    for entry in fields(kind):
        default, where = getattr(value, entry.name, entry.default), (*path, entry.name)
        bare, marks = _bare(hints[entry.name])
        if UNUSED in marks:
            continue
        if is_dataclass(default):
            yield from flags_of(default, where)
        else:
            word = any(isinstance(mark, Word) for mark in marks)
            yield Field(where, kind, hints[entry.name] if word else bare, marks, default)


def fill(value: Value, values: Mapping[str, Any], path: tuple[str, ...] = ()) -> Value:
    """Fill a dataclass with the values of flags.

    Args:
        value: the defaults.
        values: values by the path of their field, joined by dots.
        path: the path of the dataclass itself.
    """
    changes: dict[str, Any] = {}
    for entry in fields(value):  # type: ignore[arg-type]
        default, where = vars(value)[entry.name], (*path, entry.name)
        if is_dataclass(default):
            changes[entry.name] = fill(default, values, where)
        elif ".".join(where) in values:
            changes[entry.name] = values[".".join(where)]
    return replace(value, **changes)  # type: ignore[type-var]


def add_flag(add: Callable[..., Any], field: Field) -> None:
    """Add a field to a parser or a group; the result has it only if its flag is set.

    Args:
        add: the ``add_argument`` of the parser or group.
        field: the field, whose default the help shows.
    """
    option = field.option
    flags = [field.flag, *(mark.flag for mark in field.marks if isinstance(mark, Alias))]
    options: dict[str, Any] = {"dest": ".".join(field.path), "default": argparse.SUPPRESS}
    text = option.help or documented(field.owner).get(field.path[-1], "")
    if SWITCH in field.marks:
        add(*flags, action="store_true", help=_escaped(text), **options)
        return
    if field.kind is bool:
        head, dot, leaf = field.flag[2:].rpartition(".")
        text += f" (default: {'on' if field.default else 'off'})"
        flags.append(f"--{head}{dot}no-{leaf}")
        add(*flags, action=_Switch, help=_escaped(text), **options)
        return
    if ARGUMENT in field.marks:
        flags, options = [options["dest"]], {"default": None}
    elif field.default is MISSING:
        options["required"] = True
    kind = Literal[tuple(option.choices)] if option.choices else field.kind
    if inner := _inner(kind):
        repeated = REPEATED in field.marks
        options |= {"action": _Repeated} if repeated else {"nargs": "*", "action": _Tuple}
        kind = inner | None if NoneType in _parts(kind) else inner
    choices = [word for part in _parts(kind) for word in _choices(part)]
    metavar = option.metavar or _metavar(kind)
    if choices and len("|".join(choices)) > SHORT:
        metavar, text = "NAME", f"{text.rstrip('.')}. One of {', '.join(choices)}."
    if choices and all(_choices(part) or part is NoneType for part in _parts(kind)):
        # The reader refuses other words, with a message of its own; completion reads the choices.
        options["choices"] = [*choices, *([None] if NoneType in _parts(kind) else [])]
    if option.nargs:
        options |= {"nargs": option.nargs, "const": option.const}
    hidden = field.default in (None, (), "", MISSING)
    shown = "" if hidden else f" (default: {_shown(field.kind, field.default)})"
    add(*flags, type=_reader(kind), metavar=metavar, help=_escaped(text + shown), **options)


class _Switch(argparse.Action):
    """``--blur`` and ``--no-blur``; in a nested dataclass ``--train.blur`` and ``--train.no-blur``."""

    def __init__(self, option_strings: Any, dest: str, **rest: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **rest)

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, option != self.option_strings[-1])


class _Tuple(argparse.Action):
    """Stores the words of a flag as a tuple; the single word None means None."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, None if values == [None] else tuple(values))


class _Repeated(argparse.Action):
    """Stores the words of a repeated flag as a tuple."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, (*getattr(namespace, self.dest, ()), values))


def _bare(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Split a type into the bare type and its annotations."""
    if get_origin(hint) is Annotated:
        return get_args(hint)[0], hint.__metadata__
    return hint, ()


def _word(kind: Any) -> Word | None:
    marks = (mark for part in _parts(kind) for mark in _bare(part)[1])
    return next((mark for mark in marks if isinstance(mark, Word)), None)


def _parts(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _inner(kind: Any) -> Any:
    """Find the type of a tuple's members; None if the type is not a tuple."""
    return next((get_args(p)[0] for p in _parts(kind) if get_origin(p) is tuple), None)


def _choices(kind: Any) -> tuple[str, ...]:
    return get_args(kind) if get_origin(kind) is Literal else ()


def _metavar(kind: Any) -> str:
    if word := _word(kind):
        return word.metavar
    parts = [part for part in _parts(kind) if part is not NoneType]
    return "|".join("|".join(_choices(p)) or _name(p) for p in parts)


def _name(kind: Any) -> str:
    return {int: "INT", float: "FLOAT", Path: "PATH", str: "TEXT"}[kind]


def _reader(kind: Any) -> Callable[[str], Any]:
    """Make a function that reads one word of a type, or says what would be right."""
    if word := _word(kind):
        return word.read

    def read(text: str) -> Any:
        parts = [part for part in _parts(kind) if part is not NoneType]
        if text == "None" and len(parts) < len(_parts(kind)):
            return None
        for part in parts:
            if choices := _choices(part):
                if text in choices:
                    return text
                continue
            try:
                return part(text)
            except ValueError:
                continue
        expected = " or ".join(
            "None"
            if p is NoneType
            else f"one of {', '.join(c)}"
            if (c := _choices(p))
            else KINDS[p]
            for p in (parts if all(map(_choices, parts)) else _parts(kind))
        )
        similar = suggestion(text, (choice for part in parts for choice in _choices(part)))
        raise argparse.ArgumentTypeError(f"must be {expected}, not {text!r}{similar}")

    return read


def _shown(kind: Any, value: Any) -> str:
    """Format a default as one would type it."""
    if word := _word(kind):
        return word.show(value)
    if isinstance(value, tuple):
        return " ".join(_shown(_inner(kind), member) for member in value)
    return str(value)


def _escaped(text: str) -> str:
    return text.strip().replace("%", "%%")


@lru_cache
def _hints(kind: type) -> dict[str, Any]:
    return hints_of(kind, include_extras=True)


@lru_cache
def documented(kind: type) -> dict[str, str]:
    """Find the docstring of each field of a dataclass and its bases, in one line.

    It follows the field, or is among the ``Attributes`` of the class.
    """
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        node = _classes(base.__module__).get(base.__name__)
        if node is None:
            continue
        section = (ast.get_docstring(node) or "").partition("\nAttributes:\n")[2]
        entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", section, re.MULTILINE)
        for field, after in zip(node.body, node.body[1:], strict=False):
            text = after.value if isinstance(after, ast.Expr) else None
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Constant)
            ):
                entries.append((field.target.id, text.value))
        texts |= {name: " ".join(text.replace("`", "").split()) for name, text in entries}
    return texts


@lru_cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """Parse the classes of a module, by name."""
    path = getattr(sys.modules.get(module), "__file__", None)
    if path is None or not path.endswith(".py"):
        return {}
    tree = ast.parse(Path(path).read_text(encoding="utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
