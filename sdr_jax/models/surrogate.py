"""SDR with a surrogate: the policy over bins follows a model that learns from every evaluation."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sdr_jax.bins import bin_mask
from sdr_jax.distributions import entropy, moments
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.models import effects
from sdr_jax.models.features import maximise_each
from sdr_jax.models.regression import Posterior
from sdr_jax.relaxation import UNDECIDED, check_relaxation, relax
from sdr_jax.space import Proposal, Space, Width

SWEEPS = 4
"""Natural-gradient steps of the policy in every update."""

DRAWS = 32
"""Draws from the model's posterior, whose spread sets the temperatures."""


class SurrogateState(NamedTuple):
    """A policy, and the model that it follows."""

    evidence: effects.EffectsState
    belief: Posterior  # of the weights
    logits: Float[Array, "attributes bins"]  # minus infinity for bins an attribute lacks
    best: Int[Array, "attributes"]  # bins of the answer, -1 while all rewards are equal


def surrogate(
    space: Space,
    *,
    width: Width = None,
    temperature: float = 1.0,
    degree: int = 9,
    pair_degree: int | None = None,
) -> Method:
    """SDR whose policy gradient comes from a model of the reward, not from single rewards.

    As in SDR, each attribute has a softmax policy over its bins, and data sets are sampled from it and
    relaxed. REINFORCE uses a reward for one noisy step; here a Bayesian model learns from all rewards
    (`effects.py`: smooth in every attribute, pairwise within groups, scales by evidence), and
    the gradient of its expected reward is exact. The policy maximises

        E_pi[r_model] + sum_i tau_i H(pi_i),   tau_i = temperature * std_i

    where std_i is the posterior's standard deviation of the differences between i's bins: an
    attribute explores until this is smaller than the differences themselves. The natural
    gradient in the logits is `Q_i - tau_i log pi_i`; steps of 1 / tau_i, which are `logits = Q / tau`,
    alternate with new expectations. Groups say which attributes may interact; all groups are optimised at
    once.

    Policies of independent attributes cannot express "both or neither". So every second data set, counted
    over all updates, is the best one under a model drawn from the posterior (Thompson sampling). Samples of
    the policies are stratified. Rewards far below the others, such as the penalty for a crash, are clipped
    (`history.py`).

    The answer holds the bins of the model's highest mean; while all rewards are equal it is undecided.
    `spread` has the moments of the policy: an attribute without a clear effect stays
    wide.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: width of the relaxed bins, see `relax`.
        temperature: above 0; higher explores longer.
        degree: see `make_effects`.
        pair_degree: see `make_effects`.

    Returns:
        The method, for any number of updates.

    Raises:
        ValueError: an option out of range.

    Source: not in the paper, whose policy and bins it keeps; Kakade 2001, "A natural policy
        gradient"; MacKay 1992, "Bayesian interpolation".
    """
    check_relaxation(space, width, "random")
    if not (temperature > 0 and np.isfinite(temperature)):
        raise ValueError(f"temperature is {temperature}, but must be above 0")
    model = effects.make_effects(space, degree, pair_degree)
    uniform_logits = np.where(bin_mask(space), 0.0, -np.inf).astype(np.float32)

    def init(rng_key: RngKey) -> SurrogateState:
        del rng_key  # nothing is random before the first sample
        undecided = jnp.full(space.attributes, UNDECIDED, jnp.int32)
        evidence = effects.init_effects(model)
        belief = effects.posterior(model, evidence)
        return SurrogateState(evidence, belief, jnp.asarray(uniform_logits), undecided)

    def sample(rng_key: RngKey, state: SurrogateState, n: int) -> tuple[Bins, Proposal]:
        policy_key, draw_key, start_key = jax.random.split(rng_key, 3)
        actions = stratified(policy_key, space, jax.nn.softmax(state.logits), n)
        weights = effects.draw_weights(draw_key, model, state.belief, n)
        thompson = maximise_each(start_key, space, model.layout, weights)
        evidence = state.evidence
        turn = evidence.history.evaluations + jnp.arange(n)
        is_second = (turn % 2 == 1) & (evidence.statistics.evaluations > 1)
        actions = jnp.where(is_second[:, None], thompson, actions)
        return actions, relax(space, actions, width)

    def update(
        state: SurrogateState, actions: Bins, rewards: Rewards
    ) -> tuple[SurrogateState, Info]:
        info = basic_info(rewards, entropy(probabilities(state)))
        evidence = effects.observe(model, state.evidence, actions, rewards)
        belief = effects.posterior(model, evidence)
        best = effects.best_bins(model, belief)
        logits = follow(model, belief, best, temperature)
        rewards_differ = evidence.noise > 0
        next_state = SurrogateState(
            evidence,
            belief,
            jnp.where(rewards_differ, logits, state.logits),
            jnp.where(rewards_differ, best, state.best),
        )
        finite = effects.is_finite(evidence, belief)
        return next_state, info._replace(clipped=evidence.history.clipped, finite=finite)

    def probabilities(state: SurrogateState) -> Float[Array, "attributes bins"]:
        return jax.nn.softmax(state.logits)

    def solution(state: SurrogateState) -> Proposal:
        return relax(space, state.best, width)

    def spread(state: SurrogateState) -> Proposal:
        return moments(space, jax.nn.softmax(state.logits), width)

    def predict(state: SurrogateState, actions: Bins) -> tuple[Rewards, Rewards]:
        return effects.predict(model, state.evidence, state.belief, actions)

    return jit_method(init, sample, update, solution, probabilities, spread, predict=predict)


