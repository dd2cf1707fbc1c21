"""Recorded rewards of stores and run folders as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.errors import UserError
from common.lines import Record
from experiments.config import Config
from experiments.evaluation import store
from scene.attributes import SPACES, SpaceName, names
from scene.proposal import shortest


class Records(NamedTuple):
    """Rewards of one configuration, in an order that is independent of the files' order."""

    centre: np.ndarray  # f64[n, attributes]
    width: np.ndarray  # f64[n, attributes]
    rewards: np.ndarray  # f64[n], mIoU in percent
    config: str
    words: str  # description of the configuration
    failed: int  # number of failed evaluations, which are left out
    aside: tuple[str, ...]  # descriptions of other configurations


def read(paths: Sequence[Path], config: Config, target: str, name: str | None = None) -> Records:
    """Read the rewards of one configuration from files.

    Args:
        paths: stores and run folders; they may overlap.
        config: the space of the proposals, and the held attributes.
        target: name of the target of the rewards.
        name: name of the configuration; by default the one with the most rewards.

    Raises:
        UserError: a file cannot be read, or no reward fits.
    """
    stores = map(store.read, paths)
    merged = store.merged(entry for entries in stores for entry in entries.values())
    held = [record for record, _ in merged.values() if holds(record, config)]
    return choose(held, target, config.space, name, ", ".join(map(str, paths)))


def holds(record: Record, config: Config) -> bool:
    """Whether a record has the held attributes at the configuration's values; real images do not."""
    held = config.held
    if not held or record["centre"] is None:
        return not held
    rows = zip(names("extended"), record["centre"], record["width"], strict=False)
    intervals = {name: (centre, width) for name, centre, width in rows}
    return all(intervals.get(name) == (shortest(value), 0.0) for name, value in held.items())


def in_space(record: Record, space: SpaceName) -> bool:
    """Whether a record is of a proposal in a space; real images have no proposal."""
    return len(record["centre"] or ()) == len(SPACES[space])


def choose(
    records: Iterable[Record], target: str, space: SpaceName, name: str | None, origin: str
) -> Records:
    """Choose the records of one configuration: mIoU of proposals on a target's validation images.

    Args:
        records: lines of a store.
        target: name of the target.
        space: space of the proposals.
        name: name of the configuration; by default the one with the most rewards.
        origin: where the lines come from, for errors.

    Raises:
        UserError: there are none.
    """
    kinds = store.kinds_of(records)
    needed = {"target": target, "side": "reward"}
    fitting = {
        kind: [record for record in lines if in_space(record, space)]
        for kind, lines in kinds.items()
        if all(lines[0].get(field, value) == value for field, value in needed.items())
    }
    fitting = {kind: lines for kind, lines in fitting.items() if lines}
    listed = "; ".join(_words(kind, lines) for kind, lines in kinds.items()) or "nothing"
    if name is not None and name not in fitting:
        raise UserError(
            f"--records-config {name!r}: {origin} has no such rewards of {target}, but {listed}"
        )
    if not fitting:
        raise UserError(
            f"{origin} holds no rewards of target {target} in --space {space}, but {listed}"
        )
    if name is None:
        name = max(sorted(fitting), key=lambda n: sum(r["reward"] is not None for r in fitting[n]))
    chosen = fitting[name]
    aside = tuple(_words(kind, lines) for kind, lines in kinds.items() if kind != name)
    scored = [r for r in chosen if r["reward"] is not None]
    rows = sorted((*r["centre"], *r["width"], 100 * r["reward"]) for r in scored)
    count = len(SPACES[space])
    table = np.asarray(rows, float).reshape(len(rows), 2 * count + 1)
    centre, width, rewards = np.split(table, [count, 2 * count], axis=1)
    failed = len(chosen) - len(scored)
    return Records(centre, width, rewards[:, 0], name, _words(name, chosen), failed, aside)


def _words(name: str, records: Sequence[Record]) -> str:
    """Describe a configuration in words."""
    fields = ("target", "side", "size", "images", "steps", "engine")
    target, side, size, images, steps, engine = (records[0].get(field, "?") for field in fields)
    return (
        f"{name} ({len(records)} of {target}, {side} images, {size}, {images} rendered, {steps} steps, "
        f"engine {engine})"
    )
