"""Search methods beside each other on problems whose answer is known.

    python -m benchmarks.search --json search.json --plot search.png
    python -m benchmarks.search --evaluations 50 --seeds 3 --methods sdr linear --problems smooth

Every value is the true one of the proposal that a method recommends after so many noisy evaluations. On
the analytic problems 0 is random attributes and 100 the best bins, and every seed is another instance,
the same one for all methods; `camvid` is in percent of mIoU (see ``benchmarks/recorded.py``).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from benchmarks.problems import PROBLEMS, Problem
from benchmarks.ranking import behind, mean_ranks, needed, text
from benchmarks.report import Row, parser, table, write
from experiments.reward import worker_environment

DEFAULT = "actor_critic"
"""The method that a user of the experiments gets."""

LONG = ("tpe",)
"""Methods that compile next to nothing and take long."""

SLOW = ("linear", "sdr", "cma_es", DEFAULT)
"""Those that take longest of the others."""

LOOKS = 10
"""Evaluations between two looks at a method's recommendation."""


class Entry(NamedTuple):
    """A method as it is run here."""

    make: Callable[[sdr_jax.Space, int], sdr_jax.Method]  # of a space and a number of evaluations
    n: int = 1  # data sets per update
    least: int = 1  # as few as an update can take
    budgeted: bool = False  # whether the method depends on the number of evaluations


