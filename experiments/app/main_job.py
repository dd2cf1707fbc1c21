"""The main job: search, train the final networks, render the optimised streets, report."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from common.files import write, write_json
from experiments.app import few_note
from experiments.app.report import live, page, pictures, summary
from experiments.app.report.folder import NAME
from experiments.app.report.matters import FILE, matters
from experiments.attribute_search.loop import learn
from experiments.attribute_search.plans import plan_of, work_of
from experiments.config import MainConfig
from experiments.evaluation.in_worker import rendered_set
from experiments.evaluation.job import Recipe
from experiments.session.session import Session, Work
from experiments.tables.form import Form, Report, about
from experiments.tables.nets import by_row, jobs_of, paired_seeds, training_sets
from experiments.tables.skeleton import Study, do
from scene.dataset.export import export_dataset, read_dataset
from scene.preview.dataset import write_sheet
from scene.proposal import Proposal, draw
from seg.data import LabelledImages


def plan(config: MainConfig, _: Any = None) -> list[Work]:
    """Plan rewards, and the networks of every row."""
    labelled = (1 + (config.few is not None)) * config.seeds
    return [
        work_of(config, [plan_of(config)]),
        Work.at("networks on rendered images", 3 * labelled, config.final),
        Work.on_images("networks on labelled images alone", labelled, config.final),
    ]


def scores(run: Session[MainConfig], _: Any) -> Report:
    """Do the whole job, or the rest of it."""
    config, target, folder = run.config, run.target, run.config.out
    recipe, seeds = run.recipe(config.final), paired_seeds(run)
    test = target.at(config.final.height, config.final.width)["test"]
    shown = {name: _some_streets(run, recipe, name) for name in ("random", "default")}
    path = pictures.write_start(folder, target.title, test, shown)
    run.progress.say(f"{path}: images of the target, and the streets that the search starts from")
    live.watch(run, about(run, config.final))
    # Networks that need no optimised streets fill gaps of the search, the others gaps of the export.
    run.runner.prefetch(jobs_of("final", training_sets(run, None), recipe, seeds, keeps=True))
    search_result = learn(run)
    final = jobs_of("final", training_sets(run, search_result.solution), recipe, seeds, keeps=True)
    run.runner.prefetch(final)
    pictures.write_policy(folder / pictures.PICTURES, search_result)
    export(run, recipe, search_result.solution)
    dataset = read_dataset(folder / "dataset", recipe.classes.outlines)
    labels = recipe.classes.from_train_id[dataset.labels]
    shown["learnt"] = LabelledImages(dataset.images, labels)
    shown["real"] = run.images(recipe.fidelity, "labelled")
    rows = by_row(final, run.runner.test(final))
    pictures.write_images(run, test, shown, ["final"], ("few+learnt", "learnt"))
    write_json(
        folder / pictures.PICTURES / FILE,
        matters(run.evaluations.records, target.name, config.space),
    )
    share = run.workers.cpu_share()
    return {
        **summary.scores(run, rows, search_result.solution),
        "cpu_share": None if share is None else round(share, 3),
    }


def _some_streets(run: Session[MainConfig], recipe: Recipe, name: str) -> LabelledImages:
    """Render a few random or default streets to show."""
    fidelity, config = recipe.fidelity, run.config
    few = replace(fidelity, streets=min(fidelity.streets, 12), shots=min(fidelity.shots, 2))
    return rendered_set(
        recipe._replace(fidelity=few), config.streets(name), config.seed, run.workers
    )


def export(run: Session[MainConfig], recipe: Recipe, streets: Proposal) -> None:
    """Write renders of the optimised streets, with all of the engine's labels, into ``dataset/``.

    With ``--few`` a note in the folder says how to train on them and on the few images.
    `sdr-jax render` makes the same from the run's ``attributes.json`` and seed.
    """
    config, fidelity = run.config, recipe.fidelity
    export_dataset(
        draw(streets, config.seed, fidelity.streets),
        config.seed,
        config.out / "dataset",
        shots=fidelity.shots,
        settings=fidelity.render_settings(),
        renderer_name=recipe.renderer,
        pool=recipe.pool,
        streets=streets,
        workers=run.workers,
    )
    write_sheet(config.out / "dataset")
    if run.target.few_names:
        write(config.out / "dataset" / few_note.NOTE, few_note.text(run))


FORM = Form("summary", summary.derive, summary.text, {}, {NAME: page.html})
MAIN = Study(FORM, plan, scores)
RUN = partial(do, MAIN)
"""The study of `sdr-jax cityscapes`, `sdr-jax camvid` and `sdr-jax labelmefacade`."""
