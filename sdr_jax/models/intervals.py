"""A search over intervals that keeps an attribute where it begins unless the model expects a move to pay."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.bins import bin_mask, random_bins
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.models import effects, regression
from sdr_jax.models.choices import Start, choices, make_effects, shares_of_bins
from sdr_jax.models.features import Features, maximise_each
from sdr_jax.models.regression import Posterior
from sdr_jax.relaxation import check_relaxation
from sdr_jax.space import Proposal, Space, Width

REACHES = np.asarray([0.5, 1.0, 2.0], np.float32)
"""Factors of the reach: the share of attributes in which a data set differs from the answer."""

OPENING = 4
"""Rewards of the start, and of random attributes, before a search begins at the better of the two."""

FIRST_REACH = 0.3
"""The approximate share of attributes that the first data sets after the opening change in a search that
begins at its start. Without a start they change all; where random attributes are the better start, so do all
later data sets."""

SUCCESS, PACE = 0.2, 0.3
"""The reach stays as it is where this share of data sets exceeds the reward that the model expects of the
answer (the 1/5 of evolution strategies). PACE is the change of its logarithm with each data set."""

ONE_WIDTH = 0.5
"""The probability that a changed attribute gets the best interval of a drawn width, not of all widths."""

SURE = 2.0
"""Standard deviations of its gain that a move must exceed to be in `spread`."""

SWEEPS = 3
"""Number of times that the choice by the lower confidence bound goes over all attributes."""

DRAWS = 64
"""The number of drawn data sets from which `probabilities` is estimated."""


class IntervalsState(NamedTuple):
    """The regression, the answer so far, and the reach."""

    seen: effects.EffectsState
    belief: Posterior  # of the weights
    base: Int[Array, "attributes"]  # choices that the answer keeps where no other is better
    answer: Int[Array, "attributes"]  # choices
    reach: Float[Array, ""]  # approximate share of attributes that a data set changes


def intervals(
    space: Space,
    *,
    width: Width = None,
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    caution: float = 0.3,
    degree: int = 9,
    pair_degree: int | None = None,
) -> Method:
    """Chooses intervals of attributes by a Bayesian regression on features of intervals.

    Actions are intervals: runs of an attribute's bins, from one to all (`choices.runs`), or its interval in
    `start`; without relaxation they are single values. The reward of a data set is modelled as linear in its
    density,

        y = b + sum_i w_i . phi(c_i, w_i) + sum_{i<j in a group} phi(i) W_ij phi(j) + noise

    with cosines integrated over the interval and one term for its narrowness (`choices.integrated`), so
    data sets of any width teach one model. The sizes of effects, interactions and noise are learnt by
    evidence (`effects.py`).

    The first eight data sets are the start and random attributes in turn. The search then begins at its
    base: the start, or random attributes if they had the higher mean reward. Without a start the base is
    random attributes; the first data sets are these, and these with any choice for half of the attributes.
    Each later data set is the answer so far with some attributes changed to the best choice under a draw of
    the posterior (Thompson sampling); half of these choose among the intervals of a drawn width, so that wide
    ones are tried, too. More attributes are changed while changed data sets often do better than the answer,
    fewer while they seldom do; all of them where random attributes did better than the start. Rewards far
    below the others, such as the penalty for a crash, are clipped (`history.py`).

    The answer is the base, except for attributes where the lower confidence bound of a choice's gain over
    the base (the mean less `caution` standard deviations) is above 0. `spread` subtracts two.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: 0, for all attributes or for one, gives single values (single bins if they have no order);
            other widths have no effect.
        start: centres and widths of a first answer; by default random attributes.
        caution: see above, 0 or more; with 0 every move is made whose mean gain is above 0.
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
    start_choices, scale_of = jnp.asarray(chosen.began), jnp.asarray(chosen.scale)
    scales = scale_of.max(axis=1) + 1
    # The first choice is the whole range, where intervals are allowed.
    whole = jnp.asarray(chosen.width[:, 0] == 1)
    random = jnp.where(whole, 0, start_choices)
    has_start = bool(chosen.began.any())
    opening = 2 * OPENING if has_start and chosen.width[:, 0].max() == 1 else 2

    first_reach = FIRST_REACH if has_start else 1.0

    def fitted(seen: effects.EffectsState, reach: Array) -> IntervalsState:
        belief = effects.posterior(model, seen)
        first, rewards = seen.history.actions[:opening], seen.history.rewards[:opening]
        at_start = (first == start_choices[None, :]).all(axis=1)
        means = [jnp.nanmean(jnp.where(those, rewards, jnp.nan)) for those in (at_start, ~at_start)]
        base = jnp.where(means[1] > means[0], random, start_choices)
        moved = best_by_lower_bound(model, belief, base, caution)
        return IntervalsState(seen, belief, base, jnp.where(seen.noise > 0, moved, base), reach)

    def proposed(actions: Array) -> Proposal:
        rows = jnp.arange(space.attributes)
        return Proposal(*(jnp.asarray(part)[rows, actions] for part in chosen[1:3]))

    def init(rng_key: RngKey) -> IntervalsState:
        del rng_key  # nothing is random before the first sample
        return fitted(effects.init_effects(model), jnp.asarray(first_reach, jnp.float32))

    def sample(rng_key: RngKey, state: IntervalsState, n: int) -> tuple[Bins, Proposal]:
        keys = jax.random.split(rng_key, 7)
        draw_key, start_key, share_key, which_key, width_key, scale_key, open_key = keys
        weights = effects.draw_plain(draw_key, model, state.belief, n)
        share = state.reach * jax.random.choice(share_key, jnp.asarray(REACHES), (n, 1))
        chance = jax.random.uniform(which_key, (n, space.attributes))
        # At least the one with the smallest random number.
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
        as_random = whole[None, :] if has_start else chance >= 0.5
        other = jnp.where(as_random, random[None, :], anywhere)
        first = jnp.where(turn % 2 == 0, start_choices[None, :], other)
        actions = jnp.where(state.seen.statistics.seen < opening, first, changed)
        return actions, proposed(actions)

    def update(
        state: IntervalsState, actions: Bins, rewards: Rewards
    ) -> tuple[IntervalsState, Info]:
        seen = effects.observe(model, state.seen, actions, rewards)
        expected = effects.value(model, state.seen, state.belief, state.answer)
        signs = jnp.where(jnp.isfinite(rewards), (rewards > expected) - SUCCESS, 0.0)
        step = jnp.where(state.seen.noise > 0, PACE * signs.sum(), 0.0)
        reach = jnp.clip(state.reach * jnp.exp(step), 1 / space.attributes, 1.0)
        info = basic_info(rewards, jnp.asarray(jnp.nan, jnp.float32))
        reach = jnp.where(state.seen.statistics.seen < opening, first_reach, reach)
        state = fitted(seen, reach)
        at_start = (state.base == start_choices).all()
        state = state._replace(reach=jnp.where(at_start, reach, 1.0))
        finite = effects.is_finite(seen, state.belief)
        return state, info._replace(clipped=seen.history.clipped, finite=finite)

    def solution(state: IntervalsState) -> Proposal:
        return proposed(state.answer)

    def spread(state: IntervalsState) -> Proposal:
        moved = best_by_lower_bound(model, state.belief, state.base, max(SURE, caution))
        return proposed(jnp.where(state.seen.noise > 0, moved, state.base))

    def probabilities(state: IntervalsState) -> Float[Array, "attributes bins"]:
        _, tried = sample(jax.random.key(1), state, DRAWS)
        return shares_of_bins(space, tried)

    def predict(state: IntervalsState, actions: Bins) -> tuple[Rewards, Rewards]:
        return effects.expected(model, state.seen, state.belief, actions)

    return jit_method(init, sample, update, solution, probabilities, spread, predict=predict)


