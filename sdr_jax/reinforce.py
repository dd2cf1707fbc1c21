"""REINFORCE: the gradient of an expected reward, estimated from samples."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PyTree

from sdr_jax.baseline import Baseline, BaselineState, normalised
from sdr_jax.method import Info, plain_info
from sdr_jax.rewards import identity, mean_known, only_finite


def reinforce_loss(log_probs: Float[Array, "n"], advantages: Float[Array, "n"]) -> Float[Array, ""]:
    """The loss whose descent direction is the REINFORCE estimate.

    Data sets with an advantage of NaN are left out, and n counts the others.

    `-grad loss = 1/n sum_k grad log pi(a_k) advantage_k`, an unbiased estimate of the gradient of
    the expected reward when `advantage_k = reward_k - b` and b does not depend on a_k.

    Args:
        log_probs: log pi(a_k) of each data set's actions, f32[n].
        advantages: reward minus baseline of each data set, f32[n]; no gradient flows into them.

    Returns:
        The loss; only its gradient has a meaning.

    Source: section "Scalable Discretization-and-Relaxation", second equation (there the number of
        data sets n is called K); Williams 1992.
    """
    valid_mask = ~jnp.isnan(advantages)
    weights = jax.lax.stop_gradient(jnp.where(valid_mask, advantages, 0.0))
    return -jnp.sum(log_probs * weights) / jnp.maximum(valid_mask.sum(), 1)


def adam(learning_rate: float | optax.GradientTransformation) -> optax.GradientTransformation:
    """Makes Adam of a learning rate; an optimiser that is made already stays as it is."""
    if isinstance(learning_rate, optax.GradientTransformation):
        return learning_rate
    return optax.adam(learning_rate)


class Rule(NamedTuple):
    """The rule by which a policy learns (constants)."""

    optimizer: optax.GradientTransformation
    baseline: Baseline
    transform: Callable[[Array], Array] = identity  # of the rewards, first
    normalise: bool = False  # whether to divide advantages by their size


class Learner(NamedTuple):
    """A policy, and the state of its updates."""

    params: Any  # of the policy, a pytree of arrays
    opt_state: PyTree[Array]
    baseline: BaselineState


def init_learner(rule: Rule, params: PyTree[Array]) -> Learner:
    """The learner before its first update."""
    return Learner(params, rule.optimizer.init(params), rule.baseline.init())


def learn(
    rule: Rule,
    learner: Learner,
    policy: Callable[[Any], tuple[Array, Array]],
    rewards: Float[Array, "n"],
) -> tuple[Learner, Info]:
    """Makes one update: advantages, the gradient of the loss, a step of the optimiser.

    Args:
        rule: the rule.
        learner: the policy and its state.
        policy: `params -> (log pi(a_k) f32[n] of the sampled actions, entropy)`.
        rewards: f32[n]; failed ones are left out.

    Returns:
        The learner and the update's figures. If fewer rewards are known than the baseline needs, the learner
        stays as it was; otherwise the optimiser would make a step of its momentum alone.
    """
    finite = only_finite(rule.transform(rewards))
    differences, baseline_state = rule.baseline.advantage(learner.baseline, finite)
    advantages = normalised(differences) if rule.normalise else differences

    def loss(params: PyTree) -> tuple[Array, Array]:
        log_probs, entropy = policy(params)
        return reinforce_loss(log_probs, advantages), entropy

    grads, entropy = jax.grad(loss, has_aux=True)(learner.params)
    steps, opt_state = rule.optimizer.update(grads, learner.opt_state, learner.params)
    params = optax.apply_updates(learner.params, steps)
    valid_mask = ~jnp.isnan(finite)
    enough = valid_mask.sum() >= rule.baseline.least
    learnt = jax.tree.map(
        lambda new, old: jnp.where(enough, new, old),
        Learner(params, opt_state, baseline_state),
        learner,
    )
    grad_norm = jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(grads)))
    info = plain_info(rewards, entropy)._replace(
        baseline=mean_known(finite - differences),
        advantages=jnp.where(valid_mask, advantages, 0.0),
        grad_norm=grad_norm,
        finite=jnp.isfinite(grad_norm) | ~enough,
    )
    return learnt, info
