"""The measurement of fidelity: which proposals, scored on which rungs with which seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from experiments import presets
from experiments.cli import Unmet
from experiments.config import Bins, Config, Fidelity, Preset, Rederived, RewardKind, TargetName
from experiments.fidelity.report import ADDED, FORM
from experiments.run.context import REWARD_NAMES, Run, Work
from experiments.run.ladder import fidelities
from experiments.run.nets import score_nets
from experiments.study.bins import random_bins
from experiments.study.form import Report, about
from experiments.study.skeleton import Study, do
from scene.proposal import RELAXATION, Proposal, default_proposal, random_proposal
from shell.errors import UserError

FIDELITY_SEED = 10_000_000
"""Seeds begin here, above those of a run's rows."""
MOST_REPEATS = 1_000_000
"""Seeds of one rung end where those of the next begin."""


@dataclass(frozen=True, kw_only=True)
class FidelityConfig(Config, Rederived):
    """One measurement. Every field is a flag."""

    final: Fidelity
    """The full fidelity, the ladder's top rung."""
    search: Bins
    reward_kind: RewardKind = "miou"
    """miou of a net trained on the dataset; or mmd, a distance of images that needs no labels: it is
    compared with mIoU at the final size, too."""
    default_width: float = RELAXATION
    """Relaxation of the street set by eye, as a share of each range."""
    proposals: int = 24
    """Proposals with random bins for all attributes; the street set by eye and random ones are added."""
    repeated: int = 6
    """Proposals that are scored with several seeds, the two that are added among them."""
    repeats: int = 4
    """Seeds of those."""
    rungs: int | None = None
    """Only the cheapest rungs, so many; by default all of them, up to the final size."""
    require_signal: float | None = None
    """End with exit code 1 where the signal of the cheapest reward, what a search would see, is less than so
    many times its noise. 2 is a good demand to make before a search with a net that may learn nothing."""


def defaults(target: TargetName, preset: Preset) -> FidelityConfig:
    """The defaults of ``python -m experiments.fidelity``."""
    few = {"proposals": 3, "repeated": 2, "repeats": 2} if preset == "smoke" else {}
    return presets.defaults(FidelityConfig, target, preset, **few)


def check(config: FidelityConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if config.proposals < 2:
        raise UserError(f"--proposals must be 2 or more, not {config.proposals}")
    most = config.proposals + len(ADDED)
    if not 2 <= config.repeated <= most:
        raise UserError(
            f"--repeated must be 2 to {most}, the number of proposals, not {config.repeated}"
        )
    if not 2 <= config.repeats <= MOST_REPEATS:
        raise UserError(f"--repeats must be 2 to {MOST_REPEATS}, not {config.repeats}")
    if config.rungs is not None and config.rungs < 1:
        raise UserError(f"--rungs must be 1 or more, not {config.rungs}")
    if config.require_signal is not None and not 0 < config.require_signal < math.inf:
        raise UserError(f"--require-signal must be above 0, not {config.require_signal}")


class Rung(NamedTuple):
    """A reward that is measured."""

    name: str
    fidelity: Fidelity
    kind: RewardKind


def rungs(config: FidelityConfig) -> list[Rung]:
    """Those of the ladder; a reward without labels is compared with mIoU at the final size."""
    kind = config.reward_kind
    steps = fidelities(config.reward, config.final)[: config.rungs]
    found = [Rung(f"rung {k}", fidelity, kind) for k, fidelity in enumerate(steps, 1)]
    if kind != "miou" and config.rungs is None:
        found.append(Rung("final nets", config.final, "miou"))
    return found


def proposals(config: FidelityConfig) -> dict[str, Proposal]:
    """The street set by eye, random attributes, and draws with random bins, by name."""
    added = default_proposal(config.default_width, config.space), random_proposal(config.space)
    drawn = enumerate(random_bins(config, config.proposals), 1)
    return {**dict(zip(ADDED, added, strict=True)), **{f"draw-{k}": own for k, own in drawn}}


def plan(config: FidelityConfig, _: Any = None) -> list[Work]:
    """Every proposal on every rung."""
    nets = config.proposals + len(ADDED) + config.repeated * (config.repeats - 1)
    return [Work.at(rung.name, nets, rung.fidelity) for rung in rungs(config)]


def scores(run: Run[FidelityConfig], _: Any) -> Report:
    """Measure, or do what is left of it."""
    config, chosen, steps = run.config, proposals(run.config), rungs(run.config)
    return {
        **about(run, steps[-1].fidelity),
        "seeds": config.repeats,
        "required_signal": config.require_signal,
        "proposals": len(chosen),
        "repeated": config.repeated,
        "rungs": [_score(run, number, rung, chosen) for number, rung in enumerate(steps)],
    }


def _score(
    run: Run[FidelityConfig], number: int, rung: Rung, chosen: dict[str, Proposal]
) -> Report:
    """Every proposal on one rung, in the order of the seeds, which all proposals share."""
    (name, fidelity, kind), config = rung, run.config
    # Other seeds on each rung: else its noise would be another's, too, and pass for agreement.
    first = FIDELITY_SEED + MOST_REPEATS * number + config.seed
    seeds = range(first, first + config.repeats)
    once = list(chosen)[config.repeated :]
    recipe = run.recipe(fidelity)
    found = score_nets(run, name, chosen, recipe, seeds, side="reward", kind=kind, once=once)
    unit = 100 if kind == "miou" else 1
    return {
        "rung": name,
        "reward": REWARD_NAMES[kind],
        "size": fidelity.size,
        "images": fidelity.images,
        "steps": fidelity.train.steps if kind == "miou" else None,
        "rewards": {
            name: [None if o.failed else unit * o.reward for o in outcomes]
            for name, outcomes in found.items()
        },
        "core_seconds": float(np.median([o.seconds for own in found.values() for o in own])),
    }


STUDY = Study(FORM, plan, scores, check)


def measure(config: FidelityConfig) -> Report:
    """Do the whole study.

    Raises:
        UserError, DataError, WorkerError: as `do` does.
        Unmet: the signal is smaller than ``--require-signal`` demands.
    """
    report = do(STUDY, config)
    if report["fit"] is False:
        first, times = report["rungs"][0], f"{report['required_signal']:g}"
        found = first["signal_to_noise"]["value"]
        known = "not known" if found is None else f"{found:.2f} times its noise"
        raise Unmet(f"--require-signal {times}: the signal of {first['rung']} is {known}")
    return report
