"""Cache arrays that take long to compute on disk: shapes of assets, textures, cloud maps.

The cache is in ``$SDR_JAX_CACHE``, by default ``sdr-jax`` in ``$XDG_CACHE_HOME`` or ``~/.cache``; ``off``
disables it. All its files may be deleted at any time. Each version of the engine, and each state of its
sources, has its own folder. Files are written atomically, so that processes can share them; nothing is
unpickled; arrays that cannot be read or written are computed, as without a cache.
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
"""Largest size of all files in bytes; above it, the oldest are deleted."""
KEPT = 0.75
"""Share of this size that is kept then."""
LOOK = 100
"""Number of files that a process writes between two checks of the size."""

OURS = f"[0-9]*-{'[0-9a-f]' * 16}/*"
"""Pattern of this module's files below its root, which may hold other files."""
SUFFIXES = (".npz", ".new")
"""Their endings; the second is for unfinished files."""

Arrays = dict[str, np.ndarray]
_written = 0


def cached(
    name: str, make: Callable[[], Arrays], is_valid: Callable[[Arrays], bool] = lambda arrays: True
) -> Arrays:
    """The arrays of ``make()``, from disk if possible.

    Args:
        name: name of the file; the same name must always mean the same arrays.
        make: computes the arrays.
        is_valid: whether arrays from disk can be used.
    """
    folder = _folder(os.environ.get(VARIABLE, ""), os.environ.get("XDG_CACHE_HOME", ""))
    if folder is None:
        return make()
    path = folder / f"{name}.npz"
    arrays = _read(path)
    if arrays is None or not is_valid(arrays):
        arrays = make()
        _write(path, arrays)
    return arrays


@cache
def _folder(setting: str, caches: str) -> Path | None:
    """The folder of this engine's files, or None without a cache."""
    if setting == "off":
        return None
    try:
        root = Path(setting) if setting else Path(caches or Path.home() / ".cache") / "sdr-jax"
        return root / f"{ENGINE}-{_sources()}"
    except (OSError, RuntimeError):  # no home, or unreadable sources
        return None


@cache
def _sources() -> str:
    """A digest of the code that computes these arrays."""
    digest = hashlib.sha256(np.__version__.encode())
    package = Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _read(path: Path) -> Arrays | None:
    """Read the arrays of a file, or None. Its checksums show whether it is complete."""
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, NotImplementedError):
        return None


def _write(path: Path, arrays: Arrays) -> None:
    """Write a file under a temporary name and rename it when it is complete; ignore failures."""
    global _written
    if _written < 0:  # an earlier write failed
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
    """Delete the oldest files if all take more than ``MOST`` bytes."""
    files = []
    for path in root.glob(OURS):
        if path.suffix not in SUFFIXES:
            continue
        try:
            status = path.stat()
        except OSError:  # another process has deleted it
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
