"""The run folder: what is on disk, written so that a kill at any moment loses nothing told."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from sdr_jax.tune import disk
from sdr_jax.tune.errors import TuneError
from sdr_jax.tune.settings import Settings

FREE_FIELDS = ("evaluations", "timeout_seconds", "retries", "workers")
"""Fields that may differ when a run is continued: none changes what was scored before."""

PACKAGES = ("sdr-jax", "jax", "numpy")
OURS = {"lock", "config.json.part", "evaluations"}
"""What a folder may hold before there is a run in it."""


class RunFolder:
    """Opens a run folder, new or to be continued, and keeps a second process out of it.

    Args:
        path: the folder.
        settings: of the run.
        command: the simulator.

    Attributes:
        evaluations: folder with a folder for every evaluation.
        history: the file with a line for every evaluation.

    Raises:
        TuneError: it holds another run, something that is no run, is in use, or cannot be written.
    """

    def __init__(self, path: Path, settings: Settings, command: Sequence[str]) -> None:
        self.path = path
        self.evaluations = path / "evaluations"
        self.history = path / "evaluations.jsonl"
        config = json.loads(json.dumps({**asdict(settings), "command": list(command)}))
        if path.exists() and not path.is_dir():
            raise TuneError(f"--out {path} is a file; it must be a folder")
        self._refuse_foreign(config)
        path.mkdir(parents=True, exist_ok=True)
        self._lock = self._take_lock()
        try:
            self._refuse_foreign(config)  # another process may have been first
            disk.write_json(path / "config.json", {**config, "versions": disk.versions(PACKAGES)})
        except BaseException:
            self._lock.close()
            raise

    def forget(self) -> None:
        """Takes back that there is a run here; what the simulator left stays to be looked at."""
        self.history.unlink(missing_ok=True)
        (self.path / "config.json").unlink(missing_ok=True)

    def close(self) -> None:
        """Lets go of the folder."""
        self._lock.close()

    def _refuse_foreign(self, config: dict[str, Any]) -> None:
        if not self.path.exists():
            return
        stored = self.path / "config.json"
        if not stored.exists():
            if {entry.name for entry in self.path.iterdir()} - OURS:
                raise TuneError(f"--out {self.path} holds other files and no run; choose another")
            return
        try:
            found = json.loads(stored.read_text(encoding="utf-8"))
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise TuneError(f"{stored} is no JSON object; use another --out")
        found.pop("versions", None)
        for name, ours, theirs in disk.differences(config, found):
            if name not in FREE_FIELDS:
                raise TuneError(
                    f"--out {self.path} holds a run with {name} = {json.dumps(theirs)}, not "
                    f"{json.dumps(ours)}; put that back to continue it, or use another --out"
                )

    def _take_lock(self) -> TextIO:
        try:
            return disk.lock(self.path / "lock")
        except BlockingIOError:
            raise TuneError(f"--out {self.path} is in use by another run") from None
