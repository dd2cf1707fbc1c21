"""A search over intervals that moves an attribute from its start only where the model expects a gain."""

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

    evidence: effects.EffectsState
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
    """Choose intervals of attributes by a Bayesian regression on features of intervals.

    Actions are intervals: runs of an attribute's bins, from one to all (`choices.runs`), or its interval in
    `start`; without relaxation they are single values. The reward of a data set is modelled as linear in its
    density,

        y = b + sum_i w_i . phi(c_i, w_i) + sum_{i<j in a group} phi(i) W_ij phi(j) + noise

    with cosines integrated over the interval and one term for its narrowness (`choices.integrated`), so
    data sets of any width teach one model. The scales of effects, interactions and noise maximise
    the evidence (`effects.py`).

    The first eight data sets are the start and random attributes in turn. The search then begins at its
    base: the start, or random attributes if they had the higher mean reward, or if every evaluation of the
    start failed. Without a start the base is random attributes; the first data sets are these, and these
    with any choice for half of the attributes. Each later data set is the answer so far with some attributes
    changed to the best choice under a draw of the posterior (Thompson sampling); half of these choose among
    the intervals of a drawn width, so that wide ones are tried, too. More attributes are changed while
    changed data sets often do better than the answer, fewer while they seldom do; all of them where random
    attributes did better than the start. Rewards far below the others, such as the penalty for a crash, are
    clipped (`history.py`).

    The answer is the base, except for attributes where the lower confidence bound of a choice's gain over
    the base (the mean less `caution` standard deviations) is above 0. `spread` subtracts two.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: 0, for all attributes or for one, gives single values (single bins if they have no order);
            other widths have no effect.
        start: centres and widths of a first answer; by default random attributes.
        caution: see above, 0 or more; 0 makes every move whose mean gain is above 0.
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
    start_choices, scale_of = jnp.asarray(chosen.start), jnp.asarray(chosen.scale)
    scales = scale_of.max(axis=1) + 1
    # The first choice is the whole range, where intervals are allowed.
    has_whole = chosen.width[:, 0] == 1
    whole = jnp.asarray(has_whole)
    random = jnp.where(whole, 0, start_choices)
    # A start of random attributes is none.
    has_start = start is not None and bool((chosen.start.astype(bool) | ~has_whole).any())
    opening = 2 * OPENING if has_start and has_whole.any() else 2

    first_reach = FIRST_REACH if has_start else 1.0

    def with_answer(evidence: effects.EffectsState, reach: Array) -> IntervalsState:
        belief = effects.posterior(model, evidence)
        actions, rewards = (part[:opening] for part in evidence.history[:2])
        is_start = (actions == start_choices[None, :]).all(axis=1)
        start_mean = jnp.nanmean(jnp.where(is_start, rewards, jnp.nan))
        is_random = ((actions == random[None, :]) | ~whole[None, :]).all(axis=1) & ~is_start
        random_mean = jnp.nanmean(jnp.where(is_random, rewards, jnp.nan))
        only_random = jnp.isnan(start_mean) & jnp.isfinite(random_mean)  # the start always failed
        base = jnp.where((random_mean > start_mean) | only_random, random, start_choices)
        moved = best_by_lower_bound(model, belief, base, caution)
        answer = jnp.where(evidence.noise > 0, moved, base)
        return IntervalsState(evidence, belief, base, answer, reach)

    def proposed(actions: Array) -> Proposal:
        rows = jnp.arange(space.attributes)
        return Proposal(*(jnp.asarray(part)[rows, actions] for part in chosen[1:3]))

    def init(rng_key: RngKey) -> IntervalsState:
        del rng_key  # nothing is random before the first sample
        return with_answer(effects.init_effects(model), jnp.asarray(first_reach, jnp.float32))

    def sample(rng_key: RngKey, state: IntervalsState, n: int) -> tuple[Bins, Proposal]:
        keys = jax.random.split(rng_key, 7)
        draw_key, start_key, share_key, which_key, width_key, scale_key, open_key = keys
        weights = effects.draw_weights(draw_key, model, state.belief, n)
        share = state.reach * jax.random.choice(share_key, jnp.asarray(REACHES), (n, 1))
        chance = jax.random.uniform(which_key, (n, space.attributes), jnp.float32)
        # At least the one with the smallest random number.
        changes = (chance < share) | (chance == chance.min(axis=1, keepdims=True))
        scale = jnp.floor(
            jax.random.uniform(scale_key, chance.shape, jnp.float32) * scales[None, :]
        )
        of_scale = jnp.where(
            jax.random.uniform(width_key, chance.shape, jnp.float32)[..., None] < ONE_WIDTH,
            scale_of[None] == scale[..., None],
            scale_of[None] >= 0,
        )
        of_answer = jnp.arange(scale_of.shape[1])[None, None, :] == state.answer[None, :, None]
        allowed = jnp.where(changes[..., None], of_scale, of_answer)
        changed = maximise_each(start_key, chosen.space, model.layout, weights, allowed)
        count = state.evidence.history.evaluations
        turn = count + jnp.arange(n)[:, None]
        anywhere = random_bins(open_key, chosen.space, n)
        as_random = whole[None, :] if has_start else chance >= 0.5
        other = jnp.where(as_random, random[None, :], anywhere)
        first = jnp.where(turn % 2 == 0, start_choices[None, :], other)
        # An opening of two is the whole first update.
        is_opening = (turn if opening > 2 else count) < opening
        actions = jnp.where(is_opening, first, changed)
        return actions, proposed(actions)

    def update(
        state: IntervalsState, actions: Bins, rewards: Rewards
    ) -> tuple[IntervalsState, Info]:
        evidence = effects.observe(model, state.evidence, actions, rewards)
        expected = effects.value(model, state.evidence, state.belief, state.answer)
        signs = jnp.where(jnp.isfinite(rewards), (rewards > expected) - SUCCESS, 0.0)
        step = jnp.where(state.evidence.noise > 0, PACE * signs.sum(), 0.0)
        reach = jnp.clip(state.reach * jnp.exp(step), 1 / space.attributes, 1.0)
        info = basic_info(rewards, jnp.asarray(jnp.nan, jnp.float32))
        reach = jnp.where(state.evidence.history.evaluations < opening, first_reach, reach)
        state = with_answer(evidence, reach)
        is_start = (state.base == start_choices).all()
        state = state._replace(reach=jnp.where(is_start, reach, 1.0))
        finite = effects.is_finite(evidence, state.belief)
        return state, info._replace(clipped=evidence.history.clipped, finite=finite)

    def solution(state: IntervalsState) -> Proposal:
        return proposed(state.answer)

    def spread(state: IntervalsState) -> Proposal:
        moved = best_by_lower_bound(model, state.belief, state.base, max(SURE, caution))
        return proposed(jnp.where(state.evidence.noise > 0, moved, state.base))

    def probabilities(state: IntervalsState) -> Float[Array, "attributes bins"]:
        _, proposals = sample(jax.random.key(1), state, DRAWS)
        return shares_of_bins(space, proposals)

    def predict(state: IntervalsState, actions: Bins) -> tuple[Rewards, Rewards]:
        return effects.predict(model, state.evidence, state.belief, actions)

    return jit_method(init, sample, update, solution, probabilities, spread, predict=predict)


def _checked(space: Space, start: tuple[tuple[float, ...], tuple[float, ...]] | None) -> Start:
    """Check the start, by default random attributes; raise ValueError if it does not fit the space."""
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
    """Find the choices whose gain over the base has the highest lower confidence bound.

    Coordinate ascent: one attribute after the other takes the choice a with the largest

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
    mask = jnp.asarray(bin_mask(model.space))
    weights = effects.layout_weights(model, belief.mean)
    covariance = _layout_covariance(model, belief)

    def move(step: Array, actions: Array) -> Array:
        attribute = step % attributes
        change = basis[attribute] - basis[attribute, base[attribute]][None, :]
        partner = partners[attribute]  # `attributes` for padding
        cosines = basis[jnp.minimum(partner, attributes - 1)]
        cosines = cosines[jnp.arange(len(partner)), actions[partner], :short]
        cosines = jnp.where((partner < attributes)[:, None], cosines, 0.0)
        leading = jnp.einsum("cp,jq->cjpq", change[:, :short], cosines)
        pairs = jnp.where(leads[attribute][:, None, None], leading, leading.swapaxes(2, 3))
        changes = jnp.concatenate([change, pairs.reshape(len(change), -1)], axis=1)
        rows = features[attribute]
        block = covariance[rows[:, None], rows[None]]
        variance = jnp.einsum("cf,fg,cg->c", changes, block, changes)
        bound = changes @ weights[rows] - caution * jnp.sqrt(jnp.maximum(variance, 0.0))
        bound = jnp.where(mask[attribute], bound, -jnp.inf)
        best = jnp.argmax(bound).astype(jnp.int32)
        better = jnp.where(bound[best] > 0, best, base[attribute])
        return actions.at[attribute].set(better)

    return jax.lax.fori_loop(0, SWEEPS * attributes, move, base)


def _layout_covariance(model: effects.Effects, belief: Posterior) -> Float[Array, "layout layout"]:
    """Compute the covariance of the layout's weights, to which the shared weights are added."""
    covariance, size, shared = regression.covariance(belief), len(model.shared), model.shared
    mixed = covariance[:size, size:] @ shared.T
    return covariance[:size, :size] + mixed + mixed.T + shared @ covariance[size:, size:] @ shared.T


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
    pairs_of = [np.flatnonzero(np.any(layout.pairs == a, axis=1)) for a in range(attributes)]
    most = max(map(len, pairs_of), default=0)
    features = np.zeros((attributes, degree + most * size), np.int32)
    partners = np.full((attributes, most), attributes, np.int32)
    leads = np.zeros((attributes, most), bool)
    for a, pairs in enumerate(pairs_of):
        products = attributes * degree + pairs[:, None] * size + np.arange(size)
        rows = np.concatenate([a * degree + np.arange(degree), products.ravel()])
        features[a, : len(rows)] = rows
        partners[a, : len(pairs)] = layout.pairs[pairs].sum(axis=1) - a
        leads[a, : len(pairs)] = layout.pairs[pairs, 0] == a
    return features, partners, leads
