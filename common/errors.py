"""Errors of the user, whose message is one line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches

SIMILAR = 0.75
"""The least similarity of a suggestion, see `difflib.get_close_matches`: sede suggests seed, start does not
suggest target."""


class UserError(ValueError):
    """An argument, a file or a folder is wrong; the message names it and says what would be right."""


class Unfinished(UserError):
    """A part of the work could not be done; a command ends with code 1, not 2."""


def printable(text: str) -> str:
    """Replace control characters, which a terminal would obey, by their codes."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def printable_lines(text: str) -> str:
    """As `printable`, but line by line."""
    return "\n".join(map(printable, text.split("\n")))


def counted(count: int, noun: str) -> str:
    """A number with its noun: "1 image", "1,200 images"."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


def hint(word: object, names: Iterable[str]) -> str:
    """Write "did you mean car?" for a word that resembles a name, otherwise list the names."""
    names = list(names)
    return suggestion(str(word), names).removeprefix("; ") or f"known: {', '.join(names)}"


def suggestion(word: str, names: Iterable[str]) -> str:
    """Write ``; did you mean --seeds?`` for a word that resembles a name, otherwise nothing."""
    names = list(names)
    leaf = word.lstrip("-")
    similar = [name for name in names if name.rpartition(".")[2] == leaf][:2]
    if not similar:  # dashes alone make no word similar
        bare = {name.lstrip("-"): name for name in names}
        similar = [bare[name] for name in get_close_matches(leaf, bare, 1, SIMILAR)]
    return f"; did you mean {' or '.join(similar)}?" if similar else ""


def refuse_repeats(flag: str, values: Sequence[object]) -> None:
    """Raise UserError if a flag has a value twice."""
    if len(set(values)) < len(values):
        raise UserError(f"{flag} {' '.join(map(str, values))} has a value twice")


@contextmanager
def flagged(flag: str, unless: str = "--") -> Iterator[None]:
    """Make errors of libraries name the flag of the wrong value.

    Args:
        flag: the flag of the value.
        unless: beginning of messages that already name their flag.
    """
    try:
        yield
    except (ValueError, ImportError) as error:
        message = str(error)
        raise UserError(message if message.startswith(unless) else f"{flag}: {message}") from None
