"""Fit a network to labelled images, with renders mixed in, and measure their gain: `sdr-jax fit`."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import numpy as np

from common.bounds import POSITIVE, at_least, check_bounds
from common.command import Arguments, exit_code, given
from common.errors import UserError, flagged
from common.files import digest, file_digest, read_json, write
from common.folder import plain, read_config
from common.interrupt import PROGRAM
from common.labels.classes import NAMES
from common.labels.listing import list_all
from common.labels.target_file import Fit, find_target
from common.memory import in_words, memory
from common.workers.pool import WorkerError
from experiments.app.report import live, page
from experiments.app.report.fit_table import MODEL, STRIP, Row, derive, rows_of, text
from experiments.app.report.folder import NAME
from experiments.attribute_search.learn import learn, work_of
from experiments.config import FewConfig, Fidelity, Preset, parsers
from experiments.config.config import NETS
from experiments.config.limits import PIXEL, training_bytes
from experiments.config.presets import defaults, in_space
from experiments.evaluation.cached import Cached
from experiments.evaluation.cost import Cost, job_cost, prepare_cost, street_cost
from experiments.evaluation.job import Job, Keeps, LabelledSubset, Source, StreetPool
from experiments.evaluation.pace import Pace
from experiments.evaluation.predictions import file_of, load
from experiments.session.session import Session, Work, pace_here, set_up_process, total_of
from experiments.tables.form import Form, Report, about, miou, nets
from experiments.tables.skeleton import Study, attributes, do
from experiments.tables.stats import UNITS, over_units
from experiments.targets.base import Target
from experiments.targets.folder import (
    Parts,
    Read,
    all_labelled,
    common_size,
    fold_targets,
    parts_of,
    reader,
)
from experiments.targets.sizes import AREAS, SMALLEST, UNIT, Choice, Size, choose, suitable_size
from scene.attributes import SpaceName
from scene.dataset.formats.png import encode
from scene.held import read_fixed
from scene.proposal import Streets, draw
from scene.render.protocol import MAX_PIXELS
from seg.beside import TrainingSet
from seg.check import check_settings
from seg.classes import class_table, colorize
from seg.data import LabelledImages
from seg.errors import ModelError
from seg.model import SEEN, Model, classes_of, load_model, refuse_others
from seg.recipes import with_heads, with_net
from seg.settings import FILELESS_NETS, Trunk, TrunkName
from seg.train import Params, heads_of, stacked
from seg.weights import check as check_weights

SHOWN_BY: Row = "labels+renders"
"""The strip shows the best, the median and the worst image of this row's first network."""
SPACE: SpaceName = "extended"
"""The space of the streets' attributes."""
RENDERED = "mixed"
"""The rendered streets, half random and half hand-set: ahead of random ones on real images, and level with
them on targets far from the hand-set street (`docs/findings.md`)."""
FEW = 20
"""Fewer labels than these fill a quarter of a batch beside renders; more fill half (`docs/findings.md`)."""
ROOM = 2
"""A size is chosen by itself if memory holds so many times the least that it needs: with code and compiled
functions a process takes 1.6 times as much at 480x360."""
STREETS = "streets"
"""The word in plans for streets that are only rendered."""


