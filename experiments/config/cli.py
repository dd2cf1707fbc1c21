"""The command line of jobs: defaults by target and preset, then all flags.

A job is a row of `experiments.config.jobs`; its work is loaded once its flags are valid.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from inspect import get_annotations
from pathlib import Path
from typing import Any

from common.command import HELP, Parser, docstring, exit_code, unmet
from common.errors import UserError, suggestion
from common.flags import Field, add_flag, fill, flags_of
from common.workers.pool import WorkerError
from experiments.config.config import AnyConfig, Config, GroupsConfig, LearntConfig, fidelities
from experiments.config.jobs import JOBS, defaults_of, methods_of
from experiments.config.presets import in_space
from scene.attributes import SpaceName
from seg.recipes import with_heads, with_net, with_steps
from seg.settings import VGG_NETS

COMMON = (
    "target", "data", "out", "preset", "holdout", "few", "learnt", "search.method", "space", "seed",
    "seeds", "weights", "workers", "store", "rederive",
)  # fmt: skip
"""Fields in the short help, in addition to a study's own."""
TOPICS = {
    "real images": (
        "target",
        "reward_images",
        "test_images",
        "test_split",
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
    "where it runs": ("renderer", "trainers", "executor", "scheduler"),
    "the search": ("groups", "search"),
    "size of rewards": ("reward",),
    "size of final networks": ("final",),
    "size of other networks": ("compact", "vgg"),
    "networks without weights": ("from_scratch",),
}
"""Titles and fields of the other groups; nested fields go by their outermost name."""
OTHERS = "other options"
STARTED_NETS = (*VGG_NETS, "dinov2")
"""Networks that start from the file of --weights."""


class Unmet(Exception):
    """The work is done, but its result misses what a flag requires."""


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
    help_words = [word for word in words if word in HELP]
    flags = parser(name)
    if JOBS[name].target and any(word.partition("=")[0] == "--target" for word in words):
        commands = ", ".join(other for other, job in JOBS.items() if job.target is not None)
        flags.error(
            f"no option --target: the command chooses the target: use {commands}; cityscapes without "
            "--data uses the twin"
        )
    values = vars(flags.parse_args([word for word in words if word not in help_words]))
    if help_words:
        parser(name, values).parse_args(help_words)
    debug = values.pop("debug")
    do_job = work or load(JOBS[name].work)

    def run() -> None:
        from scene.render import RendererError  # the help needs no engine

        config = configured(name, values)
        try:
            do_job(config)
        except RendererError as error:  # also from a worker
            raise UserError(str(error)) from None

    return exit_code(run, also=(WorkerError, Unmet), debug=debug)


def configured(name: str, values: Mapping[str, Any]) -> Any:
    """Configure a job: its defaults with values of fields by their dotted names.

    Raises:
        UserError: no field has a name, or a value has no effect with the others.
    """
    default = _default(name, values)
    options = [".".join(field.path) for field in flags_of(default)]
    for unknown in values.keys() - {*options}:
        raise UserError(
            f"{JOBS[name].called} has no option {unknown}{suggestion(unknown, options)}"
        )
    config = fill(default, values)
    if values.get("rederive") is None:
        refuse_unused(config, values)
    return config


def parser(name: str, values: Mapping[str, Any] | None = None) -> Parser:
    """Make the command line of a job.

    Args:
        name: among `JOBS`.
        values: flags whose defaults the help shows, and says so; by default those of the preset quick.
    """
    job, default = JOBS[name], _default(name, values or {})
    description = docstring(job.module)
    if values is not None:
        more = ["--data DIR"] if job.with_data else [] if job.target else ["--target"]
        shown = f"--preset {default.preset} for {default.target}"
        others = " and ".join(("--preset", *more))
        description += (
            f"\n\nDefaults below are those of {shown}; add {others} to --help for others."
        )
    parser = Parser(job.called, description)
    add_common = parser.add_argument_group("options").add_argument
    job_fields = get_annotations(type(default))
    titles = {name: title for title, names in TOPICS.items() for name in names}
    adders = {title: parser.group(title) for title in (*TOPICS, OTHERS)}

    def rank(field: Field) -> int:
        word = ".".join(field.path)
        return COMMON.index(word) if word in COMMON else -1 if word in job_fields else len(COMMON)

    for field in sorted(flags_of(default), key=rank):
        rare = rank(field) == len(COMMON)
        add_flag(adders[titles.get(field.path[0], OTHERS)] if rare else add_common, field)
    return parser


def _default(name: str, values: Mapping[str, Any]) -> Config:
    """Return the defaults that follow from some flags."""
    job, preset = JOBS[name], values.get("preset", "quick")
    target = job.target or values.get("target", "twin")
    if job.with_data is not None and values.get("data") is not None:
        target = job.with_data
    # The twin's hidden attributes must lie in the space of the search.
    space: SpaceName = "extended" if values.get("twin") == "far" else "scenex"
    default = in_space(defaults_of(name, target, preset), values.get("space", space))
    out = Path("runs") / "-".join((name, preset) if job.target else (name, target, preset))
    return _with_nets(replace(default, out=out), values)


SDR = ("learning_rate", "baseline", "normalise", "squared_reward", "unoptimised")
"""Options of the search that only ``sdr`` has."""


def refuse_unused(config: Config, values: Mapping[str, Any]) -> None:
    """Raise UserError for a flag that has no effect with the others.

    Args:
        config: the configuration with the flags.
        values: values of the flags by their dotted names.
    """
    for flag in ("twin", "twin_seed"):
        # --twin far has its own error.
        if flag in values and config.target != "twin" and config.twin != "far":
            raise UserError(f"{_flag(flag)} is for --target twin, not {config.target}")
    fields = {field.flag: ".".join(field.path) for field in flags_of(config)}
    used = {flag for flag, path in fields.items() if values.get(path) not in (None, False, ())}
    relations = (
        # A study may lack some flags.
        (field.flag, [f for f in field.option.needs if f in fields], field.option.excludes)
        for field in flags_of(config)
    )
    if fault := unmet(relations, used):
        raise UserError(fault)
    if not isinstance(config, GroupsConfig):
        return
    search_options = [name for name in values if name.startswith("search.")]
    if search_options and isinstance(config, LearntConfig) and config.learnt is not None:
        raise UserError(f"{_flag(search_options[0])} has no effect with --learnt")
    methods = methods_of(config)
    for name in SDR:
        if f"search.{name}" in values and "sdr" not in methods:
            raise UserError(f"--search.{_flag(name)[2:]} is for sdr, not {', '.join(methods)}")
    if "search.start" in values and "intervals" not in methods:
        raise UserError(f"--search.start is for intervals, not {', '.join(methods)}")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def load(place: str) -> Any:
    """Load the function or study that ``module:name`` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _with_nets(default: AnyConfig, values: Mapping[str, Any]) -> AnyConfig:
    """Return defaults with the recipes of the chosen networks, their weights, and a warm-up that fits."""
    for name, fidelity in fidelities(default).items():
        flags = {key: values.get(f"{name}.train.{key}") for key in ("net", "backbone", "weights")}
        changes = {key: value for key, value in flags.items() if value is not None}
        weights, train = values.get("weights"), fidelity.train
        if weights is not None and changes.get("net", train.net) in STARTED_NETS:
            changes.setdefault("weights", str(weights))
        if changes and name in ("reward", "final"):
            train = with_net(train, **changes)
        if (values.get(f"{name}.train.heads") or 1) > 1:
            train = with_heads(train, values[f"{name}.train.heads"])
        steps = values.get(f"{name}.train.steps")
        if isinstance(steps, int):
            train = with_steps(train, steps)
        if train is not fidelity.train:
            change: dict[str, Any] = {name: replace(fidelity, train=train)}
            default = replace(default, **change)
    return default
