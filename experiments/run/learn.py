"""Learnt attributes: a search, and the candidate for its answer that model selection chooses.

The cheap reward favours what is easy to learn, and the dataset with the highest reward was also lucky. So
candidates are compared by nets of the final size with fresh seeds (`selection`); only the chosen one ever
meets the test images.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from experiments.config import (
    SEED_END,
    Candidate,
    Fidelity,
    SearchConfig,
    make_method,
    make_space,
    offered,
)
from experiments.evaluation.cost import cost_of
from experiments.evaluation.job import Parts, Result, Source
from experiments.run import pooled
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.ladder import climb, compared, fidelities
from experiments.run.nets import by_row, jobs_of
from experiments.run.rewards import SearchPlan
from experiments.run.search import Found, search
from experiments.run.selection import Scores, Selection, parts_of
from experiments.target.base import Target
from scene.held import hold
from scene.proposal import Streets, describe, slide
from shell.files import digest, write_json

BROAD = 0.5
"""Least width of the broad candidate's intervals."""
REFERENCE: Candidate = "default"
"""The hand-set street: where it is among the candidates, the others must be better."""


class Learnt(NamedTuple):
    """What was learnt, and how."""

    streets: Streets
    found: Found
    selection: Selection
    parts: tuple[str, ...]  # of the reward images, in words
    by_part: dict[str, list[tuple[float, ...]]]
    """Of the candidates in the selection, by seed, scores on each part; empty where they are not known."""


def plan_of(config: SearchConfig, name: str = "search") -> SearchPlan:
    """The search of a configuration, under a name that no other search of its run has.

    Raises:
        UserError: an option out of range.
    """
    options = config.search
    space = make_space(config)
    method = make_method(config, options.method, space, options.updates_per_group)
    datasets, updates = options.datasets_per_update, options.updates_per_group * len(space.groups)
    if options.method == "pool":
        datasets, updates = options.pool.rewards, options.pool.rounds
    return SearchPlan(
        name,
        config.space,
        options.method,
        method,
        space.names,
        datasets,
        updates,
        options,
        config.seed,
        config.held,
    )


def work_of(config: SearchConfig) -> list[Work]:
    """The nets that `learn` trains."""
    challengers = len(set(offered(config)) - {REFERENCE})
    rungs = _rungs(config)
    counts = compared(challengers, len(rungs), REFERENCE in config.candidates)
    return pooled.work_of(config, [plan_of(config)]) + [
        Work.at(
            f"nets of candidates, {_called(config, rung)}",
            count * config.candidate_seeds,
            rungs[rung],
        )
        for rung, count in enumerate(counts)
        if count
    ]


def learn(run: Run[Any], config: SearchConfig | None = None, name: str = "") -> Learnt:
    """Search, choose a candidate, and leave what was learnt in the run folder.

    Args:
        run: the job.
        config: of the search, where that is not the job's: of another method or seed.
        name: of the search, where a job has several; its file is ``attributes/NAME.json`` rather than
            ``attributes.json``.

    Raises:
        UserError: more than a tenth of the evaluations failed.
    """
    config = config or run.config
    parts, words = reward_parts(run.target, config)
    found = search(run, plan_of(config, name or "search"), config.reward_kind)
    candidates = {each: candidate(each, found, config) for each in offered(config)}
    selection, by_part = _selected(run, config, candidates, parts, f"{name}, " if name else "")
    streets = candidates[cast(Candidate, selection.chosen)]
    file = config.out / (f"attributes/{name}.json" if name else "attributes.json")
    file.parent.mkdir(exist_ok=True)
    write_json(file, describe(streets))
    return Learnt(streets, found, selection, words, by_part)


def reward_parts(target: Target, config: SearchConfig) -> tuple[Parts, tuple[str, ...]]:
    """The parts of the reward images that candidates are tested on separately, and what they are in words.

    Raises:
        UserError: fewer images than ``--parts``.
    """
    if config.reward_kind != "miou":
        return (), ()
    sequences = target.reward_sequences
    parts = parts_of(sequences, config.parts)
    return parts, tuple(_said(sequences[first:end]) for first, end in parts)


def _said(sequences: Sequence[str]) -> str:
    """A part of the reward images in words."""
    known = list(dict.fromkeys(sequences))
    where = known[0] if len(known) == 1 else f"{known[0]} to {known[-1]}"
    return f"{len(sequences)} images of {where}"


def candidate(name: Candidate, found: Found, config: SearchConfig) -> Streets:
    """What may be the answer: one way to read what a search found, or streets that it knew nothing of."""
    if name in found.answers:
        return found.answers[name]
    if name == "argmax":
        return found.solution
    if name == "seen":
        return found.best
    if name == "broad":
        broad = slide(found.spread.centre, np.maximum(found.spread.width, BROAD))
        return hold(broad, config.held)
    return config.streets(name)


def selection_seeds(config: SearchConfig, rung: int) -> list[int]:
    """Seeds of the nets on one rung; all candidates share them.

    Named by the search alone: another search has others, and the same one has the same in every job.
    """
    search = [config.search.method, config.seed, config.space]
    names = [["selection", *search, rung, net] for net in range(config.candidate_seeds)]
    return [int(digest(name), 16) % SEED_END for name in names]


def _rungs(config: SearchConfig) -> tuple[Fidelity, ...]:
    """The sizes at which candidates meet."""
    return fidelities(config.reward, config.final) if config.ladder else (config.final,)


def _called(config: SearchConfig, rung: int) -> str:
    """What the log calls the nets of a rung."""
    return f"rung-{rung + 1}" if config.ladder else "candidate"


def _selected(
    run: Run[Any],
    config: SearchConfig,
    candidates: Mapping[Candidate, Streets],
    parts: Parts,
    prefix: str,
) -> tuple[Selection, dict[str, list[tuple[float, ...]]]]:
    """Train and test nets of the candidates, choose one; also their scores on each part."""
    own = len(pooled.work_of(config, [plan_of(config)]))
    rungs, cost = _rungs(config), sum(work.cost for work in work_of(config)[own:])
    results: dict[str, list[Result]] = {}

    def test(rung: int, names: Sequence[str]) -> Scores:
        nonlocal results, cost
        fidelity, seeds = rungs[rung], selection_seeds(config, rung)
        sources: dict[str, Source] = {
            name: beside(run, fidelity, own) for name, own in candidates.items() if name in names
        }
        cost -= len(sources) * len(seeds) * cost_of(fidelity)
        jobs = jobs_of(
            prefix + _called(config, rung), sources, run.recipe(fidelity), seeds,
            side="reward", kind=config.reward_kind, parts=parts,
        )  # fmt: skip
        results = by_row(jobs, run.runner.test(jobs))
        return {name: [result.reward for result in own] for name, own in results.items()}

    selection = climb(distinct(candidates), len(rungs), test, REFERENCE)
    run.progress.advance(cost, replayed=True)  # of nets that candidates alike have in common
    run.progress.say(f"Answer: {selection.chosen}, {selection.verdict}")
    by_part = {
        # What another run has evaluated may know other parts.
        name: [own.parts if len(own.parts) == len(parts) else () for own in nets]
        for name, nets in results.items()
    }
    return selection, by_part


def distinct(candidates: Mapping[Candidate, Streets]) -> list[Candidate]:
    """Names without those whose streets equal another's.

    The hand-set street stays, of others the first.
    """
    order = sorted(candidates, key=lambda name: name != REFERENCE)
    known = {pickle.dumps(candidates[name]): name for name in reversed(order)}
    return [name for name in candidates if name in known.values()]
