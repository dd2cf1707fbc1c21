"""Features of bins for models that are linear in their weights, and the best bins under such a model."""

import math
from functools import partial
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sdr_jax.bins import bin_mask, ordered, random_bins
from sdr_jax.space import Space

STARTS = 8
"""Starts of coordinate ascent: one at the best main effect of each attribute, the others random."""

PAIR_FEATURES = 256
"""The approximate number of features of all interactions together; it sets their `pair_degree`."""

MOST_PAIRS = 700
"""A space with more pairs of attributes in groups is modelled without interactions."""

MOST_FEATURES = 4096
"""The most features of all pairs: a model keeps two square matrices of this size."""

SWEEPS = 4
"""Number of times that coordinate ascent goes over all attributes."""


class Features(NamedTuple):
    """The features of a space (constants): main effects of attributes first, then interactions of pairs."""

    basis: Float[np.ndarray, "attributes bins degree"]  # cosines of each bin
    pairs: Int[np.ndarray, "pairs 2"]  # which attributes interact
    pair_degree: int  # cosines of each attribute in a pair
    variance: Float[np.ndarray, "features"]  # of the prior, up to a factor; 0 for no such feature


def check_degrees(degree: int, pair_degree: int) -> None:
    """Raise ValueError unless the numbers of cosines, of main effects and in pairs, are in range."""
    if degree < 1:
        raise ValueError(f"degree is {degree}, but must be at least 1")
    if not 0 <= pair_degree <= degree:
        raise ValueError(f"pair_degree is {pair_degree}, but must lie in [0, degree = {degree}]")


def main_variances(space: Space, degree: int) -> Float[np.ndarray, "attributes columns"]:
    """The prior variances of main effects' cosines, up to a factor; 0 for cosines that an attribute lacks.

    That of the m-th cosine is 1 / m^2. K bins without an order have all K - 1 cosines, with 1 each: all bins
    are then equally different, as with one-hot features. Ordered ones have `degree`, at most K - 1.
    """
    in_order, bins = ordered(space)[:, None], np.asarray(space.bins)[:, None]
    finest = max([degree, *(space.bins[attribute] - 1 for attribute in space.unordered)])
    orders = np.arange(1, finest + 1, dtype=np.float32)[None, :]
    has_cosine = (orders < bins) & ((orders <= degree) | ~in_order)
    return has_cosine * np.where(in_order, 1 / orders**2, 1.0).astype(np.float32)


def lay_out(
    space: Space,
    basis: Float[np.ndarray, "attributes bins columns"],
    variances: Float[np.ndarray, "attributes columns"],
    pair_degree: int,
) -> Features:
    """Lay out the features of a basis with prior variances, and their products within groups.

    The variance of a product is the product of the variances of its factors.

    Raises:
        ValueError: too many products.
    """
    pairs = [pair for group in space.groups for pair in combinations(group, 2)]
    if len(pairs) * pair_degree**2 > MOST_FEATURES:
        raise ValueError(
            f"pair_degree is {pair_degree}, which makes {len(pairs) * pair_degree**2} features of "
            f"{len(pairs)} pairs of attributes in groups; at most {MOST_FEATURES} are allowed: lower "
            "pair_degree (0 for no interactions), or make the groups smaller"
        )
    if pair_degree == 0:
        pairs = []
    i, j = np.asarray(pairs, np.int32).reshape(-1, 2).T
    products = variances[i, :pair_degree, None] * variances[j, None, :pair_degree]
    variance = np.concatenate([variances.ravel(), products.ravel()])
    return Features(
        basis.astype(np.float32),
        np.asarray(pairs, np.int32).reshape(-1, 2),
        pair_degree,
        variance.astype(np.float32),
    )


