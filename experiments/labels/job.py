"""Nets on ever more labelled images, alone and beside renders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from experiments import presets
from experiments.config import LearntConfig, Preset, ShareConfig, TargetName
from experiments.labels.report import ALONE, FORM
from experiments.reward.miou import Source
from experiments.reward.truth import Truth, WithFew, part_of
from experiments.run.context import Run, Work
from experiments.run.ladder import training_cost
from experiments.run.nets import Net, paired_seeds, score_each
from experiments.study.form import Report, about, nets
from experiments.study.skeleton import Study, attributes, learnt_from, learnt_work
from experiments.target.base import Target
from experiments.target.few import spread
from scene.proposal import Streets
from shell.errors import UserError, refuse_repeats

Renders = Literal["random", "default", "mixed", "learnt"]
FIRST, SHARES = (0, 7, 14), (0.1, 0.25, 0.5, 1.0)
"""How many labelled images by default: these, and then shares of all there are."""


@dataclass(frozen=True, kw_only=True)
class LabelsConfig(LearntConfig, ShareConfig):
    """One study. Every field is a flag."""

    counts: tuple[int, ...] | None = None
    """Labelled images that nets are trained on; by default 0, 7, 14, and 10, 25, 50 and 100 % of all."""
    renders: tuple[Renders, ...] | None = None
    """What stands beside them: streets with random attributes, set by eye (default), half of either (mixed)
    or learnt; by default learnt with --learnt, else default."""

    @property
    def rendered(self) -> tuple[Renders, ...]:
        """The sets of renders."""
        if self.renders is not None:
            return self.renders
        return ("default",) if self.learnt is None else ("learnt",)


def defaults(target: TargetName, preset: Preset) -> LabelsConfig:
    """The defaults of ``python -m experiments.labels``."""
    own: dict[str, Any] = {"counts": (0, 2, 4)} if preset == "smoke" else {}
    return presets.defaults(LabelsConfig, target, preset, **own)


def check(config: LabelsConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if not config.rendered:
        raise UserError("--renders needs at least one value")
    refuse_repeats("--renders", config.rendered)
    if config.learnt is not None and "learnt" not in config.rendered:
        raise UserError(f"--learnt is of no use with --renders {' '.join(config.rendered)}")
    if config.counts is None:
        return
    refuse_repeats("--counts", config.counts)
    if sum(count > 0 for count in config.counts) < 2:
        raise UserError("--counts needs at least two numbers above 0: between them is a curve")
    if min(config.counts) < 0:
        raise UserError(f"--counts must be 0 or more, not {min(config.counts)}")


def counts_of(config: LabelsConfig, target: Target) -> tuple[int, ...]:
    """The numbers of labelled images, ascending.

    Raises:
        UserError: there are not so many.
    """
    there = len(target.reward_names)
    if config.counts is None:
        shares = [math.floor(share * there + 0.5) for share in SHARES]
        return tuple(sorted({count for count in (*FIRST, *shares) if count <= there}))
    if max(config.counts) > there:
        raise UserError(
            f"--counts {max(config.counts)} is more than the {there} labelled images of {target.name}"
        )
    return tuple(sorted(config.counts))


def plan(config: LabelsConfig) -> list[Work]:
    """The nets on labelled images and on both, after those of a search, if there is one."""
    final, seeds = config.final, config.seeds
    # By default it depends on the data how many numbers there are.
    counts = (*FIRST, *SHARES) if config.counts is None else config.counts
    some = sum(count > 0 for count in counts)
    rendered = len(config.rendered) * len(counts)
    work = learnt_work(config) if "learnt" in config.rendered else []
    return [
        *work,
        Work.at(f"nets with renders, {rendered} sets x {seeds} seeds", rendered * seeds, final),
        Work(f"nets without, {some} x {seeds} seeds", some * seeds, final, training_cost(final)),
    ]


def scores(run: Run[LabelsConfig], counts: tuple[int, ...]) -> Report:
    """Train the nets of the whole study, or what is left of them."""
    config, target = run.config, run.target
    real = run.truth(config.final, "reward")
    proposals: dict[str, Streets] = {name: attributes(run, name) for name in config.rendered}
    chosen = {
        (count, seed): _few(target, real, count, seed)
        for count in counts
        if count
        for seed in paired_seeds(run)
    }

    def source(renders: str, count: int, seed: int) -> Source:
        if renders == ALONE:
            return chosen[count, seed]
        if count == 0:
            return proposals[renders]
        return WithFew(proposals[renders], chosen[count, seed], config.few_share)

    # Those that share a rendered dataset one after the other, the largest first: a worker keeps it.
    wanted = [
        (renders, count, seed)
        for renders in (*proposals, ALONE)
        for seed in paired_seeds(run)
        for count in reversed(counts)
        if count or renders != ALONE
    ]
    recipe = run.recipe(config.final)
    jobs = [
        Net("labels", f"{count} labels, {renders}", source(renders, count, seed), recipe, seed)
        for renders, count, seed in wanted
    ]
    outcomes = score_each(run, jobs)
    found = dict(zip(wanted, outcomes, strict=True))
    rows = []
    for count in counts:
        for renders in (ALONE, *proposals):
            if count or renders != ALONE:
                own = [found[renders, count, seed] for seed in paired_seeds(run)]
                rows.append({"labels": count, "renders": renders, "nets": nets(own)})
    return {
        **about(run, config.final),
        "learnt_from": learnt_from(config) if "learnt" in proposals else None,
        "few_share": config.few_share,
        "rendered_images": config.final.images,
        "net": config.final.train.net,
        "rows": rows,
    }


def _few(target: Target, real: Truth, count: int, seed: int) -> Truth:
    """Some of the labelled images; all of them in the order of the list."""
    if count == len(real.images):
        return real
    return part_of(real, spread(target.reward_names, target.reward_sequences, count, seed))


STUDY = Study(FORM, plan, scores, check, counts_of)
"""What ``python -m experiments.labels`` does."""