def _checked(space: Space, start: tuple[tuple[float, ...], tuple[float, ...]] | None) -> Start:
    """The start, by default random attributes; raises ValueError if it does not fit the space."""
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


def best_by_lower_bound(
    model: effects.Effects, belief: Posterior, base: Int[Array, "attributes"], caution: float
) -> Int[Array, "attributes"]:
    """The choices whose gain over the base has the highest lower confidence bound.

    The function goes over the attributes one after the other. Each takes the choice a with the largest

        E[f(a) - f(base)] - caution * std[f(a) - f(base)]

    under the posterior of the model f, while the other attributes stay as they are. The base's own bound
    is 0, so an attribute keeps the base where no choice has a positive bound.

    Args:
        model: the constants.
        belief: the posterior of the model's weights.
        base: the choices of the base.
        caution: the number of standard deviations, 0 or more.

    Returns:
        The choices.
    """
    layout = model.layout
    basis, short = jnp.asarray(layout.basis), layout.pair_degree
    attributes = len(layout.basis)
    features, partners, leads = (jnp.asarray(table) for table in _tables(layout))
    there = jnp.asarray(bin_mask(model.space))
    weights = effects.plain(model, belief.mean)
    covariance = _plain_covariance(model, belief)

    def move(step: Array, actions: Array) -> Array:
        attribute = step % attributes
        change = basis[attribute] - basis[attribute, base[attribute]][None, :]
        mine = change[:, :short]
        partner = partners[attribute]  # `attributes` where there are no more
        theirs = basis[jnp.minimum(partner, attributes - 1)]
        theirs = theirs[jnp.arange(len(partner)), actions[partner], :short]
        theirs = jnp.where((partner < attributes)[:, None], theirs, 0.0)
        leading = jnp.einsum("cp,jq->cjpq", mine, theirs)
        pairs = jnp.where(leads[attribute][:, None, None], leading, leading.swapaxes(2, 3))
        changes = jnp.concatenate([change, pairs.reshape(len(change), -1)], axis=1)
        own = features[attribute]
        variance = jnp.einsum("cf,fg,cg->c", changes, covariance[own[:, None], own[None]], changes)
        bound = changes @ weights[own] - caution * jnp.sqrt(jnp.maximum(variance, 0.0))
        bound = jnp.where(there[attribute], bound, -jnp.inf)
        best = jnp.argmax(bound).astype(jnp.int32)
        better = jnp.where(bound[best] > 0, best, base[attribute])
        return actions.at[attribute].set(better)

    return jax.lax.fori_loop(0, SWEEPS * attributes, move, base)


