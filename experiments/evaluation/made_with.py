"""The backend of JAX and the versions of libraries, which also decide networks.

Initial parameters come from a generator that differs between backends and may differ between versions.
Workers and the main process (`session.set_up_process`) compute with one thread, so that the number of cores
decides nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache

import jax

from common.errors import UserError
from common.files import versions
from common.lines import Record
from common.workers.pool import Workers
from scene.version import MAKERS

MadeWith = tuple[tuple[str, str], ...]
"""Names and values."""
LIBRARIES = ("jax", "jaxlib", "flax", "optax", *MAKERS)
FIELD = "made_with"
"""The field of records and of ``config.json``."""


@lru_cache(maxsize=1)
def made_with() -> MadeWith:
    """The backend and versions of this process; starts JAX.

    Raises:
        UserError: JAX cannot start, as on a GPU whose memory other workers have taken.
    """
    try:
        backend = jax.default_backend()
    except RuntimeError as error:
        raise UserError(
            f"JAX cannot start in a worker ({' '.join(str(error).split())}); where the memory of a GPU is "
            "full, give fewer --workers"
        ) from None
    return (("backend", backend), *versions(LIBRARIES).items())


def ask_made_with(workers: Workers) -> Iterator[tuple[int, MadeWith]]:
    """Ask one of the training workers at once; taking the answer waits for it."""
    future = workers.begin(made_with, behind=False)
    return workers.map(made_with, [()], net=True, started={} if future is None else {0: future})


def refuse_other(expected: MadeWith) -> None:
    """Raise UserError in a worker whose backend or versions differ from those of the run's first."""
    versions_here = dict(made_with())
    for name, value in expected:
        if versions_here[name] != value:
            raise UserError(
                f"a worker has {name} {versions_here[name]}, the run began with {value}: give all workers "
                "the same backend and the same versions"
            )


def makers_in_words(records: Iterable[Record]) -> str:
    """Count records by the backend and versions that differ; empty if none do."""
    makers = [record.get(FIELD) for record in records]  # None: an older version did not record it
    recorded = [maker for maker in makers if maker]
    differ = (
        [n for n in recorded[0] if len({maker.get(n) for maker in recorded}) > 1]
        if recorded
        else []
    )
    if not differ and len(recorded) == len(makers):
        return ""
    counts = Counter(
        ", ".join(f"{name} {maker.get(name)}" for name in differ or ["backend"])
        if maker
        else "no record"
        for maker in makers
    )
    kinds = "; ".join(f"{count} with {words}" for words, count in counts.items())
    return f"Runs take only what their own backend and versions made: {kinds}"
