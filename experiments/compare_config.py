"""Which methods are compared on which attributes, and with how many evaluations each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_args, get_type_hints

import sdr_jax
from experiments import config as run_config
from experiments.config import POSITIONS, Group, Search, Stage, refuse_repeats
from experiments.errors import UserError
from experiments.ladder import ladder
from experiments.search import make_method, make_space
from experiments.study_config import TargetConfig, defaults_on
from scene.attributes import NAMES

RANDOM = "random_attributes"
"""The row that gains are measured from; it asks for no evaluation."""
KNOWN = tuple(dict.fromkeys((RANDOM, *get_args(get_type_hints(Search)["method"]))))
"""Every method that can be compared."""
METHODS = (RANDOM, "random_search", "attribute_descent", "sdr", "actor_critic")
"""Those that are compared by default."""
ALL = "all"
"""In place of a subset: all 23 attributes."""
SUBSETS = tuple(POSITIONS[:count] for count in (3, 5, 7))
"""The paper's: the first positions."""


@dataclass(frozen=True, kw_only=True)
class CompareConfig(TargetConfig):
    """One comparison. Every field is a flag.

    What chooses a relaxation (--candidates), --search.method and --search.updates-per-group have no
    effect here.
    """

    methods: tuple[str, ...] = METHODS
    """The search methods."""
    subsets: tuple[Group, ...] = SUBSETS
    """Attributes that are optimised, one word a subset, or the word all; the others stay random."""
    evaluations: int = 48
    """Rewards that each method may ask for, on each subset."""
    finals: bool = True
    """Train the final nets; without them only the rewards are recorded."""
    cheap_finals: bool = True
    """Also train nets at the reward's size and at one between: does the gain outlive the cheap budget?"""


class Plan(NamedTuple):
    """One method on one subset."""

    method: str
    subset: tuple[str, ...]
    search: sdr_jax.Method
    datasets: int  # per update
    updates: int


def compare_config(target: str, preset: str) -> CompareConfig:
    """The defaults of ``python -m experiments.compare``."""
    config = defaults_on(CompareConfig, target, preset)
    if preset == "smoke":
        return replace(config, evaluations=4, subsets=(POSITIONS[:2], POSITIONS[:3]))
    if preset == "paper":  # the budget of its six groups, 50 updates each
        return replace(config, evaluations=300)
    search = replace(config.search, datasets_per_update=8)
    return replace(config, search=search, seeds=3)


def subset_title(subset: Sequence[str]) -> str:
    """A subset in one word."""
    return ALL if set(subset) == set(NAMES) else ",".join(subset)


def check(config: CompareConfig) -> CompareConfig:
    """The configuration itself, with the word ``all`` spelt out.

    Raises:
        UserError: a field out of range, by name.
    """
    run_config.check(config)
    make_space(config)
    if not config.methods:
        raise UserError("--methods needs at least one method")
    for name in config.methods:
        if name not in KNOWN:
            raise UserError(f"--methods {name!r} is unknown; known: {', '.join(KNOWN)}")
    refuse_repeats("--methods", config.methods)
    subsets = tuple(NAMES if subset == (ALL,) else subset for subset in config.subsets)
    if not subsets:
        raise UserError("--subsets needs at least one subset")
    for subset in subsets:
        for name in subset:
            if name not in NAMES:
                raise UserError(
                    f"--subsets: attribute {name!r} is unknown; known: {', '.join(NAMES)}"
                )
        if len(set(subset)) < len(subset):
            raise UserError(f"--subsets {','.join(subset)} names an attribute twice")
    if len({frozenset(subset) for subset in subsets}) < len(subsets):
        raise UserError("--subsets names a subset twice")
    n = config.search.datasets_per_update
    if config.evaluations < n or config.evaluations % n:
        raise UserError(
            f"--evaluations must be a multiple of --search.datasets-per-update {n}, "
            f"not {config.evaluations}"
        )
    return replace(config, subsets=subsets)


def budgets(config: CompareConfig) -> list[Stage]:
    """The stages at which answers are scored on the test images, the final one last."""
    if not config.finals:
        return []
    return [rung.stage for rung in ladder(config)] if config.cheap_finals else [config.final]


def plans(config: CompareConfig) -> list[Plan]:
    """Every search that has to be run, subset by subset.

    Raises:
        UserError: too few evaluations, or an option that a method does not take.
    """
    return [
        plan(config, method, subset)
        for subset in config.subsets
        for method in config.methods
        if method != RANDOM
    ]


def plan(config: CompareConfig, method: Any, subset: tuple[str, ...]) -> Plan:
    """One method on one subset, with updates that take the evaluations and no more."""
    groups = [[name for name in group if name in subset] for group in config.groups]
    space = sdr_jax.space(subset, config.search.bins, [group for group in groups if group])
    n, each = schedule(config.evaluations, len(space.groups), config.search.datasets_per_update)
    search = replace(config.search, method=method, updates_per_group=max(each, 1))
    try:
        made = make_method(search, space)
    except ImportError as error:
        raise UserError(f"--methods {method}: {error}") from None
    if made.updates is None:  # it takes as many as there are
        n = config.search.datasets_per_update
    elif each == 0:
        raise UserError(
            f"--evaluations {config.evaluations} are too few for {method} on "
            f"{subset_title(subset)}: {len(space.groups)} groups of at least {n} datasets"
        )
    return Plan(method, subset, made, n, config.evaluations // n)


def schedule(evaluations: int, groups: int, datasets: int) -> tuple[int, int]:
    """Datasets per update, and updates for each group, of a method that goes group by group.

    The most datasets, up to those wanted, with which all groups get the same share of the evaluations
    and nothing is left. Where no number does that, what is left tries the answer.
    """
    for n in range(datasets, min(datasets, 2) - 1, -1):
        if evaluations % (groups * n) == 0:
            return n, evaluations // (groups * n)
    return datasets, evaluations // datasets // groups
