"""One run of `sdr-jax fit`: it renders streets, trains and tests the rows' networks, and saves a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from common.command import running_command
from common.errors import UserError, counted
from common.files import file_digest
from common.folder import as_json
from common.labels.target_file import find_target
from experiments.app.fit.config import FitConfig, planned
from experiments.app.fit.streets import Pool, RenderedStreets, pool_of
from experiments.app.report import live, page, pictures
from experiments.app.report.fit_table import MODEL, Row, derive, rows_of, saved_score, text
from experiments.app.report.folder import NAME
from experiments.attribute_search.loop import learn
from experiments.evaluation.cost import job_cost
from experiments.evaluation.job import Job, Keeps, LabelledSubset, Source
from experiments.evaluation.predictions import file_of, load
from experiments.session.session import Session, Work, set_up_process
from experiments.tables.form import Form, Report, about, miou, nets
from experiments.tables.skeleton import Study, attributes, do
from experiments.tables.stats import UNITS, over_units
from experiments.targets.base import Target
from experiments.targets.folder import Parts, Read, all_labelled, fold_targets, parts_of, reader
from seg.classes import class_table
from seg.data import LabelledImages
from seg.errors import ModelError
from seg.inference import heads_of, stacked
from seg.mixing import TrainingSet
from seg.model import SEEN, Model, classes_of, load_model, refuse_others
from seg.nets.backbones import backbone_of
from seg.step import Params

RANKED_BY: Row = "labels+renders"
"""The report ranks the test images by this row's first network."""
RENDERED = "mixed"
"""The streets to render, half of them random and half default: better than random ones on real images, and as
good as those on targets far from the default street (`docs/results.md`)."""


class Prepared(NamedTuple):
    """The data that are read before the folder of the run is made."""

    parts: Parts
    read_all: Read
    folds: list[Target]
    init: Params | None
    started_from: str | None  # the digest of the model of --init


def prepared(config: FitConfig) -> Prepared:
    """Sort the images into parts, and load the model of ``--init``.

    Raises:
        UserError: as `parts_of`, or the model does not fit.
    """
    assert config.data is not None
    refuse_others(config.out / MODEL)
    few = None if config.few is None else int(config.few)
    parts = parts_of(find_target(config.file, config.data), config.data, config.holdout, few)
    read_all = reader(parts, config.shape)
    folds = fold_targets(parts, config.data, read_all)
    if config.init is None:
        return Prepared(parts, read_all, folds, None, None)
    model = load_model(config.init)
    init = _initial_variables(config, model, folds[0])
    return Prepared(parts, read_all, folds, init, model.digest)


def _initial_variables(config: FitConfig, model: Model, target: Target) -> Params:
    """The variables of the model of ``--init``, with its heads repeated if the run has more.

    Raises:
        UserError: it has another network or other classes.
    """
    train = config.final.train
    classes = class_table(target.table).classes
    if model.names != tuple(classes):
        raise UserError(
            f"--init {config.init}: a model of other classes, {', '.join(model.names)}; the target has "
            f"{', '.join(classes)}"
        )
    for flag, expected, actual in (
        ("--net", train.net, model.settings.net),
        ("--backbone", train.backbone, model.settings.backbone),
    ):
        if expected != actual:
            raise UserError(f"--init {config.init}: a model with {flag} {actual}, not {expected}")
    if train.frozen and backbone_of(train).source != backbone_of(model.settings).source:
        raise UserError(
            f"--init {config.init}: its head was trained on other weights of the backbone; give its --weights"
        )
    heads = heads_of(model.variables, model.settings.heads)
    return stacked([heads[k % len(heads)] for k in range(train.heads)])


def plan(config: FitConfig, data: Prepared) -> list[Work]:
    """Plan streets, searches, and the networks of every row and fold."""
    return planned(config, len(data.folds))