def follow(
    model: effects.Effects,
    belief: Posterior,
    start: Int[Array, "attributes"],
    temperature: float,
) -> Float[Array, "attributes bins"]:
    """Move a policy to where a model's expected reward plus entropy is highest.

    Args:
        model: the constants.
        belief: the posterior of its weights.
        start: bins of a first, certain policy, near the best of the several maxima that interactions
            may cause.
        temperature: factor on the posterior's standard deviations.

    Returns:
        The logits, up to a constant for each attribute.
    """
    mask = jnp.asarray(bin_mask(model.space))
    sizes = jnp.asarray(model.space.bins, jnp.float32)[:, None]
    mean = effects.mean_model(model, belief)
    # With a fixed key the same evaluations give the same temperatures.
    draws = effects.draw_models(jax.random.key(0), model, belief, DRAWS)
    probabilities = jax.nn.one_hot(start, model.space.max_bins)
    for _ in range(SWEEPS):
        q = effects.values(model, mean, probabilities)
        q_draws = jax.vmap(lambda draw: effects.values(model, draw, probabilities))(draws)  # noqa: B023
        error = jnp.where(mask[None], q_draws - q[None], 0.0)
        error = error - error.sum(axis=2, keepdims=True) / sizes[None]
        variance = jnp.where(mask[None], error**2, 0.0).sum(axis=2) / sizes[None, :, 0]
        tau = temperature * jnp.sqrt(variance.mean(axis=0))
        logits = jnp.where(mask, q / jnp.maximum(tau, 1e-12)[:, None], -jnp.inf)
        probabilities = jax.nn.softmax(logits)
    return logits - jnp.max(logits, axis=1, keepdims=True)


def stratified(
    rng_key: Key[Array, ""],
    space: Space,
    probabilities: Float[Array, "attributes bins"],
    n: int,
) -> Int[Array, "n attributes"]:
    """Sample n actions from the policy that together follow it as closely as possible.

    It is a Latin hypercube: every attribute's quantiles are cut into n parts, and each action gets one of
    them, shuffled independently of other attributes.

    Args:
        rng_key: consumed.
        space: the attributes and their bins.
        probabilities: the policy; rows sum to 1.
        n: the number of actions.

    Returns:
        Bins.
    """
    shift_key, order_key = jax.random.split(rng_key)
    shift = jax.random.uniform(shift_key, (n, space.attributes), jnp.float32)
    order = jax.random.uniform(order_key, (n, space.attributes), jnp.float32)
    quantiles = (jnp.argsort(order, axis=0) + shift) / n
    below = jnp.cumsum(probabilities, axis=1)
    actions = jnp.sum(quantiles[:, :, None] >= below[None], axis=2)  # rounding may end below 1
    return jnp.minimum(actions, jnp.asarray(space.bins)[None, :] - 1).astype(jnp.int32)