def _plain_covariance(model: effects.Effects, belief: Posterior) -> Float[Array, "layout layout"]:
    """The covariance of the layout's weights, to which the shared weights are added."""
    whole = regression.covariance(belief)
    own = len(model.shared)
    mixed = whole[:own, own:] @ model.shared.T
    return whole[:own, :own] + mixed + mixed.T + model.shared @ whole[own:, own:] @ model.shared.T


def _tables(
    layout: Features,
) -> tuple[
    Int[np.ndarray, "attributes features"],
    Int[np.ndarray, "attributes partners"],
    np.ndarray,
]:
    """Each attribute's features, its partners in pairs, and whether it comes first in each pair."""
    attributes, _, degree = layout.basis.shape
    size = layout.pair_degree**2
    of = [np.flatnonzero(np.any(layout.pairs == a, axis=1)) for a in range(attributes)]
    most = max(map(len, of), default=0)
    features = np.zeros((attributes, degree + most * size), np.int32)
    partners = np.full((attributes, most), attributes, np.int32)
    leads = np.zeros((attributes, most), bool)
    for a, pairs in enumerate(of):
        products = attributes * degree + pairs[:, None] * size + np.arange(size)
        own = np.concatenate([a * degree + np.arange(degree), products.ravel()])
        features[a, : len(own)] = own
        partners[a, : len(pairs)] = layout.pairs[pairs].sum(axis=1) - a
        leads[a, : len(pairs)] = layout.pairs[pairs, 0] == a
    return features, partners, leads
