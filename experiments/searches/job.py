"""Searches of several methods and seeds, and nets of every answer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from experiments import presets
from experiments.config import FewConfig, Preset, Rederived, SearchConfig, TargetName
from experiments.reward.miou import Source
from experiments.run import few
from experiments.run.context import Run, Work
from experiments.run.ladder import training_cost
from experiments.run.learn import Learnt, learn, plan_of, work_of
from experiments.run.nets import Nets, begin, paired_seeds, score_lists
from experiments.searches.report import BASELINES, FORM, OVER
from experiments.study.form import Report, about, nets
from experiments.study.searches import core_seconds, rewards, selection
from experiments.study.skeleton import Study
from scene.proposal import describe, named
from sdr_jax.registry import MethodName
from shell.errors import UserError, refuse_repeats

OWN: dict[Preset, dict[str, Any]] = {
    "smoke": {"searches": 2, "methods": ("intervals", "random_search")},
    "quick": {"seeds": 3},
    "paper": {"searches": 1, "methods": ("sdr",)},
}
"""What differs from the main job, by preset."""
OWN_ANSWER = "own "
"""Before the name of a search: what its method itself would answer, without model selection."""


@dataclass(frozen=True, kw_only=True)
class ManyConfig(SearchConfig, FewConfig, Rederived):
    """One study. Every field is a flag."""

    searches: int = 5
    """Searches of each method, of seeds --seed, --seed + 1, ..."""
    methods: tuple[MethodName, ...] = ("intervals", "sdr", "random_search")
    """The search methods; all have the same rewards and model selection."""


class Answer(NamedTuple):
    """One search, and what it learnt."""

    method: MethodName
    seed: int
    learnt: Learnt


def defaults(target: TargetName, preset: Preset) -> ManyConfig:
    """The defaults of ``python -m experiments.searches``."""
    return presets.defaults(ManyConfig, target, preset, **OWN[preset])


def check(config: ManyConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if config.searches < 1:
        raise UserError(f"--searches must be 1 or more, not {config.searches}")
    if not config.methods:
        raise UserError("--methods needs at least one of them")
    refuse_repeats("--methods", config.methods)
    if "random_attributes" in config.methods:
        raise UserError("--methods random_attributes searches for nothing: it is the row random")
    for own in searches(config).values():
        plan_of(own)


def searches(config: ManyConfig) -> dict[str, ManyConfig]:
    """The configuration of every search, by its name."""
    return {
        f"{method}-{seed}": replace(config, seed=seed, search=replace(config.search, method=method))
        for seed in range(config.seed, config.seed + config.searches)
        for method in config.methods
    }


def plan(config: ManyConfig, _: Any = None) -> list[Work]:
    """Rewards and candidates of all searches, and the final nets."""
    own = searches(config)
    work = []
    for kind in zip(*(work_of(each) for each in own.values()), strict=True):
        count = sum(each.nets for each in kind)
        work.append(kind[0]._replace(what=f"{kind[0].what}, {len(own)} searches", nets=count))
    rendered = (2 * len(own) + len(OVER)) * config.seeds
    alone = (1 + (config.few is not None)) * config.seeds
    return [
        *work,
        Work.at("nets on rendered images", rendered, config.final),
        Work("nets on labelled images alone", alone, config.final, training_cost(config.final)),
    ]


def scores(run: Run[ManyConfig], _: Any) -> Report:
    """Do all searches, one after the other, and train their nets; or what is left of it."""
    config, seeds = run.config, paired_seeds(run)
    answers: dict[str, Answer] = {}

    def trained() -> Nets:
        streets: dict[str, Source] = {
            name: named(name, config.space, config.default_width) for name in OVER
        }
        for name, answer in answers.items():
            streets |= {
                name: answer.learnt.streets,
                OWN_ANSWER + name: answer.learnt.found.solution,
            }
        sets: dict[str, Source] = dict(streets)
        if config.few is not None:
            beside = few.rows(run, streets, config.final)
            sets = {name.removeprefix(f"{few.FEW}+"): own for name, own in beside.items()}
        sets["real"] = run.truth(config.final, "labelled")
        return Nets("searches", sets, run.recipe(config.final))

    for name, own in searches(config).items():
        begin(run, [trained()], seeds)  # nets on what is found already fill the gaps of this search
        answers[name] = Answer(own.search.method, own.seed, learn(run, own, name))
    final = trained()
    (scored,) = score_lists(run, [final], seeds)
    return {
        **about(run, config.final),
        **few.about(run),
        "rewards_at": config.reward.size,
        "evaluations": plan_of(config).evaluations,
        "space": config.space,
        "baselines": {name: nets(own) for name, own in scored.items() if name in BASELINES},
        "searches": [
            {
                "method": answer.method,
                "seed": answer.seed,
                **selection(answer.learnt),
                "rewards": rewards(answer.learnt.found),
                "core_seconds": core_seconds(answer.learnt.found),
                **describe(answer.learnt.streets),
                "nets": nets(scored[name]),
                "own_nets": nets(scored[OWN_ANSWER + name]),
            }
            for name, answer in answers.items()
        ],
    }


STUDY = Study(FORM, plan, scores, check)
"""What ``python -m experiments.searches`` does."""
