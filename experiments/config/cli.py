"""What the command lines of the experiments share: defaults by target and preset, then all flags."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from experiments.config.config import AnyConfig, Preset, TargetName, TwinName, fidelities
from experiments.config.presets import in_space
from scene.attributes import SpaceName
from scene.render import RendererError
from scene.workers import WorkerError
from seg.recipes import with_net
from seg.settings import NetName, Trunk
from shell.command import DEBUG, called, exit_code
from shell.errors import UserError


@dataclass(frozen=True)
class _Train:
    net: NetName | None = None
    trunk: Trunk | None = None
    weights: str | None = None


@dataclass(frozen=True)
class _Fidelity:
    train: _Train = _Train()


@dataclass(frozen=True)
class _Choice:
    """What decides the defaults of all other flags."""

    preset: Preset = "quick"
    target: TargetName = "twin"
    data: Path | None = None
    twin: TwinName = "near"
    space: SpaceName | None = None
    reward: _Fidelity = _Fidelity()
    final: _Fidelity = _Fidelity()


def _with_nets(default: AnyConfig, choice: _Choice) -> AnyConfig:
    """Defaults with the recipes of the nets that are chosen."""
    chosen = {"reward": choice.reward, "final": choice.final}
    for name, fidelity in fidelities(default).items():
        named = vars(chosen[name].train) if name in chosen else {}
        changes = {key: value for key, value in named.items() if value is not None}
        if changes:
            train = with_net(fidelity.train, **changes)
            own: dict[str, Any] = {name: replace(fidelity, train=train)}
            default = replace(default, **own)
    return default


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
    with_data: TargetName | None = None,
) -> int:
    """Parse, work, and turn what went wrong into one line.

    Args:
        name: the command is ``python -m experiments.NAME``.
        defaults: of all flags, for a target and a preset.
        work: the job.
        description: the help's first part.
        arguments: of the command; by default the program's.
        target: of a command that has no ``--target``.
        with_data: its target where ``--data`` is given, if that is another one.

    Returns:
        The exit code: 2 for what the user can put right, 1 for workers that died or `Unmet`, 130 after
        Ctrl-C.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    arguments = [word for word in given if word != DEBUG]  # of the command, not of the job
    # On a GPU the policy must leave the memory to the workers' nets.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    # XLA's threads: with --workers 0 nets are the same as those of workers.
    os.environ["NPROC"] = "1"

    def run() -> None:
        choice, _ = tyro.cli(_Choice, args=arguments, return_unknown_args=True, add_help=False)
        chosen = target or choice.target
        if with_data is not None and choice.data is not None:
            chosen = with_data
        # What is hidden must be within reach of the search.
        space = choice.space or ("extended" if choice.twin == "far" else "scenex")
        default = in_space(defaults(chosen, choice.preset), space)
        others = ("--preset", *(["--data DIR"] if with_data else [] if target else ["--target"]))
        words = (name, choice.preset) if target else (name, chosen, choice.preset)
        default = _with_nets(replace(default, out=Path("runs") / "-".join(words)), choice)
        config = tyro.cli(
            type(default),
            prog=called(f"experiments.{name}"),
            description=f"{description or ''}\nThe defaults below are those of --preset {choice.preset} for "
            f"{chosen}; {' and '.join(others)} beside --help show others.\n"
            f"{DEBUG} shows where an error comes from.",
            default=default,
            args=arguments,
        )
        try:
            work(config)
        except RendererError as error:  # of a worker, too
            raise UserError(str(error)) from None

    return exit_code(run, also=(WorkerError, Unmet), debug=DEBUG in given)
