"""Flags from dataclasses: every field is a flag with its docstring as help; nested fields have dots.

@dataclass(frozen=True)
class Settings:
    steps: Annotated[int, Alias("-n")] = 200
    "Updates."

for field in flags_of(Settings()):
    add_flag(parser.add_argument, field)
settings = filled(Settings(), vars(parser.parse_args(["--steps", "3"])))

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

Value = TypeVar("Value")
KINDS: dict[type, str] = {int: "a whole number", float: "a number", Path: "a path", str: "a word"}
"""Types of a word of the command line, and their names in messages."""
SHORT = 24
"""Choices of more characters stand in a flag's help, not beside the flag."""


class Alias(NamedTuple):
    """Marks a field whose flag has a second name."""

    flag: str


class Option(NamedTuple):
    """Marks how a field stands on the command line, where its type and its docstring do not say it."""

    metavar: str | None = None
    flag: str | None = None  # in place of the field's name
    nargs: str | None = None
    const: Any = None  # the value of the flag without a word
    choices: Collection[str] = ()
    help: str | None = None  # in place of the docstring
    needs: tuple[str, ...] = ()  # flags without one of which it has no effect
    excludes: tuple[str, ...] = ()  # flags with which it has none


class Word(NamedTuple):
    """Marks a type whose values are one word of the command line."""

    metavar: str
    read: Callable[[str], Any]
    show: Callable[[Any], str]


UNUSED = "no flag"
"""Marks a field that is no flag of this command."""
REPEATED = "once for each"
"""Marks a tuple whose flag takes one word and is repeated for each member."""
Size = Annotated[tuple[int, int], Word("WxH", size, lambda pixels: "{}x{}".format(*pixels))]
"""Width and height in pixels, such as 640x320."""
ARGUMENT = "no flag but a word in its place"
"""Marks a field that is an argument."""
SWITCH = "no flag turns it off"
"""Marks a bool with one flag, which turns it on."""
ONE_OF = "instead of the others"
"""Marks fields of which a command line may have one."""


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
        """How it stands on the command line."""
        return next((mark for mark in self.marks if isinstance(mark, Option)), Option())


