"""The rendered streets of `sdr-jax fit`: pools that all networks of a seed share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from common.files import digest, read_json
from experiments.app.fit.config import FitConfig
from experiments.evaluation.cost import street_cost
from experiments.evaluation.job import StreetPool
from experiments.session.session import Session
from experiments.tables.form import Form
from scene.proposal import Streets, draw


class Pool(NamedTuple):
    """The streets of a pool, which may not be rendered yet."""

    units: np.ndarray  # f32[streets, attributes]
    seed: int
    pool: StreetPool


def pool_of(run: Session[FitConfig], streets: Streets, seed: int) -> Pool:
    """Name the pool of streets of one shot that all networks of a seed share."""
    config = run.config
    units = draw(streets, seed, config.final.streets)
    name = digest([digest(units.tolist()), seed, config.final.size])
    return Pool(units, seed, StreetPool(name))


class RenderedStreets:
    """Pools of streets, rendered when the first network needs them: a finished run needs none.

    Args:
        run: the run.
        pools: the pools.
    """

    def __init__(self, run: Session[FitConfig], pools: Sequence[Pool]) -> None:
        self._run, self._pools = run, pools
        self._names = list(dict.fromkeys(pool.pool.name for pool in pools))
        self._recipe = run.recipe(run.config.final)
        self._rendered = False

    def render(self) -> None:
        """Render all streets, with their features."""
        if self._rendered:
            return
        progress, cost = self._run.progress, street_cost(self._run.config.final)
        for units, seed, pool in self._pools:

            def report_progress(count: int, replayed: bool, seed: int = seed) -> None:
                progress.advance(count * cost, networks=0, replayed=replayed)
                progress.update(f"streets of seed {seed}")

            cache = self._run.runner.cache
            cache.streets(pool.name, self._recipe, units, seed, report_progress)
        self._rendered = True

    def skip(self) -> None:
        """Count streets as done that no network needs."""
        if not self._rendered:
            count = sum(len(pool.units) for pool in self._pools)
            cost = count * street_cost(self._run.config.final)
            self._run.progress.advance(cost, replayed=True)

    def seconds(self, form: Form) -> float:
        """The core seconds of rendering, also of an earlier call that rendered the streets."""
        cache = self._run.runner.cache
        by_pool = (cache.seconds(name, self._recipe) for name in self._names)
        on_disk = [seconds for seconds in by_pool if seconds is not None]
        if len(on_disk) == len(self._names):
            return round(sum(on_disk), 1)
        file = self._run.config.out / f"{form.name}.json"
        earlier = read_json(file) if file.exists() else {}
        return float(earlier.get("seconds", {}).get("streets", 0.0))

    def remove_files(self) -> None:
        """Remove the files of the streets, also those of an earlier call that was stopped."""
        for name in self._names:
            self._run.runner.cache.forget(name, self._recipe)
