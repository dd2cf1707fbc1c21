"""The whole comparison: every method's search on every subset, the final nets, the report."""

from __future__ import annotations

from typing import Any

from experiments import compare_report
from experiments.compare_config import RANDOM, CompareConfig, budgets, check, plans
from experiments.compare_search import Comparison
from experiments.errors import UserError
from experiments.evaluator import Evaluator
from experiments.finals import random_proposal
from experiments.folder import RunFolder, refuse_foreign
from experiments.ladder import cost_of
from experiments.progress import Progress
from experiments.reward import Truth, worker_environment
from experiments.store import FILE, Store
from experiments.targets import named_target
from scene.command import duration
from scene.render import RendererError, renderer
from scene.workers import WorkerPool


def run(config: CompareConfig) -> dict[str, Any]:
    """Do the whole comparison, or what is left of it, and return what ``compare.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    config = check(config)
    work = plans(config)
    try:
        renderer(config.renderer)
    except RendererError as error:
        raise UserError(str(error)) from None
    with WorkerPool(config.workers, worker_environment()) as workers:
        target = named_target(config.target, config, workers)
        refuse_foreign(config, target.name)
        store = Store(config.store or config.out / FILE)
        print(f"Target: {target.title}", flush=True)
        small = target.at(config.reward.height, config.reward.width).reward
        folder = RunFolder(config, target.name)
        try:
            rows = [(method, subset) for subset in config.subsets for method in config.methods]
            nets = len(rows) * config.seeds
            stages = budgets(config)
            rewards = len(work) * config.evaluations
            progress = Progress(
                rewards * cost_of(config.reward) + nets * sum(map(cost_of, stages)),
                label="" if target.real else "twin, not real | ",
            )
            progress.say(
                f"Folder: {config.out} | {rewards} rewards of {config.reward.images} images, then "
                f"{nets} nets at each of {len(stages)} budgets; {store.path} holds {len(store)} "
                "evaluations"
            )
            comparison = Comparison(config, progress)
            truth = Truth(small.images, small.labels)
            evaluator = Evaluator(config, config.reward, target, "reward", truth, workers, store)
            found = {(p.method, p.subset): comparison.search(p, evaluator) for p in work}
            solutions = {
                name: random_proposal() if name[0] == RANDOM else found[name].solution
                for name in rows
            }
            scores = []
            for stage in stages:
                test = target.at(stage.height, stage.width).test
                truth = Truth(test.images, test.labels)
                evaluator = Evaluator(config, stage, target, "test", truth, workers, store)
                scores.append((stage, comparison.score(stage, solutions, evaluator)))
            report = compare_report.summarize(config, target, rows, found, scores)
            compare_report.write(report, config.out)
            progress.say(compare_report.text(report))
            progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'compare.md'}")
            return report
        finally:
            folder.close()
