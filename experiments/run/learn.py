"""Learns attributes by a search, and chooses a candidate for the answer by model selection.

The cheap reward favours datasets that are easy to learn, and the dataset with the highest reward was also
lucky. So candidates are compared by nets of the final size with fresh seeds (`selection`); only the chosen
one is tested on the test images.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from experiments.config import (
    SEED_END,
    Candidate,
    SearchConfig,
    make_method,
    make_space,
)
from experiments.evaluation.cost import cost_of
from experiments.evaluation.job import Parts, Result, Source
from experiments.run import plans
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.nets import by_row, jobs_of
from experiments.run.rewards import SearchPlan
from experiments.run.search import Found, search
from experiments.run.selection import Selection, parts_of, select
from experiments.target.base import Target
from scene.held import hold
from scene.proposal import Proposal, describe, slide
from shell.files import digest, write_json

BROAD = 0.5
"""Least width of the broad candidate's intervals."""
REFERENCE: Candidate = "default"
"""The hand-set street; if it is a candidate, the others must be better."""


class Learnt(NamedTuple):
    """The learnt streets, and how they were learnt."""

    streets: Proposal
    found: Found
    selection: Selection
    parts: tuple[str, ...]  # of the reward images, in words
    by_part: dict[str, list[tuple[float, ...]]]
    """Scores of the candidates on each part, by seed; empty if they are not known."""


def plan_of(config: SearchConfig, name: str = "search") -> SearchPlan:
    """Plan the search of a configuration, under a unique name in its run.

    Raises:
        UserError: an option out of range.
    """
    options = config.search
    space = make_space(config)
    method = make_method(config, options.method, space, options.updates_per_group)
    return SearchPlan(
        name,
        config.space,
        options.method,
        method,
        space.names,
        options.datasets_per_update,
        options.updates_per_group * len(space.groups),
        options,
        config.seed,
        config.held,
    )


def work_of(config: SearchConfig, plan: SearchPlan | None = None) -> list[Work]:
    """The nets that `learn` trains."""
    nets = len(config.candidates) * config.candidate_seeds
    rewards = plans.work_of(config, [plan or plan_of(config)])
    return [rewards, Work.at("nets of candidates", nets, config.final)]


def learn(
    run: Run[Any],
    config: SearchConfig | None = None,
    name: str = "",
    plan: SearchPlan | None = None,
) -> Learnt:
    """Search, choose a candidate, and write it into the run folder.

    Args:
        run: the job.
        config: configuration of the search; by default the job's.
        name: name of the search in a job with several; its file is ``attributes/NAME.json`` instead of
            ``attributes.json``.
        plan: the plan of the search; by default `plan_of` the configuration.

    Raises:
        UserError: more than a tenth of the evaluations failed.
    """
    config = config or run.config
    parts, words = reward_parts(run.target, config)
    found = search(run, plan or plan_of(config, name or "search"), config.reward_kind)
    candidates = {each: candidate(each, found, config) for each in config.candidates}
    selection, by_part = _selected(run, config, candidates, parts, f"{name}, " if name else "")
    streets = candidates[cast(Candidate, selection.chosen)]
    file = config.out / (f"attributes/{name}.json" if name else "attributes.json")
    file.parent.mkdir(exist_ok=True)
    write_json(file, describe(streets))
    return Learnt(streets, found, selection, words, by_part)


def reward_parts(target: Target, config: SearchConfig) -> tuple[Parts, tuple[str, ...]]:
    """The parts of the reward images on which candidates are tested separately, and their descriptions.

    Raises:
        UserError: fewer images than ``--parts``.
    """
    if config.reward_kind != "miou":
        return (), ()
    sequences = target.reward_sequences
    parts = parts_of(sequences, config.parts)
    return parts, tuple(_said(sequences[first:end]) for first, end in parts)


def _said(sequences: Sequence[str]) -> str:
    """Describe a part of the reward images."""
    known = list(dict.fromkeys(sequences))
    where = known[0] if len(known) == 1 else f"{known[0]} to {known[-1]}"
    return f"{len(sequences)} images of {where}"


def candidate(name: Candidate, found: Found, config: SearchConfig) -> Proposal:
    """The streets of a candidate: from the search, or independent of it."""
    if name == "argmax":
        return found.solution
    if name == "seen":
        return found.best
    if name == "broad":
        broad = slide(found.spread.centre, np.maximum(found.spread.width, BROAD))
        return hold(broad, config.held)
    return config.streets(name)


def selection_seeds(config: SearchConfig) -> list[int]:
    """Seeds of the nets of each candidate, which all candidates share.

    They depend on the search alone: another search has others, and the same search the same in every job.
    """
    search = [config.search.method, config.seed, config.space]
    # The 0 keeps the seeds of earlier runs, whose stores know these nets.
    names = [["selection", *search, 0, net] for net in range(config.candidate_seeds)]
    return [int(digest(name), 16) % SEED_END for name in names]


def _selected(
    run: Run[Any],
    config: SearchConfig,
    candidates: Mapping[Candidate, Proposal],
    parts: Parts,
    prefix: str,
) -> tuple[Selection, dict[str, list[tuple[float, ...]]]]:
    """Train and test nets of the candidates, and choose one; also return their scores on each part."""
    final, seeds, names = config.final, selection_seeds(config), distinct(candidates)
    sources: dict[str, Source] = {name: beside(run, final, candidates[name]) for name in names}
    jobs = jobs_of(
        f"{prefix}candidate", sources, run.recipe(final), seeds,
        side="reward", kind=config.reward_kind, parts=parts,
    )  # fmt: skip
    results: dict[str, list[Result]] = by_row(jobs, run.runner.test(jobs))
    rewards = {name: [result.reward for result in own] for name, own in results.items()}
    selection = select(rewards, REFERENCE)
    alike = (len(candidates) - len(names)) * len(seeds) * cost_of(final)
    run.progress.advance(alike, replayed=True)  # nets that equal candidates share
    run.progress.say(f"Answer: {selection.chosen}, {selection.verdict}")
    by_part = {
        # Evaluations of another run may have other parts.
        name: [own.parts if len(own.parts) == len(parts) else () for own in nets]
        for name, nets in results.items()
    }
    return selection, by_part


def distinct(candidates: Mapping[Candidate, Proposal]) -> list[Candidate]:
    """Names of the candidates without duplicates.

    Of equal ones the hand-set street stays, otherwise the first.
    """
    order = sorted(candidates, key=lambda name: name != REFERENCE)
    known = {pickle.dumps(candidates[name]): name for name in reversed(order)}
    return [name for name in candidates if name in known.values()]
