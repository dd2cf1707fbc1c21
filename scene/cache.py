"""Keeps arrays that take long to make on disk between processes: shapes of assets, textures, cloud maps.

They lie in ``$SDR_JAX_CACHE``, by default ``sdr-jax`` in ``$XDG_CACHE_HOME`` or ``~/.cache``; ``off`` keeps
nothing. All files there may be deleted at any moment. Each version of the engine, and each state of its
sources, has its own folder. Files are written whole or not at all, so that processes can share them; nothing
is unpickled; arrays that cannot be read or written are made anew, as without a cache.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from scene.version import ENGINE

VARIABLE = "SDR_JAX_CACHE"
MOST = 512 * 2**20
"""The most bytes of all files; beyond it the oldest are deleted."""
KEPT = 0.75
"""Share of these bytes that stays."""
LOOK = 100
"""Number of files that a process writes between two checks of the total size."""

OURS = f"[0-9]*-{'[0-9a-f]' * 16}/*"
"""Where the files of this module are below its root, in which others may lie."""
SUFFIXES = (".npz", ".new")
"""Their endings; the second is of unfinished ones."""

Arrays = dict[str, np.ndarray]
_written = 0


def kept(
    name: str, make: Callable[[], Arrays], sound: Callable[[Arrays], bool] = lambda found: True
) -> Arrays:
    """The arrays of ``make()``, from disk if they are there.

    Args:
        name: name of the file; the same name must always stand for the same arrays.
        make: makes the arrays.
        sound: whether arrays from disk can be used.
    """
    folder = _folder(os.environ.get(VARIABLE, ""), os.environ.get("XDG_CACHE_HOME", ""))
    if folder is None:
        return make()
    path = folder / f"{name}.npz"
    found = _read(path)
    if found is None or not sound(found):
        found = make()
        _write(path, found)
    return found


@cache
def _folder(wanted: str, caches: str) -> Path | None:
    """The folder of this engine's files; None if none are kept."""
    if wanted == "off":
        return None
    try:
        root = Path(wanted) if wanted else Path(caches or Path.home() / ".cache") / "sdr-jax"
        return root / f"{ENGINE}-{_sources()}"
    except (OSError, RuntimeError):  # no home, or sources that cannot be read
        return None


@cache
def _sources() -> str:
    """A digest of the code that makes these arrays."""
    digest = hashlib.sha256(np.__version__.encode())
    package = Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _read(path: Path) -> Arrays | None:
    """Read the arrays of a file, or None. The file's checksums tell whether it is whole."""
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, NotImplementedError):
        return None


def _write(path: Path, arrays: Arrays) -> None:
    """Write a file under a temporary name and rename it when it is whole; ignore failures."""
    global _written
    if _written < 0:  # nothing can be written here
        return
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if _written % LOOK == 0:
            _bound(path.parents[1])
        handle, temporary = tempfile.mkstemp(".new", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **cast(dict[str, Any], arrays))
        os.replace(temporary, path)
        _written += 1
    except OSError:
        _written = -1
        if temporary is not None:
            with suppress(OSError):
                Path(temporary).unlink()


def _bound(root: Path) -> None:
    """Delete the oldest files of arrays if all take more than ``MOST`` bytes."""
    files = []
    for path in root.glob(OURS):
        if path.suffix not in SUFFIXES:
            continue
        try:
            status = path.stat()
        except OSError:  # another process was faster
            continue
        files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    if total <= MOST:
        return
    for _, size, path in sorted(files):
        if total <= KEPT * MOST:
            return
        try:
            path.unlink()
        except OSError:
            continue
        total -= size
