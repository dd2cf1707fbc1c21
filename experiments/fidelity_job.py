"""The measurement of fidelity: which proposals, scored on which rungs with which seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import jax
import numpy as np

import sdr_jax
from experiments import config as run_config
from experiments import fidelity_report
from experiments.config import Config, camvid_config, cityscapes_config
from experiments.errors import UserError
from experiments.evaluator import Evaluator, Job
from experiments.fidelity_report import Level
from experiments.finals import default_proposal, draw_units, random_proposal
from experiments.folder import RunFolder, refuse_foreign
from experiments.ladder import cost_of, ladder
from experiments.main import main_on_target
from experiments.mmd_reward import FeatureNet, Reference, evaluate_mmd, feature_net
from experiments.outcome import Outcome
from experiments.progress import Progress
from experiments.reward import REWARD_NAMES, Truth, evaluate, in_words, worker_environment
from experiments.search import make_space
from experiments.store import FILE, Store
from experiments.targets import Target, named_target
from scene.command import duration
from scene.render import RendererError, renderer
from scene.workers import WorkerPool

FIDELITY_SEED = 10_000_000
"""Seeds begin here, above those of runs and their ladders."""
MOST_REPEATS = 1_000_000
"""Seeds of one rung end where those of the next begin."""


@dataclass(frozen=True, kw_only=True)
class FidelityConfig(Config):
    """One measurement. Every field is a flag.

    What belongs to a search (--search.method and its updates, --candidates, --ladder, --seeds) has no
    effect here.
    """

    target: Literal["twin", "camvid", "cityscapes"] = "twin"
    """What the nets must be good on."""
    proposals: int = 24
    """Proposals with random bins for all attributes; the street set by eye and random ones are added."""
    repeated: int = 6
    """Proposals that are scored with several seeds, the two that are added among them."""
    repeats: int = 4
    """Seeds of those."""


def fidelity_config(target: str, preset: str) -> FidelityConfig:
    """The defaults of ``python -m experiments.fidelity``."""
    base = (camvid_config if target == "camvid" else cityscapes_config)(preset)
    inherited = {field.name: getattr(base, field.name) for field in fields(base)}
    config = FidelityConfig(**{**inherited, "target": target})
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
    """Every rung of the ladder; a reward without labels is compared with mIoU at the final size."""
    kind = config.reward_kind
    rungs = ladder(config)
    found = [Level(f"rung {k + 1}", rung.stage, kind) for k, rung in enumerate(rungs)]
    if kind != "miou":
        found.append(Level("final nets", config.final, "miou"))
    return found


def run(config: FidelityConfig) -> dict[str, Any]:
    """Measure, or do what is left of it, and return what ``fidelity.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    try:
        renderer(config.renderer)
    except RendererError as error:
        raise UserError(str(error)) from None
    chosen, rungs = proposals(config), levels(config)
    names = list(chosen)
    repeated = names[: config.repeated]
    nets = len(names) + len(repeated) * (config.repeats - 1)
    with WorkerPool(config.workers, worker_environment()) as workers:
        target = named_target(config.target, config, workers)
        refuse_foreign(config, target.name)
        store = Store(config.store or config.out / FILE)
        print(f"Target: {target.title}", flush=True)
        target.at(config.reward.height, config.reward.width)
        folder = RunFolder(config, target.name)
        try:
            progress = Progress(
                nets * sum(cost_of(level.stage) for level in rungs),
                label="" if target.real else "twin, not real | ",
            )
            progress.say(
                f"Folder: {config.out} | {nets} evaluations on each of {len(rungs)} rungs; "
                f"{store.path} holds {len(store)}"
            )
            net = None
            if config.reward_kind == "mmd":
                net = feature_net(config, target.table, config.out, workers)
            outcomes = [
                _score(
                    config, target, number, level, chosen, repeated, net, workers, store, progress
                )
                for number, level in enumerate(rungs)
            ]
            report = fidelity_report.summarize(
                target, config.preset, rungs, names, names[2:], repeated, outcomes
            )
            fidelity_report.write(report, config.out)
            progress.say(fidelity_report.text(report))
            progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'fidelity.md'}")
            return report
        finally:
            folder.close()


def _score(
    config: FidelityConfig,
    target: Target,
    number: int,
    level: Level,
    chosen: dict[str, sdr_jax.Proposal],
    repeated: Sequence[str],
    net: FeatureNet | None,
    workers: WorkerPool,
    store: Store,
    progress: Progress,
) -> dict[str, list[Outcome]]:
    """Every proposal on one level, in the order of the seeds, which all proposals share."""
    stage = level.stage
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
    jobs = [
        Job(chosen[name], draw_units(chosen[name], seed, stage.streets), seed)
        for name, seed in wanted
    ]
    own = replace(config, reward_kind=level.kind)
    evaluator = Evaluator(own, stage, target, "reward", truth, workers, store)
    outcomes: dict[tuple[str, int], Outcome] = {}
    for index, outcome in evaluator.map(scoring, jobs):
        outcomes[wanted[index]] = outcome
        progress.advance(cost_of(stage), replayed=outcome.stored)
        if not outcome.stored:
            value = "failed" if outcome.failed else in_words(level.kind, outcome.reward)
            progress.update(
                f"{level.name}: {wanted[index][0]} | {REWARD_NAMES[level.kind]} {value}"
            )
    return {name: [outcomes[key] for key in wanted if key[0] == name] for name in chosen}


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_on_target("fidelity", fidelity_config, run, description, arguments)
