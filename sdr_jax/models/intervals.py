"""A search over intervals that leaves each attribute where it began unless moving it surely pays."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.models import effects
from sdr_jax.models.choices import Start, choices, make_effects
from sdr_jax.models.features import maximise_each
from sdr_jax.models.regression import Posterior
from sdr_jax.models.surely import surely
from sdr_jax.relaxation import check_relaxation, random_bins, shares_of_bins
from sdr_jax.space import Proposal, Space, Width

REACHES = np.asarray([0.5, 1.0, 2.0], np.float32)
"""Data sets try so many times the reach of attributes anew; the others stay at the answer so far."""

FIRST_REACH = 0.3
"""Share of the attributes that the first data sets after the opening try anew, about, where the search starts
from something; of random attributes all."""

SUCCESS, PACE = 0.2, 0.3
"""The reach stays as it is where so many data sets are better than the model thinks the answer is (the 1/5 of
evolution strategies), and how fast its logarithm changes with each data set."""

ONE_WIDTH = 0.5
"""How often an attribute that is tried anew has its width drawn, rather than the best interval of all."""

SURE = 2.0
"""Standard deviations by which a move must pay to be in `spread`."""

DRAWS = 64
"""Data sets behind `probabilities`."""


class IntervalsState(NamedTuple):
    """What the regression has learnt."""

    seen: effects.EffectsState
    belief: Posterior  # of the weights
    answer: Int[Array, "attributes"]  # choices
    reach: Float[Array, ""]  # share of attributes that data sets try anew, about


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
    its own in `start`; without relaxation single values. The reward of a data set is modelled as linear in
    its density,

        y = b + sum_i w_i . phi(c_i, w_i) + sum_{i<j in a group} phi(i) W_ij phi(j) + noise

    with cosines integrated over the interval and one term for its narrowness (`choices.integrated`), so
    data sets of any width teach one model. How large each effect, each interaction and the noise are is
    learnt by evidence (`effects.py`).

    The first data sets are the start's and, in turn, random attributes; where the start is random itself,
    half of its attributes at any choice. From then on each is the answer so far with some attributes changed,
    to what is best under a draw of the posterior (Thompson sampling), half of them among the intervals of one
    width, drawn for each: so wide ones are tried, too. How many are changed follows success: more where
    changed data sets often do better than the answer, fewer where they seldom do. Rewards far below the
    others, such as the penalty for a crash, are clipped (`history.py`).

    The answer is the start, but for the attributes of which a choice is better than the start's by more than
    `caution` standard deviations of that difference. In `spread` it must be by two.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: 0, of all attributes or of one, is no relaxation: single values, but of bins without an order.
            Else it plays no part.
        start: centres and widths of where to begin; by default random attributes.
        caution: see above, 0 or more; 0 moves wherever it pays on average.
        degree: cosines per attribute.
        pair_degree: cosines per attribute in interactions; by default see `effects.make_effects`.

    Returns:
        The method, for any number of updates; `entropy` in its info is NaN.

    Raises:
        ValueError: an option out of range, or a start of other attributes.

    Source: not in the paper; Thompson 1933; MacKay 1992, "Bayesian interpolation"; for the reach, Rechenberg
    1973, "Evolutionsstrategie", and trust regions as in Eriksson et al. 2019, "Scalable Global Optimization
    via Local Bayesian Optimization".
    """
    if not (caution >= 0 and np.isfinite(caution)):
        raise ValueError(f"caution is {caution}, but must be 0 or more")
    check_relaxation(space, width, "random")
    chosen = choices(space, _checked(space, start), width)
    model = make_effects(space, chosen, degree, pair_degree)
    began, scale_of = jnp.asarray(chosen.began), jnp.asarray(chosen.scale)
    scales = scale_of.max(axis=1) + 1

    def fitted(seen: effects.EffectsState, reach: Array) -> IntervalsState:
        belief = effects.posterior(model, seen)
        answer = jnp.where(seen.noise > 0, surely(model, belief, chosen.began, caution), began)
        return IntervalsState(seen, belief, answer, reach)

    def proposed(actions: Array) -> Proposal:
        rows = jnp.arange(space.attributes)
        return Proposal(*(jnp.asarray(part)[rows, actions] for part in chosen[1:3]))

    def init(rng_key: RngKey) -> IntervalsState:
        del rng_key  # nothing is random before the first sample
        reach = jnp.asarray(FIRST_REACH if chosen.began.any() else 1.0, jnp.float32)
        return fitted(effects.init_effects(model), reach)

    def sample(rng_key: RngKey, state: IntervalsState, n: int) -> tuple[Bins, Proposal]:
        keys = jax.random.split(rng_key, 7)
        draw_key, start_key, share_key, which_key, width_key, scale_key, open_key = keys
        weights = effects.draw_plain(draw_key, model, state.belief, n)
        share = state.reach * jax.random.choice(share_key, jnp.asarray(REACHES), (n, 1))
        chance = jax.random.uniform(which_key, (n, space.attributes))
        # At least one, the one with the smallest number.
        anew = (chance < share) | (chance == chance.min(axis=1, keepdims=True))
        scale = jnp.floor(jax.random.uniform(scale_key, chance.shape) * scales[None, :])
        alike = jnp.where(
            jax.random.uniform(width_key, chance.shape)[..., None] < ONE_WIDTH,
            scale_of[None] == scale[..., None],
            scale_of[None] >= 0,
        )
        own = jnp.arange(scale_of.shape[1])[None, None, :] == state.answer[None, :, None]
        allowed = jnp.where(anew[..., None], alike, own)
        changed = maximise_each(start_key, chosen.space, model.layout, weights, allowed)
        turn = state.seen.statistics.seen.astype(jnp.int32) + jnp.arange(n)[:, None]
        anywhere = random_bins(open_key, chosen.space, n)
        mixed = jnp.where(chance < 0.5, anywhere, began[None, :])
        # The first choice is the whole range, where intervals are allowed.
        other = jnp.where(chosen.width[:, 0] == 1, 0, anywhere) if chosen.began.any() else mixed
        opening = jnp.where(turn % 2 == 0, began[None, :], other)
        actions = jnp.where(state.seen.statistics.seen > 1, changed, opening)
        return actions, proposed(actions)

    def update(
        state: IntervalsState, actions: Bins, rewards: Rewards
    ) -> tuple[IntervalsState, Info]:
        seen = effects.observe(model, state.seen, actions, rewards)
        expected = effects.value(model, state.seen, state.belief, state.answer)
        signs = jnp.where(jnp.isfinite(rewards), (rewards > expected) - SUCCESS, 0.0)
        step = jnp.where(state.seen.noise > 0, PACE * signs.sum(), 0.0)
        reach = jnp.clip(state.reach * jnp.exp(step), 1 / space.attributes, 1.0)
        info = plain_info(rewards, jnp.asarray(jnp.nan, jnp.float32))
        return fitted(seen, reach), info._replace(clipped=seen.history.clipped)

    def solution(state: IntervalsState) -> Proposal:
        return proposed(state.answer)

    def spread(state: IntervalsState) -> Proposal:
        moved = surely(model, state.belief, chosen.began, max(SURE, caution))
        return proposed(jnp.where(state.seen.noise > 0, moved, began))

    def probabilities(state: IntervalsState) -> Float[Array, "attributes bins"]:
        _, tried = sample(jax.random.key(1), state, DRAWS)
        return shares_of_bins(space, tried)

    def expects(state: IntervalsState, actions: Bins) -> tuple[Rewards, Rewards]:
        return effects.expected(model, state.seen, state.belief, actions)

    return jitted(init, sample, update, solution, probabilities, spread, expects=expects)


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
