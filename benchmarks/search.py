"""Search methods beside each other on problems whose answer is known.

    python -m benchmarks.search --json search.json
    python -m benchmarks.search --evaluations 50 --seeds 3 --methods sdr linear --problems smooth

Every value is the true one of the proposal that a method recommends after so many noisy evaluations: 0
for random attributes, 100 for the best bins. Every seed is another instance of the problem, the same
one for all methods.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from benchmarks.problems import PROBLEMS, Problem
from benchmarks.report import Row, parser, table, write

DEFAULT = "sdr"
"""The method that a user of the experiments gets."""


class Entry(NamedTuple):
    """A method as it is run here."""

    make: Callable[[sdr_jax.Space, int], sdr_jax.Method]  # of a space and a number of evaluations
    n: int = 1  # data sets per update
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
    "gaussian": Entry(lambda space, _: sdr_jax.gaussian(space), n=4),
    "pbil": Entry(lambda space, _: sdr_jax.pbil(space)),
    "linear": Entry(lambda space, _: sdr_jax.linear(space)),
    "cma_es": Entry(lambda space, _: sdr_jax.cma_es(space)),
    "tpe": Entry(lambda space, _: sdr_jax.tpe(space)),
}
"""All methods, by name."""


@cache
def _made(name: str, space: sdr_jax.Space, evaluations: int | None) -> sdr_jax.Method:
    """A method, made once: what it compiles is used again for the next seed."""
    return METHODS[name].make(space, evaluations or 0)


def _method(name: str, space: sdr_jax.Space, evaluations: int) -> sdr_jax.Method:
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; known are {', '.join(METHODS)}")
    return _made(name, space, evaluations if METHODS[name].budgeted else None)


def _search(
    name: str, problem: Problem, evaluations: int, seed: int, updates: int | None = None
) -> tuple[float, int]:
    """The true value of what a method recommends, and the updates it took."""
    method = _method(name, problem.space, evaluations)
    n = METHODS[name].n
    if evaluations < n:
        raise ValueError(f"evaluations is {evaluations}, but {name} takes {n} at a time")
    most = evaluations // n if method.updates is None else min(evaluations // n, method.updates)
    updates = most if updates is None else min(updates, most)
    state, _ = sdr_jax.run_on_host(jax.random.key(seed), method, problem.reward, updates, n)
    return float(problem.true_value(method.solution(state))), updates


def evaluate(method_name: str, problem: Problem, evaluations: int, seed: int) -> float:
    """Search, and tell the true value of the recommended proposal.

    Args:
        method_name: a key of `METHODS`.
        problem: any object with `space`, `reward(rng_key, proposals)` and `true_value(proposal)`;
            it need not be written in JAX.
        evaluations: data sets that may be scored; what does not fill an update or, with SDR, all
            groups alike, stays unused.
        seed: of the search and of the noise.

    Returns:
        The true value, in the problem's units.

    Raises:
        ValueError: an unknown method, or too few evaluations for one update.
        ImportError: a library that the method needs is not installed.
    """
    return _search(method_name, problem, evaluations, seed)[0]


def rows_of(methods: list[str], problems: list[str], budgets: list[int], seeds: int) -> list[Row]:
    """One row for each method, problem and number of evaluations."""
    rows: list[Row] = []
    for problem in problems:
        instances = [PROBLEMS[problem](seed) for seed in range(seeds)]
        for evaluations in budgets:
            for name in methods:
                _search(name, instances[0], evaluations, 0, updates=2)  # compiles
                started, updates = time.perf_counter(), 0
                values = []
                for seed, instance in enumerate(instances):
                    value, taken = _search(name, instance, evaluations, seed)
                    values.append(value)
                    updates += taken
                seconds = time.perf_counter() - started
                se = float(np.std(values, ddof=1) / np.sqrt(seeds)) if seeds > 1 else None
                rows.append(
                    {
                        "method": name,
                        "problem": problem,
                        "evaluations": evaluations,
                        "mean": float(np.mean(values)),
                        "se": se,
                        "seconds_per_update": seconds / updates,
                    }
                )
    return rows


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of at least 1")
    return int(text)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    names: dict[str, Any] = {"nargs": "+", "metavar": "NAME"}
    command.add_argument("--seeds", type=_positive, default=10, help="instances of each problem")
    command.add_argument("--evaluations", type=_positive, nargs="+", default=[50, 100, 300])
    command.add_argument("--methods", choices=METHODS, default=list(METHODS), **names)
    command.add_argument("--problems", choices=PROBLEMS, default=list(PROBLEMS), **names)
    options = command.parse_args(arguments)
    try:
        rows = rows_of(options.methods, options.problems, options.evaluations, options.seeds)
    except (ImportError, ValueError) as error:
        command.error(str(error))
    print(table(rows))
    write(options.json, default=DEFAULT, rows=rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
