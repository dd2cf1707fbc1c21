"""The C library's habit of giving memory back, changed: a picture soon needs the same megabytes again."""

from __future__ import annotations

import ctypes
import sys
from functools import cache

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # parameters of glibc's ``mallopt``
KEPT = 1 << 30
"""Bytes of freed memory that stay with the process, at most."""
LARGE = 1 << 25
"""Bytes from which on an array gets pages of its own; the most that glibc takes."""


@cache
def keep_freed_memory() -> None:
    """Reuse freed arrays instead of fresh pages, which the system has to clear one by one.

    About a tenth of the time of a picture (``mallopt(3)``). Where the C library is not glibc, nothing
    changes.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        libc = ctypes.CDLL("libc.so.6")
        libc.mallopt(MMAP_THRESHOLD, LARGE)
        libc.mallopt(TRIM_THRESHOLD, KEPT)
    except (OSError, AttributeError):
        return
