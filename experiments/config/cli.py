"""The command line of jobs: defaults by target and preset, then all flags.

A command is a row of `experiments.config.studies`; its work is loaded once its flags are right.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from inspect import get_annotations
from pathlib import Path
from typing import Any

from experiments.config.config import (
    AnyConfig,
    Config,
    FewConfig,
    GroupsConfig,
    LearntConfig,
    Preset,
    TargetName,
    fidelities,
)
from experiments.config.presets import in_space
from experiments.config.studies import JOBS, SensitivityConfig, TableConfig, defaults_of, methods_of
from scene.attributes import SpaceName
from scene.workers import WorkerError
from seg.recipes import with_net, with_steps
from seg.settings import VGG_NETS
from shell.command import HELP, Parser, docstring, exit_code
from shell.errors import UserError
from shell.flags import Field, add_flag, filled, flags_of

COMMON = (
    "target", "data", "out", "preset", "holdout", "few", "learnt", "search.method", "space", "seed",
    "seeds", "weights", "workers", "store", "rederive",
)  # fmt: skip
"""Fields in the short help, beside a study's own."""
TOPICS = {
    "real images": (
        "target",
        "reward_images",
        "test_images",
        "test_split",
        "unlabelled",
        "few_share",
    ),
    "the twin": ("twin", "twin_seed"),
    "streets and assets": (
        "fix",
        "overlap",
        "assets",
        "asset_use",
        "asset_fraction",
        "asset_count",
    ),
    "where it runs": ("renderer", "executor", "scheduler"),
    "the search": ("groups", "default_width", "reward_kind", "search"),
    "model selection": ("candidates", "candidate_seeds", "parts"),
    "size of rewards": ("reward",),
    "size of final nets": ("final",),
    "size of other nets": ("compact", "vgg"),
    "nets without weights": ("from_scratch",),
}
"""Titles and fields of the other groups; nested fields go by their outermost name."""
OTHERS = "other options"
STARTED_NETS = (*VGG_NETS, "dinov2")
"""Nets that start from the file of --weights."""


class Unmet(Exception):
    """The work is done, but its result does not meet a flag's demand."""


