"""The command line of jobs: defaults by target and preset, then all flags.

A command is a row of `experiments.config.studies`; its work is loaded once its flags are right.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from inspect import get_annotations
from pathlib import Path
from typing import Any

from common.command import HELP, Parser, docstring, exit_code, meant
from common.errors import UserError
from common.flags import Field, add_flag, filled, flags_of
from common.workers.pool import WorkerError
from experiments.config.config import (
    AnyConfig,
    Config,
    FewConfig,
    GroupsConfig,
    LearntConfig,
    fidelities,
)
from experiments.config.presets import in_space
from experiments.config.studies import JOBS, SensitivityConfig, TableConfig, defaults_of, methods_of
from scene.attributes import SpaceName
from seg.recipes import with_net, with_steps
from seg.settings import VGG_NETS

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


def command(
    name: str,
    arguments: Sequence[str] | None = None,
    work: Callable[[Any], object] | None = None,
) -> int:
    """Run the command line of a job; returns the exit code.

    Args:
        name: one of `JOBS`.
        arguments: arguments of the command; by default the program's.
        work: what to do with the configuration; by default the job's own work.

    Returns:
        The exit code: 2 for errors of the user, 1 for workers that died or `Unmet`, 130 after Ctrl-C.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    asked = [word for word in words if word in HELP]
    line = parser(name)
    if JOBS[name].target and any(word.partition("=")[0] == "--target" for word in words):
        mains = ", ".join(own for own, job in JOBS.items() if job.target is not None)
        line.error(f"no option --target: the command names the target; there are {mains}")
    given = vars(line.parse_args([word for word in words if word not in asked]))
    if asked:
        parser(name, given).parse_args(asked)
    debug = given.pop("debug")
    do = work or _loaded(JOBS[name].work)

    def run() -> None:
        from scene.render import RendererError  # the help needs no engine

        config = configured(name, given)
        try:
            do(config)
        except RendererError as error:  # also from a worker
            raise UserError(str(error)) from None

    return exit_code(run, also=(WorkerError, Unmet), debug=debug)


def configured(name: str, values: Mapping[str, Any]) -> Any:
    """The configuration of a job: its defaults with values of fields by their dotted names.

    Raises:
        UserError: no field has a name, or a value has no effect beside the others.
    """
    default = _default(name, values)
    known = [".".join(field.path) for field in flags_of(default)]
    for unknown in values.keys() - {*known}:
        raise UserError(f"{JOBS[name].called} has no option {unknown}{meant(unknown, known)}")
    config = filled(default, values)
    if values.get("rederive") is None:
        refuse_unused(config, values)
    return config


def parser(name: str, given: Mapping[str, Any] | None = None) -> Parser:
    """The command line of a job.

    Args:
        name: among `JOBS`.
        given: flags whose defaults the help shows, and names; by default those of the preset quick.
    """
    job, default = JOBS[name], _default(name, given or {})
    description = docstring(job.module)
    if given is not None:
        more = ["--data DIR"] if job.with_data else [] if job.target else ["--target"]
        of = f"--preset {default.preset} for {default.target}"
        others = " and ".join(("--preset", *more))
        description += (
            f"\n\nThe defaults below are those of {of}; {others} beside --help show others."
        )
    parser = Parser(job.called, description)
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


def _default(name: str, given: Mapping[str, Any]) -> Config:
    """The defaults that the given flags lead to."""
    job, preset = JOBS[name], given.get("preset", "quick")
    target = job.target or given.get("target", "twin")
    if job.with_data is not None and given.get("data") is not None:
        target = job.with_data
    # The twin's hidden attributes must lie in the space of the search.
    usual: SpaceName = "extended" if given.get("twin") == "far" else "scenex"
    default = in_space(defaults_of(name, target, preset), given.get("space", usual))
    out = Path("runs") / "-".join((name, preset) if job.target else (name, target, preset))
    return _with_nets(replace(default, out=out), given)


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
