"""The policy: a small network that maps random attribute values to a categorical over bins for each."""

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key


class Policy(nn.Module):
    """G_phi, the paper's three-layer MLP: N inputs, 256 hidden units with ReLU, N x K logits.

    Attributes:
        attributes: N, the number of attributes that are decided jointly.
        bins: K, the number of logits of each; `mask_logits` removes bins that an attribute lacks.
        hidden: hidden units.

    Source: section "Scalable Discretization-and-Relaxation", "Discretization-and-relaxation with MLP".
    """

    attributes: int
    bins: int
    hidden: int = 256

    @nn.compact
    def __call__(self, theta: Float[Array, "attributes"]) -> Float[Array, "attributes bins"]:
        """Map random attribute values theta in [0, 1] to logits."""
        hidden = nn.relu(nn.Dense(self.hidden)(theta))
        return nn.DenseGeneral((self.attributes, self.bins))(hidden)


def mask_logits(
    logits: Float[Array, "attributes bins"], mask: Bool[Array, "attributes bins"]
) -> Float[Array, "attributes bins"]:
    """Give bins outside the mask no probability and no gradient; each row must keep one bin."""
    return jnp.where(mask, logits, -jnp.inf)


def sample_bins(
    rng_key: Key[Array, ""], logits: Float[Array, "attributes bins"], n: int
) -> Int[Array, "n attributes"]:
    """Sample theta' ~ pi_phi(theta): each attribute's bin, n times; the key is consumed."""
    shape = (n, logits.shape[0])
    return jax.random.categorical(rng_key, logits, shape=shape).astype(jnp.int32)


def log_prob(
    logits: Float[Array, "attributes bins"], actions: Int[Array, "n attributes"]
) -> Float[Array, "n"]:
    """Compute the log-probability of joint actions, `log pi(theta') = sum_i log pi_i(theta'_i)`.

    Args:
        logits: f32[attributes bins]; minus infinity where an attribute lacks the bin.
        actions: bins theta', int[n attributes].

    Returns:
        f32[n].
    """
    attributes = jnp.arange(logits.shape[0])
    return jax.nn.log_softmax(logits)[attributes[None, :], actions].sum(axis=1)
