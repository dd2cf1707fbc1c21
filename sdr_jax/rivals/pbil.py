"""PBIL on ordered bins: probabilities drift towards the best samples and their neighbours."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.relaxation import UNDECIDED, check_relaxation, entropy, moments, relax, uniform
from sdr_jax.space import Proposal, Space, Width


class PbilState(NamedTuple):
    """The distribution, and the latest evaluations."""

    probabilities: Float[Array, "attributes bins"]  # each attribute's, independent of the others
    actions: Int[Array, "memory attributes"]  # the latest evaluations, the newest last
    rewards: Float[Array, "memory"]  # theirs; minus infinity where empty or failed


def pbil(
    space: Space,
    width: Width = None,
    *,
    rate: float = 0.08,
    memory: int = 60,
    elite: float = 0.25,
    smoothing: float = 0.08,
) -> Method:
    """Population-based incremental learning: an estimation of distribution without dependencies.

    Every update moves the probabilities towards the best of the latest evaluations,

        p_i <- (1 - s) p_i + s sum_m w_m kernel_i[a_mi],   s = 1 - (1 - rate)^n

    with rank weights w_r ~ max(0, log(elite M + 1/2) - log r) over the M evaluations remembered, as
    in CMA-ES, and a Gaussian kernel over the bins' values, since neighbouring bins are alike. The
    kernel is reflected at 0 and 1, so a uniform distribution stays one. The answer is the most
    probable bin of each attribute. Groups play no part.

    Args:
        space: the attributes and their bins.
        width: of the relaxed bins, see `relax`.
        rate: how far one evaluation moves the probabilities, in (0, 1].
        memory: how many of the latest evaluations are ranked (those of one update, if more).
        elite: the fraction of them with a weight, in (0, 1].
        smoothing: standard deviation of the kernel, as a fraction of [0, 1]; 0 is plain PBIL.

    Returns:
        The method, for any number of updates.

    Raises:
        ValueError: an option out of range.

    Source: not in the paper; Baluja 1994, "Population-based incremental learning".
    """
    for name, fraction in (("rate", rate), ("elite", elite)):
        if not 0 < fraction <= 1:
            raise ValueError(f"{name} is {fraction}, but must lie in (0, 1]")
    if memory < 1:
        raise ValueError(f"memory is {memory}, but must be at least 1")
    if not (smoothing >= 0 and np.isfinite(smoothing)):
        raise ValueError(f"smoothing is {smoothing}, but must be 0 or more")
    check_relaxation(space, width, "random")
    kernel = _kernel(space, smoothing)

    def init(rng_key: RngKey) -> PbilState:
        del rng_key  # nothing is random before the first sample
        return PbilState(
            probabilities=uniform(space),
            actions=jnp.zeros((memory, space.attributes), jnp.int32),
            rewards=jnp.full(memory, -jnp.inf, jnp.float32),
        )

    def sample(rng_key: RngKey, state: PbilState, n: int) -> tuple[Bins, Proposal]:
        logits = jnp.log(state.probabilities)
        actions = jax.random.categorical(rng_key, logits, shape=(n, space.attributes))
        actions = actions.astype(jnp.int32)
        return actions, relax(space, actions, width)

    def update(state: PbilState, actions: Bins, rewards: Rewards) -> tuple[PbilState, Info]:
        n = rewards.shape[0]
        known = jnp.isfinite(rewards)
        ranked = max(memory, n)
        all_rewards = jnp.concatenate([state.rewards, jnp.where(known, rewards, -jnp.inf)])
        # Failed ones come first, as if empty, and push no other out of memory.
        latest = jnp.argsort(jnp.isfinite(all_rewards), stable=True)[-ranked:]
        all_rewards = all_rewards[latest]
        all_actions = jnp.concatenate([state.actions, actions])[latest]
        weights = _rank_weights(all_rewards, elite)

        rows = jnp.arange(space.attributes)
        # [ranked attributes bins]: where each evaluation's smoothed bins lie.
        targets = jnp.asarray(kernel)[rows[None, :], all_actions]
        target = jnp.einsum("m,mab->ab", weights, targets)
        step = 1 - (1 - rate) ** jnp.sum(known)
        step = jnp.where(weights.sum() > 0, step, 0.0)  # too few evaluations to tell good from bad
        moved = (1 - step) * state.probabilities + step * target
        moved = moved / moved.sum(axis=1, keepdims=True)
        next_state = PbilState(
            probabilities=jnp.where(step > 0, moved, state.probabilities),
            actions=all_actions[-memory:],
            rewards=all_rewards[-memory:],
        )
        return next_state, plain_info(rewards, entropy(state.probabilities))

    def solution(state: PbilState) -> Proposal:
        best = jnp.argmax(state.probabilities, axis=1).astype(jnp.int32)
        learnt = jnp.any(state.probabilities != uniform(space))
        return relax(space, jnp.where(learnt, best, UNDECIDED), width)

    def spread(state: PbilState) -> Proposal:
        return moments(space, state.probabilities, width)

    return jitted(init, sample, update, solution, lambda state: state.probabilities, spread)


def _rank_weights(rewards: Array, elite: float) -> Array:
    """Weights that fall with the rank and sum to 1; all zero below two or so evaluations."""
    known = jnp.isfinite(rewards)
    ranks = jnp.argsort(jnp.argsort(-rewards)) + 1
    weights = jnp.maximum(0.0, jnp.log(elite * known.sum() + 0.5) - jnp.log(ranks)) * known
    return weights / jnp.where(weights.sum() > 0, weights.sum(), 1.0)


def _kernel(space: Space, smoothing: float) -> Float[np.ndarray, "attributes bins bins"]:
    """Where a bin's probability goes: a Gaussian over the bins, mirrored at both borders.

    Of bins without an order all gain alike, together the share `smoothing`.
    """
    kernel = np.zeros((space.attributes, space.max_bins, space.max_bins), np.float32)
    for attribute, count in enumerate(space.bins):
        if smoothing == 0:
            kernel[attribute, :count, :count] = np.eye(count)
            continue
        if attribute in space.unordered:
            moved = min(smoothing, 1.0)
            kernel[attribute, :count, :count] = (1 - moved) * np.eye(count) + moved / count
            continue
        value = (np.arange(count) + 0.5) / count
        total = np.zeros((count, count))
        reach = int(np.ceil(4 * smoothing)) + 1
        for period in range(-reach, reach + 1):  # mirror images repeat with period 2
            for image in (value, -value):
                distance = value[:, None] - (image + 2 * period)[None, :]
                total += np.exp(-0.5 * (distance / smoothing) ** 2)
        kernel[attribute, :count, :count] = total / total.sum(axis=1, keepdims=True)
    return kernel
