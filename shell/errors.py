"""What a user can get wrong, told in one line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class UserError(ValueError):
    """An argument, a file or a folder is not as it must be; the message names it and what would be right."""


def refuse_repeats(flag: str, values: Sequence[object]) -> None:
    """Raise UserError if a flag names one value twice."""
    if len(set(values)) < len(values):
        raise UserError(f"{flag} {' '.join(map(str, values))} names one of them twice")


@contextmanager
def flagged(flag: str, unless: str = "--") -> Iterator[None]:
    """Let errors of libraries name the flag that is to blame.

    Args:
        flag: of the value.
        unless: how messages begin that name their flag already.
    """
    try:
        yield
    except (ValueError, ImportError) as error:
        said = str(error)
        raise UserError(said if said.startswith(unless) else f"{flag}: {said}") from None
