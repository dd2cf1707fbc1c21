"""What the command lines of the experiments share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import tyro

from experiments import job
from experiments.config import PRESETS, Config
from experiments.errors import UserError
from experiments.study_config import StudyConfig
from experiments.study_report import Form, rewrite
from experiments.targets import TARGETS, Target
from scene.render import RendererError
from scene.workers import WorkerError, WorkerPool
from seg.data import DataError
from seg.train import TrainingError

AnyConfig = TypeVar("AnyConfig", bound=Config)
AnyStudy = TypeVar("AnyStudy", bound=StudyConfig)

UNREAD = 141
"""Exit code where nobody reads the output any more, as shells have it for a closed pipe."""


def choice_of(arguments: Sequence[str], flag: str, known: Sequence[str], default: str) -> str:
    """The value of a flag that decides the defaults of the others.

    Raises:
        UserError: no such value.
    """
    found = default
    for position, argument in enumerate(arguments):
        if argument == flag:
            found = arguments[position + 1] if position + 1 < len(arguments) else ""
        elif argument.startswith(f"{flag}="):
            found = argument.partition("=")[2]
    if found not in known:
        raise UserError(f"{flag} {found!r} is unknown; known: {', '.join(known)}")
    return found


def preset_of(arguments: Sequence[str]) -> str:
    """The value of ``--preset`` among the arguments, by default quick.

    Raises:
        UserError: no such preset.
    """
    return choice_of(arguments, "--preset", PRESETS, "quick")


def main(
    name: str,
    presets: Callable[[str], Config],
    make_target: Callable[[Config, WorkerPool], Target],
    description: str,
    arguments: Sequence[str] | None = None,
    data_variable: str | None = None,
) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)

    def work() -> None:
        preset = preset_of(arguments)
        default = replace(presets(preset), out=Path("runs") / f"{name}-{preset}")
        if data_variable and os.environ.get(data_variable):
            default = replace(default, data=Path(os.environ[data_variable]))
        config = tyro.cli(
            Config,
            prog=f"python -m experiments.{name}",
            description=description,
            default=default,
            args=arguments,
        )
        job.run(config, make_target)

    return exit_code(work)


def main_on_target(
    name: str,
    defaults: Callable[[str, str], AnyConfig],
    run: Callable[[AnyConfig], object],
    description: str,
    arguments: Sequence[str] | None = None,
) -> int:
    """The same for commands with ``--target``; ``defaults`` are those of (target, preset)."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)

    def work() -> None:
        preset = preset_of(arguments)
        target = choice_of(arguments, "--target", TARGETS, "twin")
        default = replace(defaults(target, preset), out=Path("runs") / f"{name}-{target}-{preset}")
        if target == "camvid" and os.environ.get("CAMVID_DIR"):
            default = replace(default, data=Path(os.environ["CAMVID_DIR"]))
        config = tyro.cli(
            type(default),
            prog=f"python -m experiments.{name}",
            description=description,
            default=default,
            args=arguments,
        )
        run(config)

    return exit_code(work)


def main_of_study(
    form: Form,
    defaults: Callable[[str, str], AnyStudy],
    run: Callable[[AnyStudy], object],
    description: str,
    arguments: Sequence[str] | None = None,
) -> int:
    """The same for studies, which ``--rederive`` only lets write their report anew."""

    def work(config: AnyStudy) -> None:
        if config.rederive is None:
            run(config)
        else:
            report = rewrite(form, config.rederive, config.out)
            print(form.text(report), flush=True)

    return main_on_target(form.name, defaults, work, description, arguments)


def exit_code(work: Callable[[], None]) -> int:
    """Work, and turn what went wrong into one line and an exit code."""
    # On a GPU the policy must leave the memory to the workers' nets.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    try:
        work()
    except (UserError, DataError, RendererError, TrainingError) as error:
        return _fail(str(error), 2)
    except BrokenPipeError:  # as of ``| head``; nor can what is still unwritten be written at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        cure = "once that is put right, the same command goes on"
        return _fail(f"{where}{error.strerror or error}; {cure}", 2)
    except WorkerError as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        return _fail("stopped; the same command goes on where it was", 130)
    return 0


def _fail(message: str, code: int) -> int:
    line = " ".join(message.split())
    print(f"error: {line}" if code != 130 else f"\n{line}", file=sys.stderr, flush=True)
    return code
