"""Jobs of nets on named training sets, each with the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from experiments.config import Fidelity, RewardKind, SearchConfig
from experiments.evaluation.job import Job, Parts, Recipe, Result, Source
from experiments.run import few
from experiments.run.context import Run
from experiments.target.base import Side
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
    kind: RewardKind = "miou",
    once: Sequence[str] = (),
    parts: Parts = (),
    keeps: bool = False,
) -> list[Job]:
    """One net for each seed and training set.

    Args:
        what: these nets are, in the run folder and in progress, such as "table, compact".
        sources: training sets by name.
        recipe: sizes, net, training and assets.
        seeds: of streets and nets; the k-th of every set share one.
        side: which of the target's images they are tested on.
        kind: of the reward.
        once: names of sets that the first seed is enough for.
        parts: of the images that they are tested on separately, too.
        keeps: whether they leave their confusion matrices, those of the first seed predictions, too.
    """
    return [
        Job(
            recipe,
            source,
            seed,
            {"nets": what, "row": name, "seed": seed},
            side,
            kind,
            parts,
            ("predictions" if seed == seeds[0] else "confusion") if keeps else None,
        )
        for seed in seeds
        for name, source in sources.items()
        if name not in once or seed == seeds[0]
    ]


def by_row(jobs: Sequence[Job], results: Sequence[Result]) -> dict[str, list[Result]]:
    """Results by name of the training set, in the order of the seeds; failed ones are among them."""
    found: dict[str, list[Result]] = {}
    for job, result in zip(jobs, results, strict=True):
        found.setdefault(job.notes["row"], []).append(result)
    return found


def paired_seeds(run: Run[Any]) -> list[int]:
    """The seeds of a result's rows."""
    return [run.config.seed + k for k in range(run.config.seeds)]


def training_sets(
    run: Run[Any], learnt: Streets | None, fidelity: Fidelity | None = None, **others: Source
) -> dict[str, Source]:
    """What is compared.

    Random, default and learnt attributes, the same beside the labelled subset if there is one, other sets,
    and all labelled images.

    Args:
        run: the job.
        learnt: what it has learnt; None leaves out what it decides.
        fidelity: whose size real images have; by default the final one.
        others: sets by name.
    """
    config: SearchConfig = run.config
    fidelity = fidelity or config.final
    sets: dict[str, Source] = {
        "random": config.streets("random"),
        "default": config.streets("default"),
    }
    if learnt is not None:
        sets["learnt"] = learnt
    sets |= few.rows(run, sets, fidelity) | others
    return sets | ({"real": run.images(fidelity, "labelled")} if run.target.labelled else {})


def with_net(fidelity: Fidelity, name: NetName, weights: str | None = None) -> Fidelity:
    """A fidelity with another net, trained by the recipe that suits it (``seg.recipes.with_net``).

    Args:
        fidelity: sizes, and how its own net is trained.
        name: of the net.
        weights: file of weights that VGG nets start from, or dinov2's, in place of the fidelity's.
    """
    changes = {"net": name} if weights is None else {"net": name, "weights": weights}
    return replace(fidelity, train=recipes.with_net(fidelity.train, **changes))
