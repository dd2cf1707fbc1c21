"""The reported figures: candidates re-scored at full size, then every row with several paired seeds.

The cheap reward favours what is easy to learn, so the answer's relaxation is chosen at the final size,
still on the reward images; only the chosen one ever meets the test images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

import sdr_jax
from experiments.config import Config, Stage
from experiments.evaluator import Evaluator, Job, Side
from experiments.folder import RunFolder
from experiments.ladder import climb, cost_of, ladder, most_cost
from experiments.mmd_reward import FeatureNet, Reference, evaluate_mmd
from experiments.outcome import Outcome
from experiments.progress import Progress
from experiments.reward import (
    REWARD_NAMES,
    Evaluation,
    Truth,
    evaluate,
    evaluate_real,
    in_words,
)
from experiments.search import SearchResult
from experiments.store import Store
from experiments.targets import Split, Target
from scene.attributes import NAMES, default_unit
from scene.workers import WorkerPool
from sdr_jax.space import slide
from seg.train import TrainingError

BROAD = 0.5
"""Least width of the broad candidate's intervals."""
TRAINED_ON = {
    "random": "random attributes",
    "default": "attributes set by eye",
    "learnt": "learnt attributes",
    "real": "the reward images themselves",
}
"""What the nets of each row of the result were trained on."""
ROWS = tuple(TRAINED_ON)
"""Those of a target whose reward images have labels; without them none can be trained on."""
CANDIDATE_SEED = 1_000_000
"""Candidates are scored with seeds that no row of the result uses."""


def rows_of(target: Target) -> tuple[str, ...]:
    """The rows of a target's result."""
    return ROWS if target.labelled else tuple(row for row in ROWS if row != "real")


def random_proposal() -> sdr_jax.Proposal:
    """Every attribute anywhere in its range."""
    return _slid(np.full(len(NAMES), 0.5, np.float32), 1.0)


def default_proposal(width: float) -> sdr_jax.Proposal:
    """The street set by eye, relaxed."""
    return _slid(default_unit(), width)


def candidate_proposal(name: str, result: SearchResult) -> sdr_jax.Proposal:
    """One way to relax what the search learnt."""
    if name == "argmax":
        return result.argmax
    if name == "random":
        return random_proposal()
    if name == "broad":
        return _slid(np.asarray(result.spread.centre), np.maximum(result.spread.width, BROAD))
    return result.spread


def _distinct(proposals: Mapping[str, sdr_jax.Proposal]) -> dict[str, sdr_jax.Proposal]:
    """Proposals without those that equal an earlier one: twins would hold two places on the ladder."""
    values = {name: np.stack(proposal) for name, proposal in proposals.items()}
    names = list(values)
    return {
        name: proposals[name]
        for k, name in enumerate(names)
        if not any(np.array_equal(values[name], values[other]) for other in names[:k])
    }


def _slid(centre: np.ndarray, width: float | np.ndarray) -> sdr_jax.Proposal:
    widths = np.broadcast_to(np.asarray(width, np.float32), centre.shape)
    return jax.tree.map(np.asarray, slide(centre, widths))


def draw_units(proposal: sdr_jax.Proposal, seed: int, streets: int) -> np.ndarray:
    """Attributes f32[streets, 23]; with the same seed, all proposals share their random numbers."""
    return np.asarray(sdr_jax.draw(jax.random.key(seed), proposal, streets))


