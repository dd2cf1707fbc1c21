"""A ladder of ever costlier fidelities: many candidates at the bottom, the last ones at the final size.

Each rung scores the candidates that are left on seeds of its own, which all of them share. Candidates
that are surely worse than the best leave at once, the worse half leaves at the end of the rung. What
many cheap nets can tell apart costs no full net.

Source: successive halving, Jamieson and Talwalkar (2016), "Non-stochastic Best Arm Identification and
Hyperparameter Optimization". Leaving early on a paired test is ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from experiments.config import Fidelity
from experiments.run.judge import surest
from seg.recipes import recipe_for

CONFIDENCE = 0.95
"""Of each single comparison; many are made, so now and then a good candidate leaves early."""
FINALISTS = 2
"""Halving leaves at least so many for the final size."""
LADDER_SEED = 2_000_000
"""Seeds of the ladder begin here, above those of candidates and rows."""
RUNG_SEEDS = 1_000_000
"""From the seeds of one rung to those of the next."""
STEP_COST = {"compact": 2.5e-7, "paper": 5e-5, "vgg-adam": 5e-5, "scratch": 5e-5}
STEP_COST |= {"lite0-frozen": 8e-8, "lite0-tuned": 2e-6}
"""Seconds of a CPU that one update takes, for each pixel of its images, by recipe, about."""
VIEW_COST = 2.5e-7
"""The same for what a frozen trunk sees in one view of an image."""

Score = Callable[[int, Sequence[str], Sequence[int]], Mapping[str, list[list[float]]]]
"""(rung, candidates, seeds) -> rewards of every candidate by seed, one for each part of the images."""


class Rung(NamedTuple):
    """One size at which candidates meet."""

    fidelity: Fidelity
    seeds: tuple[int, ...]  # one net each, for every candidate


def cost_of(fidelity: Fidelity) -> float:
    """About how many CPU seconds one evaluation takes, scoring left out.

    Source: `docs/benchmarks.md`.
    """
    rays = fidelity.width * fidelity.height * fidelity.samples**2
    return fidelity.images * (0.025 + 2.8e-7 * rays) + training_cost(fidelity)


def training_cost(fidelity: Fidelity) -> float:
    """The part of ``cost_of`` that is training: all of it where the images are there already."""
    train = fidelity.train
    pixels = fidelity.width * fidelity.height
    views = VIEW_COST * fidelity.images * train.views if train.frozen else 0.0
    return pixels * (views + STEP_COST[recipe_for(train)] * train.steps * train.batch)


def middle(low: Fidelity, high: Fidelity) -> Fidelity:
    """The fidelity between two, half way on a logarithmic scale; net and rays are the higher one's."""

    def between(a: int, b: int, unit: int = 1) -> int:
        return max(round(math.sqrt(a * b) / unit), 1) * unit

    return replace(
        high,
        width=between(low.width, high.width, 8),
        height=between(low.height, high.height, 8),
        streets=between(low.streets, high.streets),
        shots=between(low.shots, high.shots),
        train=replace(high.train, steps=between(low.train.steps, high.train.steps)),
    )


def fidelities(low: Fidelity, high: Fidelity) -> tuple[Fidelity, ...]:
    """Those of the ladder: the lowest, one between, the highest."""
    return tuple(dict.fromkeys((low, middle(low, high), high)))


def ladder(low: Fidelity, high: Fidelity, nets: int, seed: int) -> tuple[Rung, ...]:
    """The rungs from the reward's fidelity to the final one.

    Args:
        low: of the first rung.
        high: of the last one.
        nets: of the last rung, for each candidate; every rung below has twice as many as the one above,
            since its nets are cheaper and tell less.
        seed: of the run.
    """
    steps = fidelities(low, high)
    rungs = []
    for number, fidelity in enumerate(steps):
        first = LADDER_SEED + RUNG_SEEDS * number + seed
        count = nets * 2 ** (len(steps) - 1 - number)
        rungs.append(Rung(fidelity, tuple(range(first, first + count))))
    return tuple(rungs)


def hopeless(ours: Any, best: Any, confidence: float = CONFIDENCE) -> bool:
    """Whether a candidate is worse than the best beyond doubt, by Student's t on paired differences.

    mean(d) + t(confidence, n - 1) s / sqrt(n) < 0, with d = ours - best and s its standard deviation.

    Args:
        ours: rewards f64[seeds parts] or f64[seeds].
        best: the best candidate's with the same seeds.
        confidence: of the one-sided interval. One pair tells nothing.
    """
    d = np.asarray(ours, float) - np.asarray(best, float)
    d = d[np.isfinite(d)]  # failed nets have no reward
    if len(d) < 2:
        return False
    half = stats.t.ppf(confidence, len(d) - 1) * d.std(ddof=1) / math.sqrt(len(d))
    return bool(d.mean() + half < 0)


def mean_of(rewards: Any) -> float:
    """The mean of the rewards that are known, of any shape; where none is, the worst."""
    values = np.asarray(rewards, float)
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else -math.inf


def best_of(scores: Mapping[str, Any], names: Sequence[str]) -> str:
    """The name with the highest mean; of equals the first."""
    return max(names, key=lambda name: mean_of(scores[name]))


def kept(entered: int) -> int:
    """How many of those that enter a rung may go on to the next."""
    return min(entered, max(-(-entered // 2), FINALISTS))


def most_nets(candidates: int, rungs: Sequence[Rung]) -> list[int]:
    """Nets on each rung, if nobody leaves early."""
    nets = []
    for rung in rungs:
        nets.append(candidates * len(rung.seeds))
        candidates = kept(candidates)
    return nets


def most_cost(candidates: int, rungs: Sequence[Rung], first: int = 0) -> float:
    """The ladder from a rung on, in the units of ``cost_of``, if nobody leaves early."""
    pairs = list(zip(most_nets(candidates, rungs), rungs, strict=True))
    return sum(nets * cost_of(rung.fidelity) for nets, rung in pairs[first:])


def climb(
    candidates: Sequence[str], rungs: Sequence[Rung], score: Score, safe: str | None = None
) -> tuple[str, dict[str, list[list[float]]]]:
    """Send candidates up the ladder.

    Args:
        candidates: their names.
        rungs: from the cheapest to the final one.
        score: works out rewards.
        safe: the candidate that never leaves, and that others must surely be better than (`judge.surest`).

    Returns:
        The surest, and the rewards on the last rung of those that got there; who left it early has fewer.
    """
    left = list(candidates)
    scores: dict[str, list[list[float]]] = {}
    for number, rung in enumerate(rungs):
        last = number == len(rungs) - 1
        if len(left) == 1 and not last:
            continue
        entered = len(left)
        scores = {name: [] for name in left}
        half = -(-len(rung.seeds) // 2)
        for seeds in (rung.seeds[:half], rung.seeds[half:]):
            if not seeds or (len(left) == 1 and scores[left[0]]):
                break
            found = score(number, left, seeds)
            for name in left:
                scores[name] += found[name]
            best = scores[best_of(scores, left)]
            left = [name for name in left if name == safe or not hopeless(scores[name], best)]
        if not last:
            ranked = sorted(left, key=lambda name: (name != safe, -mean_of(scores[name])))
            left = [name for name in left if name in ranked[: kept(entered)]]
    return surest(scores, left, safe), scores
