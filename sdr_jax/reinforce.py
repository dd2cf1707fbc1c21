"""REINFORCE: the gradient of the expected score, estimated from samples, and the update that follows it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, PyTree

from sdr_jax import trees
from sdr_jax.baseline import Baseline, BaselineState, init_baseline
from sdr_jax.method import Info
from sdr_jax.rewards import mean_without_nan
from sdr_jax.variance_reduction import normalised

HIGHEST_RATE = 1e3
"""The highest learning rate of Adam; far higher ones overflow in single precision."""


def reinforce_loss(log_probs: Float[Array, "n"], advantages: Float[Array, "n"]) -> Float[Array, ""]:
    """The loss whose descent direction is the REINFORCE estimate.

        -grad_phi loss = 1/n sum_k grad_phi log pi_phi(theta'_k) advantage_k

    is an unbiased estimate of grad_phi J(phi) if `advantage_k = Score(theta'_k) - b` and b does not depend
    on theta'_k. Data sets with an advantage of NaN are left out, and n counts the others.

    Args:
        log_probs: log pi_phi(theta'_k) of each data set's actions, f32[n].
        advantages: reward minus baseline of each data set, f32[n]; no gradient flows into them.

    Returns:
        The loss; only its gradient has a meaning.

    Source: section "Scalable Discretization-and-Relaxation", second equation (there the number of
        data sets n is called K); Williams 1992.
    """
    valid_mask = ~jnp.isnan(advantages)
    weights = jax.lax.stop_gradient(jnp.where(valid_mask, advantages, 0.0))
    return -jnp.sum(log_probs * weights) / jnp.maximum(valid_mask.sum(), 1)


class Rule(NamedTuple):
    """The rule by which a policy learns (constants)."""

    optimizer: optax.GradientTransformation
    baseline: Baseline
    normalise: bool = False  # whether to divide advantages by their root mean square


class Learner(NamedTuple):
    """A policy, and the state of its updates."""

    params: Any  # phi, a pytree of arrays
    opt_state: PyTree[Array]
    baseline: BaselineState


def adam(learning_rate: float | optax.GradientTransformation) -> optax.GradientTransformation:
    """Make Adam with a learning rate, or return the transformation that stands in its place.

    Raises:
        ValueError: a learning rate out of range.
    """
    if isinstance(learning_rate, optax.GradientTransformation):
        return learning_rate
    if not 0 < learning_rate <= HIGHEST_RATE:
        raise ValueError(f"learning_rate is {learning_rate}, but must lie in (0, {HIGHEST_RATE:g}]")
    return optax.adam(learning_rate)


def init_learner(rule: Rule, params: PyTree[Array]) -> Learner:
    """The learner before its first update."""
    return Learner(params, rule.optimizer.init(params), init_baseline())


def has_learned(learner: Learner) -> Bool[Array, "*batch"]:
    """Whether an update has had enough rewards; before, the policy's best bins mean nothing."""
    return learner.baseline.updates > 0


def learn(
    rule: Rule,
    learner: Learner,
    log_probs_of: Callable[[Any], Float[Array, "n"]],
    scores: Float[Array, "n"],
    info: Info,
) -> tuple[Learner, Info]:
    """Make one update: advantages, the gradient of the loss, a step of the optimiser.

    Args:
        rule: the rule.
        learner: the policy and its state.
        log_probs_of: `phi -> log pi_phi(theta'_k)`, f32[n], of the actions that were rewarded.
        scores: rewards of the actions, f32[n]; those that are NaN are left out.
        info: the info so far.

    Returns:
        The learner, and the info with the figures of this update. With fewer scores than the baseline
        needs, the learner stays as it was: the optimiser would otherwise step by its momentum alone.
    """
    advantages, baseline_state = rule.baseline.advantage(learner.baseline, scores)
    baseline = mean_without_nan(scores - advantages)
    advantages = normalised(advantages) if rule.normalise else advantages

    grads = jax.grad(lambda phi: reinforce_loss(log_probs_of(phi), advantages))(learner.params)
    steps, opt_state = rule.optimizer.update(grads, learner.opt_state, learner.params)
    stepped = Learner(optax.apply_updates(learner.params, steps), opt_state, baseline_state)
    valid_mask = ~jnp.isnan(scores)
    enough = valid_mask.sum() >= rule.baseline.min_rewards
    grad_norm = jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(grads)))
    info = info._replace(
        baseline=baseline,
        advantages=jnp.where(valid_mask, advantages, 0.0),
        grad_norm=grad_norm,
        finite=jnp.isfinite(grad_norm) | ~enough,
    )
    return trees.where(enough, stepped, learner), info
