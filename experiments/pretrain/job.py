"""Which nets are pre-trained on what, and on how much of the real images they are fine-tuned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import sdr_jax
from experiments import study_report
from experiments.config import Stage, refuse_repeats
from experiments.errors import UserError
from experiments.finals import draw_units, random_proposal
from experiments.ladder import cost_of, training_cost
from experiments.main import main_of_study
from experiments.outcome import Outcome
from experiments.pretrain_nets import Start, chosen_images, subsets, transfer
from experiments.pretrain_report import FORM
from experiments.progress import Progress
from experiments.study import Study, Work, learnt_attributes, opened, search_work
from experiments.study_config import StudyConfig, check_study, defaults_on
from experiments.study_nets import recall, remember, verdict
from experiments.targets import Target
from scene.command import duration

ROWS = ("scratch", "random", "learnt")
"""Those that are trained by default."""
KNOWN = (*ROWS, "longer")
"""``longer`` begins from scratch, too, but with as many steps on the real subset as the others have on
rendered images; it is as dear as pre-training for every fraction anew."""
RENDERED = ("random", "learnt")
KIND = "pretrain"
"""Name of these nets in the run folder."""


@dataclass(frozen=True, kw_only=True)
class PretrainConfig(StudyConfig):
    """One measurement of pre-training. Every field is a flag."""

    rows: tuple[str, ...] = ROWS
    """What nets begin with: scratch (nothing, or ImageNet weights), random, learnt (pre-trained on SceneX
    with these attributes), longer (as many steps on the real subset first)."""
    fractions: tuple[float, ...] = (0.05, 0.1, 0.25, 1.0)
    """Shares of the reward images that nets are fine-tuned on, nested, the same for all rows of a seed."""
    finetune_steps: int | None = None
    """Updates of the fine-tuning; by default a third of --final.train.steps."""
    finetune_lr: float | None = None
    """Highest learning rate of the fine-tuning; by default a third of --final.train.lr."""


def pretrain_config(target: str, preset: str) -> PretrainConfig:
    """The defaults of ``python -m experiments.pretrain``."""
    config = defaults_on(PretrainConfig, target, preset)
    if preset == "smoke":
        return replace(config, fractions=(0.25, 1.0))
    return config


def fine_stage(config: PretrainConfig) -> Stage:
    """The final stage, with the training that all nets are fine-tuned with."""
    train = config.final.train
    steps = max(train.steps // 3, 1) if config.finetune_steps is None else config.finetune_steps
    lr = train.lr / 3 if config.finetune_lr is None else config.finetune_lr
    fine = replace(train, steps=steps, lr=lr, warmup=min(train.warmup, steps // 2))
    return replace(config.final, train=fine)


def check(config: PretrainConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    check_study(config)
    if not config.rows or set(config.rows) - set(KNOWN):
        raise UserError(
            f"--rows must be some of {', '.join(KNOWN)}; not {' '.join(config.rows) or 'none'}"
        )
    if not config.fractions:
        raise UserError("--fractions needs at least one share of the reward images")
    for name in ("rows", "fractions"):
        refuse_repeats(f"--{name}", getattr(config, name))
    for fraction in config.fractions:
        if not 0 < fraction <= 1:
            raise UserError(f"--fractions must lie in (0, 1], not {fraction:g}")
    if config.finetune_steps is not None and config.finetune_steps < 1:
        raise UserError(f"--finetune-steps must be 1 or more, not {config.finetune_steps}")
    if config.finetune_lr is not None and not 0 < config.finetune_lr < math.inf:
        raise UserError(f"--finetune-lr must be positive, not {config.finetune_lr}")


def refuse_empty(config: PretrainConfig, target: Target) -> None:
    """Raise UserError for a fraction that selects no image."""
    images = len(target.reward_names)
    for fraction in config.fractions:
        if chosen_images(images, fraction) == 0:
            raise UserError(
                f"--fractions {fraction:g} selects none of the {images} reward images; "
                f"{1 / images:.2g} or more selects one"
            )


def plan(config: PretrainConfig) -> list[Work]:
    """The nets of every row, after those of the search."""
    fine, fractions = fine_stage(config), len(config.fractions)
    work = search_work(config) if "learnt" in config.rows else []
    rendered = sum(row in RENDERED for row in config.rows)
    if rendered:
        what = f"pre-training, {rendered} rows x {config.seeds} seeds"
        work.append(Work.at(what, rendered * config.seeds, config.final))
    if "longer" in config.rows:
        what = f"longer, {fractions} fractions x {config.seeds} seeds"
        nets = fractions * config.seeds
        work.append(Work(what, nets, config.final, training_cost(config.final)))
    what = f"fine-tuning, {len(config.rows)} rows x {fractions} fractions x {config.seeds} seeds"
    nets = len(config.rows) * fractions * config.seeds
    return [*work, Work(what, nets, fine, training_cost(fine))]


def run(config: PretrainConfig) -> dict[str, Any]:
    """Train every net, or what is left of them, and return what ``pretrain.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    with opened(config, lambda target: refuse_empty(config, target)) as study:
        progress = study.begin(plan(config))
        proposals = {"random": random_proposal()} if "random" in config.rows else {}
        if "learnt" in config.rows:
            proposals["learnt"] = learnt_attributes(study, progress)
        outcomes = tuned(study, proposals, progress)
        images = len(study.target.reward_names)
        fine = fine_stage(config).train
        scores = {
            **study_report.about(study, config.final),
            **({} if "learnt" in config.rows else {"learnt_from": None}),
            "net": fine.net,
            "weights": fine.weights,
            "pretraining": {"images": config.final.images, "steps": config.final.train.steps},
            "finetuning": {"steps": fine.steps, "lr": fine.lr},
            "rows": [
                {
                    "row": row,
                    "fraction": fraction,
                    "images": chosen_images(images, fraction),
                    "nets": study_report.nets(outcomes[row, fraction]),
                }
                for row in config.rows
                for fraction in config.fractions
            ],
        }
        report = study_report.write(FORM, scores, config.out)
        progress.say(FORM.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'pretrain.md'}")
        return report


