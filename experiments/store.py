"""Show and merge stores: files of evaluations that runs share, so that none is repeated.

    sdr-jax store show FILE
    sdr-jax store merge A.jsonl B.jsonl runs/c --out C.jsonl

Two evaluations are the same if they agree in sizes, network, training, classes, renderer, assets, real
images, engine version, JAX backend, library versions, proposal and seed. A store has one JSON object per
line, after a first line that names the attributes. Several runs may write to it at once, and a half-written
last line is dropped. In place of a file you can pass a run folder, which records its evaluations in the
same way.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.stores import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
