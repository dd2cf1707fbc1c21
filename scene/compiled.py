"""Cache compiled functions on disk.

Numba checks only a function's own file to see whether its cache is valid. Our functions use functions and
constants of other files, so each state of the sources has its own folder.
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
"""Prefix of folder names; a digest follows."""
WITHOUT = ("assets", "preview")
"""Folders of ``scene`` without compiled functions and without constants that these use."""


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
    """The marker file of a renderer if its functions are not compiled yet, else None.

    The caller creates it after rendering.
    """
    marker = cache_file(renderer)
    return None if marker.exists() else marker


def cache_file(name: str) -> Path:
    """The path of a file for this kind of processor that lives as long as the compiled functions."""
    cpu = llvmlite.binding.get_host_cpu_name()
    return Path(_folder()) / f"{numba.__version__}-{cpu}-{name}"


@cache
def _folder() -> str:
    """The first writable folder: the user's choice, next to the sources, in the home."""
    package = Path(__file__).parent
    name = NAME + _sources(package)
    for root in _roots(package):
        folder = root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        if root.parent == package:  # remove earlier states of the same sources
            for other in root.glob(NAME + "*"):
                if other != folder:
                    shutil.rmtree(other, ignore_errors=True)
        return str(folder)
    # An unpredictable name, since code in this folder is run. Child processes inherit the variable.
    temporary = os.environ[VARIABLE] = tempfile.mkdtemp(prefix="sdr-jax-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    print(
        f"Neither {package} nor a home folder is writable, so functions are compiled for this run only, "
        f"which takes a minute. Set {VARIABLE} to a writable folder.",
        file=sys.stderr,
        flush=True,
    )
    return str(Path(temporary) / name)


def _roots(package: Path) -> Iterator[Path]:
    if os.environ.get(VARIABLE):
        yield Path(os.environ[VARIABLE]).absolute()
    yield package / "__pycache__"
    with suppress(RuntimeError):  # no home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sdr-jax"


def _sources(package: Path) -> str:
    """A digest of the package's files on which compiled functions depend."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        relative = path.relative_to(package)
        if relative.parts[0] not in WITHOUT:
            digest.update(f"{relative.as_posix()} ".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]
