"""Files that tasks name, where they lie on this machine.

A worker that shares no disk with the process that sends its tasks has copies of the files that they name.
Tasks then call a file by its content, and the worker knows where its copy is; any other name is a path.
"""

from __future__ import annotations

from pathlib import Path

_COPIES: dict[str, Path] = {}


def received(name: str, copy: Path) -> None:
    """Remember where this process has a copy."""
    _COPIES[name] = copy


def here(name: str | Path) -> Path:
    """The file or folder that a task names, on this machine."""
    return _COPIES.get(str(name), Path(name))
