"""The search: one jitted step per update, its rewards from worker processes through one callback."""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
import optax

import sdr_jax
from experiments.config import Config, Search
from experiments.errors import UserError
from experiments.evaluator import Evaluator, Job
from experiments.folder import RunFolder
from experiments.mmd_reward import Reference, evaluate_mmd
from experiments.progress import Progress
from experiments.reward import REWARD_NAMES, Truth, evaluate, in_words
from experiments.store import Store
from experiments.targets import Target
from scene.attributes import NAMES
from scene.workers import WorkerPool
from seg.train import TrainingError

ON_HOST = ("cma_es", "tpe")
"""Methods of other libraries, which JAX cannot trace."""


class SearchResult(NamedTuple):
    """What the search found, and how it went."""

    argmax: sdr_jax.Proposal  # the method's answer, f32[attributes] each
    spread: sdr_jax.Proposal  # the same, wide where the policy is unsure
    rewards: np.ndarray  # f32[updates, datasets per update]
    baselines: np.ndarray  # f32[updates]
    groups: np.ndarray  # i32[updates]
    probabilities: np.ndarray  # f32[updates, attributes, bins], after each update


def make_space(config: Config) -> sdr_jax.Space:
    """The 23 attributes in the configuration's groups.

    Raises:
        UserError: groups that are no partition of the attributes.
    """
    try:
        return sdr_jax.space(NAMES, config.search.bins, config.groups)
    except ValueError as error:
        raise UserError(f"--groups: {error}") from None


def make_method(search: Search, space: sdr_jax.Space) -> sdr_jax.Method:
    """The search method that the configuration asks for.

    Raises:
        UserError: an option out of range.
    """
    try:
        if search.method == "sdr":
            return _sdr(search, space)
        if search.method == "random_attributes":
            return sdr_jax.random_attributes(space)
        return getattr(sdr_jax, search.method)(space, width=search.relaxation)
    except (ImportError, ValueError) as error:
        raise UserError(f"--search: {error}") from None


def _sdr(search: Search, space: sdr_jax.Space) -> sdr_jax.Method:
    baseline = {
        "ema": sdr_jax.ema,
        "ema_current": lambda: sdr_jax.ema(includes_current=True),
        "leave_one_out": sdr_jax.leave_one_out,
    }[search.baseline]()
    return sdr_jax.sdr(
        space,
        optax.adam(search.learning_rate),
        updates_per_group=search.updates_per_group,
        baseline=baseline,
        transform=sdr_jax.squared_percent if search.squared_reward else sdr_jax.identity,
        normalise=search.normalise,
        width=search.relaxation,
        unoptimised=search.unoptimised,
    )


def total_updates(config: Config) -> int:
    """Policy updates of the whole search."""
    return config.search.updates_per_group * len(config.groups)


