"""The main job: it searches, trains the final nets, renders the answer and reports."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from common.files import write, write_json
from experiments.app import few_note
from experiments.app.report import live, page, pictures, summary
from experiments.app.report.folder import NAME
from experiments.app.report.matters import FILE, matters
from experiments.attribute_search.learn import learn, work_of
from experiments.config import MainConfig
from experiments.evaluation.in_worker import render
from experiments.evaluation.job import Recipe
from experiments.session.session import Session, Work
from experiments.tables import few_rows
from experiments.tables.form import Form, Report, about
from experiments.tables.nets import by_row, jobs_of, paired_seeds, training_sets
from experiments.tables.skeleton import Study, do
from scene.dataset.export import export_dataset, read_dataset
from scene.preview.dataset import write_sheet
from scene.proposal import Proposal, draw
from seg.data import LabelledImages


def plan(config: MainConfig, _: Any = None) -> list[Work]:
    """Plan rewards, and the nets of every row."""
    real = config.unlabelled is None
    few = config.few is not None
    nets = 3 * (1 + few) * config.seeds
    work = [*work_of(config), Work.at("nets on rendered images", nets, config.final)]
    if real:
        nets = (1 + few) * config.seeds
        work.append(Work.on_images("nets on labelled images alone", nets, config.final))
    return work


def scores(run: Session[MainConfig], _: Any) -> Report:
    """Do the whole job, or the rest of it."""
    config, target, folder = run.config, run.target, run.config.out
    recipe, seeds = run.recipe(config.final), paired_seeds(run)
    live.watch(run, {**about(run, config.final), **few_rows.about(run)})
    # Nets without learnt attributes fill gaps of the search, the others gaps of the export.
    run.runner.prefetch(jobs_of("final", training_sets(run, None), recipe, seeds, keeps=True))
    found = learn(run)
    final = jobs_of("final", training_sets(run, found.solution), recipe, seeds, keeps=True)
    run.runner.prefetch(final)
    pictures.write_policy(folder / pictures.PICTURES, found)
    export(run, recipe, found.solution)
    test = target.at(config.final.height, config.final.width)["test"]
    shown = _shown(run, recipe)
    rows = by_row(final, run.runner.test(final))
    pictures.write_images(run, test, shown)
    told = matters(run.evaluations.records, target.name, config.space)
    write_json(folder / pictures.PICTURES / FILE, told)
    share = run.workers.cpu_share()
    return {
        **summary.scores(run, rows, found.solution),
        "cpu_share": None if share is None else round(share, 3),
    }


def _shown(run: Session[MainConfig], recipe: Recipe) -> dict[str, LabelledImages]:
    """Training images with labels to show: some random and hand-set streets, all learnt ones, real images."""
    config, fidelity = run.config, recipe.fidelity
    some = replace(fidelity, streets=min(fidelity.streets, 12), shots=min(fidelity.shots, 2))
    sets = {}
    for name in ("random", "default"):
        streets = config.streets(name)
        sets[name] = render(recipe._replace(fidelity=some), streets, config.seed, run.workers)
    sets["learnt"] = read_dataset(config.out / "dataset", recipe.classes.outlines)
    found = {
        name: LabelledImages(own.images, recipe.classes.from_train_id[own.labels])
        for name, own in sets.items()
    }
    return found | ({"real": run.images(fidelity, "labelled")} if run.target.labelled else {})


def export(run: Session[MainConfig], recipe: Recipe, streets: Proposal) -> None:
    """Write the learnt dataset with all of the engine's labels into ``dataset/``.

    With ``--few`` a note beside it says how to train on it and on the few images.
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