def scores(run: Session[FitConfig], data: Prepared) -> Report:
    """Do the whole run, or the rest of it."""
    config, seeds = run.config, run.config.trainings
    folds = [replace(run, target=target) for target in data.folds]
    facts = _facts(run, data)
    live.watch(run, facts)
    kinds = [attributes(run, {}, RENDERED)]
    if config.learnt:
        kinds += [learn(fold, name=f"fold-{k}").solution for k, fold in enumerate(folds, 1)]
    pools = [{seed: pool_of(run, streets, seed) for seed in seeds} for streets in kinds]
    jobs = [_jobs(fold, number, pools) for number, fold in enumerate(folds)]
    streets = RenderedStreets(run, [pool for by_seed in pools for pool in by_seed.values()])
    are_tested = [
        all(fold.runner.known(fold_jobs)) for fold, fold_jobs in zip(folds, jobs, strict=True)
    ]
    rendered: dict[Row, Source] = {"labels+renders": pools[0][seeds[0]].pool}
    if config.learnt:
        rendered["labels+learnt"] = pools[1][seeds[0]].pool
    model = _SavedModel(run, data, rendered, streets)
    if not all(are_tested):
        streets.render()
        for fold, fold_jobs in zip(folds, jobs, strict=True):
            if fold is folds[-1]:  # begun last, it would keep one core busy and the others idle
                model.begin("labels+renders")
            fold.runner.prefetch(fold_jobs, behind=False)
    networks: dict[Row, list[Any]] = {row: [] for row in rows_of(config.learnt)}
    averaged: dict[Row, list[float | None]] = {row: [] for row in networks}
    for number, fold in enumerate(folds):
        results = fold.runner.test(jobs[number])
        for row, by_fold in networks.items():
            of_row = [
                result
                for job, result in zip(jobs[number], results, strict=True)
                if job.notes["row"] == row
            ]
            by_fold.append(nets(of_row, config.final.train.heads))
            averaged[row] += miou(nets(of_row))
    fold = folds[0]
    labels = {"labels": model.labels}
    kinds_of_nets = [f"fold {number}" for number in range(1, len(folds) + 1)]
    test = fold.images(config.final, "test")
    pictures.write_images(fold, test, labels, kinds_of_nets, (RANKED_BY,))
    report = {**facts, "nets": networks}
    if config.final.train.heads > 1:
        report["averaged"] = averaged
        report["over_images"] = _gains_over_images(folds, jobs, data.parts)
    model.save(derive(report), finished=all(are_tested))
    seconds = {"streets": streets.seconds(FORM), "total": round(run.progress.elapsed, 1)}
    streets.remove_files()
    return {**report, "seconds": seconds}


def _facts(run: Session[FitConfig], data: Prepared) -> Report:
    """What the report says that does not depend on any result."""
    config, parts = run.config, data.parts
    return {
        **about(run, config.final),
        "command": running_command(),
        "colors": class_table(run.target.table).colors.tolist(),
        "labels": len(parts.entries),
        "folds": len(data.folds),
        "fold_labels": [len(train) for train, _ in parts.folds],
        "where": parts.where,
        "notes": list(parts.notes),
        "tested": sum(len(fold.test_names) for fold in data.folds),
        "not_rendered": [name for name, row in parts.target.classes.items() if not row.renders],
        "rendered_images": config.final.images,
        "streets": RENDERED,
        "few_share": config.few_share,
        "last_share": config.final.train.last_share,
        "net": config.final.train.net,
    }


def _jobs(fold: Session[FitConfig], number: int, pools: Sequence[Mapping[int, Pool]]) -> list[Job]:
    """The networks of all rows of a fold.

    Args:
        fold: the run on this fold's target.
        number: index of the fold.
        pools: by seed, those of mixed streets, then of the streets that each fold's search has found.
    """
    config, recipe = fold.config, fold.recipe(fold.config.final)
    labels, seeds = fold.images(config.final, "labelled"), config.trainings
    jobs: list[Job] = []
    for seed in seeds:
        renders = pools[0][seed].pool
        sources: dict[Row, Source] = {
            "labels": labels,
            "labels+renders": with_labels(config, renders, labels),
            "renders": renders,
        }
        if config.learnt:
            optimised = pools[1 + number][seed].pool
            sources["labels+learnt"] = with_labels(config, optimised, labels)
        for row, source in sources.items():
            notes = {"nets": f"fold {number + 1}", "row": row, "seed": seed}
            keeps: Keeps = "predictions" if number == 0 and seed == seeds[0] else "confusion"
            jobs.append(Job(recipe, source, seed, notes, keeps=keeps))
    return jobs


def with_labels(
    config: FitConfig, renders: Source, labels: LabelledImages | LabelledSubset
) -> TrainingSet:
    """Renders and labelled images in the shares of the configuration."""
    return TrainingSet((renders, labels), (1 - config.few_share, config.few_share))


