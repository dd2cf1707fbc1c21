"""A file of evaluations that runs share: what one has scored, no other scores again.

    python -m experiments.store show FILE
    python -m experiments.store merge A.jsonl B.jsonl --out C.jsonl

Two evaluations are the same if all that decides the reward is: stage, class table, renderer, assets,
real images, sources of the engine and of the nets, attributes and seed. The file is lines of JSON behind
one that names the attributes; a half-written last line is dropped, and many runs may write at once.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from experiments.errors import UserError
from experiments.folder import naming, write_atomically
from scene.attributes import NAMES
from scene.command import Parser

FORMAT = "sdr-jax evaluations, 1"
HEADER = {"store": FORMAT, "attributes": list(NAMES)}
FILE = "store.jsonl"
"""Name of the store in a folder that has one of its own."""
DIGITS = 6
"""Decimals that proposals are kept with; rewards are kept whole."""

FIELDS: dict[str, tuple[type, ...]] = {
    "key": (str,),
    "config": (str,),
    "centre": (list,),
    "width": (list,),
    "seed": (int,),
    "reward": (float, type(None)),
    "class_iou": (list,),
    "render_seconds": (float,),
    "train_seconds": (float,),
    "failed": (str, type(None)),
}
"""One line. A failed evaluation says why in ``failed`` and has no reward."""
VALUES = ("reward", "class_iou", "failed")
"""What is always the same for the same key; seconds are not."""


class Store:
    """The evaluations in a file, those that other runs add meanwhile included.

    Args:
        path: the file; it is made with the first evaluation.

    Raises:
        UserError: the file is no store, or the store of other attributes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._records: dict[str, dict[str, Any]] = {}
        self._lines: dict[str, int] = {}
        self._whole = 0  # bytes read; whole lines only
        self._count = 0  # lines read
        self.refresh()

    def __len__(self) -> int:
        return len(self._records)

    @property
    def records(self) -> list[dict[str, Any]]:
        """Every evaluation, in the order in which they were made."""
        return list(self._records.values())

    def refresh(self) -> None:
        """Read what other runs have added."""
        if self.path.is_dir():
            raise UserError(f"{self.path} is a folder; a store is a file")
        if self.path.exists():
            with naming(self.path), open(self.path, "rb") as file:
                self._absorb(file)

    def get(self, key: str) -> dict[str, Any] | None:
        """The evaluation of a key, if it is known."""
        return self._records.get(key)

    def line(self, key: str) -> int:
        """The number of the line that holds a key."""
        return self._lines[key]

    def add(self, record: dict[str, Any]) -> dict[str, Any]:
        """Keep an evaluation and see it to the disk; what another run added first stands.

        Returns:
            The evaluation that is kept.
        """
        with naming(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with open(self.path, "a+b", buffering=0) as file, _locked(file):
                self._absorb(file)
                known = self.get(record["key"])
                if known is not None:
                    return known
                file.truncate(self._whole)  # a kill may have left a part of a line
                lines = [record] if self._count else [HEADER, record]
                try:
                    rest = memoryview(b"".join(map(_encoded, lines)))
                    while rest:
                        rest = rest[file.write(rest) :]
                    os.fsync(file.fileno())
                except OSError:
                    with suppress(OSError):
                        file.truncate(self._whole)
                    raise
                self._absorb(file)
        return self._records[record["key"]]

    def _absorb(self, file: BinaryIO | Any) -> None:
        file.seek(self._whole)
        data = file.read()
        for line in data[: data.rfind(b"\n") + 1].splitlines(keepends=True):
            self._take(line)
            self._whole += len(line)

    def _take(self, line: bytes) -> None:
        where = f"{self.path}: line {self._count + 1}"
        try:
            record = json.loads(line, parse_constant=_refuse_constant)
        except ValueError:
            raise UserError(f"{where} is not JSON; remove it and all after it") from None
        if not isinstance(record, dict):
            raise UserError(f"{where} is no JSON object; remove it and all after it")
        if self._count == 0:
            _check_header(self.path, record)
        else:
            _check_fields(where, record)
            key = record["key"]
            first = self._records.setdefault(key, record)
            self._lines.setdefault(key, self._count + 1)
            _refuse_conflict(first, f"{self.path}: line {self._lines[key]}", record, where)
        self._count += 1


def _encoded(record: dict[str, Any]) -> bytes:
    return (json.dumps(record, allow_nan=False) + "\n").encode()


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


@contextmanager
def _locked(file: Any) -> Iterator[None]:
    """Keep other runs from writing; closing the file lets go of it."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        yield
        return
    fcntl.flock(file, fcntl.LOCK_EX)
    yield


def _check_header(path: Path, header: dict[str, Any]) -> None:
    if header.get("store") != FORMAT:
        raise UserError(f"{path} is no store of evaluations ({FORMAT!r})")
    names = header.get("attributes")
    if names != list(NAMES):
        theirs = names if isinstance(names, list) else []
        stray = [str(name) for name in theirs if name not in NAMES]
        detail = f"such as {stray[0]}" if stray else "or in another order"
        raise UserError(
            f"{path} was written by another space: {len(theirs)} attributes, not these "
            f"{len(NAMES)} ({detail}); use another store"
        )


def _check_fields(where: str, record: dict[str, Any]) -> None:
    for name, kinds in FIELDS.items():
        if name not in record or not isinstance(record[name], kinds):
            wanted = " or ".join("null" if k is type(None) else k.__name__ for k in kinds)
            raise UserError(f"{where}: {name} must be of type {wanted}")
    for name in ("centre", "width"):
        if len(record[name]) != len(NAMES):
            raise UserError(f"{where}: {name} must hold {len(NAMES)} values")
    if (record["reward"] is None) != (record["failed"] is not None):
        raise UserError(f"{where}: an evaluation has a reward or has failed, one of the two")


def _refuse_conflict(one: dict[str, Any], where: str, other: dict[str, Any], there: str) -> None:
    if any(one[name] != other[name] for name in VALUES):
        raise UserError(
            f"{where} and {there} hold the same evaluation with different values, "
            f"{_value(one)} and {_value(other)}"
        )


def _value(record: dict[str, Any]) -> str:
    return "failed" if record["reward"] is None else f"{record['reward']:.6f}"


def merge(paths: Sequence[Path], out: Path) -> int:
    """Write all evaluations of several stores into a new one; returns how many they are.

    Args:
        paths: stores, or folders with a ``store.jsonl``.
        out: the new file.

    Raises:
        UserError: a file that is missing or no store, or two that disagree; both are named.
    """
    if out.exists():
        raise UserError(f"--out {out} exists already; name a new file")
    found: dict[str, tuple[dict[str, Any], str]] = {}
    for path in paths:
        store = read(path)
        for record in store.records:
            where = f"{store.path}: line {store.line(record['key'])}"
            first, first_where = found.setdefault(record["key"], (record, where))
            _refuse_conflict(first, first_where, record, where)
    lines = [HEADER, *(record for record, _ in found.values())]
    write_atomically(out, b"".join(map(_encoded, lines)))
    return len(found)


def read(path: Path) -> Store:
    """The store in a file, or in a folder that has one.

    Raises:
        UserError: there is none.
    """
    file = path / FILE if path.is_dir() else path
    if not file.exists():
        cure = "; a run has one only if --store named it" if path.is_dir() else ""
        raise UserError(f"{file}: no such store{cure}")
    return Store(file)


def table(store: Store) -> str:
    """What a store holds, a line per configuration."""
    lines = [f"{store.path}: {len(store)} evaluations of {len(NAMES)} attributes"]
    configs: dict[str, list[dict[str, Any]]] = {}
    for record in store.records:
        configs.setdefault(record["config"], []).append(record)
    for config, records in configs.items():
        about = [str(records[0].get(name, "?")) for name in ("target", "side", "size", "images")]
        kind = f"{' '.join(about)} images"
        rewards = [r["reward"] for r in records if r["reward"] is not None]
        best, mean = (
            (100 * max(rewards), 100 * float(np.mean(rewards))) if rewards else (math.nan,) * 2
        )
        lines.append(
            f"  {config}  {kind:36s} {len(records):6d} evaluations, {len(records) - len(rewards)} failed"
            f" | mIoU best {best:5.2f}, mean {mean:5.2f}"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = Parser("experiments.store", __doc__)
    parser.add_argument("command", choices=("show", "merge"))
    parser.add_argument("files", type=Path, nargs="+", help="stores, or folders that have one")
    parser.add_argument("--out", type=Path, help="the new store that merge writes")
    options = parser.parse_args(arguments)
    if (options.out is not None) != (options.command == "merge"):
        parser.error("merge needs --out FILE, and show takes none")
    try:
        if options.command == "show":
            print("\n".join(table(read(path)) for path in options.files))
        else:
            print(f"{options.out}: {merge(options.files, options.out)} evaluations")
    except (UserError, OSError) as error:
        parser.fail(error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