class _Rewards:
    """Scores the datasets of one update: from the log where it has them, else by working."""

    def __init__(
        self,
        config: Config,
        target: Target,
        truth: Truth | Reference,
        folder: RunFolder,
        workers: WorkerPool,
        progress: Progress,
        cost: float,
        store: Store | None,
    ) -> None:
        self._evaluate = evaluate if isinstance(truth, Truth) else evaluate_mmd
        self._folder, self._progress, self._cost = folder, progress, cost
        self._evaluator = Evaluator(config, config.reward, target, "reward", truth, workers, store)
        self._known = {(r["update"], r["dataset"]): r for r in folder.evaluations.lines}
        self._update, self._actions = 0, np.zeros((0, 0), np.int32)
        self._proposals: list[sdr_jax.Proposal] = []
        self.best = -np.inf

    def begin(self, update: int, actions: np.ndarray, proposals: sdr_jax.Proposal) -> None:
        """Say which update comes next; kept with its rewards."""
        self._update, self._actions = update, actions
        self._proposals = [sdr_jax.Proposal(*pair) for pair in zip(*proposals, strict=True)]

    def __call__(self, units: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Rewards f32[n] of the datasets ``units`` f32[n, streets, 23]."""
        rewards = np.full(len(seeds), np.nan, np.float32)
        missing = []
        for k, seed in enumerate(seeds.tolist()):
            known = self._known.get((self._update, k))
            if known is None:
                missing.append(k)
                continue
            if known["seed"] != seed or known["actions"] != self._actions[k].tolist():
                raise UserError(
                    f"{self._folder.path / 'evaluations.jsonl'}: update {self._update}, dataset "
                    f"{k} was not made by this run; use another --out"
                )
            rewards[k] = known["reward"]
            self._progress.advance(self._cost, replayed=True)
        jobs = [Job(self._proposals[k], units[k], int(seeds[k])) for k in missing]
        for index, result in self._evaluator.map(self._evaluate, jobs):
            k = missing[index]
            if result.failed is not None:
                raise TrainingError(result.failed)
            rewards[k] = result.reward
            if not np.isfinite(rewards[k]):
                raise UserError(
                    f"update {self._update}, dataset {k}: the reward is {rewards[k]}; "
                    "the reward images must hold at least one labelled class"
                )
            self._progress.advance(self._cost, replayed=result.stored)
            self._folder.evaluations.append(
                {
                    "update": self._update,
                    "dataset": k,
                    "actions": self._actions[k].tolist(),
                    "seed": int(seeds[k]),
                    "reward": float(rewards[k]),
                    "class_iou": result.class_iou,
                    "render_seconds": round(result.render_seconds, 3),
                    "train_seconds": round(result.train_seconds, 3),
                    "elapsed": round(self._progress.elapsed, 2),
                }
            )
        self.best = max(self.best, float(rewards.max()))
        return rewards


def search(
    config: Config,
    target: Target,
    truth: Truth | Reference,
    folder: RunFolder,
    workers: WorkerPool,
    progress: Progress,
    cost: float,
    store: Store | None = None,
) -> SearchResult:
    """Run the whole search, or what is left of it.

    The loop replays what the run folder already knows: the same keys give the same actions, and a
    logged reward takes no time. So a killed run ends with the answer of an unbroken one.

    Args:
        config: the run.
        target: what to be good on.
        truth: the reward images, or what ``--reward-kind mmd`` knows of them.
        folder: where every reward is logged.
        workers: who renders and trains.
        progress: told about every reward.
        cost: of one reward, in the progress's units.
        store: evaluations shared with other runs.

    Raises:
        UserError: a NaN reward, or a log of another run.
    """
    space = make_space(config)
    method = make_method(config.search, space)
    rewards = _Rewards(config, target, truth, folder, workers, progress, cost, store)
    reward_fn = sdr_jax.host_reward(
        rewards, config.reward.streets, common=config.search.common_random_numbers
    )
    n = config.search.datasets_per_update
    step = sdr_jax.make_step(method, reward_fn, n, compiled=config.search.method not in ON_HOST)
    init_key, steps_key = jax.random.split(jax.random.key(config.seed))
    state = method.init(init_key)
    history: list[tuple] = []
    updates = total_updates(config)
    for update in range(updates):
        key = jax.random.fold_in(steps_key, update)
        # The draw that the step is about to make, so that the log can tell the actions.
        actions, proposals = method.sample(jax.random.split(key)[0], state, n)
        rewards.begin(update, np.asarray(actions), jax.tree.map(np.asarray, proposals))
        new_state, record = step(key, state)
        reward_fn.reraise()
        state = new_state
        info = record.info
        baseline = float(info.baseline)
        history.append(
            (
                np.asarray(record.rewards),
                baseline,
                int(info.group),
                np.asarray(method.probabilities(state)),
            )
        )
        kind = config.reward_kind
        mean, best = in_words(kind, float(info.reward_mean)), in_words(kind, rewards.best)
        line = f"{REWARD_NAMES[kind]} {mean}, best {best}"
        where = f"update {update + 1}/{updates}"
        if config.search.method == "sdr":
            where += f", group {int(info.group) + 1}/{len(config.groups)}"
        if np.isfinite(baseline):
            scale = 100 if config.search.squared_reward else 1
            line += f", baseline {in_words(kind, baseline / scale)}"
        progress.update(f"search: {where} | {line}")
    per_update, baselines, groups, probabilities = zip(*history, strict=True)
    return SearchResult(
        argmax=jax.tree.map(np.asarray, method.solution(state)),
        spread=jax.tree.map(np.asarray, method.spread(state)),
        rewards=np.stack(per_update),
        baselines=np.array(baselines, np.float32),
        groups=np.array(groups, np.int32),
        probabilities=np.stack(probabilities),
    )
