"""Nets of named training sets, each scored with the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.config import Fidelity, RewardKind, SearchConfig
from experiments.reward.evaluator import Job, Side
from experiments.reward.miou import Outcome, Parts, Recipe, Source
from experiments.reward.seen import Seen
from experiments.reward.truth import Truth
from experiments.run import few
from experiments.run.context import Run, refuse_failed, verdict
from experiments.run.ladder import cost_of, training_cost
from scene.proposal import Streets, default_proposal, random_proposal
from seg import recipes
from seg.settings import NetName

Scores = dict[str, list[Outcome]]
"""By name of the training set, outcomes in the order of the seeds; those of nets that failed among them."""


def score_nets(
    run: Run[Any],
    what: str,
    sources: Mapping[str, Source],
    recipe: Recipe,
    seeds: Sequence[int],
    *,
    side: Side = "test",
    kind: RewardKind = "miou",
    once: Sequence[str] = (),
    parts: Parts = (),
    seen: Path | None = None,
) -> Scores:
    """Train one net for each training set and seed, all at once, and score it.

    Args:
        run: the job.
        what: these nets are, in the run folder and in progress, such as "table, compact".
        sources: training sets by name, proposals or images.
        recipe: sizes, net, training and assets.
        seeds: of streets and nets; the k-th of every set share one.
        side: which of the target's images score.
        kind: of the score.
        once: names of sets that the first seed is enough for.
        parts: of the images that are scored each for itself, too.
        seen: folder where nets leave what they saw, those of the first seed with predictions.

    Raises:
        UserError: more than a tenth of the nets failed.
    """
    wanted = [
        (name, seed) for seed in seeds for name in sources if name not in once or seed == seeds[0]
    ]
    jobs = [(name, sources[name], seed) for name, seed in wanted]
    outcomes = score_jobs(run, what, jobs, recipe, side=side, kind=kind, parts=parts, seen=seen)
    found: Scores = {name: [] for name in sources}
    for (name, _), outcome in zip(wanted, outcomes, strict=True):
        found[name].append(outcome)
    return found


def score_jobs(
    run: Run[Any],
    what: str,
    wanted: Sequence[tuple[str, Source, int]],
    recipe: Recipe,
    *,
    side: Side = "test",
    kind: RewardKind = "miou",
    parts: Parts = (),
    seen: Path | None = None,
) -> list[Outcome]:
    """Train a net for every (name, training set, seed), all at once, and score it; as `score_nets`."""
    jobs = [
        Job(
            source,
            seed,
            {"nets": what, "row": name, "seed": seed},
            None if seen is None else Seen(seen, predictions=seed == wanted[0][2]),
        )
        for name, source, seed in wanted
    ]
    evaluator = run.evaluator(recipe, side, kind, parts)

    def say(index: int, outcome: Outcome) -> str:
        name, _, seed = wanted[index]
        return f"{what}: {name}, seed {seed} | {verdict(outcome, kind)}"

    # Both kinds of sets in one list of jobs, so that no worker waits; they differ in what they cost.
    cost = sum(_cost(recipe, source) for _, source, _ in wanted) / max(len(wanted), 1)
    outcomes = run.score(evaluator, jobs, log=run.finals, cost=cost, say=say)
    refuse_failed(outcomes, len(jobs))
    return outcomes


def _cost(recipe: Recipe, source: Source) -> float:
    cost = training_cost if isinstance(source, Truth) else cost_of
    return cost(recipe.fidelity)


def paired_seeds(run: Run[Any]) -> list[int]:
    """The seeds of a result's rows."""
    return [run.config.seed + k for k in range(run.config.seeds)]


def training_sets(
    run: Run[Any], learnt: Streets, fidelity: Fidelity | None = None, **others: Source
) -> dict[str, Source]:
    """What is compared.

    Random, default and learnt attributes, the same beside the few labelled images if there are any, other
    sets, and all labelled images.

    Args:
        run: the job.
        learnt: what it has learnt.
        fidelity: whose size real images have; by default the final one.
        others: sets by name.
    """
    config: SearchConfig = run.config
    fidelity = fidelity or config.final
    sets: dict[str, Source] = {
        "random": random_proposal(config.space),
        "default": default_proposal(config.default_width, config.space),
        "learnt": learnt,
    }
    sets |= few.rows(run, sets, fidelity) | others
    return sets | ({"real": run.truth(fidelity, "labelled")} if run.target.labelled else {})


def with_net(fidelity: Fidelity, name: NetName, weights: str | None = None) -> Fidelity:
    """A fidelity with another net, trained by the recipe that suits it (``seg.recipes.with_net``).

    Args:
        fidelity: sizes, and how its own net is trained.
        name: of the net.
        weights: file of ImageNet weights that VGG nets start from, in place of the fidelity's.
    """
    changes = {"net": name} if weights is None else {"net": name, "weights": weights}
    return replace(fidelity, train=recipes.with_net(fidelity.train, **changes))
