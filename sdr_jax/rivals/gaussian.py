"""A Gaussian policy without bins under REINFORCE, as in *Learning to Simulate* and *Meta-Sim*."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float

from sdr_jax import trees
from sdr_jax.baseline import Baseline
from sdr_jax.bins import bin_mask, ordered
from sdr_jax.distributions import moments
from sdr_jax.method import Info, Method, Rewards, RngKey, Values, basic_info, jit_method
from sdr_jax.reinforce import Learner, Rule, adam, init_learner, learn
from sdr_jax.relaxation import bin_widths, check_relaxation, slide
from sdr_jax.space import Proposal, Space, Width
from sdr_jax.variance_reduction import baseline_of


class GaussianParams(NamedTuple):
    """One normal distribution per attribute for the logit of its value."""

    mean: Float[Array, "attributes"]
    log_std: Float[Array, "attributes"]


def gaussian(
    space: Space,
    *,
    width: Width = None,
    learning_rate: float | optax.GradientTransformation = 0.1,
    baseline: str | Baseline = "leave_one_out",
    normalise: bool = True,
    std: float = 1.5,
) -> Method:
    """REINFORCE on the mean and spread of a Gaussian per attribute; actions are continuous.

        z ~ N(mean, std^2),   value = 1 / (1 + exp(-z))

    The logit keeps values inside [0, 1] without clipping, whose gradient would vanish. A proposal is the
    value, relaxed like a bin; bins without an order are taken as if they had one. The answer is the value
    of the mean. Groups have no effect: all attributes are optimised at once, as in the original.

    Args:
        space: the attributes; their bins set the width of proposals only.
        width: width of the proposals, see `relax`.
        learning_rate: Adam's, or any optax transformation in its place.
        baseline: as for `sdr`; "leave_one_out" needs two or more data sets per update, "ema" takes one.
        normalise: whether to divide advantages by their root mean square, so that the scale of rewards has
            no effect.
        std: initial standard deviation of the logits; 1.5 is close to uniform on [0, 1].

    Returns:
        The method, for any number of updates; actions are the logits z, f32.

    Raises:
        ValueError: an option out of range.

    Source: the paper's "Difference with learning to simulate and meta-sim"; Ruiz et al. 2019,
        "Learning to simulate"; Kar et al. 2019, "Meta-Sim".
    """
    if not (std > 0 and np.isfinite(std)):
        raise ValueError(f"std is {std}, but must be above 0")
    check_relaxation(space, width, "random")
    widths = bin_widths(space, width)
    quantiles = np.asarray(ndtri((jnp.arange(64) + 0.5) / 64))  # of the standard normal
    rule = Rule(adam(learning_rate), baseline_of(baseline), normalise)

    def init(rng_key: RngKey) -> Learner:
        del rng_key  # nothing is random before the first sample
        zeros = jnp.zeros(space.attributes, jnp.float32)
        params = GaussianParams(zeros, jnp.full_like(zeros, np.log(std)))
        return init_learner(rule, params)

    def sample(rng_key: RngKey, state: Learner, n: int) -> tuple[Values, Proposal]:
        mean, log_std = state.params
        noise = jax.random.normal(rng_key, (n, space.attributes), jnp.float32)
        actions = mean[None, :] + jnp.exp(log_std)[None, :] * noise
        relaxed = slide(jax.nn.sigmoid(actions), jnp.broadcast_to(widths, actions.shape))
        return actions, _snap(space, relaxed)

    def update(state: Learner, actions: Values, rewards: Rewards) -> tuple[Learner, Info]:
        entropy = jnp.sum(state.params.log_std + 0.5 * np.log(2 * np.pi * np.e))
        info = basic_info(rewards, entropy)
        return learn(rule, state, lambda params: _log_prob(params, actions), rewards, info)

    def solution(state: Learner) -> Proposal:
        return _snap(space, slide(jax.nn.sigmoid(state.params.mean), widths))

    def spread(state: Learner) -> Proposal:
        mean, log_std = state.params
        logits = mean[:, None] + jnp.exp(log_std)[:, None] * quantiles[None, :]
        values = jax.nn.sigmoid(logits)
        wide = slide(values.mean(axis=1), jnp.sqrt(12 * values.var(axis=1) + widths**2))
        return trees.where(
            jnp.asarray(ordered(space)), wide, moments(space, probabilities(state), width)
        )

    def probabilities(state: Learner) -> Float[Array, "attributes bins"]:
        mean, log_std = state.params
        upper = jax.scipy.special.logit(jnp.asarray(_upper_edges(space)))
        below = ndtr((upper - mean[:, None]) / jnp.exp(log_std)[:, None])
        return jnp.diff(below, prepend=0.0, axis=1) * bin_mask(space)

    return jit_method(init, sample, update, solution, probabilities, spread)


def _snap(space: Space, proposal: Proposal) -> Proposal:
    """Move attributes without an order to the bin in which their centre lies; others stay."""
    shape = proposal.centre.shape
    bins = jnp.broadcast_to(jnp.asarray(space.bins, jnp.float32), shape)
    in_order = jnp.broadcast_to(ordered(space), shape)
    centre = (jnp.clip(jnp.floor(proposal.centre * bins), 0, bins - 1) + 0.5) / bins
    return trees.where(in_order, proposal, Proposal(centre, 1 / bins))


def _log_prob(params: GaussianParams, actions: Array) -> Array:
    """Compute the log-density of the logits, f32[n], up to a constant."""
    z = (actions - params.mean[None, :]) / jnp.exp(params.log_std)[None, :]
    return jnp.sum(-0.5 * z**2 - params.log_std[None, :], axis=1)


def _upper_edges(space: Space) -> Float[np.ndarray, "attributes bins"]:
    """The upper edge of every bin, 1 for the last and beyond."""
    sizes = np.asarray(space.bins, np.float32)[:, None]
    edges = np.arange(1, space.max_bins + 1, dtype=np.float32)[None, :] / sizes
    return np.minimum(edges, np.float32(1))
