"""Evaluations on disk, so that none is made twice.

One record is one evaluation, named by everything that decides it (`identity`). A run folder keeps its own as
lines of ``evaluations.jsonl`` and ``finals.jsonl``; ``--store FILE`` names a file that many runs share and
may write to at once, whose first line names the attributes.
"""

from __future__ import annotations

import hashlib
import json
import math
import weakref
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import UserError
from common.files import digest, naming, write
from common.lines import CURE, JsonLines, Record
from experiments.evaluation.job import (
    LabelledSource,
    LabelledSubset,
    Result,
    Source,
    StreetPool,
)
from experiments.evaluation.made_with import FIELD
from scene.attributes import SPACES, names
from scene.proposal import Histogram, Mixture, Proposal, components

FORMAT = "sdr-jax evaluations, 2"
NAMES = names("extended")
"""Names of all attributes; a proposal of a smaller space holds the first of them."""
HEADER = {"store": FORMAT, "attributes": list(NAMES)}
LOGS = ("evaluations.jsonl", "finals.jsonl")
"""The files of a run folder: rewards of searches, and all other networks."""

FIELDS: dict[str, tuple[type, ...]] = {
    "key": (str,),
    "config": (str,),
    "engine": (int,),
    "centre": (list, type(None)),
    "width": (list, type(None)),
    "seed": (int,),
    "reward": (float, type(None)),
    "class_iou": (list,),
    "render_seconds": (float,),
    "train_seconds": (float,),
    "failed": (str, type(None)),
}
"""One record. A failed evaluation has its reason in ``failed`` and no reward. A network of real images
has no proposal, one of a histogram ``probabilities`` instead, one of a mixture ``components``. ``heads`` has
the class IoU of each of several heads alone."""
OF_A_RUN = ("nets", "row", "fraction", "search", "update", "dataset", "actions", "elapsed")
"""Fields that only a run's own lines have: which job of the run the evaluation was, and when."""
VALUES = ("reward", "class_iou", "failed")
"""Fields that are always the same for the same key, unlike seconds."""


def identity(config: str, source: Source, seed: int) -> str:
    """The name of an evaluation.

    Args:
        config: hash of everything that decides it but the two below.
        source: streets, or the training images.
        seed: seed of the streets and of the network.
    """
    if isinstance(source, LabelledSource):
        source_parts: Any = digest_of_images(source)
    elif isinstance(source, StreetPool):
        source_parts = source.name
    elif isinstance(source, Mixture):
        source_parts = [
            [share, *_parts(component).values()] for share, component in components(source)
        ]
    else:
        source_parts = [*_parts(source).values()]
    return digest({"config": config, "source": source_parts, "seed": int(seed)})


_DIGESTS: dict[int, tuple[weakref.ref[np.ndarray], str]] = {}
"""Digests of existing arrays, by id."""


def digest_of(*arrays: np.ndarray) -> str:
    """SHA-256 of images and similar arrays. An array is read once and then made read-only."""
    for array in arrays:
        if id(array) not in _DIGESTS:
            array.setflags(write=False)
            gone = weakref.ref(array, partial(_forget, id(array)))
            _DIGESTS[id(array)] = gone, _read(array)
    return digest([_DIGESTS[id(array)][1] for array in arrays])


_DIGESTS_OF_PARTS: dict[tuple[str, tuple[int, ...]], str] = {}
"""Digests of subsets, by the digest of all images and the indices."""


def digest_of_images(images: LabelledSource) -> str:
    """SHA-256 of labelled images, or of some of them; features follow from images."""
    if not isinstance(images, LabelledSubset):
        return digest_of(images.images, images.labels)
    whole = images.images
    name = (digest_of(whole.images, whole.labels), images.indices)
    if name not in _DIGESTS_OF_PARTS:
        subset = whole.take(images.indices)
        _DIGESTS_OF_PARTS[name] = digest_of(subset.images, subset.labels)
    return _DIGESTS_OF_PARTS[name]


def _forget(number: int, _: Any) -> None:
    _DIGESTS.pop(number, None)


def _read(array: np.ndarray) -> str:
    sha = hashlib.sha256(f"{array.dtype.str}{list(array.shape)}".encode())
    sha.update(np.ascontiguousarray(array).data)
    return sha.hexdigest()


