"""Moves away from where a search began that surely pay."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.models import regression
from sdr_jax.models.effects import Effects, plain
from sdr_jax.models.features import Features
from sdr_jax.models.regression import Posterior
from sdr_jax.relaxation import bin_mask

SWEEPS = 3
"""How often all attributes are gone over."""


def surely(
    model: Effects, belief: Posterior, began: Int[np.ndarray, "attributes"], caution: float
) -> Int[Array, "attributes"]:
    """Where it began, but for the attributes that a move surely helps.

    Attribute after attribute, the others where they then are: the choice a of the largest

        E[f(a) - f(start)] - caution * std[f(a) - f(start)]

    under the posterior of the model f; that of the start itself is 0.

    Args:
        model: the constants.
        belief: of its weights.
        began: the choices where it began.
        caution: 0 or more.

    Returns:
        Choices.
    """
    layout = model.layout
    basis, short = jnp.asarray(layout.basis), layout.pair_degree
    attributes = len(layout.basis)
    features, partners, leads = (jnp.asarray(table) for table in _tables(layout))
    there = jnp.asarray(bin_mask(model.space))
    weights = plain(model, belief.mean)
    covariance = _plain_covariance(model, belief)
    first = jnp.asarray(began)

    def move(step: Array, actions: Array) -> Array:
        attribute = step % attributes
        change = basis[attribute] - basis[attribute, first[attribute]][None, :]
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
        better = jnp.where(bound[best] > 0, best, first[attribute])
        return actions.at[attribute].set(better)

    return jax.lax.fori_loop(0, SWEEPS * attributes, move, first)


def _plain_covariance(model: Effects, belief: Posterior) -> Float[Array, "layout layout"]:
    """Of the layout's weights, what is shared handed out."""
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
    """Of each attribute: its features, its partners in pairs, and whether it comes first there."""
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
