"""Train a network on your labelled images plus renders, and measure what the renders add.

    sdr-jax fit photographs --out runs/fit                       # photographs/target.yaml describes the files
    sdr-jax fit CamVid --target camvid --few 14 --holdout 0006R0 --out runs/fit14
    sdr-jax fit photographs --preset smoke --out runs/try        # one to three minutes

It saves a model in OUT/model (see `sdr-jax predict`) and a report in OUT/report.html. The report compares
networks trained on your labels alone, on labels plus renders, and on renders alone, all tested on images that
they have not seen: a held-out split or group, or each fold of your images in turn. `sdr-jax report OUT
--serve` shows the report while the run is under way. The same command resumes a stopped run.
"""

from __future__ import annotations

import shlex

from common.command import PROGRAM, Arguments, exit_code, say
from common.errors import UserError
from common.workers.pool import WorkerError
from experiments.app.fit.config import config_of
from experiments.app.fit.job import fit
from experiments.app.report.fit_table import MODEL
from experiments.app.report.folder import NAME
from experiments.config import parsers
from scene.render import RendererError


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.fit().parse_args(arguments)

    def work() -> None:
        flags = {name: value for name, value in vars(options).items() if name != "debug"}
        config = config_of(parsers.Fit(**flags), say)
        fit(config)
        command = shlex.join([PROGRAM, "predict", str(config.out / MODEL)])
        print(f"Label other images: {command} IMAGES --out DIR")
        print(f"Report: {config.out / NAME}")

    return exit_code(work, (WorkerError,), users=(UserError, RendererError), debug=options.debug)
