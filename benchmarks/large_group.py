"""What an update costs where all attributes are in one group.

    python -m benchmarks.large_group --attributes 23 50 100 --json large_group.json

Seconds of an update (what to try, and learning from it, five data sets each, compiled before), by the clock
and by processors, and the size of the state, which does not grow with the evaluations.
"""

from __future__ import annotations

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

import sdr_jax
from benchmarks.report import Row, parser, table, write
from sdr_jax.registry import METHODS, make

EACH = 5
"""Data sets per update."""


def cost(name: str, attributes: int, updates: int) -> Row:
    """The median update of a method."""
    space = sdr_jax.space([f"x{k}" for k in range(attributes)])
    method = make(name, space)
    state = method.init(jax.random.key(0))
    rng = np.random.default_rng(0)
    taken = []
    for t in range(updates + 1):
        rewards = jnp.asarray(rng.normal(size=EACH), jnp.float32)
        started = time.perf_counter(), time.process_time()
        actions, _ = method.sample(jax.random.key(t), state, EACH)
        state, _ = method.update(state, actions, rewards)
        jax.block_until_ready(jax.tree.leaves(state))
        taken.append((time.perf_counter() - started[0], time.process_time() - started[1]))
    size = sum(np.asarray(leaf).nbytes for leaf in jax.tree.leaves(state))
    return {
        "method": name,
        "attributes": attributes,
        "seconds_per_update": float(np.median(taken[1:], axis=0)[0]),
        "cpu_seconds": float(np.median(taken[1:], axis=0)[1]),
        "first_update": taken[0][0],
        "state_mib": size / 2**20,
    }


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    traced = [name for name, entry in METHODS.items() if not entry.library]
    command.add_argument("--methods", choices=traced, nargs="+", default=["surrogate", "intervals"])
    command.add_argument("--attributes", type=int, nargs="+", default=[23, 50, 100])
    command.add_argument("--updates", type=int, default=5, help="updates that are timed")
    options = command.parse_args(arguments)
    rows = [cost(m, k, options.updates) for m in options.methods for k in options.attributes]
    print(table(rows))
    write(options.json, rows=rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
