"""With what nets are made, beside all that they are told: JAX's backend, and versions of libraries.

Initial parameters come from a generator that differs between backends and may between versions. Workers
compute with one thread, and so does the main process (`config.cli`): their number decides nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache

import jax

from scene.version import MAKERS
from scene.workers import Workers
from shell.errors import UserError
from shell.files import versions
from shell.lines import Record

MadeWith = tuple[tuple[str, str], ...]
"""Names and values."""
LIBRARIES = ("jax", "jaxlib", "flax", "optax", *MAKERS)
FIELD = "made_with"
"""Where records and ``config.json`` have it."""


@lru_cache(maxsize=1)
def made_with() -> MadeWith:
    """With what this process makes nets; starts JAX."""
    return (("backend", jax.default_backend()), *versions(LIBRARIES).items())


def asked(workers: Workers) -> Iterator[tuple[int, MadeWith]]:
    """Asks one of those who train at once; its answer is waited for when it is taken."""
    begun = workers.begin(made_with, behind=False)
    return workers.map(made_with, [()], net=True, begun={} if begun is None else {0: begun})


def refuse_other(expected: MadeWith) -> None:
    """Raise UserError in a worker that makes nets with anything else than its run's first did."""
    ours = dict(made_with())
    for name, value in expected:
        if ours[name] != value:
            raise UserError(
                f"a worker has {name} {ours[name]}, the run began with {value}: give all workers the "
                "same backend and the same versions"
            )


def told_apart(records: Iterable[Record]) -> str:
    """How many records were made with what, by all that differs; empty where nothing does."""
    found = [record.get(FIELD) for record in records]  # None: of a version that did not record it
    known = [own for own in found if own]
    differ = [n for n in known[0] if len({own.get(n) for own in known}) > 1] if known else []
    if not differ and len(known) == len(found):
        return ""
    said = Counter(
        ", ".join(f"{name} {own.get(name)}" for name in differ or ["backend"])
        if own
        else "no record"
        for own in found
    )
    kinds = "; ".join(f"{count} with {words}" for words, count in said.items())
    return f"Runs take only what their own backend and versions made: {kinds}"
