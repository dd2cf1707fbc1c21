"""Refuse sizes that do not fit into memory before it is allocated."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections.abc import Callable
from functools import cache
from pathlib import Path

from common.errors import UserError

LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""The files with the memory limit of a container."""
UNITS = ("B", "kB", "MB", "GB", "TB", "PB", "EB")
MOST = 2**62
"""The largest count."""


@cache
def memory() -> int:
    """The bytes of memory of this machine, or of the container that this process runs in."""
    limits = [MOST]
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for path in map(Path, LIMITS):
        text = path.read_text().strip() if path.is_file() else ""
        limits += [int(text)] if text.isdigit() else []
    return min(limits)


def in_words(size: float) -> str:
    """Format a number of bytes, such as ``12 MB``."""
    if size >= MOST:
        return "more than 4,000 PB"
    power = 0
    while size >= 1000:
        size, power = size / 1000, power + 1
    return f"{size:.3g} {UNITS[power]}"


def refuse_larger(flag: str, value: int, need: Callable[[int], int], what: str) -> None:
    """Raise UserError if a number of things needs more memory than this machine has.

    Args:
        flag: the flag of the number.
        value: the number.
        need: the least bytes that a number of things takes; grows with the number.
        what: the things in a few words.
    """
    if need(value) <= memory():
        return
    most = bisect_right(range(min(value, MOST)), memory(), key=need) - 1
    raise UserError(
        f"{flag} {value} would take {in_words(need(value))} of memory for {what}, but only "
        f"{in_words(memory())} are available: use at most {max(most, 0)}"
    )
