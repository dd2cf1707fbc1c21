"""The policy: a small network that maps random attribute values to a categorical over bins for each."""

from collections import defaultdict
from functools import partial

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from sdr_jax.space import Space


class Policy(nn.Module):
    """The paper's three-layer MLP: N inputs, 256 hidden units with ReLU, N x K logits.

    Attributes:
        attributes: N, the number of attributes that are decided jointly.
        bins: K, the number of logits of each; `mask_logits` removes bins that an attribute lacks.
        hidden: hidden units.

    Source: section "Scalable Discretization-and-Relaxation".
    """

    attributes: int
    bins: int
    hidden: int = 256

    @nn.compact
    def __call__(self, inputs: Float[Array, "attributes"]) -> Float[Array, "attributes bins"]:
        """Maps attribute values in [0, 1] to logits."""
        hidden = nn.relu(nn.Dense(self.hidden)(inputs))
        return nn.DenseGeneral((self.attributes, self.bins))(hidden)


def mask_logits(
    logits: Float[Array, "attributes bins"], mask: Bool[Array, "attributes bins"]
) -> Float[Array, "attributes bins"]:
    """Gives bins outside the mask no probability and no gradient; each row must keep one bin."""
    return jnp.where(mask, logits, -jnp.inf)


def sample_bins(
    rng_key: Key[Array, ""], logits: Float[Array, "attributes bins"], n: int
) -> Int[Array, "n attributes"]:
    """Samples each attribute's bin from its categorical, n times; the key is consumed."""
    shape = (n, logits.shape[0])
    return jax.random.categorical(rng_key, logits, shape=shape).astype(jnp.int32)


def log_prob(
    logits: Float[Array, "attributes bins"],
    actions: Int[Array, "n attributes"],
    valid_mask: Bool[Array, "attributes"],
) -> Float[Array, "n"]:
    """Log-probability of joint actions, `log pi(a) = sum_i log pi_i(a_i)` over valid attributes.

    Args:
        logits: f32[attributes bins]; minus infinity where an attribute lacks the bin.
        actions: bins, int[n attributes]; those of absent attributes are ignored.
        valid_mask: bool[attributes], false for padding.

    Returns:
        f32[n].
    """
    log_probs = jax.nn.log_softmax(logits)
    rows = jnp.arange(logits.shape[0])
    chosen = log_probs[rows[None, :], jnp.where(valid_mask[None, :], actions, 0)]
    return jnp.where(valid_mask[None, :], chosen, 0.0).sum(axis=1)


def entropy(
    logits: Float[Array, "attributes bins"], valid_mask: Bool[Array, "attributes"]
) -> Float[Array, ""]:
    """Entropy in nats, `-sum_i sum_k pi_i(k) log pi_i(k)`, over the valid attributes."""
    log_probs = jax.nn.log_softmax(logits)
    # For bins that an attribute lacks 0 log 0 is 0, also in gradients.
    log_probs = jnp.where(jnp.isneginf(log_probs), 0.0, log_probs)
    terms = -jax.nn.softmax(logits) * log_probs
    return jnp.where(valid_mask, terms.sum(axis=1), 0.0).sum()


def init_policies(
    rng_key: Key[Array, ""], space: Space, hidden: int
) -> tuple[PyTree[Array], Float[Array, "groups size"]]:
    """Initialises every group's policy at its own size, pads and stacks them.

    Padding is exact: a padded policy has the parameters of the policy of its own size, with zeros around
    them. Zero inputs and masked logits give these zeros no gradient, so they stay zero.

    Args:
        rng_key: consumed.
        space: the attribute space.
        hidden: hidden units of each policy.

    Returns:
        The parameters, with a leading groups axis on every leaf, for `Policy(size, max_bins)`;
        and the policies' inputs, random attribute values in [0, 1), zero where padded.
    """
    alike: dict[tuple[int, int], list[int]] = defaultdict(list)  # groups that share a compilation
    for index, group in enumerate(space.groups):
        alike[len(group), max(space.bins[attribute] for attribute in group)].append(index)
    size = max(map(len, space.groups))
    shapes = jax.eval_shape(lambda key: _init_policy(key, size, space.max_bins, hidden), rng_key)
    keys = jax.random.split(rng_key, len(space.groups))
    parts = []
    for (attributes, bins), indices in alike.items():
        init_group = partial(_init_policy, attributes=attributes, bins=bins, hidden=hidden)
        part = jax.vmap(init_group)(keys[np.asarray(indices)])
        parts.append(jax.tree.map(_pad, part, shapes))
    order = np.argsort(np.concatenate(list(alike.values())))
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[order], *parts)


def _init_policy(
    rng_key: Key[Array, ""], attributes: int, bins: int, hidden: int
) -> tuple[PyTree[Array], Float[Array, "attributes"]]:
    input_key, params_key = jax.random.split(rng_key)
    inputs = jax.random.uniform(input_key, (attributes,))
    return Policy(attributes, bins, hidden).init(params_key, inputs), inputs


def _pad(stacked: Array, like: jax.ShapeDtypeStruct) -> Array:
    sizes = zip(stacked.shape[1:], like.shape, strict=True)
    return jnp.pad(stacked, [(0, 0), *((0, to - size) for size, to in sizes)])
