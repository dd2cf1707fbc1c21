"""The configuration of `sdr-jax fit`, with the size of its images and the time that it takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from common.bounds import POSITIVE, at_least, at_most, check_bounds
from common.errors import UserError, counted, flagged
from common.folder import read_config, refuse_other_files
from common.labels.classes import NAMES
from common.labels.listing import list_all
from common.labels.target_file import Fit, TargetFile, find_target
from common.memory import in_words, memory
from experiments.app.report.fit_table import rows_of
from experiments.attribute_search.plans import plan_of, work_of
from experiments.config import FewConfig, Fidelity, parsers
from experiments.config.config import NETS, FitPreset
from experiments.config.limits import PIXEL, training_bytes
from experiments.config.presets import defaults, in_space
from experiments.config.trainers import trainers_of, training_processes, usable_gpus
from experiments.evaluation.cost import Cost, prepare_cost, street_cost
from experiments.evaluation.pace import Crew, Pace
from experiments.session.session import Work, pace_here, total_of
from experiments.targets.few import share_of
from experiments.targets.folder import Parts, common_size, parts_of
from experiments.targets.sizes import AREAS, SMALLEST, UNIT, Choice, Size, choose, suitable_size
from scene.attributes import SpaceName
from scene.held import read_fixed
from scene.render.protocol import MAX_PIXELS
from seg.check import check_settings
from seg.model import load_model
from seg.recipes import RECIPES, with_heads, with_net, with_steps
from seg.settings import FILELESS_NETS, BackboneName, BackboneTraining
from seg.weights import check as check_weights

SPACE: SpaceName = "extended"
"""The space of the streets' attributes."""
MEMORY_FACTOR = 2
"""`fit` chooses a size on its own only if memory is this many times its estimated need: code and compiled
functions make a process take 1.6 times the estimate at 480x360."""
FULL_STREETS = 800
"""Streets of `--preset full`."""


