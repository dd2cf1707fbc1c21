"""The ablation: the search of every variant, what each leaves out, then nets of what they found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from experiments import presets
from experiments.ablation.report import FORM, FULL, RANDOM, Variant
from experiments.config import MethodOptions, Preset, SearchesConfig, TargetName
from experiments.presets import DENSITIES, ENVIRONMENT, POSITIONS
from experiments.reward.miou import Source
from experiments.run import plans
from experiments.run.context import Run, Work
from experiments.run.nets import Nets, begin, paired_seeds, score_lists
from experiments.run.pooled import find, work_of
from experiments.run.search import Found, SearchPlan
from experiments.study.form import Report, about, nets
from experiments.study.searches import core_seconds, rewards
from experiments.study.skeleton import Study
from scene.attributes import SpaceName, names
from scene.proposal import random_proposal
from shell.errors import UserError, refuse_repeats

VARIANTS: tuple[Variant, ...] = get_args(Variant)
FIXED: dict[Variant, tuple[str, ...]] = {
    "no_environment": ENVIRONMENT,
    "no_positions": POSITIONS,
    "no_densities": DENSITIES,
}
"""Variants that leave some attributes random, and which."""
SHUFFLE = 2020
"""Goes into the seed of the shuffled groups."""
OWN: dict[Preset, dict[str, Any]] = {
    # One of each kind: most of the time goes into compiling the search of each variant.
    "smoke": {
        "evaluations": 4,
        "variants": (FULL, "no_relaxation", "shuffled_groups", "no_positions"),
    },
    # With eight, no method that goes group by group has rewards left over.
    "quick": {"search": {"datasets_per_update": 8}, "seeds": 3},
    "paper": {"evaluations": 300},  # the budget of its six groups, 50 updates each
}
"""What differs from the main job, by preset."""


@dataclass(frozen=True, kw_only=True)
class AblationConfig(SearchesConfig):
    """One ablation. Every field is a flag."""

    search: MethodOptions
    evaluations: int = 96
    variants: tuple[Variant, ...] = VARIANTS
    """What is compared; full must be among them."""


def defaults(target: TargetName, preset: Preset) -> AblationConfig:
    """The defaults of ``python -m experiments.ablation``."""
    return presets.defaults(AblationConfig, target, preset, **OWN[preset])


def check(config: AblationConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if config.search.method == "random_attributes":
        raise UserError("--search.method random_attributes searches for nothing")
    refuse_repeats("--variants", config.variants)
    if FULL not in config.variants:
        raise UserError(f"--variants must hold {FULL}, from which losses are measured")
    searches(config)


def without(config: AblationConfig, variant: Variant) -> AblationConfig:
    """The configuration of a variant's search; which attributes it leaves random, `subset_of` says."""
    if variant == "no_relaxation":
        return replace(config, search=replace(config.search, relaxation=0.0))
    if variant == "no_groups":
        return replace(config, groups=(names(config.space),))
    if variant == "shuffled_groups":
        return replace(config, groups=shuffled(config.groups, names(config.space), config.seed))
    return config


def subset_of(variant: Variant, space: SpaceName) -> tuple[str, ...]:
    """The attributes of a space that a variant optimises."""
    return tuple(name for name in names(space) if name not in FIXED.get(variant, ()))


def shuffled(
    groups: Sequence[Sequence[str]], names: Sequence[str], seed: int
) -> tuple[tuple[str, ...], ...]:
    """Groups of the same sizes in the same order, their members dealt at random.

    Args:
        groups: a partition of the names.
        names: in an order that does not depend on the groups.
        seed: of the deal.
    """
    order = np.random.default_rng([SHUFFLE, seed]).permutation(len(names))
    dealt = iter(names[k] for k in order)
    return tuple(tuple(next(dealt) for _ in group) for group in groups)


def searches(config: AblationConfig) -> dict[Variant, SearchPlan]:
    """The search of every variant that has one.

    Raises:
        UserError: evaluations that do not fit its groups, or an option that the method does not take.
    """
    method = config.search.method
    return {
        variant: plans.plan(
            without(config, variant), variant, method, subset_of(variant, config.space)
        )
        for variant in config.variants
        if variant != RANDOM
    }


def plan(config: AblationConfig, _: Any = None) -> list[Work]:
    """Rewards, and the nets of every variant."""
    answers = len(config.variants)
    what = f"nets, {answers} answers x {config.seeds} seeds"
    return [
        *work_of(config, list(searches(config).values())),
        Work.at(what, answers * config.seeds, config.final),
    ]


def scores(run: Run[AblationConfig], _: Any) -> Report:
    """Do the whole ablation, or what is left of it; all searches begin with the same key."""
    config, seeds = run.config, paired_seeds(run)
    found: dict[Variant, Found] = {}

    def lists() -> list[Nets]:
        answers: dict[str, Source] = {
            variant: found[variant].solution if variant in found else random_proposal(config.space)
            for variant in config.variants
            if variant == RANDOM or variant in found
        }
        return [Nets("ablation", answers, run.recipe(config.final))]

    for variant, each in searches(config).items():
        begin(run, lists(), seeds)  # nets on what is found already fill the gaps of this search
        found[variant] = find(run, each)
    (scored,) = score_lists(run, lists(), seeds)
    return {
        **about(run, config.final),
        "method": config.search.method,
        "evaluations": config.evaluations,
        "rewards_at": config.reward.size,
        "rows": [
            {
                "variant": variant,
                "search": _search(config, variant, found[variant]) if variant in found else None,
                "nets": nets(scored[variant]),
            }
            for variant in config.variants
        ],
    }


def _search(config: AblationConfig, variant: Variant, found: Found) -> Report:
    own, subset = without(config, variant), subset_of(variant, config.space)
    intervals = np.round(np.stack(found.solution, axis=-1).astype(float), 6).tolist()
    return {
        "attributes": len(subset),
        "groups": [[name for name in group if name in subset] for group in own.groups],
        "relaxation": own.search.relaxation,
        "rewards": rewards(found),
        "core_seconds": core_seconds(found),
        # Centre and width of every attribute; those left random have 0.5 and 1.
        "solution": dict(zip(names(config.space), intervals, strict=True)),
    }


STUDY = Study(FORM, plan, scores, check)
"""What ``python -m experiments.ablation`` does."""
