"""Files that a kill at any moment leaves whole, a folder's lock, and what decides figures by version."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TextIO


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Errors of the disk name ``path``; a write that finds the disk full names no file by itself."""
    try:
        yield
    except OSError as error:
        error.filename = str(path)
        raise


def write_atomically(path: Path, data: str | bytes) -> None:
    """Write a whole file or nothing."""
    part = path.with_name(path.name + ".part")
    with naming(path):
        try:
            with open(part, "wb") as file:
                file.write(data.encode() if isinstance(data, str) else data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as indented JSON, whole or not at all."""
    write_atomically(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def differences(ours: Any, theirs: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (dotted name, ours, theirs) of every value of nested objects that is not the same.

    A list of objects that have names is compared one by one.
    """
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in sorted(ours.keys() | theirs.keys()):
            inner = f"{name}.{key}" if name else key
            yield from differences(ours.get(key), theirs.get(key), inner)
    elif _named(ours) and isinstance(theirs, list) and len(ours) == len(theirs):
        for mine, other in zip(ours, theirs, strict=True):
            yield from differences(mine, other, f"{name}.{mine['name']}")
    elif ours != theirs:
        yield name, ours, theirs


def _named(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, dict) and "name" in v for v in value)


def lock(path: Path) -> TextIO:
    """Open and lock a file, until it is closed or the process ends.

    Raises:
        BlockingIOError: another process holds it.
    """
    file = open(path, "w", encoding="utf-8")
    try:
        import fcntl
    except ImportError:  # not on Windows
        return file
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise
    return file


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Versions of packages, by name."""
    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