def command_line(
    name: str, kind: type, module: str, groups: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> Parser:
    """Make the parser of a command, whose result has the fields of a dataclass.

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
        usual = one_of if ONE_OF in field.marks else parser.add_argument
        if field.default is not MISSING:
            parser.set_defaults(**{field.path[0]: field.default})
        add_flag(adders.get(field.path[0], usual), field)
        if field.option.needs:
            parser.needs(field.flag, *field.option.needs)
        parser.excludes(field.flag, *field.option.excludes)
    return parser


def flags_of(value: Any, path: tuple[str, ...] = ()) -> Iterator[Field]:
    """The fields of a dataclass, or of an instance with its values, that are flags; nested ones, too."""
    kind: Any = value if isinstance(value, type) else type(value)
    hints = _hints(kind)
    for own in fields(kind):
        default, where = getattr(value, own.name, own.default), (*path, own.name)
        bare, marks = _bare(hints[own.name])
        if UNUSED in marks:
            continue
        if is_dataclass(default):
            yield from flags_of(default, where)
        else:
            word = any(isinstance(mark, Word) for mark in marks)
            yield Field(where, kind, hints[own.name] if word else bare, marks, default)


def filled(value: Value, given: Mapping[str, Any], path: tuple[str, ...] = ()) -> Value:
    """Fill a dataclass with the values of the given flags.

    Args:
        value: the defaults.
        given: values by the path of their field, joined by dots.
        path: the path of the dataclass itself.
    """
    changes: dict[str, Any] = {}
    for own in fields(value):  # type: ignore[arg-type]
        default, where = vars(value)[own.name], (*path, own.name)
        if is_dataclass(default):
            changes[own.name] = filled(default, given, where)
        elif ".".join(where) in given:
            changes[own.name] = given[".".join(where)]
    return replace(value, **changes)  # type: ignore[type-var]


def add_flag(add: Callable[..., Any], field: Field) -> None:
    """Add a field to a parser or a group; the result has it only if its flag is given.

    Args:
        add: the ``add_argument`` of the parser or group.
        field: the field, whose default the help shows.
    """
    option = field.option
    flags = [field.flag, *(mark.flag for mark in field.marks if isinstance(mark, Alias))]
    options: dict[str, Any] = {"dest": ".".join(field.path), "default": argparse.SUPPRESS}
    said = option.help or documented(field.owner).get(field.path[-1], "")
    if SWITCH in field.marks:
        add(*flags, action="store_true", help=_escaped(said), **options)
        return
    if field.kind is bool:
        head, dot, leaf = field.flag[2:].rpartition(".")
        said += f" (default: {'on' if field.default else 'off'})"
        flags.append(f"--{head}{dot}no-{leaf}")
        add(*flags, action=_Switch, help=_escaped(said), **options)
        return
    if ARGUMENT in field.marks:
        flags, options = [options["dest"]], {"default": None}
    elif field.default is MISSING:
        options["required"] = True
    kind = Literal[tuple(option.choices)] if option.choices else field.kind
    if inner := _inner(kind):
        again = REPEATED in field.marks
        options |= {"action": _Repeated} if again else {"nargs": "*", "action": _Tuple}
        kind = inner | None if NoneType in _parts(kind) else inner
    choices = [word for part in _parts(kind) for word in _choices(part)]
    metavar = option.metavar or _metavar(kind)
    if choices and len("|".join(choices)) > SHORT:
        metavar, said = "NAME", f"{said.rstrip('.')}. One of {', '.join(choices)}."
    if choices and all(_choices(part) or part is NoneType for part in _parts(kind)):
        # What is not among them the reader refuses, in words of its own; completion asks for them.
        options["choices"] = [*choices, *([None] if NoneType in _parts(kind) else [])]
    if option.nargs:
        options |= {"nargs": option.nargs, "const": option.const}
    plain = field.default in (None, (), "", MISSING)
    shown = "" if plain else f" (default: {_shown(field.kind, field.default)})"
    add(*flags, type=_reader(kind), metavar=metavar, help=_escaped(said + shown), **options)


class _Switch(argparse.Action):
    """``--blur`` and ``--no-blur``; in a nested dataclass ``--train.blur`` and ``--train.no-blur``."""

    def __init__(self, option_strings: Any, dest: str, **rest: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **rest)

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, option != self.option_strings[-1])


class _Tuple(argparse.Action):
    """The words of a flag as a tuple; the single word None means None."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, None if values == [None] else tuple(values))


class _Repeated(argparse.Action):
    """The words of a repeated flag as a tuple."""

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
    """The type of a tuple's members; None if the type is no tuple."""
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
    """A function that reads one word of a type, or says what would be right."""
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
        wanted = " or ".join(
            "None"
            if p is NoneType
            else f"one of {', '.join(c)}"
            if (c := _choices(p))
            else KINDS[p]
            for p in _parts(kind)
        )
        raise argparse.ArgumentTypeError(f"must be {wanted}, not {text!r}")

    return read


def _shown(kind: Any, value: Any) -> str:
    """A default as one would type it."""
    if word := _word(kind):
        return word.show(value)
    if isinstance(value, tuple):
        return " ".join(_shown(_inner(kind), one) for one in value)
    return str(value)


def _escaped(text: str) -> str:
    return text.strip().replace("%", "%%")


@lru_cache
def _hints(kind: type) -> dict[str, Any]:
    return hints_of(kind, include_extras=True)


@lru_cache
def documented(kind: type) -> dict[str, str]:
    """The docstring of each field of a dataclass and its bases, in one line.

    It stands behind the field, or among the ``Attributes`` of the class.
    """
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        node = _classes(base.__module__).get(base.__name__)
        if node is None:
            continue
        section = (ast.get_docstring(node) or "").partition("\nAttributes:\n")[2]
        entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", section, re.MULTILINE)
        for field, after in zip(node.body, node.body[1:], strict=False):
            said = after.value if isinstance(after, ast.Expr) else None
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(said, ast.Constant)
            ):
                entries.append((field.target.id, said.value))
        found |= {name: " ".join(text.replace("`", "").split()) for name, text in entries}
    return found


@lru_cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The classes of a module by name."""
    path = getattr(sys.modules.get(module), "__file__", None)
    if path is None or not path.endswith(".py"):
        return {}
    tree = ast.parse(Path(path).read_text(encoding="utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
