"""Train a network on your labelled images plus renders, and measure what the renders add.

    sdr-jax fit photographs --out runs/fit                       # photographs/target.yaml describes the files
    sdr-jax fit CamVid --target camvid --few 14 --holdout 0006R0 --out runs/fit14
    sdr-jax fit photographs --preset smoke --out runs/try        # a minute or two

It saves a model in OUT/model (see `sdr-jax predict`) and a report in OUT/report.html. The report compares
networks trained on your labels alone, on labels plus renders, and on renders alone, all tested on images that
they have not seen: a held-out split or group, or each fold of your images in turn. `sdr-jax report OUT
--serve` shows the report while the run is under way. The same command resumes a stopped run.
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
    from experiments.app.fit import command  # help and worker processes load this file without it

    return command.main(arguments)


if __name__ == "__main__":
    sys.exit(main())
