"""Nets of named training sets, each scored with the same seeds; nets of all kinds are one list of jobs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from experiments.config import Fidelity, RewardKind, SearchConfig
from experiments.reward.evaluator import Evaluator, Job
from experiments.reward.miou import Outcome, Parts, Recipe, Source
from experiments.reward.seen import Seen
from experiments.run import few
from experiments.run.context import Run, net_said, refuse_failed
from experiments.run.ladder import cost_of, training_cost
from experiments.target.base import Side
from scene.proposal import Streets, default_proposal, random_proposal
from seg import recipes
from seg.data import LabelledImages
from seg.settings import NetName

Scores = dict[str, list[Outcome]]
"""By name of the training set, outcomes in the order of the seeds; those of nets that failed among them."""


class Nets(NamedTuple):
    """Nets of one recipe, one for each training set and seed."""

    what: str  # they are, in the run folder and in progress, such as "table, compact"
    sources: Mapping[str, Source]  # training sets by name, proposals or images
    recipe: Recipe  # sizes, net, training and assets
    seen: Path | None = None
    """Folder where they leave what they saw, those of the first seed with predictions."""


class Net(NamedTuple):
    """One net."""

    what: str  # as above
    row: str  # name of the training set
    source: Source
    recipe: Recipe
    seed: int  # of streets and net
    seen: Seen | None = None  # where it leaves what it saw, if anywhere


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
) -> Scores:
    """Train one net for each training set and seed, all at once, and score it.

    Args:
        run: the job.
        what: these nets are, in the run folder and in progress.
        sources: training sets by name.
        recipe: sizes, net, training and assets.
        seeds: of streets and nets; the k-th of every set share one.
        side: which of the target's images score.
        kind: of the score.
        once: names of sets that the first seed is enough for.
        parts: of the images that are scored each for itself, too.

    Raises:
        UserError: more than a tenth of the nets failed.
    """
    wanted = [
        net for net in _each([Nets(what, sources, recipe)], seeds)
        if net.row not in once or net.seed == seeds[0]
    ]  # fmt: skip
    outcomes = score_each(run, wanted, side=side, kind=kind, parts=parts)
    found: Scores = {name: [] for name in sources}
    for net, outcome in zip(wanted, outcomes, strict=True):
        found[net.row].append(outcome)
    return found


def score_lists(run: Run[Any], lists: Sequence[Nets], seeds: Sequence[int]) -> list[Scores]:
    """The nets of several recipes, all at once, scored on the test images; otherwise as `score_nets`."""
    wanted = _each(lists, seeds)
    outcomes = iter(score_each(run, wanted))
    found = []
    for nets in lists:
        own: Scores = {name: [] for name in nets.sources}
        for _ in seeds:
            for name in nets.sources:
                own[name].append(next(outcomes))
        found.append(own)
    return found


def begin(run: Run[Any], lists: Sequence[Nets], seeds: Sequence[int]) -> None:
    """Begin nets on rendered sets that `score_nets` or `score_lists` are asked for later.

    Those on real images alone are short, and fill the last gaps then.
    """
    begin_each(
        run, [net for net in _each(lists, seeds) if not isinstance(net.source, LabelledImages)]
    )


def begin_each(run: Run[Any], wanted: Sequence[Net]) -> None:
    """Begin nets that `score_each` is asked for later."""
    run.ahead.begin(_asked(run, wanted))


def score_each(
    run: Run[Any],
    wanted: Sequence[Net],
    *,
    side: Side = "test",
    kind: RewardKind = "miou",
    parts: Parts = (),
) -> list[Outcome]:
    """Train every net, all at once, and score it; as `score_nets`."""
    asked = _asked(run, wanted, side, kind, parts)

    def say(index: int, outcome: Outcome) -> str:
        return net_said(asked[index][1], outcome, kind)

    outcomes = run.score(asked, log=run.finals, say=say)
    for what in dict.fromkeys(net.what for net in wanted):
        own = [o for net, o in zip(wanted, outcomes, strict=True) if net.what == what]
        refuse_failed(own, len(own))
    return outcomes


def _each(lists: Sequence[Nets], seeds: Sequence[int]) -> list[Net]:
    return [
        Net(
            nets.what,
            name,
            source,
            nets.recipe,
            seed,
            None if nets.seen is None else Seen(nets.seen, predictions=seed == seeds[0]),
        )
        for nets in lists
        for seed in seeds
        for name, source in nets.sources.items()
    ]


def _asked(
    run: Run[Any],
    wanted: Sequence[Net],
    side: Side = "test",
    kind: RewardKind = "miou",
    parts: Parts = (),
) -> list[tuple[Evaluator, Job]]:
    """Jobs of nets, with who scores them: one for each kind of nets."""
    evaluators: dict[str, Evaluator] = {}
    asked = []
    for net in wanted:
        if net.what not in evaluators:
            evaluators[net.what] = run.evaluator(net.recipe, side, kind, parts)
        notes = {"nets": net.what, "row": net.row, "seed": net.seed}
        job = Job(net.source, net.seed, notes, _cost(net.recipe, net.source), net.seen)
        asked.append((evaluators[net.what], job))
    return asked


def _cost(recipe: Recipe, source: Source) -> float:
    cost = training_cost if isinstance(source, LabelledImages) else cost_of
    return cost(recipe.fidelity)


def paired_seeds(run: Run[Any]) -> list[int]:
    """The seeds of a result's rows."""
    return [run.config.seed + k for k in range(run.config.seeds)]


def training_sets(
    run: Run[Any], learnt: Streets | None, fidelity: Fidelity | None = None, **others: Source
) -> dict[str, Source]:
    """What is compared.

    Random, default and learnt attributes, the same beside the few labelled images if there are any, other
    sets, and all labelled images.

    Args:
        run: the job.
        learnt: what it has learnt; None leaves out what it decides.
        fidelity: whose size real images have; by default the final one.
        others: sets by name.
    """
    config: SearchConfig = run.config
    fidelity = fidelity or config.final
    sets: dict[str, Source] = {
        "random": random_proposal(config.space),
        "default": default_proposal(config.default_width, config.space),
    }
    if learnt is not None:
        sets["learnt"] = learnt
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