def record_of(key: str, source: Source, seed: int, result: Result) -> Record:
    """The record of an evaluation."""
    record: Record = {
        "key": key,
        "centre": _floats(source.centre) if isinstance(source, Proposal) else None,
        "width": _floats(source.width) if isinstance(source, Proposal) else None,
        "seed": int(seed),
        "reward": None if result.failed else float(result.reward),
        "class_iou": result.class_iou,
        "render_seconds": round(result.render_seconds, 3),
        "train_seconds": round(result.train_seconds, 3),
        "failed": result.failed,
    }
    if result.heads:
        record["heads"] = list(result.heads)
    if isinstance(source, Histogram):
        record |= _parts(source)
    if isinstance(source, Mixture):
        record["components"] = [
            {"share": share, **_parts(component)} for share, component in components(source)
        ]
    return record


def result_of(record: Record) -> Result:
    """The result in a record."""
    return Result(
        math.nan if record["reward"] is None else record["reward"],
        record["class_iou"],
        record["render_seconds"],
        record["train_seconds"],
        record["failed"],
        stored=True,
        heads=tuple(record.get("heads", ())),
    )


def _parts(component: Any) -> dict[str, list[Any]]:
    """The parts of a component in plain numbers; held attributes only if there are any."""
    return {name: _floats(part) for name, part in component._asdict().items() if len(part)}


def _floats(values: Any) -> list[Any]:
    """Float32 numbers of one or two axes, in the shortest form that is read back as the same."""
    array = np.asarray(values, np.float32)
    return [float(str(v)) if array.ndim == 1 else _floats(v) for v in array]


def first_of_each(records: Iterable[Record]) -> list[Record]:
    """The first line of every evaluation among lines of stores."""
    first_records: dict[str, Record] = {}
    for record in records:
        first_records.setdefault(record["key"], record)
    return list(first_records.values())


class Store:
    """The evaluations in a file of one run, or in a file that many runs share.

    Args:
        path: the file, which the first evaluation creates.
        shared: whether other runs write to it, too. It then begins with a header, and has each evaluation
            once. A run's own file has a line for each job, of which some are the same evaluation
            (`first_of_each`).

    Raises:
        UserError: the file is no such store, or a store of other attributes.
    """

    def __init__(self, path: Path, shared: bool = False) -> None:
        if path.is_dir():
            raise UserError(f"{path} is a folder; a store is a file")
        if shared and path.exists():
            _refuse_other_file(path)
        self.path, self._shared = path, shared
        self._known: dict[str, list[tuple[Record, str]]] = {}  # lines of a key, and their places
        self._lines = JsonLines(path, CURE if shared else f"{CURE}, or use another --out")
        self._absorb(self._lines.lines)

    def __len__(self) -> int:
        return len(self._known)

    @property
    def records(self) -> list[Record]:
        """The lines in order; of a shared file the first line of each evaluation."""
        lines = self._lines.lines
        return first_of_each(lines[1:]) if self._shared else list(lines)

    def refresh(self) -> None:
        """Read the records that other runs have added."""
        self._absorb(self._lines.refresh())

    def get(self, key: str) -> Record | None:
        """The evaluation of a key, if it is known."""
        return self._known[key][0][0] if key in self._known else None

    @property
    def placed(self) -> list[tuple[Record, str]]:
        """All lines of evaluations, each with its file and line."""
        return [line for lines in self._known.values() for line in lines]

    def notes(self, key: str, notes: Record) -> bool:
        """Whether a line of an evaluation has these notes."""
        return any(notes.items() <= line.items() for line, _ in self._known.get(key, ()))

    def add(self, record: Record) -> Record:
        """Record an evaluation and sync it to the disk.

        Returns:
            The recorded evaluation; in a shared file the first one stays, even from another run.
        """
        if not self._shared:
            self._lines.append(record)
            self._remember(record, len(self._lines.lines) - 1)
            return record
        before = len(self._lines.lines)
        with self._lines.shared():
            self._absorb(self._lines.lines[before:])
            earlier = self.get(record["key"])
            if earlier is not None:
                return earlier
            first = [] if self._lines.lines else [HEADER]
            self._lines.append(*first, record)
            self._remember(record, len(self._lines.lines) - 1)
        return record

    def _absorb(self, records: Sequence[Record]) -> None:
        start = len(self._lines.lines) - len(records)
        for number, record in enumerate(records, start):
            if self._shared and number == 0:
                _check_header(self.path, record)
                continue
            check_fields(self._lines.where(number), record)
            self._remember(record, number)

    def _remember(self, record: Record, number: int) -> None:
        lines, where = self._known.setdefault(record["key"], []), self._lines.where(number)
        if self._shared and lines:
            refuse_conflict(*lines[0], record, where)
        lines.append((record, where))


