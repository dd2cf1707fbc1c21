"""What reports of many searches say of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from experiments.run.search import Found
from experiments.study.form import mean

Rewards = list[float | None]
"""Of one search in percent, in the order of its evaluations; None where one failed."""


def rewards(found: Found) -> Rewards:
    """The rewards of a search."""
    return [None if o.failed else 100 * o.reward for o in found.outcomes]


def core_seconds(found: Found) -> float:
    """What the rewards took on a worker's one core; what another run had scored counts as done here."""
    return round(sum(outcome.seconds for outcome in found.outcomes), 2)


def thirds(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    """The mean rewards of the search's first third and of its last."""
    third = max(len(values) // 3, 1)
    return mean(values[:third]), mean(values[-third:])


def failed_evaluations(searches: Iterable[Rewards]) -> list[str]:
    """A sentence about the evaluations that failed, if any did."""
    failed = sum(values.count(None) for values in searches)
    return ["", f"{failed} evaluations failed and are left out of their update."] if failed else []
