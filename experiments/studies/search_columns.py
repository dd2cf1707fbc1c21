"""Fields of searches in the reports of studies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from experiments.attribute_search.loop import Found
from experiments.tables.form import Column, Report, number
from experiments.tables.stats import mean

Rewards = list[float | None]
"""Rewards of one search in percent, in the order of its evaluations; None for failed ones."""


def rewards(found: Found) -> Rewards:
    """The rewards of a search."""
    return [None if o.failed else 100 * o.reward for o in found.results]


def core_seconds(found: Found) -> float:
    """Core seconds of the rewards, with those from other runs."""
    return round(sum(result.seconds for result in found.results), 2)


def thirds(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    """The mean rewards of the first and the last third of a search."""
    third = max(len(values) // 3, 1)
    return mean(values[:third]), mean(values[-third:])


def _rewards(row: Report) -> Rewards:
    return row["search"]["rewards"] if row["search"] else []


REWARDS: list[Column] = [
    ("evaluations", lambda row: str(len(_rewards(row)))),
    ("reward, first third", lambda row: number(thirds(_rewards(row))[0])),
    ("last third", lambda row: number(thirds(_rewards(row))[1])),
    ("best", lambda row: number(max((r for r in _rewards(row) if r is not None), default=None))),
]
"""Columns of a table whose rows may have a ``search``."""


def failed_evaluations(searches: Iterable[Rewards]) -> list[str]:
    """A sentence on the failed evaluations, if there are any."""
    failed = sum(values.count(None) for values in searches)
    return ["", f"{failed} evaluations failed and are left out of their update."] if failed else []
