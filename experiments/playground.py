"""Open a local page with a slider for each attribute and the street that it gives.

    sdr-jax playground
    sdr-jax playground --space extended --size 640x360 --no-browser
    sdr-jax playground --attributes runs/main/attributes.json --real DIR

The page needs the extra playground: pip install 'sdr-jax[playground]'.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.playground.command import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
