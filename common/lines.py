"""Lines of JSON, appended one by one, in which every long job keeps its state.

An incomplete last line, which a kill may leave, is dropped; any other broken line is an error.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock

from common.errors import UserError
from common.files import naming, parse_json, sync_folder

Record = dict[str, Any]
CURE = "remove this line and all after it"


def _lock(file: Any) -> None:
    """Make other processes wait until an open file is closed; on Windows only one process may write."""
    with suppress(ImportError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX)


class ChangedFile(UserError, RuntimeError):
    """Another process has written to a file of this one, or has cut it."""


class JsonLines:
    """A file of JSON objects, one per line.

    Args:
        path: the file, which the first line creates; None keeps the lines in memory.
        cure: the end of error messages, which says what to do about a bad line.

    Attributes:
        path: the file.
        lines: every object so far.

    Raises:
        UserError: a line is not a JSON object.
        OSError: the file cannot be read.
    """

    def __init__(self, path: Path | None, cure: str = CURE) -> None:
        self.path, self._cure = path, cure
        self.lines: list[Record] = []
        self._size = 0  # bytes of the whole lines read
        self.refresh()

    def where(self, number: int) -> str:
        """Name the file and line of an object by its index, for errors."""
        return f"{self.path}: line {number + 1}"

    def refresh(self) -> list[Record]:
        """Read and return the lines that other processes have added since."""
        if self.path is None or not self.path.exists():
            return []
        before = len(self.lines)
        with naming(self.path), open(self.path, "rb") as file:
            file.seek(self._size)
            data = file.read()
        for line in data[: data.rfind(b"\n") + 1].splitlines(keepends=True):
            self.lines.append(self._parse(line))
            self._size += len(line)
        return self.lines[before:]

    def _parse(self, line: bytes) -> Record:
        try:
            record = parse_json(line)
        except ValueError:
            raise UserError(f"{self.where(len(self.lines))} is not JSON; {self._cure}") from None
        if not isinstance(record, dict):
            raise UserError(f"{self.where(len(self.lines))} is not a JSON object; {self._cure}")
        return record

    def append(self, *records: Record) -> None:
        """Add lines and sync them to the disk; on a full disk, none of them remains.

        Raises:
            ChangedFile: another process has added lines that this one has not read, or has removed some.
            OSError: the file cannot be written.
        """
        text = "".join(json.dumps(record, allow_nan=False) + "\n" for record in records).encode()
        if self.path is not None:
            with naming(self.path), open(self.path, "a+b", buffering=0) as file:
                _lock(file)
                shrunk = file.seek(0, os.SEEK_END) < self._size
                file.seek(self._size)
                if shrunk or b"\n" in file.read():
                    raise ChangedFile(
                        f"{self.path} was changed by another process; run the same command again"
                    )
                try:
                    file.truncate(self._size)  # a kill may have left part of a line
                    rest = memoryview(text)
                    while rest:
                        rest = rest[file.write(rest) :]
                    os.fsync(file.fileno())
                    if self._size == 0:
                        sync_folder(self.path.parent)  # the file may be new
                except OSError:
                    with suppress(OSError):
                        file.truncate(self._size)
                    raise
            self._size += len(text)
        self.lines += records

    @contextmanager
    def shared(self) -> Iterator[None]:
        """Lock out writers, and read all that other processes have written."""
        assert self.path is not None
        with naming(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(f"{self.path}.lock"):
                self.refresh()
                yield
