"""Recorded rewards as arrays: from stores of evaluations, or from lines of bins and rewards.

A line of bins is ``{"bins": [23 integers], "reward": mIoU in percent}``, as in
``benchmarks/data/camvid.jsonl``; what the bins mean, ``--search.bins`` and ``--search.relaxation`` say.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from experiments import store
from experiments.config import Config
from experiments.errors import UserError
from experiments.folder import naming
from experiments.search import make_space
from scene.attributes import NAMES

BINS = "bins"
"""In place of a configuration's name: lines of bins, which do not tell theirs."""


class Records(NamedTuple):
    """Rewards of one configuration, in an order that does not depend on how they were read."""

    centre: np.ndarray  # f64[n, 23]
    width: np.ndarray  # f64[n, 23]
    rewards: np.ndarray  # f64[n], mIoU in percent
    config: str
    words: str  # what the configuration is
    failed: int  # evaluations without a reward, left out
    aside: tuple[str, ...]  # other configurations that were found, in words


def read(paths: Sequence[Path], config: Config, target: str, wanted: str | None = None) -> Records:
    """The rewards of one configuration in some files.

    Args:
        paths: stores, folders that have one, or files of bins; they may overlap.
        config: what bins mean.
        target: name of the target whose rewards count.
        wanted: name of the configuration; by default that with the most rewards.

    Raises:
        UserError: a file that cannot be read, or no reward that fits.
    """
    found: dict[str, dict[str, Any]] = {}
    for number, path in enumerate(paths):
        if path.is_file() and BINS in _first_line(path):
            for line, record in enumerate(_read_bins(path, config)):
                found[f"{number}:{line}"] = record
            continue
        for record in store.read(path).records:
            first = found.setdefault(record["key"], record)
            if first["reward"] != record["reward"]:
                raise UserError(
                    f"{path}: evaluation {record['key'][:12]} has another reward than in the files "
                    "before it"
                )
    return choose(found.values(), target, wanted, ", ".join(map(str, paths)))


def choose(
    records: Iterable[dict[str, Any]], target: str, wanted: str | None, where: str
) -> Records:
    """The records of one configuration among those of reward images of a target.

    Args:
        records: lines of a store.
        target: name of the target.
        wanted: name of the configuration; by default that with the most rewards.
        where: they are from, for errors.

    Raises:
        UserError: there are none.
    """
    kinds: dict[str, list[dict[str, Any]]] = {}
    for record in records:
        kinds.setdefault(record["config"], []).append(record)
    fitting = {
        name: own
        for name, own in kinds.items()
        if own[0].get("side", "reward") == "reward" and own[0].get("target", target) == target
    }
    listed = "; ".join(_words(name, own) for name, own in kinds.items()) or "nothing"
    if wanted is not None:
        if wanted not in fitting:
            raise UserError(
                f"--records-config {wanted!r}: {where} has no such rewards of {target}, but {listed}"
            )
        name = wanted
    elif not fitting:
        raise UserError(f"{where} holds no rewards of target {target}, but {listed}")
    else:
        name = max(sorted(fitting), key=lambda n: sum(r["reward"] is not None for r in fitting[n]))
    own = fitting[name]
    aside = tuple(_words(other, kinds[other]) for other in kinds if other != name)
    known = [r for r in own if r["reward"] is not None]
    rows = sorted((*r["centre"], *r["width"], 100 * r["reward"]) for r in known)
    table = np.asarray(rows, float).reshape(len(rows), 2 * len(NAMES) + 1)
    centre, width, rewards = np.split(table, [len(NAMES), 2 * len(NAMES)], axis=1)
    return Records(
        centre, width, rewards[:, 0], name, _words(name, own), len(own) - len(known), aside
    )


def _words(name: str, records: Sequence[dict[str, Any]]) -> str:
    """A configuration in words."""
    one = records[0]
    if name == BINS:
        return f"{len(records)} rewards of bins"
    about = [str(one.get(field, "?")) for field in ("target", "side", "size", "images", "steps")]
    return (
        f"{name} ({len(records)} of {about[0]}, {about[1]} images, {about[2]}, "
        f"{about[3]} rendered, {about[4]} steps, engine {one.get('engine', '?')})"
    )


def _first_line(path: Path) -> Any:
    with naming(path), open(path, "rb") as file:
        line = file.readline()
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _read_bins(path: Path, config: Config) -> list[dict[str, Any]]:
    """Lines of bins as lines of a store."""
    bins, rewards = [], []
    with naming(path):
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            actions, reward = record["bins"], float(record["reward"])
            whole = all(type(k) is int and 0 <= k < config.search.bins for k in actions)
            if not (whole and len(actions) == len(NAMES) and math.isfinite(reward)):
                raise ValueError
        except (ValueError, KeyError, TypeError):
            raise UserError(
                f"{path}: line {number} must hold a reward and {len(NAMES)} bins from 0 to "
                f"{config.search.bins - 1} (--search.bins)"
            ) from None
        bins.append(actions)
        rewards.append(reward)
    relaxed = jax.device_get(
        sdr_jax.relax(make_space(config), np.asarray(bins, np.int32), config.search.relaxation)
    )
    return [
        {"config": BINS, "centre": centre, "width": width, "reward": reward / 100}
        for centre, width, reward in zip(
            relaxed.centre.tolist(), relaxed.width.tolist(), rewards, strict=True
        )
    ]
