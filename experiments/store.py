"""Shows and merges files of evaluations that runs share, so that none is made twice.

    sdr-jax store show FILE
    sdr-jax store merge A.jsonl B.jsonl runs/c --out C.jsonl

Two evaluations are the same if they agree in sizes, net and training, class table, renderer, assets, real
images, version of the engine, JAX's backend, versions of libraries, proposal and seed. The file is lines of
JSON after a first line that names the attributes; a half-written last line is dropped, and many runs may
write at once. Run folders, which record evaluations in the same way, may replace files.
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