def command(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run the command line of a job; returns the exit code.

    Args:
        name: one of `JOBS`.
        arguments: arguments of the command; by default the program's.
    """
    job = JOBS[name]
    return main(
        name, partial(defaults_of, name), job.work, docstring(job.module), arguments,
        target=job.target, with_data=job.with_data,
    )  # fmt: skip


def parser(name: str) -> Parser:
    """The command line of a job, with the defaults of its preset quick.

    Args:
        name: among `JOBS`.
    """
    job = JOBS[name]
    default = defaults_of(name, job.target or "twin", "quick")
    return _parser(name, default, docstring(job.module))


def main(
    name: str,
    defaults: Callable[[TargetName, Preset], AnyConfig],
    work: Callable[[AnyConfig], object] | str,
    description: str | None,
    arguments: Sequence[str] | None = None,
    *,
    target: TargetName | None = None,
    with_data: TargetName | None = None,
) -> int:
    """Parse, work, and turn errors into one line.

    Args:
        name: name of the command.
        defaults: gives the defaults of all flags for a target and a preset.
        work: the job, or the ``module:name`` from which it is loaded once the flags are right.
        description: the help's first part.
        arguments: arguments of the command; by default the program's.
        target: the target of a command without ``--target``.
        with_data: another target of such a command with ``--data``.

    Returns:
        The exit code: 2 for errors of the user, 1 for workers that died or `Unmet`, 130 after Ctrl-C.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    others = ("--preset", *(["--data DIR"] if with_data else [] if target else ["--target"]))

    def configured(given: Mapping[str, Any]) -> tuple[AnyConfig, str]:
        """The defaults for the given flags, and a description of them."""
        preset, chosen = given.get("preset", "quick"), target or given.get("target", "twin")
        if with_data is not None and given.get("data") is not None:
            chosen = with_data
        # The twin's hidden attributes must lie in the space of the search.
        usual: SpaceName = "extended" if given.get("twin") == "far" else "scenex"
        space: SpaceName = given.get("space", usual)
        default = in_space(defaults(chosen, preset), space)
        out = Path("runs") / "-".join((name, preset) if target else (name, chosen, preset))
        return _with_nets(replace(default, out=out), given), f"--preset {preset} for {chosen}"

    asked = [word for word in words if word in HELP]
    parser = _parser(name, configured({})[0], description)
    if target is not None and any(word.partition("=")[0] == "--target" for word in words):
        mains = ", ".join(own for own, job in JOBS.items() if job.target is not None)
        parser.error(f"no option --target: the command names the target; there are {mains}")
    given = vars(parser.parse_args([word for word in words if word not in asked]))
    if asked:  # show the defaults that the other flags lead to
        default, of = configured(given)
        note = f"The defaults below are those of {of}; {' and '.join(others)} beside --help show others."
        _parser(name, default, f"{description or ''}\n\n{note}").parse_args(asked)
    debug = given.pop("debug")
    do = _loaded(work) if isinstance(work, str) else work

    def run() -> None:
        from scene.render import RendererError  # the help needs no engine

        config = filled(configured(given)[0], given)
        if given.get("rederive") is None:
            refuse_unused(config, given)
        try:
            do(config)
        except RendererError as error:  # also from a worker
            raise UserError(str(error)) from None

    return exit_code(run, also=(WorkerError, Unmet), debug=debug)


SDR = ("learning_rate", "baseline", "normalise", "squared_reward", "unoptimised")
"""Options of the search that only ``sdr`` has."""


def refuse_unused(config: Config, given: Mapping[str, Any]) -> None:
    """Raise UserError for a flag that has no effect beside the others.

    Args:
        config: the configuration with the flags.
        given: values of the flags by their dotted names.
    """
    for flag in ("twin", "twin_seed"):
        if (
            flag in given and config.target != "twin" and config.twin != "far"
        ):  # far has its own error
            raise UserError(f"{_flag(flag)} is for --target twin, not {config.target}")
    if isinstance(config, FewConfig) and "few_share" in given and config.few is None:
        raise UserError("--few-share needs --few")
    if isinstance(config, TableConfig) and given.get("all_images"):
        if config.gta5 is config.synthia is config.kitti is None:
            raise UserError("--all-images needs --gta5, --synthia or --kitti")
    if isinstance(config, SensitivityConfig) and config.records and "evaluations" in given:
        raise UserError("--evaluations is of no use with --records, which are all analysed")
    if not isinstance(config, GroupsConfig):
        return
    searched = [name for name in given if name.startswith("search.")]
    if searched and isinstance(config, LearntConfig) and config.learnt is not None:
        raise UserError(f"{_flag(searched[0])} is of no use with --learnt: nothing is searched")
    methods = methods_of(config)
    for name in SDR:
        if f"search.{name}" in given and "sdr" not in methods:
            raise UserError(f"--search.{_flag(name)[2:]} is for sdr, not {', '.join(methods)}")
    if "search.start" in given and "intervals" not in methods:
        raise UserError(f"--search.start is for intervals, not {', '.join(methods)}")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _loaded(place: str) -> Callable[[Any], object]:
    """Load the object that ``module:name`` names."""
    module, _, name = place.partition(":")
    found: Callable[[Any], object] = getattr(import_module(module), name)
    return found


def _parser(name: str, default: Config, description: str | None) -> Parser:
    """The parser of a configuration; its help shows these defaults."""
    parser = Parser(JOBS[name].called if name in JOBS else name, description)
    common, own = parser.add_argument_group("options").add_argument, get_annotations(type(default))
    titles = {name: title for title, names in TOPICS.items() for name in names}
    adders = {title: parser.group(title) for title in (*TOPICS, OTHERS)}

    def rank(field: Field) -> int:
        word = ".".join(field.path)
        return COMMON.index(word) if word in COMMON else -1 if word in own else len(COMMON)

    for field in sorted(flags_of(default), key=rank):
        rare = rank(field) == len(COMMON)
        add_flag(adders[titles.get(field.path[0], OTHERS)] if rare else common, field)
    return parser


def _with_nets(default: AnyConfig, given: Mapping[str, Any]) -> AnyConfig:
    """Defaults with the recipes of the chosen nets, their weights, and a warm-up that fits the steps."""
    for name, fidelity in fidelities(default).items():
        flags = {key: given.get(f"{name}.train.{key}") for key in ("net", "trunk", "weights")}
        changes = {key: value for key, value in flags.items() if value is not None}
        weights, train = given.get("weights"), fidelity.train
        if weights is not None and changes.get("net", train.net) in STARTED_NETS:
            changes.setdefault("weights", str(weights))
        if changes and name in ("reward", "final"):
            train = with_net(train, **changes)
        steps = given.get(f"{name}.train.steps")
        if isinstance(steps, int):
            train = with_steps(train, steps)
        if train is not fidelity.train:
            own: dict[str, Any] = {name: replace(fidelity, train=train)}
            default = replace(default, **own)
    return default
