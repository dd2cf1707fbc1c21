"""The ablation from start to report: every variant's search, the final nets, the losses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import sdr_jax
from experiments import study_report
from experiments.ablation_config import (
    RANDOM,
    AblationConfig,
    ablation_config,
    check,
    comparison,
    plan,
    searched,
)
from experiments.ablation_report import FORM
from experiments.compare_search import Comparison, Found
from experiments.finals import random_proposal
from experiments.main import main_of_study
from experiments.progress import Progress
from experiments.study import Study, Work, opened
from experiments.study_nets import Source, score_nets
from scene.attributes import NAMES
from scene.command import duration


def run(config: AblationConfig) -> dict[str, Any]:
    """Do the whole ablation, or what is left of it, and return what ``ablation.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    variants = searched(config)
    with opened(config) as study:
        progress = study.begin(
            [
                Work.at(
                    f"rewards, {len(variants)} searches x {config.evaluations}",
                    len(variants) * config.evaluations,
                    config.reward,
                ),
                Work.at(
                    f"final nets, {len(config.variants)} answers x {config.seeds} seeds",
                    len(config.variants) * config.seeds,
                    config.final,
                ),
            ]
        )
        found = {name: search(study, name, progress) for name in variants}
        answers: dict[str, Source] = {
            name: random_proposal() if name == RANDOM else found[name].solution
            for name in config.variants
        }
        outcomes = score_nets(study, "ablation", answers, config.final, progress)
        rows = [
            {
                "variant": name,
                "search": _search(config, name, found[name]) if name in found else None,
                "nets": study_report.nets(outcomes[name]),
            }
            for name in config.variants
        ]
        scores = {
            **study_report.about(study, config.final),
            "method": config.search.method,
            "evaluations": config.evaluations,
            "rewards_at": f"{config.reward.width}x{config.reward.height}",
            "rows": rows,
        }
        report = study_report.write(FORM, scores, config.out)
        progress.say(FORM.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'ablation.md'}")
        return report


def search(study: Study[AblationConfig], variant: str, progress: Progress) -> Found:
    """The search of one variant; all of them begin with the same key."""
    config = study.config
    evaluator = study.evaluator(config.reward, "reward")
    progress.say(f"Variant: {variant.replace('_', ' ')}")
    return Comparison(comparison(config, variant), progress).search(
        plan(config, variant), evaluator
    )


def _search(config: AblationConfig, variant: str, found: Found) -> dict[str, Any]:
    """One search; rewards in percent, None where they failed."""
    own = comparison(config, variant)
    (subset,) = own.subsets
    return {
        "attributes": len(subset),
        "groups": [[n for n in group if n in subset] for group in own.groups],
        "relaxation": own.search.relaxation,
        "rewards": [None if o.failed else 100 * o.reward for o in found.outcomes],
        "core_seconds": round(sum(o.seconds for o in found.outcomes), 2),
        "solution": _solution(found.solution),
    }


def _solution(proposal: sdr_jax.Proposal) -> dict[str, list[float]]:
    """Centre and width of every attribute; those left random have 0.5 and 1."""
    pairs = np.stack([np.asarray(part, float) for part in proposal], axis=-1)
    return {
        name: [round(v, 6) for v in pair] for name, pair in zip(NAMES, pairs.tolist(), strict=True)
    }


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_of_study(FORM, ablation_config, run, description, arguments)
