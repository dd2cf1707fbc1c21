"""A step of a policy over streets, from the reward of every street of a round.

A round draws N streets from the policy. The regression of their rewards on the streets' statistics is the
natural policy gradient (`docs/method.md`), and the policy follows it as far as a trust region allows. The
policy is the paper's, a categorical over bins for each attribute, or a mixture of two of them: one begins
uniform, the other at a start.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.nn import logsumexp
from jaxtyping import Array, Float, Int

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.models import regression
from sdr_jax.models.history import lowest
from sdr_jax.models.regression import Centred
from sdr_jax.relaxation import (
    bin_centres,
    check_relaxation,
    entropy,
    moments,
    relax,
    shares_of_bins,
    uniform,
)
from sdr_jax.space import Proposal, Space, Width

FLOOR = 0.05
"""Share of every distribution that stays uniform: a bin keeps at least 0.05 / K."""

SIGNALS = np.append(0.0, np.geomspace(1e-6, 300, 18)).astype(np.float32)
"""Prior variances of an effect relative to the noise's; the evidence chooses one. 0 means no effect."""

STRONG = 3.0
"""The evidence in nats from which a step has its full length. Odds of 20 are commonly called strong."""

TINY = 1e-30
"""It is smaller than any squared effect and keeps denominators above 0."""

WEYL = np.uint32(2654435769)
"""2^32 times the golden ratio less one: its multiples, modulo 2^32, are spread evenly."""


class PoolState(NamedTuple):
    """The policy, and the sums of all rewards so far."""

    logits: Float[Array, "components attributes bins"]  # without the uniform part
    balance: Float[Array, "components"]  # logits of the shares, without the uniform part
    data: Centred  # of the regression, centred within each pool
    drawn: Int[Array, ""]  # number of streets drawn so far


class Policy(NamedTuple):
    """A mixture of distributions over streets; in each one the attributes are independent."""

    shares: Float[Array, "components"]  # of the streets; they add up to 1
    probabilities: Float[Array, "components attributes bins"]  # rows add up to 1


