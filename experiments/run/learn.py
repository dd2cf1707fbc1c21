"""Learnt attributes: a search, and the candidate for its answer that is surely best at the final size.

The cheap reward favours what is easy to learn, and a search fits the images that it is scored on. So the
answer is chosen at the final size, on parts of the reward images each for itself (`judge`); only the chosen
one ever meets the test images.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from experiments.config import Candidate, Fidelity, SearchConfig, make_method, make_space, start_of
from experiments.reward.miou import Parts, Source
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.judge import parts_of, surest
from experiments.run.ladder import Rung, climb, cost_of, ladder, most_cost, most_nets
from experiments.run.nets import score_nets
from experiments.run.search import Found, SearchPlan, search
from experiments.target.base import Target
from scene.attributes import names
from scene.proposal import (
    Mixture,
    Proposal,
    Streets,
    describe,
    mixture,
    named,
    slide,
)
from shell.files import write_json

BROAD = 0.5
"""Least width of the broad candidate's intervals."""
CAMERA = ("field_of_view", "exposure", "white_balance")
"""Attributes of the camera, beside those whose names begin with the word."""
CANDIDATE_SEED = 1_000_000
"""Candidates are scored with seeds that no row of the result uses."""
SAFE: Candidate = "default"
"""The candidate that others must surely be better than, if it is among them."""


class Learnt(NamedTuple):
    """What was learnt, and how."""

    streets: Streets
    found: Found
    chosen: Candidate
    scores: dict[str, list[list[float]]]  # rewards at the final size, by candidate, seed and part
    parts: tuple[str, ...]  # of the reward images, in words


def plan_of(config: SearchConfig, name: str = "search") -> SearchPlan:
    """The search of a configuration, under a name that no other search of its run has.

    Raises:
        UserError: an option out of range.
    """
    options = config.search
    method = make_method(config, options.method, make_space(config), options.updates_per_group)
    updates = options.updates_per_group * len(config.groups)
    return SearchPlan(
        name,
        config.space,
        options.method,
        method,
        names(config.space),
        options.datasets_per_update,
        updates,
        options,
        config.seed,
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
    parts, words = judged_on(run.target, config)
    found = search(run, plan_of(config, name or "search"), config.reward_kind)
    streets = {each: candidate(each, found, config) for each in config.candidates}
    judge = _Judge(run, config, streets, parts, f"{name}, " if name else "")
    chosen, scores = judge.climb() if config.ladder else judge.choose()
    file = config.out / (f"attributes/{name}.json" if name else "attributes.json")
    file.parent.mkdir(exist_ok=True)
    write_json(file, describe(streets[chosen]))
    return Learnt(streets[chosen], found, chosen, scores, words)


def judged_on(target: Target, config: SearchConfig) -> tuple[Parts, tuple[str, ...]]:
    """The parts of the reward images that candidates are judged on, and what they are in words.

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
    if name == "argmax":
        return found.solution
    if name == "seen":
        return found.best
    if name == "camera":
        return camera_of(found.solution, config)
    if name == "half":
        return mixture((0.5, 0.5), (found.solution, camera_of(found.solution, config)))
    if name in ("random", "default"):
        return named(name, config.space, config.default_width)
    if name == "broad":
        return slide(found.spread.centre, np.maximum(found.spread.width, BROAD))
    return found.spread


def camera_of(solution: Proposal, config: SearchConfig) -> Proposal:
    """The camera of a solution, all else where the search began."""
    own = [name.startswith("camera") or name in CAMERA for name in names(config.space)]
    began = start_of(config)
    return Proposal(*(np.where(own, a, b) for a, b in zip(solution, began, strict=True)))


Scores = dict[str, list[list[float]]]
"""By candidate and seed, one reward for each part of the images."""


@dataclass(frozen=True)
class _Judge:
    """Scores candidates on the parts of the reward images."""

    run: Run[Any]
    config: SearchConfig
    streets: Mapping[Candidate, Streets]
    parts: Parts
    prefix: str  # of what the log calls the nets

    def choose(self) -> tuple[Candidate, Scores]:
        """The surest candidate at the final size, and every one's rewards."""
        config, names = self.config, distinct(self.streets)
        seeds = [CANDIDATE_SEED + config.seed + k for k in range(config.candidate_seeds)]
        scores = self._rewards("candidate", names, config.final, seeds)
        saved = (len(self.streets) - len(names)) * len(seeds) * cost_of(config.final)
        self.run.progress.advance(saved, replayed=True)  # twins are trained once
        best = surest(scores, names, _safe(names))
        return next(name for name in names if name == best), scores

    def climb(self) -> tuple[Candidate, Scores]:
        """The surest candidate, and the rewards of those that reach the top of the ladder."""
        rungs, kept = _ladder(self.config), distinct(self.streets)
        left = most_cost(len(self.streets), rungs)

        def score(number: int, names: Sequence[str], seeds: Sequence[int]) -> Scores:
            nonlocal left
            chosen = [name for name in kept if name in names]
            fidelity = rungs[number].fidelity
            left -= len(names) * len(seeds) * cost_of(fidelity)
            return self._rewards(f"rung-{number + 1}", chosen, fidelity, seeds)

        best, scores = climb(kept, rungs, score, _safe(kept))
        self.run.progress.advance(left, replayed=True)  # nets of those that left early
        return next(name for name in kept if name == best), scores

    def _rewards(
        self, what: str, names: Sequence[Candidate], fidelity: Fidelity, seeds: Sequence[int]
    ) -> Scores:
        """Rewards of candidates on every part, in the order of the seeds."""
        run, kind = self.run, self.config.reward_kind
        sources: dict[str, Source] = {
            name: beside(run, fidelity, self.streets[name]) for name in names
        }
        outcomes = score_nets(
            run, f"{self.prefix}{what}", sources, run.recipe(fidelity), seeds,
            side="reward", kind=kind, parts=self.parts,
        )  # fmt: skip
        count = max(len(self.parts), 1)
        return {
            name: [list(o.parts) or [o.reward] * count for o in own]
            for name, own in outcomes.items()
        }


def _safe(names: Iterable[str]) -> str | None:
    return SAFE if SAFE in names else None


def _ladder(config: SearchConfig) -> tuple[Rung, ...]:
    return ladder(config.reward, config.final, config.candidate_seeds, config.seed)


def distinct(streets: Mapping[Candidate, Streets]) -> list[Candidate]:
    """Names without those that equal another: twins would hold two places on the ladder.

    The safe candidate stays, of others the first.
    """
    order = sorted(streets, key=lambda name: name != SAFE)
    known = {_bytes(streets[name]): name for name in reversed(order)}
    return [name for name in streets if name in known.values()]


def _bytes(streets: Streets) -> tuple:
    if isinstance(streets, Mixture):
        return streets.shares, *map(_bytes, streets.proposals)
    return (np.asarray(streets, np.float32).tobytes(),)