@dataclass(frozen=True, kw_only=True)
class FitConfig(FewConfig):
    """One job; the command line has a few of these fields."""

    target: str = "camvid"  # type: ignore[assignment]
    """The name of the target, which may be the user's own."""
    file: str | None = None
    """The target's file, or its name; by default target.yaml beside the images."""
    shape: Fit | None = None
    """How images of another shape are treated; by default as the target's file says."""
    learnt: bool = False
    """Whether streets are learnt, too."""
    minutes: Annotated[float | None, POSITIVE] = None
    """The most minutes that decided the size."""
    seeds: Annotated[int, at_least(1), NETS] = 3
    """Networks of each row and fold; on a frozen trunk they are heads of one."""
    init: Path | None = None
    """Folder of a model from which the net starts."""

    @property
    def apart(self) -> list[int]:
        """The seeds of the networks of a row that are trained apart: heads of one network share its seed."""
        heads = self.final.train.heads
        return [self.seed + k for k in range(self.seeds // heads)]

    @property
    def processes(self) -> int:
        """The number of worker processes."""
        return max(self.workers, 1)


class Prepared(NamedTuple):
    """The data that are read before the folder of the job is made."""

    parts: Parts
    whole: Read  # all images
    folds: list[Target]
    init: Params | None


def config_of(
    data: Path,
    out: Path,
    *,
    target: str | None = None,
    few: int | None = None,
    holdout: str | None = None,
    search: bool = False,
    preset: Preset = "quick",
    size: Size | None = None,
    minutes: float | None = None,
    shape: Fit | None = None,
    seeds: int = FitConfig.seeds,
    workers: int | None = None,
    init: Path | None = None,
    store: Path | None = None,
    net: TrunkName = "lite0",
    trunk: Trunk = "frozen",
    weights: Path | None = None,
    fix: Sequence[str] = (),
    no_mirror: bool = False,
    say: Callable[[str], None] = lambda text: None,
) -> FitConfig:
    """Make the configuration of a command line.

    Without ``size``, a run that ``out`` holds keeps its own.

    Args:
        data: folder of the images.
        out: folder of the run.
        target: the target's file, or the name of one that comes with the package.
        few: number of labels to use.
        holdout: the group to test on.
        search: whether to learn streets, too.
        preset: quick or smoke.
        size: width and height of the images for networks; by default as `choose` decides.
        minutes: the most minutes of this machine that decide the size, without ``size``.
        shape: how images of another shape are treated.
        seeds: nets of each row and fold.
        workers: number of processes.
        init: folder of a model to start from.
        store: file of evaluations that runs share.
        net: the net, named by its trunk.
        trunk: whether the trunk is frozen or tuned; for a search's rewards it is always frozen.
        weights: file of the trunk's weights, for dinov2.
        fix: attributes to hold at a value in all streets, such as field_of_view=90.
        no_mirror: whether networks leave out the mirror image, over which they average otherwise.
        say: called with size and time, and before this machine's pace is measured.

    Raises:
        UserError: there is no such target or folder, none of its classes is rendered, an image cannot be
            read, weights are of another net, an attribute cannot be held, or a size takes too much memory
            or time.
    """
    read_fixed(fix, SPACE)
    found = find_target(target, data)
    if not any(found.rendered):
        raise UserError(
            f"{found.source}: no class has 'renders', so renders would show none of them; name what the "
            f"engine has of each: {', '.join(NAMES)}"
        )
    parts = parts_of(found, data, holdout, few)
    if size is not None and (min(size) < SMALLEST or any(side % UNIT for side in size)):
        raise UserError(
            f"--size must be two multiples of {UNIT}, {SMALLEST} or more, not {size[0]}x{size[1]}"
        )
    if weights is not None and net in FILELESS_NETS:
        raise UserError(
            f"--weights {weights} is for --net dinov2; those of {net} come with a package"
        )
    file = None if weights is None else str(weights.absolute())
    begun = _size_of(out) if size is None else size
    if begun is None:
        every = [entry for split in list_all(found, data).values() for entry in split]
        photographs = common_size(every)
    else:
        photographs = begun

    width = None if init is None else load_model(init).settings.head_width

    def at(size: Size) -> FitConfig:
        base = configured(size, preset, net, trunk, file, search=search, seeds=seeds)
        train = replace(base.final.train, average_mirror=not no_mirror)
        if width is not None and train.has_trunk:
            train = replace(train, head_width=width)
        return replace(
            base,
            final=replace(base.final, train=train),
            target=found.name,
            data=data,
            out=out,
            few_share=share_of(len(parts.entries)),
            file=target,
            shape=shape,
            few=few,
            holdout=holdout,
            minutes=minutes,
            init=init,
            store=store,
            fix=tuple(fix),
            workers=base.workers if workers is None else workers,
        )

    first = at(photographs)
    check_bounds(first, "--")
    with flagged("--net"):
        check_settings(first.final.train)
    check_weights(first.final.train, 1)
    if begun is not None:
        _refuse_large(first, len(parts.every))
    pace = pace_here(first.processes, say, measure=begun is None and preset != "smoke")
    choice = sized(at, parts, photographs, pace, size=begun, minutes=minutes)
    config = at(choice.size)
    _refuse_large(config, len(parts.every))
    say(choice.text(config.processes))
    return config


def share_of(labels: int) -> float:
    """The share of so many labelled images in a batch with renders, at first."""
    return 0.25 if labels < FEW else 0.5


def sized(
    at: Callable[[Size], FitConfig],
    parts: Parts,
    photographs: Size,
    pace: Pace,
    *,
    size: Size | None = None,
    minutes: float | None = None,
) -> Choice:
    """Decide the size of the images for networks; `fit` and `doctor` share it.

    Args:
        at: gives the configuration at a size.
        parts: parts of the labelled images.
        photographs: width and height of most of them.
        pace: this machine's.
        size: a size that is decided already.
        minutes: the most that it may take.

    Raises:
        UserError: as `choose`.
    """

    def seconds(size: Size) -> float:
        config = at(size)
        return pace.seconds_of(cost_of_fit(config, parts), config.processes)

    def fits(size: Size) -> bool:
        return ROOM * _memory(at(size), len(parts.every)) <= memory()

    preset = at(photographs).preset
    return choose(photographs, preset, seconds, fits, size=size, minutes=minutes)


def _size_of(out: Path) -> Size | None:
    """The size of the run that a folder holds, if it holds one."""
    with suppress(UserError, OSError, LookupError, TypeError, ValueError, OverflowError):
        final = read_config(out)["final"]
        size = int(final["width"]), int(final["height"])
        return size if min(size) >= SMALLEST else None
    return None


def cost_of_fit(config: FitConfig, parts: Parts) -> Cost:
    """The cost of a whole job, with the features of every fold's labelled images."""
    folds = len(parts.folds)
    work = total_of(planned(config, folds))
    features = prepare_cost(config.final, len(parts.every)).times(folds)
    return work._replace(train=work.train + features.train)


def _memory(config: FitConfig, labelled: int) -> int:
    """The bytes that a job takes.

    Each worker has a training set of its own; this process holds all labelled images, and those of a fold.
    """
    final = config.final
    held = 2 * labelled * final.width * final.height * PIXEL
    return config.processes * training_bytes(final, labelled) + held


def _refuse_large(config: FitConfig, labelled: int) -> None:
    """Raise UserError with the flags of `fit` for a size whose arrays do not fit into memory."""
    final, workers = config.final, config.processes
    if final.width * final.height > MAX_PIXELS:
        raise UserError(f"--size {final.size} has more than {MAX_PIXELS:,} pixels, the most")
    need = _memory(config, labelled)
    if need > memory():
        scale = math.sqrt(memory() / need)
        width, height = (int(scale * side / UNIT) * UNIT for side in (final.width, final.height))
        fewer = ", or fewer --workers" if workers > 1 else ""
        raise UserError(
            f"--size {final.size} would take {in_words(need)} of memory to train nets in {workers} "
            f"worker(s), and there are {in_words(memory())}: use --size {width}x{height} or less{fewer}"
        )


def configured(
    size: tuple[int, int],
    preset: Preset = "quick",
    net: TrunkName = "lite0",
    trunk: Trunk = "frozen",
    weights: str | None = None,
    *,
    search: bool = False,
    seeds: int = FitConfig.seeds,
) -> FitConfig:
    """The configuration of a preset for a network at a size of images.

    The networks of a row are heads of one where the trunk is frozen (recipe `lite0-heads`). The rewards of a
    search take the preset's smallest size, which they were made cheap for.
    """
    base = in_space(defaults(FitConfig, "camvid", preset), SPACE)

    cheap = suitable_size(*size, AREAS[preset][0]) if search else size

    def fidelity(own: Fidelity, trunk: Trunk, size: Size) -> Fidelity:
        train = with_net(own.train, net=net, trunk=trunk, weights=weights)
        return replace(own, width=size[0], height=size[1], train=train)

    final = fidelity(base.final, trunk, size)
    return replace(
        base,
        learnt=search,
        seeds=seeds,
        reward=fidelity(base.reward, "frozen", cheap),
        final=replace(final, shots=1, train=with_heads(final.train, max(seeds, 1))),
        reward_images=None,
        test_images=None,
    )


def prepared(config: FitConfig) -> Prepared:
    """Sort the images into parts, and load the model of ``--init``.

    Raises:
        UserError: as `parts_of`, or the model does not fit.
    """
    assert config.data is not None
    refuse_others(config.out / MODEL)
    few = None if config.few is None else int(config.few)
    parts = parts_of(find_target(config.file, config.data), config.data, config.holdout, few)
    whole = reader(parts, config.shape)
    folds = fold_targets(parts, config.data, whole)
    init = None if config.init is None else _start(config, folds[0])
    return Prepared(parts, whole, folds, init)


def _start(config: FitConfig, target: Target) -> Params:
    """The variables of the model of ``--init``; its heads begin several if there are more.

    Raises:
        UserError: there is no model, or it has another net or other classes.
    """
    assert config.init is not None
    model, train = load_model(config.init), config.final.train
    classes = class_table(target.table).classes
    if model.names != tuple(classes):
        raise UserError(
            f"--init {config.init}: a model of other classes, {', '.join(model.names)}; the target has "
            f"{', '.join(classes)}"
        )
    for flag, ours, theirs in (
        ("--net", train.net, model.settings.net),
        ("--trunk", train.trunk, model.settings.trunk),
    ):
        if ours != theirs:
            raise UserError(f"--init {config.init}: a model with {flag} {theirs}, not {ours}")
    heads = heads_of(model.variables, model.settings)
    return stacked([heads[k % len(heads)] for k in range(train.heads)])


def plan(config: FitConfig, own: Prepared) -> list[Work]:
    """Plan streets, searches, and the nets of every row and fold."""
    return planned(config, len(own.folds))


def planned(config: FitConfig, folds: int) -> list[Work]:
    """Plan the same for a number of folds."""
    final = config.final
    kinds = 1 + config.learnt * folds
    searches = [work._replace(nets=work.nets * folds) for work in work_of(config)]
    count = len(rows_of(config.learnt)) * folds * len(config.apart)
    return [
        *(searches if config.learnt else []),
        Work(STREETS, kinds * len(config.apart) * final.streets, final, Cost(street_cost(final))),
        Work.on_images("nets, each of which is tested", count, final),
        Work.on_images("the net that is left", 1, final),
    ]


def scores(run: Session[FitConfig], known: Prepared) -> Report:
    """Do the whole job, or the rest of it."""
    config, seeds = run.config, run.config.apart
    folds = [replace(run, target=target) for target in known.folds]
    target = known.parts.target
    facts = {
        **about(run, config.final),
        "command": given(),
        "colors": class_table(run.target.table).colors.tolist(),
        "labels": len(known.parts.entries),
        "folds": len(folds),
        "where": known.parts.where,
        "notes": list(known.parts.notes),
        "tested": sum(len(fold.test_names) for fold in known.folds),
        "not_rendered": [name for name, own in target.classes.items() if not own.renders],
        "rendered_images": config.final.images,
        "streets": RENDERED,
        "few_share": config.few_share,
        "last_share": config.final.train.last_share,
        "net": config.final.train.net,
    }
    live.watch(run, facts)
    kinds = [attributes(run, {}, RENDERED)]
    if config.learnt:
        kinds += [learn(fold, name=f"fold-{k}").solution for k, fold in enumerate(folds, 1)]
    pools = [{seed: _pool(run, streets, seed) for seed in seeds} for streets in kinds]
    jobs = [_jobs(fold, number, pools) for number, fold in enumerate(folds)]
    streets = _Rendered(run, [pool for by_seed in pools for pool in by_seed.values()])
    tested = [all(fold.runner.known(some)) for fold, some in zip(folds, jobs, strict=True)]
    if not all(tested):
        streets.make()
    scored: dict[Row, list[Any]] = {row: [] for row in rows_of(config.learnt)}
    averaged: dict[Row, list[float | None]] = {row: [] for row in scored}
    for number, fold in enumerate(folds):
        results = fold.runner.test([streets.of(job) for job in jobs[number]])
        for row, values in scored.items():
            chosen = [
                result
                for job, result in zip(jobs[number], results, strict=True)
                if job.notes["row"] == row
            ]
            values.append(nets(chosen, config.final.train.heads))
            averaged[row] += miou(nets(chosen))
        if number == 0:
            _show(run, fold, [job for job in jobs[0] if job.keeps == "predictions"])
    extra: dict[Row, Source] = {"labels+renders": pools[0][seeds[0]].pool}
    if config.learnt:
        extra["labels+learnt"] = pools[1][seeds[0]].pool
    report = {**facts, "nets": scored}
    if config.final.train.heads > 1:
        report["averaged"] = averaged
        report["over_images"] = _over_images(folds, jobs, known.parts)
    _leave(run, known, extra, derive(report), streets, finished=all(tested))
    seconds = {"streets": streets.seconds(), "total": round(run.progress.elapsed, 1)}
    streets.forget()
    return {**report, "seconds": seconds}


class _Pool(NamedTuple):
    """A pool whose streets may not be rendered yet."""

    units: np.ndarray  # f32[streets, attributes]
    seed: int
    pool: StreetPool


def _pool(run: Session[FitConfig], streets: Streets, seed: int) -> _Pool:
    """Name the pool of streets of one shot that all nets of a seed share."""
    config = run.config
    units = draw(streets, seed, config.final.streets)
    name = digest([digest(units.tolist()), seed, config.final.size])
    return _Pool(units, seed, StreetPool(name, Cached("")))


class _Rendered:
    """Pools of streets, rendered when the first net needs them: a finished job needs none.

    Args:
        run: the job.
        pools: the pools.
    """

    def __init__(self, run: Session[FitConfig], pools: Sequence[_Pool]) -> None:
        self._run, self._pools = run, pools
        self._recipe = run.recipe(run.config.final)
        self._held: dict[str, Cached] = {}

    def make(self) -> None:
        """Render all streets with their features."""
        progress, cost = self._run.progress, street_cost(self._run.config.final)
        for units, seed, pool in self._pools:

            def done(count: int, seed: int = seed) -> None:
                progress.advance(count * cost)
                progress.update(f"streets of seed {seed}")

            if pool.name not in self._held:
                cache = self._run.runner.cache
                self._held[pool.name] = cache.streets(pool.name, self._recipe, units, seed, done)

    def skip(self) -> None:
        """Count streets as done that no net needs."""
        if not self._held:
            count = sum(len(pool.units) for pool in self._pools)
            cost = count * street_cost(self._run.config.final)
            self._run.progress.advance(cost, replayed=True)

    def of(self, job: Job) -> Job:
        """A job with the rendered streets of its pool, if they are rendered."""
        return job._replace(source=self._filled(job.source))

    def _filled(self, source: Any) -> Any:
        if isinstance(source, TrainingSet):
            return source._replace(parts=tuple(map(self._filled, source.parts)))
        if isinstance(source, StreetPool) and source.name in self._held:
            return source._replace(held=self._held[source.name])
        return source

    def seconds(self) -> float:
        """The core seconds of rendering, also of an earlier call that rendered the streets."""
        if self._held:
            cache = self._run.runner.cache
            return round(sum(cache.seconds(name, self._recipe) for name in self._held), 1)
        file = self._run.config.out / f"{FORM.name}.json"
        earlier = read_json(file) if file.exists() else {}
        return float(earlier.get("seconds", {}).get("streets", 0.0))

    def forget(self) -> None:
        """Remove the files of the streets."""
        for name in self._held:
            self._run.runner.cache.forget(name, self._recipe)


def _jobs(fold: Session[FitConfig], number: int, pools: Sequence[Mapping[int, _Pool]]) -> list[Job]:
    """The nets of all rows of a fold.

    Args:
        fold: the run on this fold's target.
        number: index of the fold.
        pools: by seed, those of mixed streets, then of the streets that each fold has learnt.
    """
    config, recipe = fold.config, fold.recipe(fold.config.final)
    labels, seeds = fold.images(config.final, "labelled"), config.apart
    jobs: list[Job] = []
    for seed in seeds:
        renders = pools[0][seed].pool
        sources: dict[Row, Source] = {
            "labels": labels,
            "labels+renders": _beside(config, renders, labels),
            "renders": renders,
        }
        if config.learnt:
            sources["labels+learnt"] = _beside(config, pools[1 + number][seed].pool, labels)
        for row, source in sources.items():
            notes = {"nets": f"fold {number + 1}", "row": row, "seed": seed}
            keeps: Keeps = "predictions" if number == 0 and seed == seeds[0] else "confusion"
            jobs.append(Job(recipe, source, seed, notes, keeps=keeps))
    return jobs


def _beside(
    config: FitConfig, renders: Source, labels: LabelledImages | LabelledSubset
) -> TrainingSet:
    return TrainingSet((renders, labels), (1 - config.few_share, config.few_share))


def _over_images(
    folds: Sequence[Session[FitConfig]], jobs: Sequence[Sequence[Job]], parts: Parts
) -> dict[Row, Report]:
    """The gain of the first network of each row over labels alone, with its bootstrap over tested images.

    Images of a group are drawn together if there are at least `UNITS` groups, otherwise each by itself.
    Without every image's confusion matrix, such as where evaluations come from a store, it is empty.
    """
    seed, found = folds[0].config.apart[0], {}
    for row in rows_of(folds[0].config.learnt):
        files = [
            file_of(fold.config.out, fold.runner.key(job))
            for fold, some in zip(folds, jobs, strict=True)
            for job in some
            if (job.notes["row"], job.notes["seed"]) == (row, seed)
        ]
        matrices = [held.by_image if (held := load(file)) else None for file in files]
        if any(matrix is None for matrix in matrices):
            return {}
        found[row] = np.concatenate(cast(list[np.ndarray], matrices)).astype(np.int64)
    tested = [parts.every[k].sequence for _, test in parts.folds for k in test]
    names, units = np.unique(tested, return_inverse=True)
    grouped = len(names) >= UNITS
    if not grouped:
        units = np.arange(len(tested))
    summed = {
        row: np.stack([matrices[units == unit].sum(axis=0) for unit in range(units.max() + 1)])
        for row, matrices in found.items()
    }
    return {
        row: {
            **over_units(summed[row], summed["labels"])._asdict(),
            "units": f"{len(names)} groups" if grouped else f"{len(tested)} images",
        }
        for row in found
        if row.startswith("labels+")
    }


def _leave(
    run: Session[FitConfig],
    known: Prepared,
    extra: Mapping[Row, Source],
    report: Report,
    streets: _Rendered,
    *,
    finished: bool,
) -> None:
    """Train the net on all labels in the way of the best row with labels, and save it.

    The learnt streets are those of the first fold, whose search has seen most of the labels. If
    all tests were ``finished`` before, a model of the same images and results stays.
    """
    config, parts = run.config, known.parts
    assert config.data is not None
    target = all_labelled(parts, known.folds[0], config.data, known.whole)
    whole = replace(run, target=target)
    labels = whole.images(config.final, "labelled")
    best = report["recipe"]
    notes = {
        "target": parts.target.name,
        "labelled_images": len(labels.images),
        SEEN: sorted(file_digest(entry.image_path) for entry in parts.seen),
        "trained_on": best,
        "verdict": report["verdict"],
        "miou": report["rows"][best].get("averaged") or report["rows"][best]["mean"],
        "reported_on": report["where"],
    }
    if config.init is not None:
        notes["started_from"] = load_model(config.init).digest
    seed, recipe = config.seed, run.recipe(config.final)
    source = labels if best == "labels" else _beside(config, extra[best], labels)
    job = Job(recipe, source, seed, {})
    if finished and _is_saved(config, notes):
        streets.skip()
        run.progress.advance(job_cost(job), replayed=True)
        return
    if best == "labels":
        streets.skip()
    else:
        streets.make()
    variables = whole.runner.train(streets.of(job), known.init)
    Model(
        config.final.train,
        variables,
        (config.final.height, config.final.width),
        classes_of(parts.target),
        "colours" if parts.target.kind == "colours" else "ids",
        notes,
    ).save(config.out / MODEL)
    run.progress.advance(job_cost(job))


def _is_saved(config: FitConfig, notes: Mapping[str, Any]) -> bool:
    """Whether the run folder holds the model that these notes describe."""
    try:
        return load_model(config.out / MODEL).notes == plain(notes)
    except ModelError:
        return False  # there is none, or it is damaged


def _show(run: Session[FitConfig], fold: Session[FitConfig], jobs: Sequence[Job]) -> None:
    """Write the best, the median and the worst test image, with its label and each row's prediction."""
    colors = class_table(fold.target.table).colors
    images = fold.images(run.config.final, "test")
    kept = [load(file_of(run.config.out, fold.runner.key(job))) for job in jobs]
    found = [own for own in kept if own is not None and own.picked is not None]
    if len(found) < len(jobs):
        return  # some came from the store, which has no predictions
    ranked = next(own for own, job in zip(found, jobs, strict=True) if job.notes["row"] == SHOWN_BY)
    lines = []
    for place in shown(cast(np.ndarray, ranked.miou)):
        index = cast(np.ndarray, ranked.picked)[place]
        seen = [colorize(cast(np.ndarray, own.predictions)[place], colors) for own in found]
        lines.append(
            np.hstack([images.images[index], colorize(images.labels[index], colors), *seen])
        )
    write(run.config.out / STRIP, encode(np.vstack(lines)))


def shown(miou: np.ndarray) -> list[int]:
    """The places of the best, the median and the worst image, fewer if there are fewer.

    Args:
        miou: f32[images] of each image; NaN, if all of its pixels are ignored, comes last.
    """
    ranked = np.argsort(-np.nan_to_num(miou, nan=-1.0), kind="stable")
    last = max(int(np.isfinite(miou).sum()) - 1, 0)
    return ranked[list(dict.fromkeys((0, last // 2, last)))].tolist()


FORM = Form("summary", derive, text, {}, {NAME: page.html})


def fit(config: FitConfig) -> Report:
    """Do a whole job, or the rest of it; `config_of` makes its configuration.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    set_up_process()  # a model of --init starts JAX
    own = prepared(config)
    study: Study[FitConfig] = Study(
        FORM, plan, scores, prepare=lambda *_: own, target=lambda *_: own.folds[0]
    )
    return do(study, config)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.fit().parse_args(arguments)
    say = partial(print, flush=True)

    def work() -> None:
        given = {name: value for name, value in vars(options).items() if name != "debug"}
        config = config_of(given.pop("data"), given.pop("out"), say=say, **given)
        fit(config)
        command = shlex.join([PROGRAM, "predict", str(config.out / MODEL)])
        print(f"Use the net: {command} IMAGES --out DIR")
        print(f"Look at {config.out / NAME}")

    from scene.render import RendererError  # the help needs no engine

    return exit_code(work, (WorkerError,), users=(UserError, RendererError), debug=options.debug)