@dataclass(frozen=True, kw_only=True)
class FitConfig(FewConfig):
    """The fields of one run; the command line has a few of them."""

    target: str = "camvid"  # type: ignore[assignment]
    """The name of the target, which may be the user's own."""
    preset: FitPreset = "quick"  # type: ignore[assignment]
    """The set of defaults of all other fields."""
    file: str | None = None
    """The target's file, or its name; by default target.yaml in the folder of the images."""
    shape: Fit | None = None
    """How images of another shape are treated; by default as the target's file says."""
    learnt: bool = False
    """Whether streets are optimised, too."""
    minutes: Annotated[float | None, POSITIVE] = None
    """The time limit by which the size was chosen."""
    seeds: Annotated[int, at_least(1), at_most(2**10), NETS] = 3
    """Networks of each row and fold; on a frozen backbone they are heads of one."""
    init: Path | None = None
    """Folder of a model from which the saved network starts."""

    @property
    def trainings(self) -> list[int]:
        """The seeds of a row's trainings: heads of one network are trained together and share its seed."""
        heads = self.final.train.heads
        return [self.seed + k for k in range(self.seeds // heads)]

    @property
    def processes(self) -> int:
        """The number of worker processes."""
        return max(self.workers, 1)

    @property
    def separate_trainers(self) -> int | None:
        """The number of processes that only train, one for each GPU by default; None where all do both."""
        return trainers_of(self.trainers, usable_gpus())


def config_of(
    flags: parsers.Fit,
    say: Callable[[str], None] = lambda text: None,
    *,
    streets: int | None = None,
    steps: int | None = None,
) -> FitConfig:
    """Make the configuration of a command line.

    Args:
        flags: the command line. Without a size, the run that its folder holds keeps its own.
        say: called with size and time, and before this machine's pace is measured.
        streets: rendered streets; by default the preset's.
        steps: training steps; by default the recipe's.

    Raises:
        UserError: there is no such target or folder, none of its classes is rendered, an image cannot be
            read, weights are of another network, an attribute cannot be held, or a size takes too much
            memory or time.
    """
    flags = replace(flags, fix=tuple(flags.fix))  # functions may give a list
    _check_flags(flags)
    target_file = _rendered_target(flags)
    parts = parts_of(target_file, flags.data, flags.holdout, flags.few)
    preset = flags.preset or default_preset()
    weights = None if flags.weights is None else str(flags.weights.absolute())
    decided = flags.size or _size_of(flags.out)
    if decided is None:
        entries = [entry for split in list_all(target_file, flags.data).values() for entry in split]
        photographs = common_size(entries)
    else:
        photographs = decided
    head_width = None if flags.init is None else load_model(flags.init).settings.head_width

    def at(size: Size) -> FitConfig:
        base = configured(
            size, preset, flags.net, flags.backbone, weights, search=flags.search, seeds=flags.seeds
        )
        final = base.final if streets is None else replace(base.final, streets=streets)
        train = final.train if steps is None else with_steps(final.train, steps)
        train = replace(train, average_mirror=not flags.no_mirror)
        if not usable_gpus():
            train = replace(train, dtype="float32")  # CPUs emulate bfloat16
        if head_width is not None and train.has_backbone:
            train = replace(train, head_width=head_width)
        same = ("data", "out", "shape", "few", "holdout", "minutes", "init", "store", "trainers")
        return replace(
            base,
            final=replace(final, train=train),
            target=target_file.name,
            file=flags.target,
            few_share=share_of(len(parts.entries), preset),
            fix=flags.fix,
            workers=base.workers if flags.workers is None else flags.workers,
            **{name: getattr(flags, name) for name in same},
        )

    first = at(photographs)
    check_bounds(first, "--")
    with flagged("--net"):
        check_settings(first.final.train)
    check_weights(first.final.train, 1)
    if decided is not None:
        _refuse_large(first, len(parts.every))
    pace = pace_here(first.processes, say, measure=decided is None and preset != "smoke")
    choice = choose_size(at, parts, photographs, pace, size=decided, minutes=flags.minutes)
    config = at(choice.size)
    _refuse_large(config, len(parts.every))
    say(choice.text(config.processes))
    return config


def _check_flags(flags: parsers.Fit) -> None:
    """Raise UserError for flags that are wrong whatever the images are."""
    check_bounds(flags, "--")
    refuse_other_files(flags.out)
    read_fixed(flags.fix, SPACE)
    size = flags.size
    if size is not None and (min(size) < SMALLEST or any(side % UNIT for side in size)):
        raise UserError(
            f"--size must be two multiples of {UNIT}, {SMALLEST} or more, not {size[0]}x{size[1]}"
        )
    if flags.weights is not None and flags.net in FILELESS_NETS:
        raise UserError(
            f"--weights {flags.weights} is for --net dinov2; those of {flags.net} come with a package"
        )


def _rendered_target(flags: parsers.Fit) -> TargetFile:
    """Find the target of the images; raise UserError if renders show none of its classes."""
    target_file = find_target(flags.target, flags.data)
    if not any(target_file.rendered):
        raise UserError(
            f"{target_file.source}: no class has 'renders', so renders would show none of them; say which "
            f"of the engine's classes each one is: {', '.join(NAMES)}"
        )
    return target_file


def default_preset() -> FitPreset:
    """The preset without ``--preset``."""
    return "full" if usable_gpus() else "quick"


def choose_size(
    at: Callable[[Size], FitConfig],
    parts: Parts,
    photographs: Size,
    pace: Pace,
    *,
    size: Size | None = None,
    minutes: float | None = None,
) -> Choice:
    """Choose the size of the images for networks, as `fit` does and `doctor` announces.

    Args:
        at: gives the configuration at a size.
        parts: parts of the labelled images.
        photographs: width and height of most of them.
        pace: this machine's.
        size: a size that is decided already.
        minutes: the time limit.

    Raises:
        UserError: as `choose`.
    """

    def seconds(size: Size) -> float:
        config = at(size)
        cost = cost_of_fit(config, parts)
        return Crew(pace, config.processes, config.separate_trainers).seconds_of(cost)

    def fits(size: Size) -> bool:
        return MEMORY_FACTOR * _memory(at(size), len(parts.every)) <= memory()

    preset = at(photographs).preset
    return choose(photographs, preset, seconds, fits, size=size, minutes=minutes)


def _size_of(out: Path) -> Size | None:
    """The size of the run that a folder holds, if it holds one."""
    with suppress(UserError, OSError, LookupError, TypeError, ValueError, OverflowError):
        final = read_config(out)["final"]
        size = int(final["width"]), int(final["height"])
        return size if min(size) >= SMALLEST else None
    return None


STREETS = "streets"
"""The word in plans for streets that are rendered without a network of their own."""


def planned(config: FitConfig, folds: int) -> list[Work]:
    """Plan the streets, the searches, and the networks of every row for a number of folds."""
    final = config.final
    kinds = 1 + config.learnt * folds
    trainings = len(config.trainings)
    tested = len(rows_of(config.learnt)) * folds * trainings
    return [
        *([work_of(config, [plan_of(config)] * folds)] if config.learnt else []),
        Work(STREETS, kinds * trainings * final.streets, final, Cost(street_cost(final))),
        Work.on_images("networks to test", tested, final),
        Work.on_images("network to save", 1, final),
    ]


def cost_of_fit(config: FitConfig, parts: Parts) -> Cost:
    """The cost of a whole run, with the features of every fold's labelled images."""
    folds = len(parts.folds)
    work = total_of(planned(config, folds))
    features = prepare_cost(config.final, len(parts.every)).times(folds)
    return work._replace(train=work.train + features.train)


def _memory(config: FitConfig, labelled: int) -> int:
    """The bytes that a run takes.

    Each process that trains has a training set of its own; this process holds all labelled images, and those
    of a fold.
    """
    final = config.final
    images = 2 * labelled * final.width * final.height * PIXEL
    _, processes = training_processes(config)
    return processes * training_bytes(final, labelled) + images


def _refuse_large(config: FitConfig, labelled: int) -> None:
    """Raise UserError with the flags of `fit` for a size whose arrays do not fit into memory."""
    final, (flag, processes) = config.final, training_processes(config)
    if final.width * final.height > MAX_PIXELS:
        raise UserError(f"--size {final.size} has more than {MAX_PIXELS:,} pixels, the most")
    need = _memory(config, labelled)
    if need > memory():
        scale = math.sqrt(memory() / need)
        width, height = (int(scale * side / UNIT) * UNIT for side in (final.width, final.height))
        ways = [f"--size {width}x{height} or less"] if min(width, height) >= SMALLEST else []
        ways += [f"fewer {flag}"] if processes > 1 else []
        way = " or ".join(ways)
        raise UserError(
            f"--size {final.size} would take {in_words(need)} of memory to train networks in "
            f"{counted(processes, flag[2:-1])}, but only {in_words(memory())} are available"
            f"{way and f': use {way}'}"
        )


def configured(
    size: Size,
    preset: FitPreset = "quick",
    net: BackboneName = "lite0",
    backbone: BackboneTraining | None = None,
    weights: str | None = None,
    *,
    search: bool = False,
    seeds: int = FitConfig.seeds,
) -> FitConfig:
    """The configuration of a preset for a network at a size of images.

    The networks of a row are heads of one where the backbone is frozen (recipe `lite0-heads`). The rewards of
    a search take the smallest size of `quick`, for which they were made cheap.
    """
    full = preset == "full"
    others = "quick" if preset == "full" else preset  # decides what is not changed below
    backbone = backbone or ("tuned" if full and net != "dinov2" else "frozen")
    base = in_space(defaults(FitConfig, "camvid", others), SPACE)
    reward_size = suitable_size(*size, AREAS[others][0]) if search else size

    def fidelity(usual: Fidelity, backbone: BackboneTraining, size: Size) -> Fidelity:
        train = with_net(usual.train, net=net, backbone=backbone, weights=weights)
        return replace(usual, width=size[0], height=size[1], train=train)

    final = fidelity(base.final, backbone, size)
    train = with_heads(final.train, max(seeds, 1))
    if full:
        final = replace(final, streets=FULL_STREETS)
        if backbone == "tuned":
            train = replace(RECIPES["lite0-full"], net=net, weights=weights)
    return replace(
        base,
        preset=preset,
        learnt=search,
        seeds=seeds,
        reward=fidelity(base.reward, "frozen", reward_size),
        final=replace(final, shots=1, train=train),
        reward_images=None,
        test_images=None,
    )
