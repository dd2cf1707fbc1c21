"""The nets of a study: named training sets, rendered or real, each scored with the same seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sdr_jax
from experiments.config import Stage
from experiments.evaluator import Evaluator, Job, Side
from experiments.finals import draw_units
from experiments.folder import RunFolder
from experiments.ladder import cost_of, training_cost
from experiments.outcome import Outcome, attempt
from experiments.progress import Progress
from experiments.reward import Truth, evaluate, evaluate_real, in_words
from experiments.study import Study

Source = sdr_jax.Proposal | Truth
"""What a net is trained on: a dataset rendered from a proposal f32[23], or images that are there already.
Labels of these are ids of the target's table."""


def score_proposals(
    evaluator: Evaluator,
    scoring: Callable[..., Any],
    wanted: Sequence[tuple[sdr_jax.Proposal, int]],
    stage: Stage,
    progress: Progress,
    say: Callable[[int, Outcome], str],
) -> list[Outcome]:
    """One net for each (proposal, seed), in their order; streets are drawn with the seed of the net.

    Args:
        evaluator: at the stage.
        scoring: ``reward.evaluate`` or ``mmd_reward.evaluate_mmd``.
        wanted: proposals f32[23] and seeds.
        stage: sizes, net and training.
        progress: advanced by ``cost_of(stage)`` for each.
        say: what progress says about a new outcome; its index in ``wanted`` is the first argument.
    """
    jobs = [Job(p, draw_units(p, seed, stage.streets), seed) for p, seed in wanted]
    outcomes: dict[int, Outcome] = {}
    for index, outcome in evaluator.map(scoring, jobs):
        outcomes[index] = outcome
        progress.advance(cost_of(stage), replayed=outcome.stored)
        if not outcome.stored:
            progress.update(say(index, outcome))
    return [outcomes[index] for index in range(len(jobs))]


def score_nets(
    study: Study[Any],
    kind: str,
    sources: Mapping[str, Source],
    stage: Stage,
    progress: Progress,
    side: Side = "test",
) -> dict[str, list[Outcome]]:
    """Train ``--seeds`` nets on each training set and score them; the k-th of every set share a seed.

    Rendered nets are kept in the store, those on real images in the run folder. To score with other
    assets, hand over ``study._replace(config=replace(config, asset_fraction=0.5))``.

    Args:
        study: gives the target, the assets and the seeds.
        kind: name of this set of nets in the run folder, such as "table compact".
        sources: training sets by name.
        stage: sizes, net and training.
        progress: advanced by ``cost_of(stage)`` for each rendered net, else by ``training_cost(stage)``.
        side: which of the target's images score.

    Returns:
        By name, outcomes in the order of the seeds; nets whose training failed among them.
    """
    config, table = study.config, study.target.table
    seeds = [config.seed + k for k in range(config.seeds)]
    rendered = [(n, s) for s in seeds for n in sources if not isinstance(sources[n], Truth)]
    evaluator = study.evaluator(stage, side)
    jobs = [(source, s) for n, s in rendered if not isinstance(source := sources[n], Truth)]

    def said(name: str, seed: int, outcome: Outcome) -> str:
        return f"{kind}: {name}, seed {seed} | {verdict(outcome)}"

    scored = score_proposals(
        evaluator, evaluate, jobs, stage, progress, lambda k, o: said(*rendered[k], o)
    )
    found = dict(zip(rendered, scored, strict=True))
    known = recall(study.folder, kind)
    real = [(n, s) for s in seeds for n in sources if isinstance(sources[n], Truth)]
    missing = [key for key in real if key not in known]
    found |= {key: known[key] for key in real if key in known}
    progress.advance(training_cost(stage) * (len(real) - len(missing)), replayed=True)
    truth = study.truth(stage, side)
    tasks = [(evaluate_real, stage, table, *sources[n], s, truth) for n, s in missing]
    for k, outcome in study.workers.map(attempt, tasks):
        progress.advance(training_cost(stage))
        found[missing[k]] = outcome
        remember(study.folder, kind, *missing[k], outcome, progress)
        progress.update(said(*missing[k], outcome))
    return {name: [found[name, seed] for seed in seeds] for name in sources}


def verdict(outcome: Outcome) -> str:
    """What progress says about a net."""
    return "failed" if outcome.failed else f"mIoU {in_words('miou', outcome.reward)}"


def recall(folder: RunFolder, kind: str) -> dict[tuple[str, int], Outcome]:
    """Nets of a kind that the run folder remembers, by name and seed."""
    return {
        (line["row"], line["seed"]): Outcome(
            line["miou"],
            line["class_iou"],
            line["render_seconds"],
            line["train_seconds"],
            stored=True,
        )
        for line in folder.finals.lines
        if line["kind"] == kind
    }


def remember(
    folder: RunFolder, kind: str, name: str, seed: int, outcome: Outcome, progress: Progress
) -> None:
    """Keep a net's score in the run folder; one that failed is trained again, and fails again."""
    if outcome.failed is None:
        folder.finals.append(
            {
                "kind": kind,
                "row": name,
                "seed": seed,
                "miou": outcome.reward,
                "class_iou": outcome.class_iou,
                "render_seconds": round(outcome.render_seconds, 3),
                "train_seconds": round(outcome.train_seconds, 3),
                "elapsed": round(progress.elapsed, 2),
            }
        )