def pool(
    space: Space,
    width: Width = None,
    *,
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    bound: float = 0.04,
) -> Method:
    """A natural policy gradient with a trust region.

    An action is a street's bins. `update` regresses rewards on the statistics of their streets: u and
    (u - 1/2)^2 of an ordered attribute, the bins of one without order, less their means in the street's
    component; and the component. Sums of all rounds are kept, with an intercept for each round. The evidence
    chooses the ridge.

    The new policy is the old one times exp(eta e . statistics), with eta as large as
    KL(new, old) <= `bound` times the number of attributes allows. If the evidence for any effect is below
    three nats, eta is smaller in proportion, so that pure noise hardly moves the policy.

    Args:
        space: the attributes and their bins; groups play no part.
        width: width of the relaxed bins, see `relax`.
        start: centres and widths of a second component, from which half of the first streets are drawn.
        bound: the largest KL of a step for each attribute, in nats.

    Returns:
        The method, for any number of updates.

    Raises:
        ValueError: an option out of range, or a start of other attributes.

    Source: not in the paper; Kakade 2001, "A Natural Policy Gradient"; Peters et al. 2010, "Relative Entropy
    Policy Search"; Abdolmaleki et al. 2015, "Model-Based Relative Entropy Stochastic Search".
    """
    if not (bound > 0 and np.isfinite(bound)):
        raise ValueError(f"bound is {bound}, but must be above 0")
    check_relaxation(space, width, "random")
    table = jnp.asarray(basis(space))
    first = _first(space, start)
    components = len(first)
    floor = FLOOR * uniform(space)[None]

    def init(rng_key: RngKey) -> PoolState:
        del rng_key  # nothing is random before the first sample
        size = table.shape[-1] + components
        gram, moment, zero = jnp.zeros((size, size)), jnp.zeros(size), jnp.zeros(())
        data = Centred(gram, moment, zero, zero)
        # Bins outside the start can grow, too.
        logits = jnp.log(floor + (1 - FLOOR) * first)
        return PoolState(logits, jnp.zeros(components), data, jnp.zeros((), jnp.int32))

    def policy_of(state: PoolState) -> Policy:
        own = jax.nn.softmax(state.logits)
        shares = FLOOR / components + (1 - FLOOR) * jax.nn.softmax(state.balance)
        return Policy(shares, floor + (1 - FLOOR) * own)

    def turns(state: PoolState, n: int) -> Int[Array, "n"]:
        """The component of each of the next n streets; components take turns by their shares."""
        place = (state.drawn.astype(jnp.uint32) + jnp.arange(1, n + 1, dtype=jnp.uint32)) * WEYL
        ends = jnp.cumsum(policy_of(state).shares)[:-1]
        return jnp.searchsorted(ends, place.astype(jnp.float32) / 2.0**32, side="right")

    def sample(rng_key: RngKey, state: PoolState, n: int) -> tuple[Bins, Proposal]:
        logits = jnp.log(policy_of(state).probabilities)[turns(state, n)]
        actions = jax.random.categorical(rng_key, logits).astype(jnp.int32)
        return actions, relax(space, actions, width)

    def statistics(state: PoolState, actions: Bins) -> Float[Array, "n features"]:
        means = expected(table, policy_of(state).probabilities)
        of = turns(state, len(actions))
        parts = jax.nn.one_hot(of, components) * np.sqrt(components)
        return jnp.concatenate([of_streets(table, actions) - means[of], parts], axis=1)

    def update(state: PoolState, actions: Bins, rewards: Rewards) -> tuple[PoolState, Info]:
        x = statistics(state, actions)
        least = lowest(rewards)
        data = counted(state.data, x, jnp.maximum(rewards, least))
        effects, evidence = effects_of(data)
        before = policy_of(state)

        def moved(eta: Array) -> PoolState:
            values = (table @ effects[:-components])[None]  # of every bin
            means = (before.probabilities * values).sum(axis=(1, 2))
            all_ = jnp.broadcast_to(eta * values, before.probabilities.shape)
            grown = logsumexp(all_, axis=2, b=before.probabilities).sum(axis=1)
            gain = eta * (np.sqrt(components) * effects[-components:] - means) + grown
            logits = jax.nn.log_softmax(state.logits + eta * values)
            balance = jax.nn.log_softmax(state.balance + gain)
            return state._replace(logits=logits, balance=balance)

        limit = bound * space.attributes * jnp.minimum(evidence / STRONG, 1.0)
        eta = _largest(lambda eta: divergence(policy_of(moved(eta)), before), limit, effects)
        info = plain_info(rewards, entropy(marginal(before)))
        clipped = jnp.sum(rewards < least, dtype=jnp.int32)
        new = moved(eta)._replace(data=data, drawn=state.drawn + len(actions))
        return new, info._replace(clipped=clipped, grad_norm=jnp.linalg.norm(effects))

    def probabilities(state: PoolState) -> Float[Array, "attributes bins"]:
        return marginal(policy_of(state))

    def solution(state: PoolState) -> Proposal:
        return moments(space, probabilities(state), width)

    method = jitted(init, sample, update, solution, probabilities)
    return method._replace(policy=jax.jit(policy_of))


def basis(space: Space) -> Float[np.ndarray, "attributes bins features"]:
    """The statistics of every bin: two of an ordered attribute, one per bin of one without order.

    Each has mean 0 and variance 1 under the uniform distribution. A bin's statistics of other attributes
    are 0, so that a street's statistics are the sum over its bins.
    """
    centres = bin_centres(space)
    columns = []
    for attribute, count in enumerate(space.bins):
        for column in _columns(space, attribute, centres[attribute, :count]):
            values = np.zeros(centres.shape, np.float32)
            values[attribute, :count] = (column - column.mean()) / column.std()
            columns.append(values)
    return np.stack(columns, axis=-1)


