"""The policy: a small network from random attribute values to a categorical over bins for each."""

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key


class Policy(nn.Module):
    """The paper's three-layer MLP: N inputs, 256 hidden units with ReLU, N x K logits.

    Attributes:
        attributes: N, how many attributes are decided jointly.
        bins: K, the number of logits of each; `mask_logits` removes those an attribute lacks.
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
    """Gives bins outside the mask no probability and no gradient; each row must keep a bin."""
    return jnp.where(mask, logits, -jnp.inf)


def sample(
    rng_key: Key[Array, ""], logits: Float[Array, "attributes bins"], n: int
) -> Int[Array, "n attributes"]:
    """Samples each attribute's bin from its categorical, n times; the key is consumed."""
    shape = (n, logits.shape[0])
    return jax.random.categorical(rng_key, logits, shape=shape).astype(jnp.int32)


def log_prob(
    logits: Float[Array, "attributes bins"],
    actions: Int[Array, "n attributes"],
    present: Bool[Array, "attributes"],
) -> Float[Array, "n"]:
    """Log-probability of joint actions, `log pi(a) = sum_i log pi_i(a_i)` over present attributes.

    Args:
        logits: f32[attributes bins]; minus infinity where an attribute lacks the bin.
        actions: bins, int[n attributes]; ignored where an attribute is not present.
        present: bool[attributes], false for padding.

    Returns:
        f32[n].
    """
    log_probs = jax.nn.log_softmax(logits)
    rows = jnp.arange(logits.shape[0])
    picked = log_probs[rows[None, :], jnp.where(present[None, :], actions, 0)]
    return jnp.where(present[None, :], picked, 0.0).sum(axis=1)


def entropy(
    logits: Float[Array, "attributes bins"], present: Bool[Array, "attributes"]
) -> Float[Array, ""]:
    """Entropy in nats, `-sum_i sum_k pi_i(k) log pi_i(k)`, over the attributes present."""
    log_probs = jax.nn.log_softmax(logits)
    # Bins an attribute lacks: 0 log 0 is 0, also for gradients.
    log_probs = jnp.where(jnp.isneginf(log_probs), 0.0, log_probs)
    terms = -jax.nn.softmax(logits) * log_probs
    return jnp.where(present, terms.sum(axis=1), 0.0).sum()
