"""A search over intervals that leaves each attribute where it began unless moving it surely pays."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.models import effects
from sdr_jax.models import memory as memories
from sdr_jax.models.choices import Start, choices, make_effects
from sdr_jax.models.features import maximise_each
from sdr_jax.models.regression import Posterior
from sdr_jax.models.surely import surely
from sdr_jax.relaxation import random_bins
from sdr_jax.space import Proposal, Space, Width

SHARES = np.asarray([0.3, 0.6, 1.0], np.float32)
"""Shares of attributes that a data set tries anew; the others stay at the answer so far."""

SURE = 2.0
"""Standard deviations by which a move must pay to be in `spread`."""

DRAWS = 64
"""Data sets behind `probabilities`."""


class IntervalsState(NamedTuple):
    """What the regression has learnt."""

    seen: effects.EffectsState
    belief: Posterior  # of the weights
    answer: Int[Array, "attributes"]  # choices
    memory: memories.Memory


def intervals(
    space: Space,
    width: Width = None,
    *,
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    caution: float = 0.3,
    degree: int = 9,
    pair_degree: int | None = None,
) -> Method:
    """Which attributes to narrow, and to what, by a Bayesian regression on what intervals have in them.

    Actions are intervals: runs of an attribute's bins, from single ones to all of them (`choices.runs`), or
    its own in `start`; relaxation plays no part. The reward of a data set is modelled as linear in its
    density,

        y = b + sum_i w_i . phi(c_i, w_i) + sum_{i<j in a group} phi(i) W_ij phi(j) + noise

    with cosines integrated over the interval and one term for its narrowness (`choices.integrated`), so
    data sets of any width teach one model. How large each effect, each interaction and the noise are is
    learnt by evidence (`effects.py`).

    The first data set is the start's, the second random attributes, further ones of that update have half of
    their attributes at the start and half at any choice. From then on each is the answer so far with a random
    share of its attributes changed, to what is best under a draw of the posterior (Thompson sampling). Where
    repeats show that rewards have no noise, nothing is tried twice (`memory.py`).

    The answer is the start, but for the attributes of which a choice is better than the start's by more than
    `caution` standard deviations of that difference. In `spread` it must be by two.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: plays no part.
        start: centres and widths of where to begin; by default random attributes.
        caution: see above, 0 or more; 0 moves wherever it pays on average.
        degree: cosines per attribute.
        pair_degree: cosines per attribute in interactions; by default see `effects.make_effects`.

    Returns:
        The method, for any number of updates; `entropy` in its info is NaN.

    Raises:
        ValueError: an option out of range, or a start of other attributes.

    Source: not in the paper; Thompson 1933; MacKay 1992, "Bayesian interpolation".
    """
    del width
    if not (caution >= 0 and np.isfinite(caution)):
        raise ValueError(f"caution is {caution}, but must be 0 or more")
    chosen = choices(space, _checked(space, start))
    model = make_effects(space, chosen, degree, pair_degree)
    began = jnp.asarray(chosen.began)

    def fitted(seen: effects.EffectsState, memory: memories.Memory) -> IntervalsState:
        belief = effects.posterior(model, seen)
        moved = jnp.where(seen.noise > 0, surely(model, belief, chosen.began, caution), began)
        answer = jnp.where(memories.exact(memory), memory.best, moved)
        return IntervalsState(seen, belief, answer, memory)

    def proposed(actions: Array) -> Proposal:
        rows = jnp.arange(space.attributes)
        return Proposal(*(jnp.asarray(part)[rows, actions] for part in chosen[1:3]))

    def init(rng_key: RngKey) -> IntervalsState:
        del rng_key  # nothing is random before the first sample
        return fitted(effects.init_effects(model), memories.empty(space.attributes))

    def sample(rng_key: RngKey, state: IntervalsState, n: int) -> tuple[Bins, Proposal]:
        draw_key, start_key, share_key, which_key, open_key = jax.random.split(rng_key, 5)
        weights = effects.draw_plain(draw_key, model, state.belief, n)
        best = maximise_each(start_key, chosen.space, model.layout, weights)
        share = jax.random.choice(share_key, jnp.asarray(SHARES), (n, 1))
        chance = jax.random.uniform(which_key, best.shape)
        changed = jnp.where(chance < share, best, state.answer[None, :])
        mixed = jnp.where(chance < 0.5, random_bins(open_key, chosen.space, n), began[None, :])
        turn = state.seen.statistics.seen.astype(jnp.int32) + jnp.arange(n)[:, None]
        opening = jnp.where(turn == 0, began[None, :], jnp.where(turn == 1, 0, mixed))
        actions = jnp.where(state.seen.noise > 0, changed, opening)
        actions = memories.untried(state.memory, chosen.space, model.layout, weights, actions)
        return actions, proposed(actions)

    def update(
        state: IntervalsState, actions: Bins, rewards: Rewards
    ) -> tuple[IntervalsState, Info]:
        seen = effects.observe(model, state.seen, actions, rewards)
        memory = memories.remember(state.memory, actions, rewards)
        return fitted(seen, memory), plain_info(rewards, jnp.asarray(jnp.nan, jnp.float32))

    def solution(state: IntervalsState) -> Proposal:
        return proposed(state.answer)

    def spread(state: IntervalsState) -> Proposal:
        moved = surely(model, state.belief, chosen.began, max(SURE, caution))
        return proposed(jnp.where(state.seen.noise > 0, moved, began))

    def probabilities(state: IntervalsState) -> Float[Array, "attributes bins"]:
        _, tried = sample(jax.random.key(1), state, DRAWS)
        return shares_of_bins(space, tried)

    return jitted(init, sample, update, solution, probabilities, spread)


def shares_of_bins(space: Space, proposals: Proposal) -> Float[Array, "attributes bins"]:
    """How much of each bin streets of n proposals f32[n attributes] fill, rows adding up to 1."""
    bins = jnp.asarray(space.bins, jnp.float32)[:, None]
    edges = jnp.arange(space.max_bins + 1)[None, :] / bins
    width = jnp.maximum(proposals.width, 1e-4)[..., None]
    below = (edges[None] - proposals.centre[..., None]) / width + 0.5
    filled = jnp.diff(jnp.clip(below, 0.0, 1.0), axis=-1).mean(axis=0)
    filled = jnp.where(jnp.arange(space.max_bins)[None, :] < bins, filled, 0.0)
    return filled / filled.sum(axis=1, keepdims=True)


def _checked(space: Space, start: tuple[tuple[float, ...], tuple[float, ...]] | None) -> Start:
    """The start, by default random attributes; raises ValueError where it does not fit the space."""
    if start is None:
        return np.full(space.attributes, 0.5, np.float32), np.ones(space.attributes, np.float32)
    centre, width = (np.asarray(part, np.float32) for part in start)
    if centre.shape != (space.attributes,) or width.shape != centre.shape:
        raise ValueError(
            f"start has {centre.size} attributes, not the {space.attributes} of the space"
        )
    if not np.all((centre - width / 2 >= -1e-6) & (centre + width / 2 <= 1 + 1e-6) & (width >= 0)):
        raise ValueError("start has an interval that is not in [0, 1]")
    return centre, width
