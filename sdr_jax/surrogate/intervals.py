"""A search over intervals that leaves each attribute where it began unless moving it surely pays."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float, Int

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.space import Proposal, Space, Width
from sdr_jax.surrogate import regression
from sdr_jax.surrogate.choices import Start, choices, layout_of
from sdr_jax.surrogate.features import Features, evaluate, maximise_each
from sdr_jax.surrogate.regression import Posterior, Statistics

SIGNALS = np.geomspace(0.003, 30, 7).astype(np.float32)
PAIRS = np.asarray([0.0, 0.1, 1.0], np.float32)
"""Prior variances of an effect, relative to the noise's, and of an interaction, relative to an effect's; the
evidence chooses among them."""

SHARES = np.asarray([0.3, 0.6, 1.0], np.float32)
"""Shares of attributes that a data set tries anew; the others stay at the answer so far."""

SWEEPS = 3
"""How often the answer is gone over, attribute by attribute."""

SURE = 2.0
"""Standard deviations by which a move must pay to be in `spread`."""

DRAWS = 64
"""Draws from the posterior behind `probabilities`."""


class IntervalsState(NamedTuple):
    """What the regression has learnt."""

    statistics: Statistics
    belief: Posterior  # of the weights
    answer: Int[Array, "attributes"]  # choices


def intervals(
    space: Space,
    width: Width = None,
    *,
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    caution: float = 0.3,
    degree: int = 6,
    pair_degree: int = 2,
) -> Method:
    """Which attributes to narrow, and to what, by a Bayesian regression on what intervals have in them.

    Actions are intervals of [0, 1] of widths 1 to 1/8 (`choices`), or the attribute's own in `start`; bins
    and their relaxation play no part. The reward of a data set is modelled as linear in its density,

        y = b + sum_i w_i . phi(c_i, w_i) + sum_{i<j in a group} phi(i) W_ij phi(j) + noise

    with cosines integrated over the interval and one term for its narrowness (`choices.integrated`), so
    data sets of any width teach one model. How large effects and interactions are, beside the noise, is
    chosen by the evidence at every update.

    The first data sets are the start's and random ones, alternately. After them each is the answer so far
    with a random share of its attributes changed, to what is best under a draw of the posterior (Thompson
    sampling).

    The answer is the start, but for the attributes of which a choice is better than the start's by more than
    `caution` standard deviations of that difference. In `spread` it must be by two.

    Args:
        space: the attributes, and the groups whose members may interact.
        width: plays no part.
        start: centres and widths of where to begin; by default random attributes.
        caution: see above, 0 or more; 0 moves wherever it pays on average.
        degree: cosines per attribute.
        pair_degree: cosines per attribute in interactions; fewer, or none, where groups are large.

    Returns:
        The method, for any number of updates; `entropy` in its info is NaN.

    Raises:
        ValueError: an option out of range, or a start of other attributes.

    Source: not in the paper; Thompson 1933; MacKay 1992, "Bayesian interpolation".
    """
    del width
    if not (caution >= 0 and np.isfinite(caution)):
        raise ValueError(f"caution is {caution}, but must be 0 or more")
    first = _checked(space, start)
    chosen = choices(space, first)
    layout = layout_of(chosen, degree, pair_degree)
    own = space.attributes * layout.basis.shape[2]
    size = len(layout.variance)
    began = jnp.full(space.attributes, chosen.centre.shape[1] - 1, jnp.int32)
    among = np.where(np.arange(size) < own, 1.0, PAIRS[:, None]).astype(np.float32)
    priors = SIGNALS[:, None, None] * among * layout.variance
    stds = jnp.sqrt(jnp.asarray(priors.reshape(-1, size)))

    def fitted(statistics: Statistics) -> IntervalsState:
        belief = regression.by_evidence(regression.centred(statistics), stds)
        moved = surely(layout, belief, began, caution)
        # Two rewards make a difference.
        return IntervalsState(statistics, belief, jnp.where(statistics.seen > 1, moved, began))

    def proposed(actions: Array) -> Proposal:
        rows = jnp.arange(space.attributes)
        return Proposal(*(jnp.asarray(part)[rows, actions] for part in chosen[1:]))

    def init(rng_key: RngKey) -> IntervalsState:
        del rng_key  # nothing is random before the first sample
        return fitted(regression.empty(size))

    def sample(rng_key: RngKey, state: IntervalsState, n: int) -> tuple[Bins, Proposal]:
        draw_key, start_key, share_key, which_key = jax.random.split(rng_key, 4)
        weights = regression.draw(draw_key, state.belief, n)
        best = maximise_each(start_key, chosen.space, layout, weights)
        share = jax.random.choice(share_key, jnp.asarray(SHARES), (n, 1))
        anew = jax.random.uniform(which_key, best.shape) < share
        changed = jnp.where(anew, best, state.answer[None, :])
        turn = (state.statistics.seen.astype(jnp.int32) + jnp.arange(n)) % 2
        opening = jnp.where(turn[:, None] == 0, began[None, :], 0)
        actions = jnp.where(state.statistics.seen > 1, changed, opening)
        return actions, proposed(actions)

    def update(
        state: IntervalsState, actions: Bins, rewards: Rewards
    ) -> tuple[IntervalsState, Info]:
        statistics = regression.add(state.statistics, evaluate(layout, actions), rewards)
        return fitted(statistics), plain_info(rewards, jnp.asarray(jnp.nan, jnp.float32))

    def solution(state: IntervalsState) -> Proposal:
        return proposed(state.answer)

    def spread(state: IntervalsState) -> Proposal:
        moved = surely(layout, state.belief, began, max(SURE, caution))
        return proposed(jnp.where(state.statistics.seen > 1, moved, began))

    def probabilities(state: IntervalsState) -> Float[Array, "attributes bins"]:
        _, tried = sample(jax.random.key(1), state, DRAWS)
        return shares_of_bins(space, tried)

    return jitted(init, sample, update, solution, probabilities, spread)


def surely(
    layout: Features, belief: Posterior, began: Int[Array, "attributes"], caution: float
) -> Int[Array, "attributes"]:
    """Where it began, but for the attributes that a move surely helps.

    Attribute after attribute, the others where they then are: the choice a of the largest

        E[f(a) - f(start)] - caution * std[f(a) - f(start)]

    under the posterior of the model f; that of the start itself is 0.
    """
    basis = jnp.asarray(layout.basis)
    attributes, _, degree = basis.shape
    first, second = (jnp.asarray(own) for own in layout.pairs.T)
    short = layout.pair_degree

    def difference(attribute: Array, actions: Array) -> Array:
        """Features f32[choices, features] of an attribute's choices less those of where it began."""
        change = basis[attribute] - basis[attribute, began[attribute]][None, :]
        alone = jnp.zeros((change.shape[0], attributes, degree)).at[:, attribute].set(change)
        at = basis[jnp.arange(attributes), actions, :short]
        mine = change[:, :short]
        one = (first == attribute)[:, None] * at[second]
        other = (second == attribute)[:, None] * at[first]
        pairs = jnp.einsum("cp,jq->cjpq", mine, one) + jnp.einsum("jp,cq->cjpq", other, mine)
        return jnp.concatenate(
            [alone.reshape(len(change), -1), pairs.reshape(len(change), -1)], axis=1
        )

    def move(step: Array, actions: Array) -> Array:
        attribute = step % attributes
        changes = difference(attribute, actions)
        whitened = solve_triangular(belief.factor, (belief.scale[None, :] * changes).T, lower=True)
        std = jnp.linalg.norm(whitened, axis=0)
        bound = changes @ belief.mean - caution * std
        best = jnp.argmax(bound).astype(jnp.int32)
        better = jnp.where(bound[best] > 0, best, began[attribute])
        return actions.at[attribute].set(better)

    return jax.lax.fori_loop(0, SWEEPS * attributes, move, began)


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
