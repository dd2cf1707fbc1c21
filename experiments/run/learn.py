"""Learnt attributes: a search, and the relaxation of its answer that does best at the final size.

The cheap reward favours what is easy to learn, so the answer's relaxation is chosen at the final size,
still on the reward images; only the chosen one ever meets the test images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.config import Candidate, Fidelity, SearchConfig, make_method, make_space
from experiments.reward.miou import Source
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.ladder import Rung, climb, cost_of, ladder, mean_of, most_cost, most_nets
from experiments.run.nets import score_nets
from experiments.run.search import Found, SearchPlan, search
from scene.attributes import names
from scene.proposal import Proposal, default_proposal, describe, random_proposal, slide
from shell.files import write_json

BROAD = 0.5
"""Least width of the broad candidate's intervals."""
CANDIDATE_SEED = 1_000_000
"""Candidates are scored with seeds that no row of the result uses."""


class Learnt(NamedTuple):
    """What was learnt, and how."""

    proposal: Proposal  # f32[attributes] each
    found: Found
    chosen: Candidate
    scores: dict[str, list[float]]  # rewards of every candidate at the final size, by seed


def plan_of(config: SearchConfig) -> SearchPlan:
    """The search of a configuration.

    Raises:
        UserError: an option out of range.
    """
    options = config.search
    method = make_method(config, options.method, make_space(config), options.updates_per_group)
    updates = options.updates_per_group * len(config.groups)
    return SearchPlan(
        "search",
        config.space,
        options.method,
        method,
        names(config.space),
        options.datasets_per_update,
        updates,
        options,
    )


def work_of(config: SearchConfig) -> list[Work]:
    """The nets that `learn` trains."""
    work = [Work.at("rewards of the search", plan_of(config).evaluations, config.reward)]
    candidates = len(config.candidates)
    if not config.ladder:
        nets = candidates * config.candidate_seeds
        return [*work, Work.at("nets of candidates", nets, config.final)]
    rungs = _ladder(config)
    return work + [
        Work.at(f"nets of candidates at most, rung {number}", nets, rung.fidelity)
        for number, (nets, rung) in enumerate(
            zip(most_nets(candidates, rungs), rungs, strict=True), start=1
        )
    ]


def learn(run: Run[Any]) -> Learnt:
    """Search, choose a relaxation, and leave what was learnt in ``attributes.json``.

    Args:
        run: its configuration is a `SearchConfig`.

    Raises:
        UserError: more than a tenth of the evaluations failed.
    """
    config: SearchConfig = run.config
    found = search(run, plan_of(config), config.reward_kind)
    proposals = {name: candidate(name, found, config) for name in config.candidates}
    chosen, scores = (_climb if config.ladder else _choose)(run, proposals)
    write_json(config.out / "attributes.json", describe(proposals[chosen]))
    return Learnt(proposals[chosen], found, chosen, scores)


def candidate(name: Candidate, found: Found, config: SearchConfig) -> Proposal:
    """What may be the answer: one way to relax what a search found, or streets that it knew nothing of."""
    if name == "argmax":
        return found.solution
    if name == "random":
        return random_proposal(config.space)
    if name == "default":
        return default_proposal(config.default_width, config.space)
    if name == "broad":
        return slide(found.spread.centre, np.maximum(found.spread.width, BROAD))
    return found.spread


def _choose(
    run: Run[Any], proposals: Mapping[Candidate, Proposal]
) -> tuple[Candidate, dict[str, list[float]]]:
    """The best candidate on the reward images, at the final size, and every one's rewards by seed."""
    config: SearchConfig = run.config
    seeds = [CANDIDATE_SEED + config.seed + k for k in range(config.candidate_seeds)]
    chosen = {name: proposals[name] for name in distinct(proposals)}
    scores = _rewards(run, "candidate", chosen, config.final, seeds)
    saved = (len(proposals) - len(chosen)) * len(seeds) * cost_of(config.final)
    run.progress.advance(saved, replayed=True)  # twins are trained once
    return max(chosen, key=lambda name: mean_of(scores[name])), scores


def _rewards(
    run: Run[Any],
    what: str,
    proposals: Mapping[Candidate, Proposal],
    fidelity: Fidelity,
    seeds: Sequence[int],
) -> dict[str, list[float]]:
    """Every candidate's rewards on the reward images, in the order of the seeds."""
    sources: dict[str, Source] = {
        name: beside(run, fidelity, own) for name, own in proposals.items()
    }
    recipe, kind = run.recipe(fidelity), run.config.reward_kind
    outcomes = score_nets(run, what, sources, recipe, seeds, side="reward", kind=kind)
    return {name: [o.reward for o in own] for name, own in outcomes.items()}


def _ladder(config: SearchConfig) -> tuple[Rung, ...]:
    return ladder(config.reward, config.final, config.candidate_seeds, config.seed)


def _climb(
    run: Run[Any], proposals: Mapping[Candidate, Proposal]
) -> tuple[Candidate, dict[str, list[float]]]:
    """The best candidate, and the rewards of those that reach the top of the ladder."""
    config: SearchConfig = run.config
    rungs = _ladder(config)
    left = most_cost(len(proposals), rungs)
    kept = distinct(proposals)

    def score(number: int, names: Sequence[str], seeds: Sequence[int]) -> dict[str, list[float]]:
        nonlocal left
        chosen = {name: proposals[name] for name in kept if name in names}
        fidelity = rungs[number].fidelity
        left -= len(names) * len(seeds) * cost_of(fidelity)
        return _rewards(run, f"rung-{number + 1}", chosen, fidelity, seeds)

    best, scores = climb(kept, rungs, score)
    run.progress.advance(left, replayed=True)  # nets of those that left early
    return next(name for name in kept if name == best), scores


def distinct(proposals: Mapping[Candidate, Proposal]) -> list[Candidate]:
    """Names without those that equal an earlier one: twins would hold two places on the ladder."""
    values = {name: np.stack(proposal) for name, proposal in proposals.items()}
    names = list(values)
    return [
        name
        for k, name in enumerate(names)
        if not any(np.array_equal(values[name], values[other]) for other in names[:k])
    ]
