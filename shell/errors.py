"""What a user can get wrong, told in one line."""

from __future__ import annotations

from collections.abc import Sequence


class UserError(ValueError):
    """An argument, a file or a folder is not as it must be; the message names it and what would be right."""


def refuse_repeats(flag: str, values: Sequence[object]) -> None:
    """Raise UserError if a flag names one value twice."""
    if len(set(values)) < len(values):
        raise UserError(f"{flag} {' '.join(map(str, values))} names one of them twice")
