"""Which candidate is the answer: surely better than the street set by eye, and no worse on any part.

A search fits its reward images. So its candidates are scored on parts of them, by sequence or city, with
several seeds, and the lower end of what they gain over the street set by eye decides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from experiments.reward.miou import Parts
from shell.errors import UserError

FEWEST, MOST = 2, 4
"""Parts, where nobody says how many."""
ERRORS = 1.0
"""Standard errors below the mean gain where its lower end is, and what a part may lose."""

Rewards = Mapping[str, Sequence[Sequence[float]]]
"""By candidate and seed, one for each part of the images; NaN where training failed."""


def parts_of(sequences: Sequence[str], count: int | None = None) -> Parts:
    """Cut images into parts of about one size, between sequences where there are enough of them.

    Args:
        sequences: of every image, those of one sequence one after the other.
        count: of parts; by default one for each sequence, but 2 to 4.

    Returns:
        First image of every part, and the first after it.

    Raises:
        UserError: fewer images than parts.
    """
    images = len(sequences)
    starts = [k for k in range(images) if k == 0 or sequences[k] != sequences[k - 1]]
    count = min(max(len(starts), FEWEST), MOST, images) if count is None else count
    if count > images:
        raise UserError(
            f"--parts {count} would leave a part without images: {images} give the reward"
        )
    cuts = {0, images}
    while len(cuts) <= count:  # halve the largest part that can be cut
        ends = sorted(cuts)
        for places in (starts, range(images)):
            found = [
                (last - first, min((abs(2 * k - first - last), k) for k in inside)[1])
                for first, last in pairwise(ends)
                if (inside := [k for k in places if first < k < last])
            ]
            if found:
                cuts.add(max(found, key=lambda each: each[0])[1])
                break
    return tuple(pairwise(sorted(cuts)))


def gains(rewards: Rewards, names: Sequence[str], safe: str | None) -> dict[str, np.ndarray]:
    """What candidates gain, f64[seeds parts] each, over the safe one; without one, over their mean."""
    values = {name: np.asarray(rewards[name], float) for name in names}
    level = np.mean(list(values.values()), axis=0) if safe is None else values[safe]
    return {name: own - level for name, own in values.items()}


def surest(rewards: Rewards, names: Sequence[str], safe: str | None = None) -> str:
    """The candidate whose gain has the highest lower end, and that surely loses on no part.

    The lower end is mean(d) - s / sqrt(n), d = gain on a part with a seed, s its standard deviation; that
    of one d alone is d. The safe candidate's is 0.

    Args:
        rewards: of the candidates, all with the same seeds and parts.
        names: of those to choose from; of equals the first.
        safe: the candidate that gains are over, one of the names, and the answer where none is better.
    """

    def lower(name: str) -> float:
        known = found[name][np.isfinite(found[name])]
        if not len(known):
            return -math.inf
        if safe is not None and name != safe and _loses(found[name]):
            return -math.inf
        error = known.std(ddof=1) / math.sqrt(len(known)) if len(known) > 1 else 0.0
        return float(known.mean() - ERRORS * error)

    found = gains(rewards, names, safe)
    best = max(names, key=lower)
    return safe if safe is not None and lower(best) <= 0 else best


def _loses(gain: np.ndarray) -> bool:
    """Whether the mean gain on any part is negative, by more than its error over two or more seeds."""
    known = gain[np.isfinite(gain).all(axis=1)]
    if not len(known):
        return False
    variance = known.var(axis=0, ddof=1).mean() if len(known) > 1 else 0.0
    return bool((known.mean(axis=0) < -ERRORS * math.sqrt(variance / len(known))).any())
