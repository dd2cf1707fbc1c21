"""A search that the caller drives: ask what to evaluate, evaluate it anywhere, tell the reward."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Real

from common.errors import UserError
from common.lines import CURE, JsonLines
from sdr_jax.method import Method, State, refuse_not_finite
from sdr_jax.rewards import LARGEST
from sdr_jax.run import first_state, on_cpu
from sdr_jax.space import Proposal, Space

RECORD = ("id", "update", "actions", "seed", "reward")
"""The fields of every line of a history; the caller may add more."""

RESOLUTION = 1e-4
"""The largest rounding of a reward, as a share of the interquartile range of the distinct rewards."""


class Trial(NamedTuple):
    """One data set that waits for its reward."""

    id: int  # counts from 0 through the whole search
    proposal: Proposal  # NumPy f32[attributes] each: centre and width of every attribute, in [0, 1]
    seed: int  # uint32, for whatever is random in the evaluation


class AskTell:
    """A search that the caller drives, and that continues after any interruption.

        search = AskTell(space, method, n=8, seed=0, path="history.jsonl")
        while trials := search.ask():
            for trial in trials:
                search.tell(trial.id, evaluate(trial.proposal, trial.seed))  # None if it failed
        search.solution()

    `ask` returns the n trials of an update together; one process at a time may tell their rewards, in any
    order. The method is updated once it has all n, in the order of their ids. Methods and keys are pure, so
    the state needs no file: replaying the history gives the same state to the last bit, with host
    adapters too. Keys are used as in `drive`: the same seed proposes the same data sets.

    Methods compute in single precision, so a method gets the rewards minus the median of the first update,
    unless it is not shift invariant. If later rewards are so far from this median that their differences
    would be lost, as after a penalty of -1e9, the method starts again with all rewards minus their median.
    While all rewards are equal, the answer stays as it was before the first reward. Methods run on the CPU,
    and leave a GPU to the evaluations.

    Args:
        space: the attributes.
        method: the search method.
        n: data sets per update.
        seed: seed of the whole search.
        path: the history, JSONL; resumed if it exists, None keeps it in memory. Its folder is made.

    Attributes:
        state: the method's state after the last complete update.
        updates: complete updates so far.
        clipped: the largest number of rewards that the method has clipped so far, see `Info`.
        history: one record per reward, in the order in which they were told.

    Raises:
        ValueError: n below 1, a seed that is not in 0..2^32 - 1, or one of them is not an integer.
        UserError: the history has other actions or seeds than this search, as with other numbers of
            attributes or bins, another method, n or seed. Names and widths are not in it: keep them.
    """

    @on_cpu()
    def __init__(
        self,
        space: Space,
        method: Method,
        n: int = 1,
        seed: int = 0,
        path: str | os.PathLike[str] | None = None,
    ) -> None:
        for name, value in (("n", n), ("seed", seed)):
            if not isinstance(value, int | np.integer):
                raise ValueError(f"{name} is {value!r}, but must be an integer")
        if n < 1:
            raise ValueError(f"n is {n}, but must be at least 1")
        if not 0 <= seed < 2**32:  # JAX drops higher bits, so two seeds would give the same search
            raise ValueError(f"seed is {seed}, but must lie in 0..{2**32 - 1}")
        if path is not None:
            Path(path).absolute().parent.mkdir(parents=True, exist_ok=True)
        self.space, self.method, self.n = space, method, n
        rng_key = jax.random.key(seed)
        self._steps_key = jax.random.split(rng_key)[1]
        self.state: State = first_state(rng_key, method)
        self.updates, self.clipped = 0, 0
        self._start = self.state
        self._updates: list[tuple[Real[Array, "n attributes"], np.ndarray]] = []  # actions, rewards
        self._offset: float | None = None  # subtracted from rewards
        self._actions: Real[Array, "n attributes"] = jnp.zeros((n, space.attributes), jnp.int32)
        self._trials: tuple[Trial, ...] = ()  # none before the actions are sampled
        self._rewards: dict[int, float] = {}
        self._log = JsonLines(
            None if path is None else Path(path), f"{CURE}, or start a new history"
        )
        for number, record in enumerate(self._log.lines):
            self._replay(record, self._log.where(number))

    @property
    def history(self) -> list[dict[str, Any]]:
        """One record per reward: id, update, actions, seed, reward (None: failed) and notes."""
        return self._log.lines

    @on_cpu()
    def ask(self) -> list[Trial]:
        """Return the trials of this update that have no reward yet.

        Returns:
            One to n trials; none once the method has made all its updates.
        """
        if self.method.updates is not None and self.updates >= self.method.updates:
            return []
        self._sample()
        return [trial for trial in self._trials if trial.id not in self._rewards]

    @on_cpu()
    def tell(self, id: int, reward: float | None, **notes: Any) -> None:
        """Save one reward; the last of its update also updates the method.

        Args:
            id: id of a trial from `ask`.
            reward: higher is better, from -1e15 to 1e15. `sdr` learns nothing from differences far below
                1e-6, where Adam's epsilon is larger than its gradients, and no method from differences below
                1e-18, which single precision loses. None, NaN or an infinite value means
                that the evaluation failed; it is recorded as failed, not as a low reward.
            notes: JSON values that the trial's record keeps.

        Raises:
            ValueError: an id that waits for no reward, a reward out of range, or a note with the name of
                a field.
            TypeError: a note is no JSON value.
            OSError: the history cannot be written; the trial then still waits for its reward.
            RuntimeError: another process has written to it.
            FloatingPointError: the method's numbers are no longer finite.
        """
        clash = [name for name in notes if name in RECORD]
        if clash:
            raise ValueError(f"{clash[0]} is a field of every record; give the note another name")
        waiting = {trial.id: trial for trial in self.ask()}
        if id not in waiting:
            others = f"waiting are {', '.join(map(str, waiting))}" if waiting else "none is waiting"
            raise ValueError(f"trial {id} waits for no reward; {others}")
        value = math.nan if reward is None else float(reward)
        if math.isfinite(value) and abs(value) > LARGEST:
            raise ValueError(f"reward is {value:g}, but must lie within +-{LARGEST:g}")
        outcome = {"reward": value if math.isfinite(value) else None, **notes}
        self._log.append({**self._trial_fields(waiting[id]), **outcome})
        self._add_reward(id, value)

    @on_cpu()
    def solution(self) -> Proposal:
        """The method's answer after the last complete update, f32[attributes] each."""
        return _on_host(self.method.solution(self._answering_state))

    @on_cpu()
    def spread(self) -> Proposal:
        """The answer with wide intervals where the method is unsure, f32[attributes] each.

        It is the solution for a method without diagnostics.
        """
        diagnostics = self.method.diagnostics
        answer = self.method.solution if diagnostics is None else diagnostics.spread
        return _on_host(answer(self._answering_state))

    @property
    def _answering_state(self) -> State:
        rewards = self._finite_rewards()
        return self.state if np.any(rewards != rewards[:1]) else self._start

    def _finite_rewards(self) -> np.ndarray:
        """The rewards of all complete updates, without failed ones."""
        rewards = np.concatenate([np.zeros(0), *(rewards for _, rewards in self._updates)])
        return rewards[np.isfinite(rewards)]

    def _sample(self) -> None:
        if self._trials:
            return
        key = jax.random.fold_in(self._steps_key, self.updates)
        sample_key, seed_key = jax.random.split(key)
        self._actions, proposals = self.method.sample(sample_key, self.state, self.n)
        centre, width = np.asarray(proposals.centre), np.asarray(proposals.width)
        seeds = np.asarray(jax.random.bits(seed_key, (self.n,), jnp.uint32))
        self._trials = tuple(
            Trial(self.updates * self.n + k, _on_host((centre[k], width[k])), int(seeds[k]))
            for k in range(self.n)
        )

    def _trial_fields(self, trial: Trial) -> dict[str, Any]:
        """The fields of a trial in its record."""
        actions = np.asarray(self._actions)[trial.id % self.n].tolist()
        return {"id": trial.id, "update": self.updates, "actions": actions, "seed": trial.seed}

    def _add_reward(self, id: int, reward: float) -> None:
        """Add a reward; after the last of its update, update the method."""
        self._rewards[id] = reward if math.isfinite(reward) else math.nan
        if len(self._rewards) < self.n:
            return
        rewards = np.asarray([self._rewards[trial.id] for trial in self._trials], np.float64)
        self._updates.append((self._actions, rewards))
        self.updates += 1
        self._trials, self._rewards = (), {}
        if not self.method.shift_invariant:
            self._update(self._actions, rewards)
            return
        finite = self._finite_rewards()
        if self._offset is None or _loses_digits(finite, self._offset):
            median = np.median if self._offset is None else _upper_median
            self._offset = float(median(finite)) if len(finite) else None
            self.state, self.clipped = self._start, 0
            for update in self._updates:
                self._update(*update)
        else:
            self._update(self._actions, rewards)

    def _update(self, actions: Real[Array, "n attributes"], rewards: np.ndarray) -> None:
        shifted = jnp.asarray(rewards - (self._offset or 0.0), jnp.float32)
        self.state, info = self.method.update(self.state, actions, shifted)
        refuse_not_finite(info)
        self.clipped = max(self.clipped, int(info.clipped))

    def _replay(self, record: dict[str, Any], where: str) -> None:
        waiting = {trial.id: trial for trial in self.ask()}
        id, reward = record.get("id"), record.get("reward")
        is_number = isinstance(reward, int | float) and not isinstance(reward, bool)
        if not (reward is None or (is_number and abs(reward) <= LARGEST)):
            raise UserError(
                f"{where}: reward must be null or a number within +-{LARGEST:g}, not {reward!r}"
            )
        trial = waiting.get(id) if type(id) is int else None
        fields = None if trial is None else self._trial_fields(trial)
        if fields is None or any(record.get(name) != value for name, value in fields.items()):
            raise UserError(
                f"{where} does not belong to this search: use the space, method, n and seed with which the "
                "history was started"
            )
        self._add_reward(fields["id"], np.nan if reward is None else float(reward))


def _upper_median(rewards: np.ndarray) -> float:
    """Compute the upper median of the distinct rewards, so that a repeated penalty counts once."""
    return float(np.quantile(np.unique(rewards), 0.5, method="higher"))


def _loses_digits(rewards: np.ndarray, offset: float) -> bool:
    """Tell whether single precision, after an offset, loses the differences between most rewards.

    The spread of the distinct rewards is that of `history.py`: the lower quartile may be a penalty.
    """
    if not len(rewards):
        return False
    low, median, high = np.quantile(np.unique(rewards), [0.25, 0.5, 0.75], method="higher")
    spread = min(high - low, 4 * (high - median))
    return bool(np.spacing(np.float32(abs(median - offset))) > RESOLUTION * spread > 0)


def _on_host(proposal: tuple[Any, Any]) -> Proposal:
    centre, width = map(np.asarray, proposal)
    return Proposal(cast(Array, centre), cast(Array, width))
