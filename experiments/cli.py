"""What the command lines of the experiments share: defaults by target and preset, then all flags."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from experiments.config import Preset, TargetName
from experiments.run.context import AnyConfig
from scene.render import RendererError
from scene.workers import WorkerError
from shell.command import exit_code
from shell.errors import UserError


@dataclass(frozen=True)
class _Choice:
    """What decides the defaults of all other flags."""

    preset: Preset = "quick"
    target: TargetName = "twin"


class Unmet(Exception):
    """The work is done, but its result is not what a flag demands."""


def main(
    name: str,
    defaults: Callable[[TargetName, Preset], AnyConfig],
    work: Callable[[AnyConfig], object],
    description: str | None,
    arguments: Sequence[str] | None = None,
    *,
    target: TargetName | None = None,
) -> int:
    """Parse, work, and turn what went wrong into one line.

    Args:
        name: the command is ``python -m experiments.NAME``.
        defaults: of all flags, for a target and a preset.
        work: the job.
        description: the help's first part.
        arguments: of the command; by default the program's.
        target: of a command that has no ``--target``.

    Returns:
        The exit code: 2 for what the user can put right, 1 for workers that died or `Unmet`, 130 after
        Ctrl-C.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # On a GPU the policy must leave the memory to the workers' nets.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

    def run() -> None:
        choice, _ = tyro.cli(_Choice, args=arguments, return_unknown_args=True, add_help=False)
        chosen = target or choice.target
        default = defaults(chosen, choice.preset)
        words = (name, choice.preset) if target else (name, chosen, choice.preset)
        default = replace(default, out=Path("runs") / "-".join(words))
        config = tyro.cli(
            type(default),
            prog=f"python -m experiments.{name}",
            description=description,
            default=default,
            args=arguments,
        )
        try:
            work(config)
        except RendererError as error:  # of a worker, too
            raise UserError(str(error)) from None

    return exit_code(run, also=(WorkerError, Unmet))
