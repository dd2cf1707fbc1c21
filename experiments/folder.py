"""The run folder: what is on disk, written so that a kill at any moment loses nothing.

``evaluations.jsonl`` is the run's memory: one line per reward, flushed as it happens. A run that
is started again asks it before working, so the search repeats itself from the beginning in no time and
goes on where it was; no other checkpoint is needed. ``finals.jsonl`` does the same for the final nets.
"""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, TextIO

from experiments.config import Config
from experiments.errors import UserError
from sdr_jax.tune.disk import differences, lock, naming, write_atomically, write_json
from sdr_jax.tune.disk import versions as installed

__all__ = [  # with what is passed on from `sdr_jax.tune.disk`
    "Log",
    "RunFolder",
    "naming",
    "plain",
    "refuse_foreign",
    "versions",
    "write_atomically",
    "write_json",
]

PACKAGES = ("sdr-jax", "jax", "flax", "optax", "numpy", "trimesh", "embreex", "pyrender")
FREE_FIELDS = ("out", "workers", "store")
"""Fields that may differ when a run is continued."""

EVALUATION_FIELDS = {
    "update": int,
    "dataset": int,
    "actions": list,
    "seed": int,
    "reward": float,
    "class_iou": list,
    "render_seconds": float,
    "train_seconds": float,
    "elapsed": float,
}
"""One line of ``evaluations.jsonl``."""
FINAL_FIELDS = {
    "kind": str,
    "row": str,
    "seed": int,
    "miou": float,
    "class_iou": list,
    "render_seconds": float,
    "train_seconds": float,
    "elapsed": float,
}
"""One line of ``finals.jsonl``."""


def plain(value: Any) -> Any:
    """A configuration as JSON would hold it."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    return json.loads(json.dumps(value, default=str))


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


class Log:
    """Lines of JSON, appended one by one; a half-written last line is dropped on reading.

    Args:
        path: the file; it is made with the first line.
        fields: name and type of what every line must hold.

    Raises:
        UserError: a line is not as this program writes it.
    """

    def __init__(self, path: Path, fields: dict[str, type]) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self.lines: list[dict[str, Any]] = []
        whole = 0
        if path.exists():
            for line in path.read_bytes().splitlines(keepends=True):
                if not line.endswith(b"\n"):
                    break
                self.lines.append(self._parse(line, fields))
                whole += len(line)
            if whole < path.stat().st_size:
                with open(path, "r+b") as file:
                    file.truncate(whole)

    def _parse(self, line: bytes, fields: dict[str, type]) -> dict[str, Any]:
        where = f"{self._path}: line {len(self.lines) + 1}"
        cure = "remove it and all after it, or use another --out"
        try:
            record = json.loads(line, parse_constant=_refuse_constant)
        except ValueError:
            raise UserError(f"{where} is not JSON; {cure}") from None
        if not isinstance(record, dict):
            raise UserError(f"{where} is no JSON object; {cure}")
        for name, kind in fields.items():
            if not isinstance(record.get(name), kind):
                raise UserError(f"{where}: {name} must be of type {kind.__name__}; {cure}")
        return record

    def append(self, record: dict[str, Any]) -> None:
        """Add one line and see it to the disk; on a full disk, no part of it stays."""
        line = (json.dumps(record, allow_nan=False) + "\n").encode()
        with naming(self._path):
            if self._file is None:
                self._file = open(self._path, "ab", buffering=0)
            before = os.fstat(self._file.fileno()).st_size
            try:
                rest = memoryview(line)
                while rest:
                    rest = rest[self._file.write(rest) :]
                os.fsync(self._file.fileno())
            except OSError:
                with suppress(OSError):
                    self._file.truncate(before)
                raise
        self.lines.append(record)

    def close(self) -> None:
        """Close the file; more lines may follow later."""
        if self._file is not None:
            self._file.close()
            self._file = None


def refuse_foreign(config: Config, target: str) -> None:
    """Raise UserError if ``config.out`` cannot take this run; nothing on the disk is changed.

    Args:
        config: the run; ``config.out`` is new, empty, or holds the same run.
        target: name of the target.
    """
    path, stored = config.out, config.out / "config.json"
    if path.exists() and not path.is_dir():
        raise UserError(f"--out {path} is a file; it must be a folder")
    if not path.exists():
        return
    if not stored.exists():
        if {p.name for p in path.iterdir()} - {"lock", "config.json.part"}:
            raise UserError(f"--out {path} holds other files and no run; choose another")
        return
    try:
        found = json.loads(stored.read_text(encoding="utf-8"))
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise UserError(f"{stored} is no JSON object; use another --out")
    found.pop("versions", None)
    for name, ours, theirs in differences({"target": target, **plain(config)}, found):
        if name not in FREE_FIELDS:
            raise UserError(
                f"--out {path} holds a run with {name} = {theirs}, not {ours}; "
                "use the same flags to continue it, or another --out"
            )


class RunFolder:
    """Opens a run folder, new or to be continued, and keeps a second process out of it.

    Raises:
        UserError: the folder holds the run of another configuration, something that is no run, is
            in use, or cannot be written.
    """

    def __init__(self, config: Config, target: str) -> None:
        self.path = config.out
        refuse_foreign(config, target)
        new = not self.path.exists()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = self._take_lock()
        except OSError as error:
            raise UserError(
                f"--out {self.path} cannot be written ({error.strerror}); choose another"
            ) from None
        try:
            stored = self.path / "config.json"
            if not stored.exists():
                wanted = {"target": target, **plain(config)}
                write_json(stored, {**wanted, "versions": versions()})
            self.continued = (self.path / "evaluations.jsonl").exists()
            self.evaluations = Log(self.path / "evaluations.jsonl", EVALUATION_FIELDS)
            self.finals = Log(self.path / "finals.jsonl", FINAL_FIELDS)
        except BaseException:
            self._lock.close()
            if new:
                shutil.rmtree(self.path, ignore_errors=True)
            raise

    def _take_lock(self) -> TextIO:
        try:
            return lock(self.path / "lock")
        except BlockingIOError:
            raise UserError(f"--out {self.path} is in use by another run") from None

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
    return installed(PACKAGES)
