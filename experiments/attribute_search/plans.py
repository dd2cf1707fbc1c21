"""Plans of searches: what is searched by which method, and how many rewards it takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import sdr_jax
from common.errors import UserError
from experiments.config import GroupsConfig, SearchConfig, make_method, make_space
from experiments.evaluation.cost import cost_of
from experiments.session.session import Work


class SearchPlan(NamedTuple):
    """The plan of one search."""

    config: GroupsConfig  # its options, seed, space and held attributes
    name: str  # in the run's log
    method: str
    search: sdr_jax.Method
    subset: tuple[str, ...]  # the optimised attributes; all others stay random or are held
    datasets: int  # per update
    updates: int

    @property
    def evaluations(self) -> int:
        """The number of its rewards."""
        return self.datasets * self.updates


def plan_of(config: SearchConfig, name: str = "search") -> SearchPlan:
    """Plan the search of a configuration, under a unique name in its run.

    Raises:
        UserError: an option out of range.
    """
    options, space = config.search, make_space(config)
    method = make_method(config, options.method, space, options.updates_per_group)
    updates = options.updates_per_group * len(space.groups)
    datasets = options.datasets_per_update
    return SearchPlan(config, name, options.method, method, space.names, datasets, updates)


def work_of(config: GroupsConfig, plans: Sequence[SearchPlan]) -> Work:
    """The rewards of searches."""
    count = sum(plan.evaluations for plan in plans)
    return Work.at("rewards of the search", count, config.reward)


def within(
    config: GroupsConfig, name: str, method: str, subset: tuple[str, ...], minutes: float
) -> SearchPlan:
    """Plan a search of as many rewards as take about `minutes` of a core; the rest as `plan`."""
    datasets = config.search.datasets_per_update
    count = int(60 * minutes / (datasets * cost_of(config.reward))) * datasets
    if not count:
        raise UserError(f"--core-minutes {minutes:g} are too few for one update of {method}")
    return plan(config, name, method, subset, count)


def plan(
    config: GroupsConfig, name: str, method: str, subset: tuple[str, ...], evaluations: int
) -> SearchPlan:
    """Plan a search whose updates take exactly the evaluations.

    Args:
        config: the configuration with options and groups of the search.
        name: unique name in the run's log.
        method: the search method.
        subset: the attributes to optimise; groups keep their order and lose the others.
        evaluations: the number of rewards.

    Raises:
        UserError: too few evaluations, or an option that the method lacks.
    """
    make_space(config)  # checks the groups
    datasets = config.search.datasets_per_update
    if evaluations < datasets or evaluations % datasets:
        raise UserError(
            f"--evaluations must be a multiple of --search.datasets-per-update {datasets}, not "
            f"{evaluations}"
        )
    groups = [[name for name in group if name in subset] for group in config.groups]
    space = sdr_jax.space(subset, config.search.bins, [group for group in groups if group])
    datasets_that_fit, updates_per_group = schedule(evaluations, len(space.groups), datasets)
    search_method = make_method(config, method, space, max(updates_per_group, 1))
    if search_method.updates is not None:  # otherwise it takes any number
        if updates_per_group == 0:
            raise UserError(
                f"--evaluations {evaluations} are too few for {method} on {len(subset)} attributes: "
                f"{len(space.groups)} groups of at least {datasets_that_fit} datasets"
            )
        datasets = datasets_that_fit
    updates = evaluations // datasets
    return SearchPlan(config, name, method, search_method, subset, datasets, updates)


def schedule(evaluations: int, groups: int, datasets: int) -> tuple[int, int]:
    """Datasets per update, and updates per group, of a method that goes group by group.

    It takes the most datasets, up to ``datasets``, with which all groups have the same share of the
    evaluations and none is left. If no number does that, the rest evaluates the answer.
    """
    for n in range(datasets, min(datasets, 2) - 1, -1):
        if evaluations % (groups * n) == 0:
            return n, evaluations // (groups * n)
    return datasets, evaluations // datasets // groups
