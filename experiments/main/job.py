"""The main job: search, choose, train the final nets, render the answer, report."""

from __future__ import annotations

from typing import Any

from experiments.config import MainConfig
from experiments.main import note, page, pictures, summary
from experiments.reward.miou import Recipe, render
from experiments.run.context import Run, Work
from experiments.run.ladder import training_cost
from experiments.run.learn import learn, work_of
from experiments.run.nets import Nets, begin, paired_seeds, score_lists, training_sets
from experiments.study.form import Form, Report
from experiments.study.skeleton import Study
from scene.dataset.export import export_dataset, read_dataset
from scene.proposal import Streets, draw, random_proposal
from shell.files import write


def plan(config: MainConfig) -> list[Work]:
    """Rewards, candidates, and the nets of every row."""
    real = config.unlabelled is None
    few = config.few is not None
    nets = 3 * (1 + few) * config.seeds
    work = [*work_of(config), Work.at("nets on rendered images", nets, config.final)]
    if real:
        each = training_cost(config.final)
        nets = (1 + few) * config.seeds
        work.append(Work("nets on labelled images alone", nets, config.final, each))
    return work


def scores(run: Run[MainConfig], _: Any) -> Report:
    """Do the whole job, or what is left of it."""
    config, target, folder = run.config, run.target, run.config.out
    recipe, seeds = run.recipe(config.final), paired_seeds(run)
    # What the search does not decide fills its gaps; what it does, those of the export.
    begin(run, [Nets("final", training_sets(run, None), recipe)], seeds)
    learnt = learn(run)
    final = Nets("final", training_sets(run, learnt.streets), recipe)
    begin(run, [final], seeds)
    pictures.rewards(folder / "pictures", learnt.found, target.title, config.reward_kind)
    pictures.distributions(folder / "pictures", learnt.found, target.title)
    export(run, recipe, learnt.streets)
    datasets = {
        "random": render(recipe, random_proposal(config.space), config.seed, run.workers),
        "learnt": read_dataset(folder / "dataset"),
    }
    test = target.at(config.final.height, config.final.width).test
    pictures.samples(folder / "pictures", target, test, datasets)
    (rows,) = score_lists(run, [final], seeds)
    return summary.scores(run, rows, learnt)


def export(run: Run[MainConfig], recipe: Recipe, streets: Streets) -> None:
    """The learnt dataset, with every label the engine knows, in ``dataset/``.

    With ``--few`` a note beside it says how to train on it and on them.
    ``scene.render`` makes the same from the run's ``attributes.json`` and seed.
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
    if run.target.few_names:
        write(config.out / "dataset" / note.README, note.text(run))


FORM = Form("summary", summary.derive, summary.text, {"report.html": page.html})
MAIN = Study(FORM, plan, scores)
"""What ``experiments.cityscapes`` and ``experiments.camvid`` do."""
