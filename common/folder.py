"""The folder of a job, which records its job and refuses another job or a second process."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from common.errors import UserError
from common.files import read_json, versions, write_json

CONFIG, LOCK = "config.json", "lock"
VERSION = 1
"""Version of the layout of ``config.json``. A file without a version is of version 1."""


def read_config(path: Path) -> dict[str, Any]:
    """Read the ``config.json`` of a folder, without its version.

    Raises:
        UserError: it is not a JSON object, or of an unknown version.
    """
    file = path / CONFIG
    try:
        config = read_json(file)
    except ValueError:
        config = None
    if not isinstance(config, dict):
        raise UserError(f"{file} is not a JSON object")
    version = config.pop("version", 1)
    if version != VERSION:
        raise UserError(
            f"{file} has version {json.dumps(version)}, but this program reads version {VERSION}"
        )
    return config


def refuse_unwritable(path: Path) -> None:
    """Raise UserError if ``--out`` is a file, or cannot be written; it need not exist yet."""
    existing = next(p for p in (path.absolute(), *path.absolute().parents) if p.exists())
    if path.exists() and not path.is_dir():
        raise UserError(f"--out {path} is a file; it must be a folder")
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        why = "read-only" if existing.is_dir() else "a file"
        raise UserError(f"--out {path} cannot be written ({existing} is {why}); choose another")


def refuse_other_files(path: Path, allowed: Sequence[str] = ()) -> None:
    """Raise UserError if ``--out`` cannot be written, or contains no run and files that are not allowed."""
    refuse_unwritable(path)
    if path.exists() and not (path / CONFIG).exists():
        if {entry.name for entry in path.iterdir()} - {LOCK, f"{CONFIG}.part", *allowed}:
            raise UserError(f"--out {path} contains other files and no run; choose another")


def refuse_foreign(
    path: Path, config: dict[str, Any], free: Sequence[str] = (), allowed: Sequence[str] = ()
) -> None:
    """Raise UserError if a folder cannot take this job; the disk is not changed.

    Args:
        path: ``--out``: new, empty, or the folder of the same job.
        config: all settings of the job as plain values.
        free: dotted names of values that may differ when a job is resumed.
        allowed: files that a folder may contain before its job, besides the lock.
    """
    refuse_other_files(path, allowed)
    if not (path / CONFIG).exists():
        return
    try:
        recorded = read_config(path)
    except UserError as error:
        raise UserError(f"{error}; use another --out") from None
    recorded.pop("versions", None)
    preset = recorded.get("preset")
    if preset is not None and config.get("preset") not in (None, preset):  # it sets other values
        raise UserError(
            f"--out {path} holds a run that was started with --preset {preset}; use that preset to resume "
            "it, or another --out"
        )
    for name, requested, former in differences(as_json(config), recorded):
        if name not in free:
            raise UserError(
                f"--out {path} holds a run with {name} = {json.dumps(former)}, not "
                f"{json.dumps(requested)}; restore that value to resume it, or use another --out"
            )


@contextmanager
def opened(
    path: Path,
    config: dict[str, Any],
    *,
    free: Sequence[str] = (),
    allowed: Sequence[str] = (),
    packages: Sequence[str] = (),
) -> Iterator[bool]:
    """Open the folder of a new or resumed job, and lock out other processes.

    Args:
        path: the folder.
        config: all settings of the job, recorded in ``config.json`` with its version and those of packages.
        free: dotted names of values that may differ when a job is resumed.
        allowed: files that a folder may contain before its job.
        packages: the packages whose versions are recorded.

    Yields:
        Whether the job is resumed.

    Raises:
        UserError: the folder holds another job or other files, is in use, or cannot be written.
    """
    refuse_foreign(path, config, free, allowed)
    new = not path.exists()
    lock = FileLock(path / LOCK, timeout=0)
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise UserError(f"--out {path} is in use by another run") from None
    except OSError as error:
        if new:
            shutil.rmtree(path, ignore_errors=True)
        raise UserError(
            f"--out {path} cannot be written ({error.strerror}); choose another"
        ) from None
    try:
        refuse_foreign(path, config, free, allowed)  # another process may have been first
        resumed = (path / CONFIG).exists()
        if not resumed:
            record = {"version": VERSION, **as_json(config), "versions": versions(packages)}
            write_json(path / CONFIG, record)
        yield resumed
    finally:
        lock.release()
        if new and not (path / CONFIG).exists():
            shutil.rmtree(path, ignore_errors=True)


def as_json(value: Any) -> Any:
    """Convert a value as JSON would; types that JSON lacks, such as paths, become text."""
    return json.loads(json.dumps(value, default=str))


def differences(new: Any, old: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (dotted name, new, old) for every value of nested objects that differs.

    Objects in a list are compared one by one if they have names.
    """
    if isinstance(new, dict) and isinstance(old, dict):
        for key in sorted(new.keys() | old.keys()):
            inner = f"{name}.{key}" if name else key
            yield from differences(new.get(key), old.get(key), inner)
    elif _named(new) and isinstance(old, list) and len(new) == len(old):
        for new_item, old_item in zip(new, old, strict=True):
            yield from differences(new_item, old_item, f"{name}.{new_item['name']}")
    elif new != old:
        yield name, new, old


def _named(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, dict) and "name" in v for v in value)
