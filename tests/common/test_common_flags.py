"""Flags of dataclasses: names, types, defaults, and messages about a wrong word."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from common.command import Parser
from common.flags import (
    ARGUMENT,
    ONE_OF,
    SWITCH,
    UNUSED,
    Alias,
    Option,
    Size,
    Word,
    add_flag,
    command_line,
    documented,
    fill,
    flags_of,
)

Pair = Annotated[tuple[str, ...], Word("A,B", lambda word: tuple(word.split(",")), ",".join)]


@dataclass(frozen=True)
class Inner:
    """Nested.

    Attributes:
        learning_rate: how fast, at 5 %
            of all.
        net: which.
    """

    learning_rate: float = 0.1
    net: Literal["lite0", "compact"] = "compact"


@dataclass(frozen=True)
class Base:
    """One."""

    count: int = 3
    """Of things."""
    hidden: Annotated[int, UNUSED] = 4


@dataclass(frozen=True)
class Settings(Base):
    """Two."""

    count: Annotated[int, "a bound"] = 5
    share: int | float | None = None
    """A number or ``None``."""
    path: Path | None = None
    words: tuple[Literal["a", "b"], ...] = ("a",)
    sizes: tuple[int, ...] | None = None
    pairs: tuple[Pair, ...] = (("x", "y"), ("z",))
    on: bool = True
    train: Inner = field(default_factory=Inner)
    method: Annotated[str, Alias("--how")] = "sdr"


def read(*words: str) -> Settings:
    parser = Parser("x", None)
    for one in flags_of(Settings()):
        add_flag(parser.add_argument, one)
    return fill(Settings(), vars(parser.parse_args(words)))


@pytest.mark.parametrize(("words", "changed"), [
    ("", Settings()),
    ("--count 7 --share 2", Settings(count=7, share=2)),
    ("--share=0.5 --how tpe", Settings(share=0.5, method="tpe")),
    ("--share None --path None --sizes None", Settings()),
    ("--path a/b --words b a --sizes 1 2", Settings(path=Path("a/b"), words=("b", "a"), sizes=(1, 2))),
    ("--words --no-on", Settings(words=(), on=False)), ("--no-on --on", Settings()),
    ("--pairs p,q r", Settings(pairs=(("p", "q"), ("r",)))),
    ("--train.learning-rate 3 --train.net lite0", Settings(train=Inner(3.0, "lite0"))),
    ("--train.learning_rate=3", Settings(train=Inner(3.0))),
])  # fmt: skip
def test_words_become_values(words, changed):
    settings = read(*words.split())
    assert settings == changed and type(settings.share) is type(changed.share)


@pytest.mark.parametrize(("words", "message"), [
    ("--count x", "argument --count: must be a whole number, not 'x'"),
    ("--share x", "must be a whole number or a number or None, not 'x'"),
    ("--words a c", "must be one of a, b, not 'c'"),
    ("--hidden 3", "no option --hidden"),
    ("--lerning-rate 3", "no option --lerning-rate; did you mean --train.learning-rate?"),
])  # fmt: skip
def test_a_wrong_word_is_one_line(words, message, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        read(*words.split())
    line = capsys.readouterr().err
    assert message in line and line.count("\n") == 1


def test_the_help_has_docstrings_and_defaults(capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        read("--help")
    text = " ".join(capsys.readouterr().out.split())
    for part in (
        "--count INT Of things. (default: 5)", "--share INT|FLOAT A number or None. --path",
        "how fast, at 5 % of all. (default: 0.1)", "(default: x,y z)", "--on, --no-on (default: on)",
        "--train.net lite0|compact which. (default: compact)", "--method, --how TEXT",
    ):  # fmt: skip
        assert part in text, part
    assert documented(Settings)["count"] == "Of things."


@dataclass(frozen=True, kw_only=True)
class Options:
    """Of a command."""

    run: Annotated[Path, ARGUMENT, Option("RUN")]
    """Folder."""
    files: Annotated[tuple[Path, ...], ARGUMENT, Option("FILE", nargs="*")] = ()
    out: Annotated[Path, Option("DIR")]
    """Where to."""
    how: Annotated[str, Option(flag="--as", choices=("ids", "colours"))] = "ids"
    """Content."""
    serve: Annotated[int | None, Option("PORT", nargs="?", const=80)] = None
    size: Size | None = None
    rank: Annotated[bool, SWITCH] = False
    """Order."""
    first: Annotated[int, Option("N", needs=("--rank",), excludes=("--size",))] = 7
    a: Annotated[str | None, ONE_OF] = None
    b: Annotated[str | None, ONE_OF] = None


def test_a_similar_choice_is_suggested(capsys):
    for word, end in (("colour", "; did you mean colours?"), ("xyz", "")):
        words = ["r", "--out", "o", "--as", word]
        with pytest.raises(SystemExit, match=r"^2$"):
            command_line("x", Options, "common.flags").parse_args(words)
        error = f"argument --as: must be one of ids, colours, not '{word}'{end}\n"
        assert capsys.readouterr().err.endswith(error)


@pytest.mark.parametrize(("words", "values"), [
    ("r --out o", {}), ("r f g --out o", {"files": (Path("f"), Path("g"))}),
    ("r --out o --as colours --serve --size 3x4", {"how": "colours", "serve": 80, "size": (3, 4)}),
    ("r --out o --serve 9 --rank --first 2 --b x", {"serve": 9, "rank": True, "first": 2, "b": "x"}),
])  # fmt: skip
def test_a_command_line_is_the_fields_of_a_dataclass(words, values):
    parsed = vars(command_line("x", Options, "common.flags").parse_args(words.split()))
    defaults = {name: value for name, value in vars(Options).items() if name in parsed}
    paths = {"run": Path("r"), "out": Path("o"), "debug": False}
    assert parsed == {**defaults, **paths, **values}


@pytest.mark.parametrize(("words", "message"), [
    ("r", "arguments are required: --out"), ("--out o", "are required: RUN"),
    ("r --out o --first 2", "--first needs --rank"), ("r --out o --how ids", "no option --how"),
    ("r --out o --rank --first 2 --size 1x1", "--first has no effect with --size"),
    ("r --out o --as x", "argument --as: must be one of ids, colours, not 'x'"),
    ("r --out o --size 3", "must look like 640x320, not '3'"), ("r --out o --no-rank", "no option --no-rank"),
    ("r --out o --a x --b y", "argument --b: not allowed with argument --a"),
])  # fmt: skip
def test_marks_of_fields_are_rules_of_the_command_line(words, message, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        command_line("x", Options, "common.flags").parse_args(words.split())
    line = capsys.readouterr().err
    assert message in line and line.count("\n") == 1


def test_groups_of_a_command_line_are_shown_by_all_of_its_help():
    line = command_line("x", Options, "common.flags", {"rare": ("serve", "size")})
    short, whole = line.format_help(), line.format_help(True)
    assert "show 2 more options: rare" in short and "--size" not in short
    text = " ".join(whole.split())
    assert "--size WxH" in text and "--as ids|colours Content. (default: ids)" in text
