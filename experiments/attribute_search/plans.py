"""Plans of many searches in one job, all with the same number of evaluations."""

from __future__ import annotations

from collections.abc import Sequence

import sdr_jax
from common.errors import UserError
from experiments.attribute_search.rewards import SearchPlan
from experiments.config import GroupsConfig, make_method, make_space
from experiments.evaluation.cost import cost_of
from experiments.session.session import Work


def work_of(config: GroupsConfig, plans: Sequence[SearchPlan]) -> Work:
    """The rewards of searches."""
    count = sum(plan.evaluations for plan in plans)
    return Work.at("rewards of the search", count, config.reward)


def within(
    config: GroupsConfig, name: str, method: str, subset: tuple[str, ...], minutes: float
) -> SearchPlan:
    """Plan a search of as many rewards as take about so many minutes of a core; the rest as `plan`."""
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
    options = config.search
    datasets = options.datasets_per_update
    if evaluations < datasets or evaluations % datasets:
        raise UserError(
            f"--evaluations must be a multiple of --search.datasets-per-update {datasets}, not "
            f"{evaluations}"
        )
    groups = [[name for name in group if name in subset] for group in config.groups]
    space = sdr_jax.space(subset, options.bins, [group for group in groups if group])
    datasets_that_fit, updates_per_group = schedule(evaluations, len(space.groups), datasets)
    search_method = make_method(config, method, space, max(updates_per_group, 1))
    if search_method.updates is not None:  # otherwise it takes any number
        if updates_per_group == 0:
            raise UserError(
                f"--evaluations {evaluations} are too few for {method} on {len(subset)} attributes: "
                f"{len(space.groups)} groups of at least {datasets_that_fit} datasets"
            )
        datasets = datasets_that_fit
    return SearchPlan(
        name,
        config.space,
        method,
        search_method,
        subset,
        datasets,
        evaluations // datasets,
        options,
        config.seed,
        config.held,
    )


def schedule(evaluations: int, groups: int, datasets: int) -> tuple[int, int]:
    """Datasets per update, and updates per group, of a method that goes group by group.

    It takes the most datasets, up to ``datasets``, with which all groups have the same share of the
    evaluations and none is left. If no number does that, the rest evaluates the answer.
    """
    for n in range(datasets, min(datasets, 2) - 1, -1):
        if evaluations % (groups * n) == 0:
            return n, evaluations // (groups * n)
    return datasets, evaluations // datasets // groups
