"""The main job from target to summary: search, choose, train the final nets, report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from experiments import pictures, summary
from experiments.config import Config, check
from experiments.errors import UserError
from experiments.finals import (
    Finals,
    candidate_proposal,
    draw_units,
    random_proposal,
    rows_of,
)
from experiments.folder import RunFolder, refuse_foreign, write_atomically, write_json
from experiments.ladder import cost_of as cost
from experiments.ladder import ladder, most_cost, most_nets
from experiments.mmd_reward import feature_net
from experiments.progress import Progress
from experiments.report import html as report_html
from experiments.reward import Truth, render, worker_environment
from experiments.search import make_method, make_space, search, total_updates
from experiments.store import Store
from experiments.study import check_renderer
from experiments.targets import Split, Target
from scene.command import duration
from scene.export import ExportError, export_dataset, read_dataset
from scene.proposal import Proposal
from scene.workers import WorkerPool


def run(config: Config, make_target: Callable[[Config, WorkerPool], Target]) -> dict[str, Any]:
    """Do the whole job, or what is left of it, and return the summary.

    Args:
        config: the run; ``config.out`` is its folder.
        make_target: ``targets.cityscapes_target`` or ``targets.camvid_target``.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    make_method(config.search, make_space(config))
    check_renderer(config.renderer)
    with WorkerPool(config.workers, worker_environment()) as workers:
        # Whatever the user got wrong shows before the folder is made: options, folder, images.
        target = make_target(config, workers)
        refuse_foreign(config, target.name)
        title = f"Target: {target.title}"
        if not target.real:  # rendering it takes a while; say at once that it is not real
            print(title, flush=True)
        small = target.at(config.reward.height, config.reward.width)
        if target.real:
            print(title, flush=True)
        store = None if config.store is None else Store(config.store)
        folder = RunFolder(config, target.name)
        try:
            return _run(config, target, small, folder, workers, store)
        finally:
            folder.close()


def _run(
    config: Config,
    target: Target,
    small: Split,
    folder: RunFolder,
    workers: WorkerPool,
    store: Store | None,
) -> dict[str, Any]:
    search_cost, final_cost = cost(config.reward), cost(config.final)
    final_nets = len(rows_of(target)) * config.seeds
    most, ladder_cost = "", 0.0
    if config.ladder:
        rungs = ladder(config)
        ladder_cost = most_cost(len(config.candidates), rungs)
        most = f"at most {sum(most_nets(len(config.candidates), rungs))} nets on the ladder, then "
    else:
        final_nets += len(config.candidates) * config.candidate_seeds
    evaluations = total_updates(config) * config.search.datasets_per_update
    progress = Progress(
        evaluations * search_cost + ladder_cost + final_nets * final_cost,
        folder.elapsed,
        label="" if target.real else "twin, not real | ",
    )
    progress.say(
        f"Run folder: {folder.path} | {evaluations} rewards of {config.reward.images} images at "
        f"{config.reward.width}x{config.reward.height}, then {most}{final_nets} nets on "
        f"{config.final.images} at {config.final.width}x{config.final.height}"
    )
    if folder.continued:
        progress.say(
            f"Continuing: {len(folder.evaluations.lines)} rewards and {len(folder.finals.lines)} "
            f"final nets are done, in {duration(folder.elapsed)}"
        )
    net = None
    if config.reward_kind == "mmd":
        progress.say("The reward is -MMD^2 in the features of one net: labels are left alone")
        net = feature_net(config, target.table, folder.path, workers)
    images = small.reward
    truth = net.reference(images.images) if net else Truth(images.images, images.labels)
    result = search(config, target, truth, folder, workers, progress, search_cost, store)
    pictures.rewards(folder.path / "pictures", result, target.title, config.reward_kind)
    pictures.distributions(folder.path / "pictures", result, target.title)

    split = target.at(config.final.height, config.final.width)
    finals = Finals(config, target, split, folder, workers, progress, final_cost, store, net)
    chosen, scores = finals.candidates(result)
    learnt = candidate_proposal(chosen, result)
    attributes = summary.attributes(learnt)
    write_json(folder.path / "attributes.json", attributes)
    rows = finals.rows(learnt)

    stage = config.final
    units = {
        name: draw_units(proposal, config.seed, stage.streets)
        for name, proposal in (("random", random_proposal()), ("learnt", learnt))
    }
    try:
        export_dataset(
            units["learnt"],
            config.seed,
            folder.path / "dataset",
            shots=stage.shots,
            settings=stage.render_settings(),
            renderer_name=config.renderer,
            pool=config.pool,
            proposal=Proposal(np.asarray(learnt.centre), np.asarray(learnt.width)),
            workers=workers,
        )
    except ExportError as error:
        raise UserError(str(error)) from None
    datasets = {
        "random": render(
            stage, config.renderer, config.pool, units["random"], config.seed, workers
        ),
        "learnt": read_dataset(folder.path / "dataset"),
    }
    pictures.samples(folder.path / "pictures", target, split.test, datasets)
    report = summary.summarize(
        config, target, folder, rows, chosen, scores, learnt, progress.elapsed
    )
    write_atomically(folder.path / "report.html", report_html(report, attributes))
    write_json(folder.path / "summary.json", report)
    progress.say(summary.text(report))
    note = "" if target.real else " (the twin, not real data)"
    progress.say(f"Done in {duration(progress.elapsed)}{note}: {folder.path / 'summary.json'}")
    return report
