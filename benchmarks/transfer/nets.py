"""Which nets the tables need."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import scene
import seg
from benchmarks.transfer.recipe import Recipe, real_net, rendered_net

ATTRIBUTES = ("random", "default")
PARTS = ("transfer", "recognition", "tones")
REAL = "real"
REAL_COST = 2.0
"""What a net trained on real images costs, against one trained on renders."""


class Net(NamedTuple):
    """One network to train."""

    key: dict[str, Any]  # numbers and text: networks with the same key are the same
    cost: float
    task: tuple  # function and arguments


def engine() -> str:
    """Hash the sources that results depend on: tables are made while the engine is being changed."""
    folders = (Path(package.__path__[0]) for package in (scene, seg))
    sources = sorted(path for folder in folders for path in folder.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


def nets(recipe: Recipe, parts: Sequence[str], seeds: Sequence[int]) -> list[Net]:
    """List all networks that the tables in ``parts`` need, the longest first so that workers end together."""
    same = {"engine": engine(), "recipe": recipe._asdict()}
    all_nets = []

    def add(name: str, seed: int, cost: float, *task: Any) -> None:
        all_nets.append(Net({**same, "net": name, "seed": seed}, cost, task))

    for seed in seeds if "recognition" in parts else ():
        add(REAL, seed, REAL_COST, real_net, recipe, seed)
    for seed in seeds if "transfer" in parts else ():
        for attributes in ATTRIBUTES:
            add(attributes, seed, 1.0, rendered_net, recipe, attributes, seed)
    return all_nets
