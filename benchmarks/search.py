"""Compare search methods on problems with known answers.

    python -m benchmarks.search --json search.json --plot search.png
    python -m benchmarks.search --evaluations 50 --seeds 3 --methods sdr surrogate --problems smooth

Every value is the true value of the proposal that a method recommends after a number of noisy evaluations.
On the analytic problems random attributes have 0 and the best bins 100, and every seed is another instance,
the same for all methods; `camvid` is in percent of mIoU (see ``benchmarks/recorded.py``).
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from benchmarks import foreign, problems, recorded
from benchmarks.problems import Problem, grouped_space
from benchmarks.ranking import behind, mean_ranks, plot, text
from benchmarks.report import Row, count, new_file, parser, table, write
from benchmarks.rivals import METHODS, RIVALS, make
from common.workers.pool import cores
from experiments.evaluation.in_worker import worker_environment

DEFAULT = "surrogate"
"""The default method of `sdr-jax tune`, which has no start."""

AT_ONCE = {"surrogate": 5, "intervals": 5, "gaussian": 5, "gaussian_process": 5}
"""Data sets per update of methods that compare them, or fit a model from scratch; others take one."""

BUDGETED = "sdr"
"""The method that needs the number of updates in advance."""

PROBLEMS: dict[str, Callable[[int], Problem]] = {
    "smooth": problems.smooth,
    "rugged": problems.rugged,
    "plateau": problems.plateau,
    "weak-signal": problems.weak_signal,
    "camvid": lambda seed: recorded.camvid(),
    "products": lambda seed: foreign.products(seed, grouped_space()),
    "ridge": lambda seed: foreign.ridge(seed, grouped_space()),
    "categories": foreign.categories,
    "binary": foreign.binary,
}
"""Functions that make the instance of a problem for a seed, by name."""

LOOKS = 10
"""Evaluations between two checks of the recommendation of a method."""


class Trace(NamedTuple):
    """The course of one search."""

    values: dict[int, float]  # evaluations -> true value of the recommendation
    seconds: float  # of the method itself, without the rewards
    updates: int


@cache
def _method(name: str, space: sdr_jax.Space, evaluations: int | None) -> sdr_jax.Method:
    """Make a method once, so that the next seed uses its compiled functions."""
    options = {}
    if evaluations:  # spread evenly over the groups, one data set per update
        options["updates_per_group"] = max(1, evaluations // len(space.groups))
    return make(name, space, **options)


@cache
def _instance(problem: str, seed: int) -> Problem:
    """Make an instance of a problem once: some take long to find their best bins, or to compile."""
    return PROBLEMS[problem](seed)


class _Watched:
    """The reward of a problem, which records its seconds."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self.seconds = problem, 0.0

    def __call__(
        self, rng_key: jax.Array, proposals: sdr_jax.Proposal, actions: jax.Array
    ) -> np.ndarray:
        del actions  # the problems are functions of proposals
        jax.block_until_ready(proposals)
        started = time.perf_counter()
        rewards = np.asarray(self._problem.reward(rng_key, proposals), np.float32)
        self.seconds += time.perf_counter() - started
        return rewards


