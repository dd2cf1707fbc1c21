"""Fits a net to your labelled images, with renders beside them, and measures the gain by the renders.

    sdr-jax fit photographs --out runs/fit                       # photographs/target.yaml says what is where
    sdr-jax fit CamVid --target camvid --few 14 --holdout 0006R0 --out runs/fit14
    sdr-jax fit photographs --preset smoke --out runs/try        # a minute or two

It saves the net in OUT/model (see `sdr-jax predict`) and a report in OUT/report.html on nets that are trained
on your labels alone, with renders beside them, and on renders alone, and tested on images that they have not
seen. If the data have no split, these are the folds of your images, by group, in turn. While the run goes on,
`sdr-jax report OUT --serve` shows the report so far. The same command continues a stopped run.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from common.command import Arguments

if TYPE_CHECKING:
    from experiments.app.functions import fit as fit


def __getattr__(name: str) -> Any:
    """Load the function `experiments.fit` on first use."""
    if name == "fit":
        from experiments.app.functions import fit as function

        return function
    raise AttributeError(name)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app import fit as work  # help and worker processes load this file without it

    return work.main(arguments)


if __name__ == "__main__":
    sys.exit(main())