class Finals:
    """Scores nets at the final size, each once, remembering them in the run folder."""

    def __init__(
        self,
        config: Config,
        target: Target,
        split: Split,
        folder: RunFolder,
        workers: WorkerPool,
        progress: Progress,
        cost: float,
        store: Store | None = None,
        net: FeatureNet | None = None,
    ) -> None:
        self._net = net  # with it candidates are scored as the search was, without labels
        self._config, self._target, self._split = config, target, split
        self._folder, self._workers, self._progress = folder, workers, progress
        self._cost, self._store = cost, store
        self._size = (config.final.height, config.final.width)

    def candidates(self, result: SearchResult) -> tuple[str, dict[str, list[float]]]:
        """The best relaxation of the learnt answer, and every candidate's reward by seed.

        Rewards are mIoU in [0, 1], or as ``--reward-kind`` has it; finals.jsonl calls both miou.
        """
        config = self._config
        proposals = {name: candidate_proposal(name, result) for name in config.candidates}
        seeds = [CANDIDATE_SEED + config.seed + k for k in range(config.candidate_seeds)]
        if config.ladder:
            return self._climb(proposals)
        records = self._score("candidate", proposals, seeds, "reward")
        scores = {
            name: [records[name, seed]["miou"] for seed in seeds] for name in config.candidates
        }
        return max(config.candidates, key=lambda name: float(np.mean(scores[name]))), scores

    def _climb(
        self, proposals: Mapping[str, sdr_jax.Proposal]
    ) -> tuple[str, dict[str, list[float]]]:
        """The best candidate, and the mIoU of those that reach the top of the ladder."""
        rungs = ladder(self._config)
        planned = len(proposals)
        proposals = _distinct(proposals)
        left = self._units(most_cost(planned, rungs))

        def score(
            number: int, names: Sequence[str], seeds: Sequence[int]
        ) -> dict[str, list[float]]:
            nonlocal left
            chosen, stage = {name: proposals[name] for name in names}, rungs[number].stage
            records = self._score(f"rung-{number + 1}", chosen, seeds, "reward", stage)
            left -= self._units(len(names) * len(seeds) * cost_of(stage))
            return {name: [records[name, seed]["miou"] for seed in seeds] for name in names}

        found = climb(tuple(proposals), rungs, score)
        self._progress.advance(left, replayed=True)  # nets of those that left early
        return found

    def _units(self, cost: float) -> float:
        """A cost in the progress's units."""
        return self._cost * cost / cost_of(self._config.final)

    def rows(self, learnt: sdr_jax.Proposal) -> dict[str, list[dict[str, Any]]]:
        """Every row of the result, scored on the test images: records in the order of the seeds."""
        config = self._config
        proposals: dict[str, sdr_jax.Proposal | None] = {
            "random": random_proposal(),
            "default": default_proposal(config.default_width),
            "learnt": learnt,
            "real": None,
        }
        rows = rows_of(self._target)
        seeds = [config.seed + k for k in range(config.seeds)]
        records = self._score("final", {row: proposals[row] for row in rows}, seeds, "test")
        return {row: [records[row, seed] for seed in seeds] for row in rows}

    def _score(
        self,
        kind: str,
        proposals: Mapping[str, sdr_jax.Proposal | None],
        seeds: Sequence[int],
        side: Side,
        stage: Stage | None = None,
    ) -> dict[tuple[str, int], dict[str, Any]]:
        config, target = self._config, self._target
        stage = stage or config.final
        size = (stage.height, stage.width)
        split = self._split if size == self._size else target.at(*size)
        images = getattr(split, side)
        kind_of_reward = "miou" if side == "test" else config.reward_kind
        truth: Truth | Reference
        if kind_of_reward == "mmd" and self._net is not None:
            truth = self._net.reference(images.images)
        else:
            truth = Truth(images.images, images.labels)
        records = {
            (line["row"], line["seed"]): line
            for line in self._folder.finals.lines
            if line["kind"] == kind
        }
        wanted = [(row, seed) for seed in seeds for row in proposals]
        missing = [key for key in wanted if key not in records]
        each = self._units(cost_of(stage))
        self._progress.advance(each * (len(wanted) - len(missing)), replayed=True)
        rendered = [
            ((row, seed), Job(proposal, draw_units(proposal, seed, stage.streets), seed))
            for row, seed in missing
            if (proposal := proposals[row]) is not None
        ]
        real = [key for key in missing if proposals[key[0]] is None]

        def keep(key: tuple[str, int], evaluation: Outcome | Evaluation, stored: bool) -> None:
            self._progress.advance(each, replayed=stored)
            row, seed = key
            record = {
                "kind": kind,
                "row": row,
                "seed": seed,
                "miou": evaluation.reward,
                "class_iou": evaluation.class_iou,
                "render_seconds": round(evaluation.render_seconds, 3),
                "train_seconds": round(evaluation.train_seconds, 3),
                "elapsed": round(self._progress.elapsed, 2),
            }
            self._folder.finals.append(record)
            records[key] = record
            self._progress.update(
                f"{kind} nets: {row}, seed {seed} | {REWARD_NAMES[kind_of_reward]} "
                f"{in_words(kind_of_reward, evaluation.reward)}"
            )

        scoring = evaluate if isinstance(truth, Truth) else evaluate_mmd
        evaluator = Evaluator(config, stage, target, side, truth, self._workers, self._store)
        for index, outcome in evaluator.map(scoring, [job for _, job in rendered]):
            if outcome.failed is not None:
                raise TrainingError(outcome.failed)
            keep(rendered[index][0], outcome, outcome.stored)
        own = self._split.reward
        bound = [(stage, target.table, own.images, own.labels, seed, truth) for _, seed in real]
        for index, evaluation in self._workers.map(evaluate_real, bound):
            keep(real[index], evaluation, False)
        return records
