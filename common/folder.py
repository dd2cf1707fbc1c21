"""A job's folder, which names its job and refuses another job or a second process."""

from __future__ import annotations

import json
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
        UserError: it is no JSON object, or of an unknown version.
    """
    file = path / CONFIG
    try:
        found = read_json(file)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise UserError(f"{file} is no JSON object")
    version = found.pop("version", 1)
    if version != VERSION:
        raise UserError(
            f"{file} has version {json.dumps(version)}, and this program reads version {VERSION}"
        )
    return found


def refuse_foreign(
    path: Path, config: dict[str, Any], free: Sequence[str] = (), ours: Sequence[str] = ()
) -> None:
    """Raise UserError if a folder cannot take this job; the disk is not changed.

    Args:
        path: ``--out``: new, empty, or the folder of the same job.
        config: all settings of the job as plain values.
        free: dotted names of values that may differ when a job is continued.
        ours: files that a folder may hold before its job, beside the lock.
    """
    if not path.exists():
        return
    if not path.is_dir():
        raise UserError(f"--out {path} is a file; it must be a folder")
    if not (path / CONFIG).exists():
        if {entry.name for entry in path.iterdir()} - {LOCK, f"{CONFIG}.part", *ours}:
            raise UserError(f"--out {path} holds other files and no run; choose another")
        return
    try:
        found = read_config(path)
    except UserError as error:
        raise UserError(f"{error}; use another --out") from None
    found.pop("versions", None)
    begun = found.get("preset")
    if begun is not None and config.get("preset") not in (None, begun):  # it decides other values
        raise UserError(
            f"--out {path} holds a run that was begun with --preset {begun}; use that preset to continue it, "
            "or another --out"
        )
    for name, mine, theirs in differences(plain(config), found):
        if name not in free:
            raise UserError(
                f"--out {path} holds a run with {name} = {json.dumps(theirs)}, not "
                f"{json.dumps(mine)}; put that back to continue it, or use another --out"
            )


@contextmanager
def opened(
    path: Path,
    config: dict[str, Any],
    *,
    free: Sequence[str] = (),
    ours: Sequence[str] = (),
    packages: Sequence[str] = (),
) -> Iterator[bool]:
    """Open the folder of a new or continued job, and lock out other processes.

    Args:
        path: the folder.
        config: all settings of the job; ``config.json`` holds them with its version and those of packages.
        free: dotted names of values that may differ when a job is continued.
        ours: files that a folder may hold before its job.
        packages: the packages whose versions are recorded.

    Yields:
        Whether the job is continued.

    Raises:
        UserError: the folder holds another job or other files, is in use, or cannot be written.
    """
    refuse_foreign(path, config, free, ours)
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
        refuse_foreign(path, config, free, ours)  # another process may have been first
        continued = (path / CONFIG).exists()
        if not continued:
            told = {"version": VERSION, **plain(config), "versions": versions(packages)}
            write_json(path / CONFIG, told)
        yield continued
    finally:
        lock.release()
        if new and not (path / CONFIG).exists():
            shutil.rmtree(path, ignore_errors=True)


def plain(value: Any) -> Any:
    """A value as JSON would hold it; types that JSON lacks, such as paths, become text."""
    return json.loads(json.dumps(value, default=str))


def differences(ours: Any, theirs: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (dotted name, ours, theirs) for every value of nested objects that differs.

    Objects in a list are compared by name if they have names.
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
