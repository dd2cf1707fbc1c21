"""The whole comparison: every method's search on every subset, the final nets, the report."""

from __future__ import annotations

from typing import Any

from experiments import compare_report
from experiments.compare_config import RANDOM, CompareConfig, budgets, check, plans
from experiments.compare_search import Comparison
from experiments.finals import random_proposal
from experiments.ladder import cost_of
from experiments.study import opened
from scene.command import duration


def run(config: CompareConfig) -> dict[str, Any]:
    """Do the whole comparison, or what is left of it, and return what ``compare.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    config = check(config)
    work = plans(config)
    with opened(config) as study:
        rows = [(method, subset) for subset in config.subsets for method in config.methods]
        nets = len(rows) * config.seeds
        stages = budgets(config)
        rewards = len(work) * config.evaluations
        progress = study.progress(
            rewards * cost_of(config.reward) + nets * sum(map(cost_of, stages))
        )
        progress.say(
            f"Folder: {config.out} | {rewards} rewards of {config.reward.images} images, then "
            f"{nets} nets at each of {len(stages)} budgets; {study.store.path} holds "
            f"{len(study.store)} evaluations"
        )
        comparison = Comparison(config, progress)
        evaluator = study.evaluator(config.reward, "reward")
        found = {(p.method, p.subset): comparison.search(p, evaluator) for p in work}
        solutions = {
            name: random_proposal() if name[0] == RANDOM else found[name].solution for name in rows
        }
        scores = [
            (stage, comparison.score(stage, solutions, study.evaluator(stage, "test")))
            for stage in stages
        ]
        report = compare_report.summarize(config, study.target, rows, found, scores)
        compare_report.write(report, config.out)
        progress.say(compare_report.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'compare.md'}")
        return report
