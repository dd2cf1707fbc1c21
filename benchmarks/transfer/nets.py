"""The nets of the tables, and the real images for their training and tests."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import scene
import seg
from benchmarks.transfer.ingredients import INGREDIENTS
from benchmarks.transfer.recipe import TABLE, Recipe, real_net, rendered_net, units
from seg.data import DataError, LabelledImages, list_split, load
from shell.target_file import shipped

SEQUENCES = ("0001TP", "0016E5")
"""Drives of CamVid that may steer the engine; results use the other drive, which is not read here."""
BLOCKS = 5
"""Number of stretches of each drive; a net trained on real images is tested on one of them."""
ATTRIBUTES = ("random", "default")
PARTS = ("transfer", "ingredients", "recognition", "tones", "content")
REAL = "real"
WITHOUT = "without "
REAL_COST = 3.0
"""Cost of a net trained on real images, with close-ups, relative to a net trained on renders."""


class Net(NamedTuple):
    """One net to train."""

    key: dict[str, Any]  # plain values that identify it
    cost: float
    task: tuple  # function and arguments


def steering_set(root: Path, recipe: Recipe) -> LabelledImages:
    """The labelled images of the sequences that may steer the engine, in the order of time.

    Raises:
        DataError: the folder is not CamVid, or lacks a sequence.
    """
    files = shipped(TABLE)
    entries = {e.name: e for split in ("train", "val") for e in list_split(files, root, split)}
    chosen = [entries[name] for name in sorted(entries) if entries[name].sequence in SEQUENCES]
    missing = sorted(set(SEQUENCES) - {e.sequence for e in chosen})
    if missing:
        raise DataError(f"{root}: train and val have no image of sequence {', '.join(missing)}")
    return load(chosen, files, (recipe.height, recipe.width))


def held_out(sequences: Sequence[str], block: int) -> np.ndarray:
    """bool[n]: the images of the ``block``-th stretch of every sequence."""
    names = np.asarray(sequences)
    chosen = np.zeros(len(names), bool)
    for name in set(sequences):
        chosen[np.array_split(np.flatnonzero(names == name), BLOCKS)[block % BLOCKS]] = True
    return chosen


def engine() -> str:
    """A name for the sources that decide the figures, since the engine may change between runs."""
    folders = (Path(package.__path__[0]) for package in (scene, seg))
    sources = sorted(path for folder in folders for path in folder.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


def nets(
    recipe: Recipe, real: LabelledImages, parts: Sequence[str], seeds: Sequence[int]
) -> list[Net]:
    """Every net of the tables in ``parts``, the longest first so that workers end together."""
    same = {"engine": engine(), "recipe": recipe._asdict(), "images": len(real.images)}
    found = []

    def add(name: str, seed: int, cost: float, *task: Any) -> None:
        found.append(Net({**same, "net": name, "seed": seed}, cost, task))

    for seed in seeds if "recognition" in parts else ():
        unseen = held_out(real.sequences, seed)
        sides = [real.take(np.flatnonzero(side)) for side in (~unseen, unseen)]
        default = units(recipe, "default", seed)
        add(REAL, seed, REAL_COST, real_net, recipe, *sides, default, seed)
    for seed in seeds:
        drawn = {name: units(recipe, name, seed) for name in ATTRIBUTES}
        rows: list[tuple[str, str | None, str]] = []
        if "transfer" in parts:
            rows.append(("random", None, "random"))
        if "transfer" in parts or "ingredients" in parts:
            rows.append(("default", None, "default"))
        if "ingredients" in parts:
            rows += [(WITHOUT + name, name, "default") for name in INGREDIENTS]
        for name, without, attributes in rows:
            add(name, seed, 1.0, rendered_net, recipe, without, drawn[attributes], seed, real)
    return found