def trace(
    name: str, problem: Problem, evaluations: int, seed: int, looks: tuple[int, ...]
) -> Trace:
    """Run one search with checks on the way.

    Args:
        name: a key of `METHODS`.
        problem: the problem.
        evaluations: the most data sets that the search may evaluate.
        seed: seed of the search and of the noise.
        looks: numbers of evaluations after which the recommendation is checked.

    Returns:
        The trace; a check between two updates takes the state after the earlier one.
    """
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; choose from {', '.join(METHODS)}")
    n = min(AT_ONCE.get(name, 1), evaluations)
    method = _method(name, problem.space, evaluations if name == BUDGETED else None)
    updates = min(evaluations // n, method.updates or evaluations)
    rng_key = jax.random.key(seed)
    reward_fn = _Watched(problem)
    values: dict[int, float] = {}
    waiting = sorted(looks)
    seconds = 0.0
    started = time.perf_counter()
    for t, (state, _) in enumerate(sdr_jax.drive(rng_key, method, reward_fn, updates, n), 1):
        jax.block_until_ready(jax.tree.leaves(state))
        seconds += time.perf_counter() - started
        while waiting and (t == updates or (t + 1) * n > waiting[0]):
            look = waiting.pop(0)
            values[look] = float(problem.true_value(method.solution(state)))
        started = time.perf_counter()
    seconds -= reward_fn.seconds
    return Trace(values, seconds, updates)


def evaluate(method_name: str, problem: Problem, evaluations: int, seed: int) -> float:
    """Search and return the true value of the recommended proposal.

    Args:
        method_name: a key of `METHODS`.
        problem: any object with `space`, `reward(rng_key, proposals)` and `true_value(proposal)`;
            it need not be written in JAX. For tables see `benchmarks.problems.tabular`.
        evaluations: the most data sets that the search may evaluate; a remainder that does not fill an
            update, or with SDR all groups equally, is not used.
        seed: seed of the search and of the noise.

    Returns:
        The true value, in the problem's units.

    Raises:
        ValueError: an unknown method, or too few evaluations for one update.
        ImportError: a library that the method needs is not installed.
    """
    if evaluations < 1:
        raise ValueError(f"evaluations is {evaluations}, but must be at least 1")
    return trace(method_name, problem, evaluations, seed, (evaluations,)).values[evaluations]


class Task(NamedTuple):
    """The task of a process: one method on all instances of one problem."""

    method: str
    problem: str
    budgets: tuple[int, ...]
    seeds: int


class Result(NamedTuple):
    """The outcome of a task."""

    task: Task
    values: np.ndarray  # f64[budgets seeds]: of the recommendation
    course: dict[int, float]  # evaluations -> mean value in the longest search
    seconds_per_update: float


def work(task: Task) -> Result:
    """Search all instances; one long search serves all budgets of a method that needs no budget."""
    instances = [_instance(task.problem, seed) for seed in range(task.seeds)]
    longest = max(task.budgets)
    looks = tuple(sorted({*range(LOOKS, longest + 1, LOOKS), *task.budgets}))
    brief = min(2 * AT_ONCE.get(task.method, 1), longest)
    trace(task.method, instances[0], brief, 0, ())  # compiles
    budgeted = task.method == BUDGETED
    lengths = task.budgets if budgeted else (longest,)
    runs = {
        length: [
            trace(task.method, instance, length, seed, looks if length == longest else (length,))
            for seed, instance in enumerate(instances)
        ]
        for length in lengths
    }

    def at(budget: int) -> list[float]:
        return [run.values[budget] for run in runs[budget if budgeted else longest]]

    seconds = sum(run.seconds for traces in runs.values() for run in traces)
    updates = sum(run.updates for traces in runs.values() for run in traces)
    return Result(
        task,
        np.asarray([at(budget) for budget in task.budgets]),
        {look: float(np.mean([run.values[look] for run in runs[longest]])) for look in looks},
        seconds / updates,
    )


def batches(tasks: list[Task]) -> list[list[Task]]:
    """Split tasks into batches for one process: all problems of a method, so that it compiles once.

    Methods of other libraries compile hardly anything and take long: their tasks come first, one by one.
    """
    alone = [[task] for task in tasks if task.method in RIVALS]
    methods = dict.fromkeys(task.method for task in tasks if task.method not in RIVALS)
    return alone + [[task for task in tasks if task.method == method] for method in methods]


def work_all(tasks: list[Task]) -> list[Result]:
    """Run one batch."""
    return [work(task) for task in tasks]


def results(tasks: list[Task], workers: int) -> Iterator[list[Result]]:
    """Run all batches in order in ``workers`` processes; 0 uses this one."""
    if workers == 0:
        yield from map(work_all, batches(tasks))
        return
    # One thread each, since the processes share the cores.
    os.environ.update(worker_environment())
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(work_all, batches(tasks))


def rows_of(results: list[Result]) -> list[Row]:
    """Tabulate methods, problems and numbers of evaluations."""
    return [
        {
            "method": result.task.method,
            "problem": result.task.problem,
            "evaluations": evaluations,
            "mean": float(values.mean()),
            "se": float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None,
            "seconds_per_update": result.seconds_per_update,
        }
        for result in results
        for evaluations, values in zip(result.task.budgets, result.values, strict=True)
    ]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    names: dict[str, Any] = {"nargs": "+", "metavar": "NAME"}
    positive = partial(count, 1)
    command.add_argument("--seeds", type=positive, default=10, help="instances of each problem")
    command.add_argument("--evaluations", type=positive, nargs="+", default=[50, 100, 300])
    command.add_argument("--methods", choices=METHODS, default=list(METHODS), **names)
    command.add_argument("--problems", choices=PROBLEMS, default=list(PROBLEMS), **names)
    command.add_argument(
        "--workers", type=partial(count, 0), default=cores(), help="processes; 0: this one"
    )
    command.add_argument(
        "--plot", type=new_file, help="also draw value against evaluations into this PNG"
    )
    options = command.parse_args(arguments)
    budgets = tuple(sorted(set(options.evaluations)))
    tasks = [Task(m, p, budgets, options.seeds) for m in options.methods for p in options.problems]
    done_results: list[Result] = []
    started = time.perf_counter()
    try:
        for batch in results(tasks, options.workers):
            done_results += batch
            seconds = time.perf_counter() - started
            done = ", ".join(result.task.problem for result in batch)
            print(
                f"[{100 * len(done_results) / len(tasks):3.0f} %] {batch[0].task.method} on {done}"
                f" | {seconds:.0f} s",
                file=sys.stderr, flush=True,
            )  # fmt: skip
    except (ImportError, ValueError) as error:
        command.error(str(error))
    done_results.sort(key=lambda r: (options.methods.index(r.task.method), r.task.problem))
    rows = rows_of(done_results)
    values = {(r.task.method, r.task.problem): r.values for r in done_results}
    course = {(r.task.method, r.task.problem): r.course for r in done_results}
    ranks, lost = mean_ranks(values), behind(values, DEFAULT, budgets)
    print(table(rows), end="\n\n")
    print(text(ranks, lost, DEFAULT))
    write(options.json, default=DEFAULT, rows=rows, mean_rank=ranks, behind=lost)
    if options.plot:
        plot(course, options.plot, DEFAULT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
