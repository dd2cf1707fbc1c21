"""The Python interface of `experiments`: `fit`, `search` and `reward`, with named results.

`fit` does the work of `sdr-jax fit`, and `search` that of `sdr-jax camvid` and its siblings. They print
progress, and a stopped call resumes when it is repeated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any, NamedTuple, cast

from common.command import say
from common.errors import UserError
from common.files import read_json
from common.workers.pool import WorkerPool
from experiments.app import main_job
from experiments.app.fit import job as fit_job
from experiments.app.fit.config import config_of
from experiments.app.report import fit_table, summary
from experiments.app.report.fit_table import MODEL
from experiments.app.report.folder import NAME
from experiments.config import MainConfig, Preset, TargetName, check
from experiments.config.cli import configured
from experiments.config.jobs import JOBS
from experiments.config.parsers import Fit
from experiments.evaluation.cache import by_target, statistics_of
from experiments.evaluation.in_worker import evaluate_miou
from experiments.evaluation.job import Recipe
from experiments.session.session import set_up_process, with_few
from experiments.tables.form import Report, interval, number
from experiments.tables.row_names import trained_on
from experiments.targets.base import Target
from experiments.targets.named import named_target
from scene.held import hold
from scene.proposal import NAMES, Streets, read_streets, streets_in
from seg.model import Model, load_model

PATHS = ("init", "store", "weights")
"""Options of `fit` that are files or folders."""


class Score(NamedTuple):
    """A mean with its 95 % interval; None where there are too few networks."""

    mean: float | None
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class FinishedRun:
    """A finished run folder."""

    folder: Path
    summary: Report
    """The content of ``summary.json``."""

    @property
    def miou(self) -> dict[str, Score]:
        """The mIoU in percent of each training set, by the name of its row."""
        return {name: _score(row) for name, row in self.summary["rows"].items()}

    @property
    def report(self) -> Path:
        """The report as a page."""
        return self.folder / NAME

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(trained_on(self.summary, row))}</td><td>{number(score.mean)}</td>"
            f"<td>{interval(score.ci95)}</td></tr>"
            for row, score in self.miou.items()
        )
        head = "<tr><th>trained on</th><th>mIoU, %</th><th>95 % interval</th></tr>"
        return f"<table>{head}{rows}</table><p>{escape(self.verdict)}</p>"


class Fitted(FinishedRun):
    """The result of `fit`."""

    @property
    def verdict(self) -> str:
        """The gain from renders, in one sentence."""
        return str(self.summary["verdict"])

    @property
    def gain(self) -> Score:
        """The gain from renders over labels alone, in points of mIoU."""
        return _score(self.summary["gains"]["labels+renders"])

    @property
    def model(self) -> Model:
        """The model trained on all labels."""
        return load_model(self.folder / MODEL)

    def __str__(self) -> str:
        return fit_table.text(self.summary)


class Searched(FinishedRun):
    """The result of `search`."""

    @property
    def attributes(self) -> Streets:
        """The attributes that the search has found, for `scene.stream` or `reward`."""
        return streets_in(self.folder / "attributes.json")

    @property
    def dataset(self) -> Path:
        """The folder of the optimised streets, rendered and labelled."""
        return self.folder / "dataset"

    @property
    def verdict(self) -> str:
        """Whether optimised streets are better than default ones, in one sentence."""
        return summary.verdict(self.summary)

    def __str__(self) -> str:
        return summary.text(self.summary)


class Reward(NamedTuple):
    """The value of a rendered training set: the mIoU of a network trained on it."""

    miou: float  # in [0, 1]
    classes: dict[
        str, float | None
    ]  # IoU in [0, 1] of each class; None where no tested pixel has it


def fit(
    data: str | Path,
    out: str | Path,
    *,
    mirror: bool = True,
    streets: int | None = None,
    steps: int | None = None,
    **options: Any,
) -> Fitted:
    """Train networks on labelled images plus renders, as `sdr-jax fit` does.

    Args:
        data: folder of images and labels, with a ``target.yaml`` unless ``target`` is given.
        out: folder of the run.
        mirror: whether predictions are averaged over the mirror image.
        streets: number of rendered streets; by default the preset's.
        steps: training steps; by default the recipe's.
        options: flags of the command with underscores, such as ``few=14``, ``holdout="0006R0"``,
            ``size=(480, 360)``, ``minutes=20`` or ``seeds=5``.

    Returns:
        Scores, the model, and the folder with everything else.

    Raises:
        UserError, DataError: the data or an argument cannot be used; the message names it.
        TypeError: the command has no such flag, or it is an argument here.
        WorkerError: worker processes keep dying.
    """
    paths = {name: Path(options[name]) for name in PATHS if options.get(name) is not None}
    flags = Fit(**options | paths, data=Path(data), out=Path(out), no_mirror=not mirror)
    config = config_of(flags, say, streets=streets, steps=steps)
    return Fitted(config.out, fit_job.fit(config))


def search(
    target: TargetName = "twin",
    data: str | Path | None = None,
    out: str | Path | None = None,
    *,
    preset: Preset = "quick",
    **options: Any,
) -> Searched:
    """Optimise the streets for a target, as `sdr-jax camvid` does, and compare them with the default ones.

    Args:
        target: ``twin``, ``cityscapes``, ``camvid`` or ``labelmefacade``.
        data: folder of the target's images; none for the twin.
        out: folder of the run; by default ``runs/TARGET-PRESET``, with cityscapes for the twin.
        preset: ``smoke``, ``quick`` or ``paper``.
        options: flags of the command with underscores, such as ``holdout="0006R0"``, ``space="extended"`` or
            ``seeds=5``; those with a dot as a dictionary, such as ``search={"updates_per_group": 4}``.

    Returns:
        Scores, the attributes found, and the folder with everything else.

    Raises:
        UserError, DataError: the data or an argument cannot be used; the message names it.
        WorkerError: worker processes keep dying.
    """
    config = _main_config(target, data, preset, options)
    if out is not None:
        config = replace(config, out=Path(out))
    main_job.RUN(config)
    return Searched(config.out, read_json(config.out / f"{main_job.FORM.name}.json"))


def reward(
    streets: Streets | str | Path = "default",
    target: TargetName = "twin",
    data: str | Path | None = None,
    *,
    seed: int = 0,
    preset: Preset = "quick",
    **options: Any,
) -> Reward:
    """Render a training set, train a network on it, and test it on a target's labelled images.

    With the same options it is a reward of `search`. It runs in this process; the target's images are read
    once.

    Args:
        streets: ``random``, ``default``, ``mixed``, a file ``attributes.json``, or a `scene.Proposal`.
        target: as in `search`.
        data: as in `search`.
        seed: seed of the streets and of the network; rewards to be compared have the same.
        preset: as in `search`.
        options: as in `search`, such as ``reward={"streets": 24, "train": {"steps": 100}}``.

    Raises:
        UserError, DataError: the data or an argument cannot be used; the message names it.
        TrainingError: the loss is not finite.
    """
    set_up_process()
    config = _main_config(target, data, preset, options)
    check(config)
    if str(streets) in NAMES:
        streets = config.streets(str(streets))
    elif isinstance(streets, str | Path):
        try:
            streets = read_streets(str(streets), config.space)
        except (OSError, ValueError) as error:
            raise UserError(f"streets: {error}") from None
    labelled, fidelity = _target(config), config.reward
    images = labelled.at(fidelity.height, fidelity.width)["reward"]
    recipe = Recipe(
        fidelity,
        labelled.table,
        config.renderer,
        config.pool,
        statistics_of(images.images, fidelity.train) if by_target(fidelity.train) else None,
        config.search.checkpoints,
    )
    source = with_few(config, labelled, fidelity, hold(streets, config.held))
    result = evaluate_miou(recipe, source, seed, images)
    names = recipe.classes.classes
    return Reward(result.reward, dict(zip(names, result.class_iou, strict=True)))


@lru_cache(maxsize=2)
def _target(config: MainConfig) -> Target:
    return named_target(config, WorkerPool(0))


def _main_config(
    target: str, data: str | Path | None, preset: Preset, options: dict[str, Any]
) -> MainConfig:
    command = "cityscapes" if target == "twin" else target
    commands = [name for name, job in JOBS.items() if job.target is not None]
    if command not in commands:
        raise UserError(f"target must be one of twin, {', '.join(commands)}, not {target!r}")
    flags = {"preset": preset, **_flat(options)}
    if "fix" in flags:
        flags["fix"] = tuple(flags["fix"])  # configurations are hashed
    if data is not None:
        flags["data"] = Path(data)
    config = cast(MainConfig, configured(command, flags))
    if config.target != target:  # the command takes the twin without data
        needs = "takes no data" if target == "twin" else "needs its folder, data="
        raise UserError(f"target {target!r} {needs}")
    return config


def _flat(options: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested dictionaries as dotted names: ``{"reward": {"streets": 4}}`` as ``reward.streets``."""
    flat: dict[str, Any] = {}
    for name, value in options.items():
        nested = isinstance(value, dict)
        flat |= _flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return flat


def _score(row: Report) -> Score:
    ci95 = row["ci95"]
    return Score(row["mean"], None if ci95 is None else (ci95[0], ci95[1]))