def tuned(
    study: Study[PretrainConfig], proposals: dict[str, sdr_jax.Proposal], progress: Progress
) -> dict[tuple[str, float], list[Outcome]]:
    """Every (row, fraction), in the order of the seeds; a worker takes one (row, seed) at a time.

    Args:
        study: gives the target, rows, fractions and seeds.
        proposals: of the rows that are pre-trained, f32[23] each.
        progress: told about every net.
    """
    config, final, fine = study.config, study.config.final, fine_stage(study.config)
    settings = replace(fine.train, table=study.target.table)
    found = recall(study.folder, KIND)
    seeds = [config.seed + k for k in range(config.seeds)]
    missing: list[tuple[str, int, list[float]]] = []
    for seed in seeds:
        for row in config.rows:
            left = [f for f in config.fractions if (name_of(row, f), seed) not in found]
            first = cost_of(final) if row in RENDERED else 0.0
            each = training_cost(fine) + (training_cost(final) if row == "longer" else 0.0)
            known = len(config.fractions) - len(left)
            progress.advance(each * known + (0.0 if left else first), replayed=True)
            if left:
                missing.append((row, seed, left))
    real, truth = study.truth(final, "reward"), study.truth(final, "test")

    def task(row: str, seed: int, left: list[float]) -> tuple:
        units = draw_units(proposals[row], seed, final.streets) if row in proposals else None
        start = Start(final, units, on_subset=row == "longer")
        chosen = subsets(len(real.images), left, seed)
        return start, settings, config.renderer, config.pool, seed, real, chosen, truth

    for index, outcomes in study.workers.map(transfer, [task(*work) for work in missing]):
        row, seed, left = missing[index]
        if row in RENDERED:
            progress.advance(cost_of(final))
        for fraction, outcome in zip(left, outcomes, strict=True):
            found[name_of(row, fraction), seed] = outcome
            remember(study.folder, KIND, name_of(row, fraction), seed, outcome, progress)
            progress.advance(training_cost(fine) + (training_cost(final) if row == "longer" else 0))
        said = ", ".join(verdict(outcome) for outcome in outcomes)
        progress.update(f"{row}, seed {seed} | {said}")
    return {
        (row, fraction): [found[name_of(row, fraction), seed] for seed in seeds]
        for row in config.rows
        for fraction in config.fractions
    }


def name_of(row: str, fraction: float) -> str:
    """A row at a fraction, as the run folder calls it."""
    return f"{row} {fraction!r}"


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_of_study(FORM, pretrain_config, run, description, arguments)