def _refuse_other_file(path: Path) -> None:
    """Raise UserError if a file does not begin as a store; a kill may have left part of its first line."""
    start = json.dumps(HEADER).partition(",")[0].encode()
    with naming(path), open(path, "rb") as file:
        content = file.read(len(start))
    if not start.startswith(content):
        raise UserError(
            f"{path} is no store of evaluations: it does not begin with {FORMAT!r}; use another file"
        )


def _check_header(path: Path, header: Record) -> None:
    file_format = header.get("store")
    if file_format != FORMAT:
        raise UserError(
            f"{path} is of another version ({file_format!r}), expected {FORMAT!r}; use another store"
        )
    attributes = header.get("attributes")
    if attributes != list(NAMES):
        attributes = attributes if isinstance(attributes, list) else []
        stray = [str(name) for name in attributes if name not in NAMES]
        detail = f"such as {stray[0]}" if stray else "or in another order"
        raise UserError(
            f"{path} was written by another space: {len(attributes)} attributes, not these "
            f"{len(NAMES)} ({detail}); use another store"
        )


def check_fields(where: str, record: Record) -> None:
    """Raise UserError for a record with other fields than this program writes."""
    for name, kinds in FIELDS.items():
        if name not in record or not isinstance(record[name], kinds):
            types = " or ".join("null" if k is type(None) else k.__name__ for k in kinds)
            raise UserError(f"{where}: {name} must be of type {types}")
    sizes = [len(rows) for rows in SPACES.values()]
    for name in ("centre", "width"):
        if record[name] is not None and not (
            len(record[name]) in sizes and all(isinstance(v, float | int) for v in record[name])
        ):
            raise UserError(f"{where}: {name} must hold {' or '.join(map(str, sizes))} numbers")
    if (record["centre"] is None) != (record["width"] is None):
        raise UserError(f"{where}: an evaluation has both a centre and a width, or neither")
    heads = record.get("heads") or []
    if not isinstance(heads, list) or not all(map(_is_iou, (record["class_iou"], *heads))):
        raise UserError(f"{where}: class_iou and heads must hold numbers or null")
    made_with = record.get(FIELD) or {}
    if not isinstance(made_with, dict) or not all(isinstance(v, str) for v in made_with.values()):
        raise UserError(f"{where}: {FIELD} must be a table of versions by name")
    if (record["reward"] is None) != (record["failed"] is not None):
        raise UserError(f"{where}: an evaluation has a reward or has failed, one of the two")


def _is_iou(row: Any) -> bool:
    """Whether a value is the IoU of each class."""
    return isinstance(row, list) and all(v is None or isinstance(v, float | int) for v in row)


def refuse_conflict(record: Record, where: str, other: Record, other_where: str) -> None:
    """Raise UserError if two records of the same evaluation disagree."""
    differ = [name for name in VALUES if record.get(name) != other.get(name)]
    if differ:
        raise UserError(
            f"{where} and {other_where} hold the same evaluation with different values of {differ[0]}; "
            f"its rewards are {_value(record)} and {_value(other)}"
        )


def _value(record: Record) -> str:
    return "failed" if record["reward"] is None else f"{record['reward']:.6f}"


def read(path: Path) -> dict[str, tuple[Record, str]]:
    """Read the evaluations of a store or a run folder by key, each with its file and line.

    Raises:
        UserError: there are none, or two disagree.
    """
    if path.is_dir():
        files = [path / name for name in LOGS if (path / name).exists()]
        if not files:
            raise UserError(f"{path} is not a run folder: it has neither {' nor '.join(LOGS)}")
        return merged(line for file in files for line in Store(file).placed)
    if not path.exists():
        raise UserError(f"{path} does not exist; pass a store or a run folder")
    return merged(Store(path, shared=True).placed)


def merged(records: Iterable[tuple[Record, str]]) -> dict[str, tuple[Record, str]]:
    """Merge evaluations by key.

    Raises:
        UserError: two disagree; the message names both.
    """
    by_key: dict[str, tuple[Record, str]] = {}
    for record, where in records:
        refuse_conflict(*by_key.setdefault(record["key"], (record, where)), record, where)
    return by_key


def kinds_of(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Group records by the name of their configuration."""
    by_config: dict[str, list[Record]] = {}
    for record in records:
        by_config.setdefault(record["config"], []).append(record)
    return by_config


def write_store(path: Path, records: Sequence[Record]) -> None:
    """Write a new store, whole or not at all, without the fields of single runs."""
    kept = ({k: v for k, v in record.items() if k not in OF_A_RUN} for record in records)
    write(path, (json.dumps(line, allow_nan=False) + "\n" for line in (HEADER, *kept)))