def _columns(space: Space, attribute: int, u: np.ndarray) -> list[np.ndarray]:
    """The raw statistics of an attribute's bins; the square is left out for two bins."""
    if attribute in space.unordered:
        return list(np.eye(len(u)))
    return [u, (u - 0.5) ** 2][: len(u) - 1]


def of_streets(
    table: Float[Array, "attributes bins features"], actions: Bins
) -> Float[Array, "n features"]:
    """The statistics of streets."""
    return jnp.einsum("nab,abf->nf", jax.nn.one_hot(actions, table.shape[1]), table)


def expected(
    table: Float[Array, "attributes bins features"],
    probabilities: Float[Array, "components attributes bins"],
) -> Float[Array, "components features"]:
    """The mean statistics of each component's streets."""
    return jnp.einsum("zab,abf->zf", probabilities, table)


def counted(data: Centred, x: Float[Array, "n features"], rewards: Rewards) -> Centred:
    """The sums with one more round, centred by its means; failed rewards are left out."""
    known = jnp.isfinite(rewards)[:, None]
    both = jnp.where(known, jnp.concatenate([x, rewards[:, None]], axis=1), 0.0)
    seen = known.sum()
    both = jnp.where(known, both - both.sum(axis=0, keepdims=True) / jnp.maximum(seen, 1), 0.0)
    x, y = both[:, :-1], both[:, -1]
    freedom = jnp.maximum(seen - 1, 0)
    return jax.tree.map(
        jnp.add, data, Centred(x.T @ x, x.T @ y, y @ y, freedom.astype(jnp.float32))
    )


def effects_of(data: Centred) -> tuple[Float[Array, "features"], Float[Array, ""]]:
    """The mean effects under the most likely prior, all 0 where no effect is more likely.

    Returns:
        The effects; and the log odds of that prior against no effect, in nats.
    """
    stds = jnp.sqrt(jnp.asarray(SIGNALS))[:, None] * jnp.ones((1, len(data.moment)))
    belief, _, evidence = regression.with_evidence(data, stds)
    return belief.mean, evidence.max() - evidence[0]


def marginal(policy: Policy) -> Float[Array, "attributes bins"]:
    """Every attribute's distribution, averaged over the components."""
    return jnp.einsum("z,zab->ab", policy.shares, policy.probabilities)


def divergence(new: Policy, old: Policy) -> Float[Array, ""]:
    """KL(new, old) of the joint distribution of component and street, in nats."""
    of_streets = _relative(new.probabilities, old.probabilities).sum(axis=(1, 2))
    return _relative(new.shares, old.shares).sum() + jnp.dot(new.shares, of_streets)


def _relative(new: Array, old: Array) -> Array:
    there = old > 0
    return jnp.where(there, new * jnp.log(jnp.where(there, new / old, 1.0)), 0.0)


def _largest(
    cost: Callable[[Array], Array], limit: Float[Array, ""], effects: Float[Array, "features"]
) -> Float[Array, ""]:
    """Finds the largest eta whose cost is within the limit by bisection; 0 without effects."""
    size = jnp.linalg.norm(effects)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        fits = cost(middle) <= limit
        return jnp.where(fits, middle, low), jnp.where(fits, high, middle)

    most = jnp.where(size > 0, 100.0 / jnp.maximum(size, TINY), 0.0)
    return jax.lax.fori_loop(0, 40, halve, (jnp.zeros(()), most))[0]


def _first(
    space: Space, start: tuple[tuple[float, ...], tuple[float, ...]] | None
) -> Float[np.ndarray, "components attributes bins"]:
    """The distributions that the search begins with."""
    if start is None:
        return np.asarray(uniform(space))[None]
    centre, width = (np.asarray(part, np.float32) for part in start)
    if centre.shape != (space.attributes,) or width.shape != centre.shape:
        raise ValueError(
            f"start has {centre.size} attributes, not the {space.attributes} of the space"
        )
    own = shares_of_bins(space, Proposal(jnp.asarray(centre[None]), jnp.asarray(width[None])))
    return np.stack([np.asarray(uniform(space)), np.asarray(own)])