def affordable(space: Space, degree: int) -> int:
    """Choose the cosines of each attribute in interactions, so that these have about 256 features; or 0.

    For many attributes in one group, a model without interactions is about as good and far cheaper.
    """
    pairs = sum(len(group) * (len(group) - 1) // 2 for group in space.groups)
    if pairs > MOST_PAIRS:
        return 0
    return min(degree, max(space.bins) - 1, max(1, math.isqrt(PAIR_FEATURES // max(pairs, 1))))


def evaluate(layout: Features, actions: Int[Array, "n attributes"]) -> Float[Array, "n features"]:
    """Compute the features of data sets from their bins."""
    n, attributes = actions.shape
    rows = jnp.arange(attributes)
    cosines = jnp.asarray(layout.basis)[rows[None, :], actions]  # [n attributes degree]
    short = cosines[:, :, : layout.pair_degree]
    first, second = short[:, layout.pairs[:, 0]], short[:, layout.pairs[:, 1]]
    products = first[:, :, :, None] * second[:, :, None, :]
    return jnp.concatenate([cosines.reshape(n, -1), products.reshape(n, -1)], axis=1)


def split(layout: Features, weights: Array) -> tuple[Array, Array]:
    """Split a model's weights into the main effect of each bin, and symmetric interactions.

    Returns:
        f32[attributes bins] and f32[attributes attributes pair_degree pair_degree].
    """
    attributes, _, degree = layout.basis.shape
    short = layout.pair_degree
    main_weights = weights[: attributes * degree].reshape(attributes, degree)
    main = jnp.einsum("abd,ad->ab", jnp.asarray(layout.basis), main_weights)
    blocks = weights[attributes * degree :].reshape(len(layout.pairs), short, short)
    i, j = layout.pairs.T
    zeros = jnp.zeros((attributes, attributes, short, short), weights.dtype)
    return main, zeros.at[i, j].set(blocks).at[j, i].set(blocks.transpose(0, 2, 1))


def maximise(
    rng_key: Key[Array, ""],
    space: Space,
    layout: Features,
    weights: Float[Array, "features"],
    allowed: Bool[Array, "attributes bins"] | None = None,
) -> Int[Array, "attributes"]:
    """Find the best bins under a model, by coordinate ascent from several starts.

    Args:
        rng_key: consumed, for the starts.
        space: the attribute space.
        layout: its features.
        weights: the model.
        allowed: bins to choose from, at least one of each attribute; by default all.

    Returns:
        The bins of the best local optimum found.
    """
    main, interactions = split(layout, weights)
    basis = jnp.asarray(layout.basis)[:, :, : layout.pair_degree]
    rows = jnp.arange(space.attributes)
    mask = jnp.asarray(bin_mask(space)) if allowed is None else allowed
    first = jnp.where(mask, main, -jnp.inf).argmax(axis=1)
    random = random_bins(rng_key, space, STARTS - 1)
    starts = jnp.concatenate([first[None, :].astype(jnp.int32), random])

    def ascend(actions: Array) -> tuple[Array, Array]:
        def move(step: Array, actions: Array) -> Array:
            attribute = step % space.attributes
            pull = jnp.einsum("jpq,jq->p", interactions[attribute], basis[rows, actions])
            values = main[attribute] + basis[attribute] @ pull
            values = jnp.where(mask[attribute], values, -jnp.inf)
            return actions.at[attribute].set(jnp.argmax(values).astype(jnp.int32))

        actions = jax.lax.fori_loop(0, SWEEPS * space.attributes, move, actions)
        cosines = basis[rows, actions]
        pairs = 0.5 * jnp.einsum("ip,ijpq,jq->", cosines, interactions, cosines)
        return actions, main[rows, actions].sum() + pairs

    optima, values = jax.vmap(ascend)(starts)
    return optima[jnp.argmax(values)]


def maximise_each(
    rng_key: Key[Array, ""],
    space: Space,
    layout: Features,
    weights: Float[Array, "n features"],
    allowed: Bool[Array, "n attributes bins"] | None = None,
) -> Int[Array, "n attributes"]:
    """Find the best allowed bins under each of n models; the key is consumed."""
    keys = jax.random.split(rng_key, len(weights))
    return jax.vmap(partial(maximise, space=space, layout=layout))(
        keys, weights=weights, allowed=allowed
    )
