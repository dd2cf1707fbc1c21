"""REINFORCE: the gradient of an expected score that can only be sampled."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def reinforce_loss(log_probs: Float[Array, "n"], advantages: Float[Array, "n"]) -> Float[Array, ""]:
    """The loss whose descent direction is the REINFORCE estimate.

    Data sets whose advantage is NaN are left out, and n counts the others.

    `-grad loss = 1/n sum_k grad log pi(a_k) advantage_k`, an unbiased estimate of the gradient of
    the expected reward when `advantage_k = reward_k - b` and b does not depend on a_k.

    Args:
        log_probs: log pi(a_k) of each data set's actions, f32[n].
        advantages: reward minus baseline of each data set, f32[n]; no gradient flows into them.

    Returns:
        The loss; its value means nothing, its gradient does.

    Source: section "Scalable Discretization-and-Relaxation", second equation (there the number of
        data sets n is called K); Williams 1992.
    """
    known = ~jnp.isnan(advantages)
    weights = jax.lax.stop_gradient(jnp.where(known, advantages, 0.0))
    return -jnp.sum(log_probs * weights) / jnp.maximum(known.sum(), 1)
