"""The run folder: what is on disk, written so that a kill at any moment loses nothing.

``evaluations.jsonl`` is the run's memory: one line per reward, flushed as it happens. A run that
is started again asks it before working, so the search repeats itself from the beginning in no time and
goes on where it was; no other checkpoint is needed. ``finals.jsonl`` does the same for the final nets.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TextIO

from experiments.config import Config
from experiments.errors import UserError

PACKAGES = ("sdr-jax", "jax", "flax", "optax", "numpy", "trimesh", "embreex", "pyrender")
FREE_FIELDS = ("out", "workers")
"""Fields that may differ when a run is continued."""


def write_atomically(path: Path, text: str) -> None:
    """Write a whole file or nothing."""
    temporary = path.with_name(path.name + ".part")
    with open(temporary, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as indented JSON, whole or not at all."""
    write_atomically(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """A configuration as JSON would hold it."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    return json.loads(json.dumps(value, default=str))


def _differences(ours: Any, theirs: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in sorted(ours.keys() | theirs.keys()):
            inner = f"{name}.{key}" if name else key
            yield from _differences(ours.get(key), theirs.get(key), inner)
    elif ours != theirs:
        yield name, ours, theirs


class Log:
    """Lines of JSON, appended one by one; a half-written last line is dropped on reading."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: TextIO | None = None
        self.lines: list[dict[str, Any]] = []
        whole = 0
        if path.exists():
            for line in path.read_bytes().splitlines(keepends=True):
                if not line.endswith(b"\n"):
                    break
                try:
                    self.lines.append(json.loads(line))
                except ValueError:
                    raise UserError(
                        f"{path}: line {len(self.lines) + 1} is not JSON; "
                        "remove it and all after it, or use another --out"
                    ) from None
                whole += len(line)
            if whole < path.stat().st_size:
                with open(path, "r+b") as file:
                    file.truncate(whole)

    def append(self, record: dict[str, Any]) -> None:
        """Add one line and see it to the disk."""
        if self._file is None:
            self._file = open(self._path, "a", encoding="utf-8")
        self._file.write(json.dumps(record, allow_nan=False) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.lines.append(record)

    def close(self) -> None:
        """Close the file; more lines may follow later."""
        if self._file is not None:
            self._file.close()
            self._file = None


class RunFolder:
    """Opens a run folder, new or to be continued, and keeps a second process out of it.

    Raises:
        UserError: the folder holds the run of another configuration, something that is no run, or
            is in use.
    """

    def __init__(self, config: Config, target: str) -> None:
        self.path = config.out
        wanted = {"target": target, **plain(config)}
        if self.path.exists() and not self.path.is_dir():
            raise UserError(f"--out {self.path} is a file; it must be a folder")
        stored = self.path / "config.json"
        if self.path.exists() and any(self.path.iterdir()) and not stored.exists():
            leftovers = {"lock", "config.json.part"}
            if {p.name for p in self.path.iterdir()} - leftovers:
                raise UserError(f"--out {self.path} holds other files and no run; choose another")
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock = self._take_lock()
        if stored.exists():
            try:
                found = json.loads(stored.read_text(encoding="utf-8"))
            except ValueError:
                raise UserError(f"{stored} is not JSON; use another --out") from None
            found.pop("versions", None)
            for name, ours, theirs in _differences(wanted, found):
                if name not in FREE_FIELDS:
                    raise UserError(
                        f"--out {self.path} holds a run with {name} = {theirs}, not {ours}; "
                        "use the same flags to continue it, or another --out"
                    )
        else:
            write_json(stored, {**wanted, "versions": versions()})
        self.continued = (self.path / "evaluations.jsonl").exists()
        self.evaluations = Log(self.path / "evaluations.jsonl")
        self.finals = Log(self.path / "finals.jsonl")

    def _take_lock(self) -> TextIO:
        file = open(self.path / "lock", "w", encoding="utf-8")
        try:
            import fcntl
        except ImportError:  # not on Windows
            return file
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise UserError(f"--out {self.path} is in use by another run") from None
        return file

    @property
    def elapsed(self) -> float:
        """Seconds that earlier sessions worked on this run."""
        lines = self.evaluations.lines + self.finals.lines
        return max((line["elapsed"] for line in lines), default=0.0)

    def close(self) -> None:
        """Let go of the folder."""
        self.evaluations.close()
        self.finals.close()
        self._lock.close()


def versions() -> dict[str, str]:
    """Versions of what decides the figures."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
