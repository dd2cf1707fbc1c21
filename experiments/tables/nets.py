"""Jobs of networks on named training sets with the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from experiments.config import Fidelity, SearchConfig
from experiments.evaluation.job import Job, Recipe, Result, Source
from experiments.session.session import Session
from experiments.tables.row_names import FEW
from experiments.targets.base import Side
from scene.proposal import Streets
from seg import recipes
from seg.settings import NetName


def jobs_of(
    what: str,
    sources: Mapping[str, Source],
    recipe: Recipe,
    seeds: Sequence[int],
    *,
    side: Side = "test",
    once: Sequence[str] = (),
    keeps: bool = False,
) -> list[Job]:
    """Make one job for each seed and training set.

    Args:
        what: kind of the networks in the run folder and in progress, such as "table, compact".
        sources: training sets by name.
        recipe: sizes, network, training and assets.
        seeds: seeds of streets and networks; the k-th networks of all sets share one.
        side: the target's images to test on.
        once: names of sets that only need the first seed.
        keeps: whether to keep confusion matrices, and predictions for the first seed.
    """
    return [
        Job(
            recipe,
            source,
            seed,
            {"nets": what, "row": name, "seed": seed},
            side,
            ("predictions" if seed == seeds[0] else "confusion") if keeps else None,
        )
        for seed in seeds
        for name, source in sources.items()
        if name not in once or seed == seeds[0]
    ]


def by_row(jobs: Sequence[Job], results: Sequence[Result]) -> dict[str, list[Result]]:
    """Group results by training set, in the order of the seeds; failed ones are included."""
    by_name: dict[str, list[Result]] = {}
    for job, result in zip(jobs, results, strict=True):
        by_name.setdefault(job.notes["row"], []).append(result)
    return by_name


def paired_seeds(run: Session[Any]) -> list[int]:
    """Return the seeds that all rows of a result share."""
    return [run.config.seed + k for k in range(run.config.seeds)]


def training_sets(run: Session[Any], learnt: Streets | None) -> dict[str, Source]:
    """Make the training sets to compare.

    These are random, default and optimised streets, the same mixed with the labelled subset if there is one,
    and all labelled images.

    Args:
        run: the job.
        learnt: the optimised streets; None leaves out sets that depend on them.
    """
    config: SearchConfig = run.config
    sets: dict[str, Source] = {
        "random": config.streets("random"),
        "default": config.streets("default"),
    }
    if learnt is not None:
        sets["learnt"] = learnt
    if run.target.few_names:
        mixed = {f"{FEW}+{name}": run.with_few(config.final, set_) for name, set_ in sets.items()}
        sets |= {FEW: run.images(config.final, "few"), **mixed}
    return sets | {"real": run.images(config.final, "labelled")}


def with_net(fidelity: Fidelity, name: NetName, weights: str | None = None) -> Fidelity:
    """Return a fidelity with another network, trained by the recipe that suits it (``seg.recipes.with_net``).

    Args:
        fidelity: sizes, and the training of its own network.
        name: name of the other network.
        weights: file of weights for VGG networks or dinov2, instead of the fidelity's.
    """
    changes = {"net": name} if weights is None else {"net": name, "weights": weights}
    return replace(fidelity, train=recipes.with_net(fidelity.train, **changes))