def _sdr(space: sdr_jax.Space, evaluations: int) -> sdr_jax.Method:
    """The paper's settings, one data set per update, spread evenly over the groups."""
    return sdr_jax.sdr(space, updates_per_group=max(1, evaluations // len(space.groups)))


METHODS: dict[str, Entry] = {
    "random_attributes": Entry(lambda space, _: sdr_jax.random_attributes(space)),
    "random_search": Entry(lambda space, _: sdr_jax.random_search(space)),
    "attribute_descent": Entry(lambda space, _: sdr_jax.attribute_descent(space)),
    "sdr": Entry(_sdr, budgeted=True),
    # It compares the data sets of an update with each other.
    "gaussian": Entry(lambda space, _: sdr_jax.gaussian(space), n=5, least=2),
    "pbil": Entry(lambda space, _: sdr_jax.pbil(space)),
    "linear": Entry(lambda space, _: sdr_jax.linear(space)),
    "cma_es": Entry(lambda space, _: sdr_jax.cma_es(space)),
    "tpe": Entry(lambda space, _: sdr_jax.tpe(space)),
    "actor_critic": Entry(lambda space, _: sdr_jax.actor_critic(space), n=5),
}
"""All methods, by name."""


class Trace(NamedTuple):
    """One search as it went."""

    values: dict[int, float]  # evaluations -> true value of what is then recommended
    luckiest: dict[int, float]  # evaluations -> true value of the data set of the highest reward
    seconds: float  # of the method itself, sampling and updating
    updates: int


@cache
def _made(name: str, space: sdr_jax.Space, evaluations: int | None) -> sdr_jax.Method:
    """A method, made once: what it compiles is used again for the next seed."""
    return METHODS[name].make(space, evaluations or 0)


def _method(name: str, space: sdr_jax.Space, evaluations: int) -> sdr_jax.Method:
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; known are {', '.join(METHODS)}")
    return _made(name, space, evaluations if METHODS[name].budgeted else None)


@jax.jit
def _step_keys(rng_key: jax.Array, t: int) -> tuple[jax.Array, jax.Array]:
    sample_key, reward_key = jax.random.split(jax.random.fold_in(rng_key, t))
    return sample_key, reward_key


def trace(
    name: str, problem: Problem, evaluations: int, seed: int, looks: tuple[int, ...]
) -> Trace:
    """One search, looked at on the way.

    Args:
        name: a key of `METHODS`.
        problem: what is searched.
        evaluations: data sets that may be scored.
        seed: of the search and of the noise.
        looks: numbers of evaluations after which the recommendation is valued.

    Returns:
        The trace; a look between two updates sees the state after the one before.
    """
    method, entry = _method(name, problem.space, evaluations), METHODS[name]
    n = min(entry.n, evaluations)
    if n < entry.least:
        raise ValueError(
            f"evaluations is {evaluations}, but {name} takes at least {entry.least} at a time"
        )
    updates = evaluations // n
    if method.updates is not None:
        updates = min(updates, method.updates)
    init_key, steps_key = jax.random.split(jax.random.key(seed))
    state = method.init(init_key)
    best, lucky = -np.inf, method.solution(state)
    values: dict[int, float] = {}
    luckiest: dict[int, float] = {}
    waiting = sorted(looks)
    seconds = 0.0
    for t in range(updates):
        sample_key, reward_key = _step_keys(steps_key, t)
        started = time.perf_counter()
        actions, proposals = jax.block_until_ready(method.sample(sample_key, state, n))
        seconds += time.perf_counter() - started
        rewards = np.asarray(problem.reward(reward_key, proposals), np.float32)
        top = int(np.where(np.isnan(rewards), -np.inf, rewards).argmax())
        if rewards[top] > best:
            best = float(rewards[top])
            lucky = sdr_jax.Proposal(*(np.asarray(part)[top] for part in proposals))
        started = time.perf_counter()
        state, _ = method.update(state, actions, jax.numpy.asarray(rewards))
        jax.block_until_ready(jax.tree.leaves(state))
        seconds += time.perf_counter() - started
        done = (t + 1) * n
        while waiting and (t == updates - 1 or done + n > waiting[0]):
            look = waiting.pop(0)
            values[look] = float(problem.true_value(method.solution(state)))
            luckiest[look] = float(problem.true_value(lucky))
    return Trace(values, luckiest, seconds, updates)


def evaluate(method_name: str, problem: Problem, evaluations: int, seed: int) -> float:
    """Search, and tell the true value of the recommended proposal.

    Args:
        method_name: a key of `METHODS`.
        problem: any object with `space`, `reward(rng_key, proposals)` and `true_value(proposal)`;
            it need not be written in JAX. For tables see `benchmarks.problems.Tabular`.
        evaluations: data sets that may be scored; what does not fill an update or, with SDR, all
            groups alike, stays unused.
        seed: of the search and of the noise.

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
    """What one process does at a time: one method on all instances of one problem."""

    method: str
    problem: str
    budgets: tuple[int, ...]
    seeds: int


class Result(NamedTuple):
    """What came out."""

    task: Task
    values: np.ndarray  # f64[budgets seeds]: recommended
    luckiest: np.ndarray  # f64[budgets seeds]: of the highest reward
    course: dict[int, float]  # evaluations -> mean value in the longest search
    seconds_per_update: float


def work(task: Task) -> Result:
    """Search all instances; one long search serves all budgets of a method that knows none."""
    instances = [PROBLEMS[task.problem](seed) for seed in range(task.seeds)]
    longest = max(task.budgets)
    looks = tuple(sorted({*range(LOOKS, longest + 1, LOOKS), *task.budgets}))
    trace(task.method, instances[0], min(2 * METHODS[task.method].n, longest), 0, ())  # compiles
    budgeted = METHODS[task.method].budgeted
    lengths = task.budgets if budgeted else (longest,)
    runs = {
        length: [
            trace(task.method, instance, length, seed, looks if length == longest else (length,))
            for seed, instance in enumerate(instances)
        ]
        for length in lengths
    }

    def at(budget: int, kind: str) -> list[float]:
        return [getattr(run, kind)[budget] for run in runs[budget if budgeted else longest]]

    seconds = sum(run.seconds for found in runs.values() for run in found)
    updates = sum(run.updates for found in runs.values() for run in found)
    return Result(
        task,
        np.asarray([at(budget, "values") for budget in task.budgets]),
        np.asarray([at(budget, "luckiest") for budget in task.budgets]),
        {look: float(np.mean([run.values[look] for run in runs[longest]])) for look in looks},
        seconds / updates,
    )


def batches(tasks: list[Task]) -> list[list[Task]]:
    """What one process does in a row: all problems of a method that compiles, so that it does so once.

    Those of `LONG` methods are dealt out one by one, and first.
    """
    alone = [[task] for task in tasks if task.method in LONG]
    methods = dict.fromkeys(task.method for task in tasks if task.method not in LONG)
    return alone + [[task for task in tasks if task.method == method] for method in methods]


def work_all(tasks: list[Task]) -> list[Result]:
    """Do a batch."""
    return [work(task) for task in tasks]


def results(tasks: list[Task], workers: int) -> Iterator[list[Result]]:
    """Do all batches, in their order, in so many processes; 0 works in this one."""
    if workers == 0:
        yield from map(work_all, batches(tasks))
        return
    # One thread each: the processes share the cores.
    os.environ.update(worker_environment())
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(work_all, batches(tasks))


def rows_of(found: list[Result]) -> list[Row]:
    """One row for each method, problem and number of evaluations."""
    return [
        {
            "method": result.task.method,
            "problem": result.task.problem,
            "evaluations": evaluations,
            "mean": float(values.mean()),
            "se": float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None,
            "seconds_per_update": result.seconds_per_update,
        }
        for result in found
        for evaluations, values in zip(result.task.budgets, result.values, strict=True)
    ]


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of at least 1")
    return int(text)


def _workers(text: str) -> int:
    return 0 if text == "0" else _positive(text)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    names: dict[str, Any] = {"nargs": "+", "metavar": "NAME"}
    command.add_argument("--seeds", type=_positive, default=10, help="instances of each problem")
    command.add_argument("--evaluations", type=_positive, nargs="+", default=[50, 100, 300])
    command.add_argument("--methods", choices=METHODS, default=list(METHODS), **names)
    command.add_argument("--problems", choices=PROBLEMS, default=list(PROBLEMS), **names)
    command.add_argument("--workers", type=_workers, default=os.cpu_count(), help="processes")
    command.add_argument("--plot", help="also draw value against evaluations into this PNG")
    options = command.parse_args(arguments)
    budgets = tuple(sorted(set(options.evaluations)))
    # The slowest first, so that the processes end together.
    methods = sorted(options.methods, key=lambda name: name not in SLOW)
    tasks = [Task(m, p, budgets, options.seeds) for m in methods for p in options.problems]
    found: list[Result] = []
    started = time.perf_counter()
    try:
        for batch in results(tasks, options.workers):
            found += batch
            seconds = time.perf_counter() - started
            problems = ", ".join(result.task.problem for result in batch)
            print(
                f"[{100 * len(found) / len(tasks):3.0f} %] {batch[0].task.method} on {problems}"
                f" | {seconds:.0f} s",
                file=sys.stderr, flush=True,
            )  # fmt: skip
    except (ImportError, ValueError) as error:
        command.error(str(error))
    found.sort(key=lambda r: (options.methods.index(r.task.method), r.task.problem))
    rows = rows_of(found)
    values = {(r.task.method, r.task.problem): r.values for r in found}
    luckiest = {(r.task.method, r.task.problem): r.luckiest for r in found}
    course = {(r.task.method, r.task.problem): r.course for r in found}
    ranks, lost = mean_ranks(values), behind(values, DEFAULT, budgets)
    effort = needed(course, values, budgets)
    print(table(rows), end="\n\n")
    print(text(ranks, lost, effort, values, luckiest, budgets, DEFAULT))
    write(
        options.json, default=DEFAULT, rows=rows, mean_rank=ranks, behind=lost, evaluations=effort
    )
    if options.plot:
        from benchmarks.ranking import plot

        plot(course, options.plot, DEFAULT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
