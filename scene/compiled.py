"""Keeps compiled functions on disk between processes.

Numba checks only a function's own file to see whether its cache is valid. Our functions call functions and
use constants of other files, so each state of the sources has its own folder.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

VARIABLE = "NUMBA_CACHE_DIR"
NAME = "kernels-"
"""Prefix of the folders' names; a digest follows."""
WITHOUT = ("assets", "preview")
"""Folders of ``scene`` without compiled functions and without constants of these."""


def njit(**options: Any) -> Any:
    """``numba.njit`` with these options, with a cache for each state of all sources."""

    def decorate(function: Callable[..., Any]) -> Any:
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _folder()
        try:
            return numba.njit(**options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return decorate


def first_use(renderer: str) -> Path | None:
    """The file that marks that a renderer's functions are kept, if they are not yet; else None.

    Who makes the file has rendered with it.
    """
    marker = kept(renderer)
    return None if marker.exists() else marker


def kept(name: str) -> Path:
    """A file of this kind of processor that is kept as long as the compiled functions."""
    cpu = llvmlite.binding.get_host_cpu_name()
    return Path(_folder()) / f"{numba.__version__}-{cpu}-{name}"


@cache
def _folder() -> str:
    """The first folder that can be written: the user's choice, beside the sources, in the home."""
    package = Path(__file__).parent
    name = NAME + _sources(package)
    for root in _roots(package):
        folder = root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        if root.parent == package:  # earlier states of the same sources
            for other in root.glob(NAME + "*"):
                if other != folder:
                    shutil.rmtree(other, ignore_errors=True)
        return str(folder)
    # An unpredictable name, since files there are run. Child processes find it, too.
    made = os.environ[VARIABLE] = tempfile.mkdtemp(prefix="sdr-jax-")
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    print(
        f"Neither {package} nor a home folder can be written to: functions are compiled for this run only, "
        f"which takes a minute. Set {VARIABLE} to a folder that can be.",
        file=sys.stderr,
        flush=True,
    )
    return str(Path(made) / name)


def _roots(package: Path) -> Iterator[Path]:
    if os.environ.get(VARIABLE):
        yield Path(os.environ[VARIABLE]).absolute()
    yield package / "__pycache__"
    with suppress(RuntimeError):  # no home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sdr-jax"


def _sources(package: Path) -> str:
    """A digest of all files on which compiled functions depend."""
    found = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        own = path.relative_to(package)
        if own.parts[0] not in WITHOUT:
            found.update(f"{own.as_posix()} ".encode() + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]
