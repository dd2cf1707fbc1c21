"""The variants of the ablation: what each search leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from experiments import compare_config
from experiments.compare_config import CompareConfig, Plan
from experiments.config import DENSITIES, ENVIRONMENT, POSITIONS, Config, refuse_repeats
from experiments.errors import UserError
from experiments.study_config import StudyConfig, check_study, defaults_on
from scene.attributes import NAMES

FULL = "full"
"""The whole method, from which losses are measured."""
RANDOM = "random"
"""All attributes random: what no search at all is worth."""
FIXED = {
    "no_environment": ENVIRONMENT,
    "no_positions": POSITIONS,
    "no_densities": DENSITIES,
}
"""Variants that leave some attributes random, and which."""
VARIANTS = (FULL, "no_relaxation", "no_groups", "shuffled_groups", *FIXED, RANDOM)
SMOKE = (FULL, "no_relaxation", "shuffled_groups", "no_positions")
"""One of each kind."""
SHUFFLE = 2020
"""Goes into the seed of the shuffled groups."""


@dataclass(frozen=True, kw_only=True)
class AblationConfig(StudyConfig):
    """One ablation. Every field is a flag.

    What chooses a relaxation (--candidates) and --search.updates-per-group have no effect here.
    """

    variants: tuple[str, ...] = VARIANTS
    """What is compared; full must be among them."""
    evaluations: int = 96
    """Rewards that the search of each variant may ask for."""


def ablation_config(target: str, preset: str) -> AblationConfig:
    """The defaults of ``python -m experiments.ablation``."""
    config = defaults_on(AblationConfig, target, preset)
    if preset == "smoke":  # most of its time goes into compiling the search of each variant
        return replace(config, evaluations=4, variants=SMOKE)
    if preset == "paper":  # the budget of its six groups, 50 updates each
        return replace(config, evaluations=300)
    # With eight, no method that goes group by group has rewards left over.
    search = replace(config.search, datasets_per_update=8)
    return replace(config, search=search, seeds=3)


def check(config: AblationConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    check_study(config)
    if config.reward_kind != "miou":
        raise UserError("--reward-kind: the ablation knows miou only")
    if config.learnt is not None:
        raise UserError("--learnt has no use here: every variant searches by itself")
    if config.search.method == "random_attributes":
        raise UserError("--search.method random_attributes searches for nothing")
    for name in config.variants:
        if name not in VARIANTS:
            raise UserError(f"--variants {name!r} is unknown; known: {', '.join(VARIANTS)}")
    refuse_repeats("--variants", config.variants)
    if FULL not in config.variants:
        raise UserError(f"--variants must hold {FULL}, from which losses are measured")
    for name in searched(config):
        plan(config, name)


def searched(config: AblationConfig) -> list[str]:
    """The variants that search."""
    return [name for name in config.variants if name != RANDOM]


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


def comparison(config: AblationConfig, variant: str) -> CompareConfig:
    """The search of a variant, as a comparison of one method on one subset."""
    inherited = {field.name: getattr(config, field.name) for field in fields(Config)}
    left_out = FIXED.get(variant, ())
    subset = tuple(name for name in NAMES if name not in left_out)
    made = CompareConfig(
        **inherited,
        target=config.target,
        methods=(config.search.method,),
        subsets=(subset,),
        evaluations=config.evaluations,
    )
    if variant == "no_relaxation":
        return replace(made, search=replace(config.search, relaxation=0.0))
    if variant == "no_groups":
        return replace(made, groups=(NAMES,))
    if variant == "shuffled_groups":
        return replace(made, groups=shuffled(config.groups, NAMES, config.seed))
    return made


def plan(config: AblationConfig, variant: str) -> Plan:
    """How a variant searches.

    Raises:
        UserError: evaluations that do not fit its groups, or an option that the method does not take.
    """
    (made,) = compare_config.plans(compare_config.check(comparison(config, variant)))
    return made
