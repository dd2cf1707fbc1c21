"""The comparison: every method's search on every subset, then nets of what they found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from experiments import presets
from experiments.compare.report import FORM, RANDOM
from experiments.config import Fidelity, Group, Preset, SearchesConfig, TargetName
from experiments.presets import POSITIONS
from experiments.reward.miou import Source
from experiments.run import plans
from experiments.run.context import Run, Work
from experiments.run.ladder import fidelities
from experiments.run.nets import Nets, begin, paired_seeds, score_lists
from experiments.run.pooled import affordable, find, work_of
from experiments.run.search import Found, SearchPlan
from experiments.study.form import Report, about, miou, nets
from experiments.study.searches import core_seconds, rewards
from experiments.study.skeleton import Study
from scene.attributes import names
from scene.proposal import random_proposal
from sdr_jax.registry import MethodName
from shell.errors import UserError, refuse_repeats

ALL = "all"
"""In place of a subset: all 23 attributes."""
OWN: dict[Preset, dict[str, Any]] = {
    "smoke": {"evaluations": 4, "subsets": (POSITIONS[:2], POSITIONS[:3])},
    "quick": {"search": {"datasets_per_update": 8}, "seeds": 3},
    "paper": {"evaluations": 300},  # the budget of its six groups, 50 updates each
}
"""What differs from the main job, by preset."""


@dataclass(frozen=True, kw_only=True)
class CompareConfig(SearchesConfig):
    """One comparison. Every field is a flag."""

    evaluations: int = 48
    core_minutes: float | None = None
    """In place of --evaluations: as many rewards for each search as cost so many minutes of a core, about."""
    methods: tuple[MethodName, ...] = (
        RANDOM, "random_search", "attribute_descent", "sdr", "surrogate",
    )  # fmt: skip
    """The search methods."""
    subsets: tuple[Group, ...] = tuple(POSITIONS[:count] for count in (3, 5, 7))
    """Attributes that are optimised, one word a subset, or the word all; the others stay random."""
    finals: bool = True
    """Train the final nets; without them only the rewards are recorded."""
    cheap_finals: bool = True
    """Also train nets at the reward's size and at one between: does the gain outlive the cheap budget?"""


class Row(NamedTuple):
    """A method on a subset."""

    method: MethodName
    subset: tuple[str, ...]
    title: str  # the subset in one word
    name: str  # such as "sdr, 3 attributes"; no two rows share one


def defaults(target: TargetName, preset: Preset) -> CompareConfig:
    """The defaults of ``python -m experiments.compare``."""
    return presets.defaults(CompareConfig, target, preset, **OWN[preset])


