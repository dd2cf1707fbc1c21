"""The measurement of fidelity: which proposals, scored on which rungs with which seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

import sdr_jax
from experiments import config as run_config
from experiments import fidelity_report
from experiments.errors import UserError
from experiments.evaluator import Evaluator
from experiments.fidelity_report import Level
from experiments.finals import default_proposal, random_proposal
from experiments.ladder import cost_of, ladder
from experiments.main import main_on_target
from experiments.mmd_reward import FeatureNet, Reference, evaluate_mmd, feature_net
from experiments.outcome import Outcome
from experiments.progress import Progress
from experiments.reward import REWARD_NAMES, Truth, evaluate, in_words
from experiments.search import make_space
from experiments.study import Study, opened
from experiments.study_config import TargetConfig, defaults_on
from experiments.study_nets import score_proposals
from scene.command import duration

FIDELITY_SEED = 10_000_000
"""Seeds begin here, above those of runs and their ladders."""
MOST_REPEATS = 1_000_000
"""Seeds of one rung end where those of the next begin."""


@dataclass(frozen=True, kw_only=True)
class FidelityConfig(TargetConfig):
    """One measurement. Every field is a flag.

    What belongs to a search (--search.method and its updates, --candidates, --ladder, --seeds) has no
    effect here.
    """

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


def fidelity_config(target: str, preset: str) -> FidelityConfig:
    """The defaults of ``python -m experiments.fidelity``."""
    config = defaults_on(FidelityConfig, target, preset)
    if preset == "smoke":
        return replace(config, proposals=3, repeated=2, repeats=2)
    return config


def check(config: FidelityConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    run_config.check(config)
    if config.unlabelled is not None:
        raise UserError("--unlabelled: rewards are compared with mIoU here, which needs labels")
    if config.proposals < 2:
        raise UserError(f"--proposals must be 2 or more, not {config.proposals}")
    if not 2 <= config.repeated <= config.proposals + 2:
        raise UserError(
            f"--repeated must be 2 to {config.proposals + 2}, the number of proposals, "
            f"not {config.repeated}"
        )
    if not 2 <= config.repeats <= MOST_REPEATS:
        raise UserError(f"--repeats must be 2 to {MOST_REPEATS}, not {config.repeats}")
    if config.rungs is not None and config.rungs < 1:
        raise UserError(f"--rungs must be 1 or more, not {config.rungs}")
    if config.require_signal is not None and not config.require_signal > 0:
        raise UserError(f"--require-signal must be above 0, not {config.require_signal}")
    width = config.search.relaxation
    if width is not None and not 0 <= width <= 1:
        raise UserError(f"--search.relaxation must lie in [0, 1], not {width}")


def proposals(config: FidelityConfig) -> dict[str, sdr_jax.Proposal]:
    """The street set by eye, random attributes, and draws with random bins, by name."""
    space, bins = make_space(config), config.search.bins
    rng = np.random.default_rng(config.seed)
    actions = rng.integers(0, bins, (config.proposals, space.attributes))
    relaxed = jax.device_get(sdr_jax.relax(space, actions, config.search.relaxation))
    drawn = {
        f"draw-{k + 1}": sdr_jax.Proposal(*pair)
        for k, pair in enumerate(zip(*relaxed, strict=True))
    }
    return {
        "default": default_proposal(config.default_width),
        "random": random_proposal(),
        **drawn,
    }


def levels(config: FidelityConfig) -> list[Level]:
    """The rungs of the ladder; a reward without labels is compared with mIoU at the final size."""
    kind = config.reward_kind
    rungs = ladder(config)[: config.rungs]
    found = [Level(f"rung {k + 1}", rung.stage, kind) for k, rung in enumerate(rungs)]
    if kind != "miou" and config.rungs is None:
        found.append(Level("final nets", config.final, "miou"))
    return found


def run(config: FidelityConfig) -> dict[str, Any]:
    """Measure, or do what is left of it, and return what ``fidelity.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    chosen, rungs = proposals(config), levels(config)
    names = list(chosen)
    repeated = names[: config.repeated]
    nets = len(names) + len(repeated) * (config.repeats - 1)
    with opened(config) as study:
        progress = study.progress(nets * sum(cost_of(level.stage) for level in rungs))
        progress.say(
            f"Folder: {config.out} | {nets} evaluations on each of {len(rungs)} rungs; "
            f"{study.store.path} holds {len(study.store)}"
        )
        net = None
        if config.reward_kind == "mmd":
            net = feature_net(config, study.target.table, config.out, study.workers)
        outcomes = [
            _score(study, number, level, chosen, repeated, net, progress)
            for number, level in enumerate(rungs)
        ]
        report = fidelity_report.summarize(
            study.target,
            config.preset,
            rungs,
            names,
            names[2:],
            repeated,
            outcomes,
            config.require_signal,
        )
        fidelity_report.write(report, config.out)
        progress.say(fidelity_report.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'fidelity.md'}")
        return report


def _score(
    study: Study[FidelityConfig],
    number: int,
    level: Level,
    chosen: dict[str, sdr_jax.Proposal],
    repeated: Sequence[str],
    net: FeatureNet | None,
    progress: Progress,
) -> dict[str, list[Outcome]]:
    """Every proposal on one level, in the order of the seeds, which all proposals share."""
    config, target, stage = study.config, study.target, level.stage
    images = target.at(stage.height, stage.width).reward
    truth: Truth | Reference
    if level.kind == "mmd" and net is not None:
        truth = net.reference(images.images)
    else:
        truth = Truth(images.images, images.labels)
    scoring = evaluate if isinstance(truth, Truth) else evaluate_mmd
    # Other seeds on each rung: else its noise would be another's, too, and pass for agreement.
    first = FIDELITY_SEED + MOST_REPEATS * number + config.seed
    wanted = [
        (name, first + k)
        for name in chosen
        for k in range(config.repeats if name in repeated else 1)
    ]
    own = replace(config, reward_kind=level.kind)
    evaluator = Evaluator(own, stage, target, "reward", truth, study.workers, study.store)

    def say(index: int, outcome: Outcome) -> str:
        value = "failed" if outcome.failed else in_words(level.kind, outcome.reward)
        return f"{level.name}: {wanted[index][0]} | {REWARD_NAMES[level.kind]} {value}"

    jobs = [(chosen[name], seed) for name, seed in wanted]
    outcomes = score_proposals(evaluator, scoring, jobs, stage, progress, say)
    return {
        name: [o for o, (own_name, _) in zip(outcomes, wanted, strict=True) if own_name == name]
        for name in chosen
    }


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code, 1 for too little signal."""
    fit = True

    def measure(config: FidelityConfig) -> None:
        nonlocal fit
        fit = run(config)["fit"] is not False

    code = main_on_target("fidelity", fidelity_config, measure, description, arguments)
    return code if fit else 1
