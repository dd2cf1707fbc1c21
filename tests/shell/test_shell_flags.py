"""Flags of dataclasses: names, kinds, defaults, and what is said of a wrong word."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from shell.command import Parser
from shell.flags import UNUSED, Alias, Word, add_flag, documented, filled, flags_of

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
    return filled(Settings(), vars(parser.parse_args(words)))


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
    found = read(*words.split())
    assert found == changed and type(found.share) is type(changed.share)


@pytest.mark.parametrize(("words", "said"), [
    ("--count x", "argument --count: must be a whole number, not 'x'"),
    ("--share x", "must be a whole number or a number or None, not 'x'"),
    ("--words a c", "must be one of a, b, not 'c'"),
    ("--hidden 3", "no option --hidden"),
    ("--lerning-rate 3", "no option --lerning-rate; did you mean --train.learning-rate?"),
])  # fmt: skip
def test_a_wrong_word_is_one_line(words, said, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        read(*words.split())
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1


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
