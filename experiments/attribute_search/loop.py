"""The search: one jitted step per update, with rewards from worker processes through one callback."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from common.files import write_json
from experiments.attribute_search.plans import SearchPlan, plan_of
from experiments.attribute_search.rewards import Rewards, embed
from experiments.config import SearchConfig
from experiments.evaluation.job import Result
from experiments.session.session import Session
from scene.proposal import Proposal, describe
from sdr_jax.method import clipping_message
from sdr_jax.run import on_cpu


class Found(NamedTuple):
    """The answer of a search, and its course."""

    solution: Proposal  # the method's answer, f32[attributes of the space] each
    results: list[Result]  # in the order of the requests
    probabilities: np.ndarray  # f32[updates, attributes of the subset, bins], after each update
    expected: np.ndarray | None = None
    """f32[updates, datasets, 2]: the model's prior mean and standard deviation of each reward, NaN before the
    first rewards; None without a model."""


def learn(
    run: Session[Any],
    config: SearchConfig | None = None,
    name: str = "",
    plan: SearchPlan | None = None,
) -> Found:
    """Search, and write the method's answer into the run folder.

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
    answer = search(run, plan or plan_of(config, name or "search"))
    file = config.out / (f"attributes/{name}.json" if name else "attributes.json")
    file.parent.mkdir(exist_ok=True)
    write_json(file, describe(answer.solution))
    return answer


@on_cpu()
def search(run: Session[Any], plan: SearchPlan) -> Found:
    """Run a whole search, or the rest of it.

    The loop replays the rewards of the run folder: the same keys give the same actions, and a logged reward
    takes no time. So a killed and continued run ends with the same answer. A failed evaluation is left out of
    its update.

    Args:
        run: its reward's fidelity is the search's.
        plan: the plan of the search.

    Raises:
        UserError: more than a tenth of the evaluations failed, or the log is from another run.
    """
    method, rewards = plan.search, Rewards(run, plan)
    diagnostics = method.diagnostics
    assert diagnostics is not None  # every method by name has them
    common, key = plan.config.search.common_random_numbers, jax.random.key(plan.config.seed)
    reward_fn = sdr_jax.host_reward(rewards, common=common)
    steps = sdr_jax.drive(key, method, reward_fn, plan.updates, plan.datasets)
    distributions: list[np.ndarray] = []
    expectations: list[np.ndarray] = []
    state: Any = None  # there are no expectations before the first update
    clipped = False
    for update in range(plan.updates):
        previous = state
        state, record = next(steps)
        expectations += _expectations(method, previous, record)
        distributions.append(np.asarray(diagnostics.probabilities(state)))
        info, results = jax.device_get(record.info), rewards.results
        if info.clipped and not clipped:
            clipped = True
            message = clipping_message(int(info.clipped), len(results))
            run.progress.say(f"{plan.name}: {message}")
        line = _progress_line(plan, update, results[-plan.datasets :], info)
        if scored := _scored(results):
            run.progress.standing = f"best mIoU {max(scored):.1f}"
            line += f", {run.progress.standing}"
        run.progress.update(line)
    return Found(
        embed(plan, jax.device_get(method.solution(state))),
        rewards.results,
        np.stack(distributions),
        np.stack(expectations) if expectations else None,
    )


def _expectations(
    method: sdr_jax.Method, previous: Any, record: sdr_jax.Record
) -> list[np.ndarray]:
    """The model's expectations of an update's rewards, f32[datasets, 2]; empty without a model."""
    if method.diagnostics is None or method.diagnostics.predict is None:
        return []
    if previous is None:
        return [np.full((len(record.rewards), 2), np.nan, np.float32)]
    return [np.stack(method.diagnostics.predict(previous, record.actions), axis=-1)]


def _scored(results: Sequence[Result]) -> list[float]:
    """The rewards in percent of the evaluations that succeeded."""
    return [100 * result.reward for result in results if result.failed is None]


def _progress_line(plan: SearchPlan, update: int, latest: Sequence[Result], info: Any) -> str:
    """The progress line of an update, whose results are the latest ones."""
    where = f"{plan.name}: update {update + 1}/{plan.updates}"
    if plan.method == "sdr":
        where += f", group {int(info.group) + 1}"
    scored, baseline = _scored(latest), float(info.baseline)
    line = f"mIoU {np.mean(scored):.1f}" if scored else "all failed"
    if np.isfinite(baseline):
        if plan.config.search.squared_reward:
            baseline = np.sign(baseline) * np.sqrt(abs(baseline)) / 100
        line += f", baseline {100 * baseline:.1f}"
    return f"{where} | {line}"