def check(config: CompareConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    for name in ("methods", "subsets"):
        if not getattr(config, name):
            raise UserError(f"--{name} needs at least one of them")
    refuse_repeats("--methods", config.methods)
    if config.core_minutes is not None and not config.core_minutes > 0:
        raise UserError(f"--core-minutes must be positive, not {config.core_minutes:g}")
    known = names(config.space)
    for subset in subsets_of(config):
        for name in subset:
            if name not in known:
                raise UserError(
                    f"--subsets: attribute {name!r} is unknown; known: {ALL}, {', '.join(known)}"
                )
        refuse_repeats("--subsets", subset)
    refuse_repeats("--subsets", [",".join(sorted(subset)) for subset in subsets_of(config)])
    searches(config)


def subsets_of(config: CompareConfig) -> list[tuple[str, ...]]:
    """The subsets, with the word ``all`` spelt out."""
    return [names(config.space) if subset == (ALL,) else subset for subset in config.subsets]


def rows(config: CompareConfig) -> list[Row]:
    """Methods and subsets, in the order of the table."""
    subsets = subsets_of(config)
    sizes = [len(subset) for subset in subsets]
    found = []
    for subset in subsets:
        alone = sizes.count(len(subset)) == 1
        words = f"{len(subset)} attributes" if alone else ",".join(subset)
        title = ALL if set(subset) == set(names(config.space)) else ",".join(subset)
        found += [Row(method, subset, title, f"{method}, {words}") for method in config.methods]
    return found


def searches(config: CompareConfig) -> list[SearchPlan]:
    """Every search that has to be run.

    Raises:
        UserError: too few evaluations, or an option that a method does not take.
    """
    found = []
    for row in rows(config):
        if row.method == RANDOM:
            continue
        own = config
        if config.core_minutes is not None:
            count = affordable(config, row.method, config.core_minutes)
            if not count:
                raise UserError(
                    f"--core-minutes {config.core_minutes:g} are too few for one update of {row.method}"
                )
            own = replace(config, evaluations=count)
        found.append(plans.plan(own, row.name, row.method, row.subset))
    return found


def budgets(config: CompareConfig) -> tuple[Fidelity, ...]:
    """The fidelities at which answers are scored on the test images, the final one last."""
    if not config.finals:
        return ()
    return fidelities(config.reward, config.final) if config.cheap_finals else (config.final,)


def words(fidelity: Fidelity) -> str:
    """A fidelity in a few words."""
    return f"{fidelity.size}, {fidelity.images} images, {fidelity.train.steps} steps"


def plan(config: CompareConfig, _: Any = None) -> list[Work]:
    """Rewards, and nets at every budget."""
    answers = len(rows(config))
    return work_of(config, searches(config)) + [
        Work.at(f"nets, {answers} answers x {config.seeds} seeds", answers * config.seeds, fidelity)
        for fidelity in budgets(config)
    ]


def scores(run: Run[CompareConfig], _: Any) -> Report:
    """Do the whole comparison, or what is left of it."""
    config, seeds = run.config, paired_seeds(run)
    found: dict[str, Found] = {}

    def lists() -> list[Nets]:
        answers: dict[str, Source] = {
            row.name: found[row.name].answers.get("last", found[row.name].solution)
            if row.name in found
            else random_proposal(config.space)
            for row in rows(config)
            if row.method == RANDOM or row.name in found
        }
        return [Nets(words(at), answers, run.recipe(at)) for at in budgets(config)]

    for each in searches(config):
        begin(run, lists(), seeds)  # nets on what is found already fill the gaps of this search
        found[each.name] = find(run, each)
    scored = score_lists(run, lists(), seeds)
    workers = max(run.workers.workers, 1)
    return {
        **about(run, config.final),
        "evaluations": config.evaluations if config.core_minutes is None else None,
        "core_minutes": config.core_minutes,
        "workers": workers,
        "rewards_at": config.reward.size,
        "seeds": config.seeds if config.finals else 0,
        "budgets": [words(fidelity) for fidelity in budgets(config)],
        "rows": [
            {
                "attributes": len(row.subset),
                "subset": row.title,
                "method": row.method,
                "search": _search(config, found[row.name], row, workers)
                if row.name in found
                else None,
                "budgets": [{"miou": miou(nets(at[row.name]))} for at in scored],
            }
            for row in rows(config)
        ],
    }


def _search(config: CompareConfig, found: Found, row: Row, workers: int) -> Report:
    core = core_seconds(found)
    cpu, wall = round(found.cpu_seconds, 2), round(found.wall_seconds, 2)
    pairs = zip(names(config.space), *(part.tolist() for part in found.solution), strict=True)
    intervals = {
        name: {"centre": round(centre, 6), "width": round(width, 6)}
        for name, centre, width in pairs
    }
    return {
        "rewards": rewards(found),
        "reward_seconds": {"core": core, "wall": round(core / workers, 2)},
        "method_seconds": {"cpu": cpu, "wall": wall},
        "solution": {name: intervals[name] for name in row.subset},
    }


STUDY = Study(FORM, plan, scores, check)
"""What ``python -m experiments.compare`` does."""