def _gains_over_images(
    folds: Sequence[Session[FitConfig]], jobs: Sequence[Sequence[Job]], parts: Parts
) -> dict[Row, Report]:
    """The gain of the first network of each row over labels alone, with its interval over test images.

    Images of a group are left out together if there are at least `UNITS` groups, otherwise one by one, which
    ignores that images of a group are alike. The result is empty where some image's confusion matrix is
    missing, such as if evaluations come from a store.
    """
    seed = folds[0].config.trainings[0]
    by_row: dict[Row, np.ndarray] = {}
    for row in rows_of(folds[0].config.learnt):
        files = [
            file_of(fold.config.out, fold.runner.key(job))
            for fold, fold_jobs in zip(folds, jobs, strict=True)
            for job in fold_jobs
            if (job.notes["row"], job.notes["seed"]) == (row, seed)
        ]
        stored = [load(file) for file in files]
        matrices = [predictions and predictions.by_image for predictions in stored]
        if any(matrix is None for matrix in matrices):
            return {}
        by_row[row] = np.concatenate(cast(list[np.ndarray], matrices)).astype(np.int64)
    groups = [parts.every[k].sequence for _, test in parts.folds for k in test]
    names, units = np.unique(groups, return_inverse=True)
    grouped = len(names) >= UNITS
    if not grouped:
        units = np.arange(len(groups))
    of_images = f"{len(groups)} images"
    if len(names) < len(groups):
        of_images += f" of {counted(len(names), 'group')}, too narrow for other groups"
    summed = {
        row: np.stack([matrices[units == unit].sum(axis=0) for unit in range(units.max() + 1)])
        for row, matrices in by_row.items()
    }
    return {
        row: {
            **over_units(summed[row], summed["labels"])._asdict(),
            "units": f"{len(names)} groups" if grouped else of_images,
        }
        for row in by_row
        if row.startswith("labels+")
    }


class _SavedModel:
    """The network on all labels that a run saves.

    Args:
        run: the run.
        data: its data.
        rendered: the streets of each row with labels and renders.
        streets: the rendered streets.
    """

    def __init__(
        self,
        run: Session[FitConfig],
        data: Prepared,
        rendered: Mapping[Row, Source],
        streets: RenderedStreets,
    ) -> None:
        config = run.config
        assert config.data is not None
        target = all_labelled(data.parts, data.folds[0], config.data, data.read_all)
        self._run, self._data, self._rendered = replace(run, target=target), data, rendered
        self._streets = streets
        self.labels = self._run.images(config.final, "labelled")
        self._futures: dict[Row, Future | None] = {}

    def _job(self, row: Row) -> Job:
        config = self._run.config
        source: Source = self.labels
        if row != "labels":
            source = with_labels(config, self._rendered[row], self.labels)
        return Job(self._run.recipe(config.final), source, config.seed, {})

    def begin(self, row: Row) -> None:
        """Begin to train it in the way of the row that is most likely the best."""
        self._futures[row] = self._run.runner.begin_training(self._job(row), self._data.init)

    def save(self, report: Report, *, finished: bool) -> None:
        """Train the network in the way of the best row with labels, and save it.

        Optimised streets are those of the first fold, whose search has seen most of the labels.

        Args:
            report: the report on the tested networks.
            finished: whether all tests were known before the run; a saved model of the same images and
                results then stays.
        """
        config, parts, progress = self._run.config, self._data.parts, self._run.progress
        best = report["recipe"]
        notes = {
            "target": parts.target.name,
            "labelled_images": len(self.labels.images),
            SEEN: sorted(file_digest(entry.image_path) for entry in parts.model_entries),
            "trained_on": best,
            "verdict": report["verdict"],
            "miou": saved_score(report["rows"][best]),
            "reported_on": report["where"],
        }
        if self._data.started_from is not None:
            notes["started_from"] = self._data.started_from
        if finished and _is_saved(config, notes):
            self._streets.skip()
            progress.advance(job_cost(self._job(best)), replayed=True)
            return
        if best == "labels":
            self._streets.skip()
        else:
            self._streets.render()
        job = self._job(best)
        variables = self._run.runner.train(job, self._data.init, self._futures.get(best))
        Model(
            config.final.train,
            variables,
            (config.final.height, config.final.width),
            classes_of(parts.target),
            "colours" if parts.target.kind == "colours" else "ids",
            notes,
        ).save(config.out / MODEL)
        progress.advance(job_cost(job))


def _is_saved(config: FitConfig, notes: Mapping[str, Any]) -> bool:
    """Whether the run folder holds the model that these notes describe."""
    try:
        return load_model(config.out / MODEL).notes == as_json(notes)
    except ModelError:
        return False  # there is none, or it is damaged


FORM = Form("summary", derive, text, {}, {NAME: page.html})


def fit(config: FitConfig) -> Report:
    """Do a whole run, or the rest of it; `config_of` makes its configuration.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    set_up_process()  # a model of --init starts JAX
    data = prepared(config)
    study: Study[FitConfig] = Study(
        FORM, plan, scores, prepare=lambda *_: data, target=lambda *_: data.folds[0]
    )
    return do(study, config)
