"""Find the files that tasks name on this machine.

A worker that does not share a disk with the sender of its tasks has copies of their files. Such tasks name
a file by its content, and the worker knows the path of its copy; any other name is a path.
"""

from __future__ import annotations

from pathlib import Path

_COPIES: dict[str, Path] = {}


def received(name: str, copy: Path) -> None:
    """Record the path of this process's copy of a file."""
    _COPIES[name] = copy


def here(name: str | Path) -> Path:
    """The path on this machine of the file or folder that a task names."""
    return _COPIES.get(str(name), Path(name))
