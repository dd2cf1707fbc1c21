"""The command line of `sdr-jax fit`."""

from __future__ import annotations

import shlex
from functools import partial

from common.command import Arguments, exit_code
from common.errors import UserError
from common.interrupt import PROGRAM
from common.workers.pool import WorkerError
from experiments.app.fit.config import config_of
from experiments.app.fit.job import fit
from experiments.app.report.fit_table import MODEL
from experiments.app.report.folder import NAME
from experiments.config import parsers


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.fit().parse_args(arguments)
    say = partial(print, flush=True)

    def work() -> None:
        flags = {name: value for name, value in vars(options).items() if name != "debug"}
        config = config_of(flags.pop("data"), flags.pop("out"), say=say, **flags)
        fit(config)
        command = shlex.join([PROGRAM, "predict", str(config.out / MODEL)])
        print(f"Label other images: {command} IMAGES --out DIR")
        print(f"Report: {config.out / NAME}")

    from scene.render import RendererError  # the help needs no engine

    return exit_code(work, (WorkerError,), users=(UserError, RendererError), debug=options.debug)
