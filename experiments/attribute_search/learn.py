"""Learns attributes by a search; the answer is the method's own."""

from __future__ import annotations

from typing import Any

from common.files import write_json
from experiments.attribute_search import plans
from experiments.attribute_search.loop import Found, search
from experiments.attribute_search.rewards import SearchPlan
from experiments.config import SearchConfig, make_method, make_space
from experiments.session.session import Session, Work
from scene.proposal import describe


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
    """The networks that `learn` trains."""
    return [plans.work_of(config, [plan or plan_of(config)])]


def learn(
    run: Session[Any],
    config: SearchConfig | None = None,
    name: str = "",
    plan: SearchPlan | None = None,
) -> Found:
    """Search, and write the answer into the run folder.

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
    answer = search(run, plan or plan_of(config, name or "search"), config.reward_kind)
    file = config.out / (f"attributes/{name}.json" if name else "attributes.json")
    file.parent.mkdir(exist_ok=True)
    write_json(file, describe(answer.solution))
    return answer
