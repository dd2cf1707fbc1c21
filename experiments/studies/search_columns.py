"""What reports of studies say about their searches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from experiments.attribute_search.loop import Found
from experiments.tables.form import Column, Report, number
from experiments.tables.stats import mean

Rewards = list[float | None]
"""Rewards of one search in percent, in the order of its evaluations; None for failed ones."""


def rewards(answer: Found) -> Rewards:
    """Return the rewards of a search."""
    return [None if result.failed else 100 * result.reward for result in answer.results]


def core_seconds(answer: Found) -> float:
    """Sum the core seconds of the rewards, those from other runs included."""
    return round(sum(result.seconds for result in answer.results), 2)


def thirds(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    """Compute the mean rewards of the first and the last third of a search."""
    third = max(len(values) // 3, 1)
    return mean(values[:third]), mean(values[-third:])


def reward_columns(rewards: Callable[[Report], Rewards]) -> list[Column]:
    """Make columns of the number of rewards of a row's search, the means of two thirds, and the best one."""
    return [
        ("rewards", lambda row: str(len(rewards(row)))),
        ("reward, first third", lambda row: number(thirds(rewards(row))[0])),
        ("last third", lambda row: number(thirds(rewards(row))[1])),
        ("best", lambda row: number(max((r for r in rewards(row) if r is not None), default=None))),
    ]


def failed_evaluations(searches: Iterable[Rewards]) -> list[str]:
    """Write a sentence on the failed evaluations, if there are any."""
    failed = sum(values.count(None) for values in searches)
    return ["", f"Evaluations left out because they failed: {failed}."] if failed else []
