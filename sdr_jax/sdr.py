"""SDR, scalable discretization and relaxation: REINFORCE over the bins of one group after the other."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PyTree

from sdr_jax.baseline import Baseline, baseline_of
from sdr_jax.coordinate_descent import (
    Descent,
    active_group,
    begin,
    choose,
    concat,
    descend,
    has_started,
    lay_out,
    take,
)
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted
from sdr_jax.policy import Policy, entropy, init_policies, log_prob, mask_logits, sample_bins
from sdr_jax.reinforce import Learner, Rule, adam, init_learner, learn
from sdr_jax.relaxation import UNDECIDED, check_relaxation, moments, relax
from sdr_jax.rewards import identity, squared_percent
from sdr_jax.space import Proposal, Space, Width


class SdrState(NamedTuple):
    """The state of SDR: the learners of its groups, and the progress of the descent."""

    learners: Learner  # of all groups, stacked on a leading groups axis
    inputs: Float[Array, "groups size"]  # the policies' random inputs, drawn once
    descent: Descent


def sdr(
    space: Space,
    *,
    width: Width = None,
    updates_per_group: int = 50,
    hidden: int = 256,
    learning_rate: float | optax.GradientTransformation = 0.01,
    baseline: str | Baseline = "ema",
    normalise: bool = False,
    squared_reward: bool = False,
    unoptimised: str = "random",
) -> Method:
    """Scalable discretization and relaxation, in groups.

    REINFORCE trains each group's policy for `updates_per_group` updates, with the earlier groups
    fixed at their arg max and the later ones random (`coordinate_descent.py`). `update`
    moves on to the next group by itself. After the last, `sample` proposes the answer and `update`
    returns the state as it is.

    The actions of `sample` hold sampled bins for the active group, learnt ones for finished groups,
    and -1 for later groups. `solution` is the arg max of every group that has begun; `spread` has the
    moments of the policy (`relaxation.moments`): a uniform policy gives all of [0, 1], a certain one its
    relaxed bin.

    An update without a reward, or with only one under `leave_one_out()`, teaches nothing; it still
    counts, so that the descent moves on.

    Beside its options, it deviates from the paper, or decides what the paper leaves open, in:

    - the policies' inputs: random attributes as in the paper, but drawn once; the paper draws new ones each
      time, which the policy must learn to ignore;
    - the first logits: Flax's own (Lecun normal weights), with which the likeliest of ten bins has a
      probability of about 0.18 at first, not 0.10;
    - the order of the groups: that of the space; the paper gives no order.

    Args:
        space: the attributes, their bins and groups.
        width: width of the relaxed bins, see `relax`.
        updates_per_group: number of updates of each group (the paper: "up to 50").
        hidden: hidden units of each policy.
        learning_rate: Adam's, or any optax transformation in its place; a schedule in it starts afresh with
            every group.
        baseline: "ema", "ema_current" (the authors' code), "leave_one_out", or a `Baseline` such as
            `ema(0.5)`; it starts afresh with every group.
        normalise: whether to divide advantages by their size.
        squared_reward: whether to learn from `squared_percent` of the rewards (the authors' code).
        unoptimised: "random" (the paper) or "half" (the authors' code), see `relax`.

    Returns:
        The method; `updates` is groups x updates_per_group.

    Raises:
        ValueError: an option out of range.

    Source: sections "Scalable Discretization-and-Relaxation" and "SDR in Groups".
    """
    if updates_per_group < 1:
        raise ValueError(f"updates_per_group is {updates_per_group}, but must be at least 1")
    check_relaxation(space, width, unoptimised)
    groups = lay_out(space, updates_per_group)
    transform = squared_percent if squared_reward else identity
    rule = Rule(adam(learning_rate), baseline_of(baseline), transform, normalise)
    net = Policy(groups.members.shape[1], space.max_bins, hidden)

    def logits_of(params: PyTree, inputs: Array, bins: Array) -> Array:
        return mask_logits(net.apply(params, inputs), bins)

    def proposal(actions: Array) -> Proposal:
        return relax(space, actions, width, unoptimised)

    def init(rng_key: RngKey) -> SdrState:
        params, inputs = init_policies(rng_key, space, hidden)
        learners = jax.vmap(lambda group_params: init_learner(rule, group_params))(params)
        return SdrState(learners, inputs, begin(groups))

    def sample(rng_key: RngKey, state: SdrState, n: int) -> tuple[Bins, Proposal]:
        params, inputs, bins = take(
            (state.learners.params, state.inputs, groups.bin_mask),
            active_group(groups, state.descent),
        )
        sampled = sample_bins(rng_key, logits_of(params, inputs, bins), n)
        actions = concat(groups, state.descent, sampled)
        return actions, proposal(actions)

    def update(state: SdrState, actions: Bins, rewards: Rewards) -> tuple[SdrState, Info]:
        def learn_group(learner: Learner, group: Array) -> tuple[Learner, Array, Info]:
            inputs, members, valid_mask, bin_mask = take((state.inputs, *groups[:3]), group)
            group_actions = jnp.take(actions, members, axis=1, mode="clip")

            def policy(params: PyTree) -> tuple[Array, Array]:
                logits = logits_of(params, inputs, bin_mask)
                log_probs = log_prob(logits, group_actions, valid_mask)
                return log_probs, entropy(logits, valid_mask)

            learner, info = learn(rule, learner, policy, rewards)
            best = jnp.argmax(logits_of(learner.params, inputs, bin_mask), axis=1)
            return learner, best.astype(jnp.int32), info._replace(group=group)

        descent, learners, info = descend(groups, state.descent, state.learners, learn_group)
        return SdrState(learners, state.inputs, descent), info

    def probabilities(state: SdrState) -> Float[Array, "attributes bins"]:
        bins = jnp.asarray(groups.bin_mask)
        logits = jax.vmap(logits_of)(state.learners.params, state.inputs, bins)
        return jax.nn.softmax(logits)[groups.group_of, groups.slot_of]

    def solution(state: SdrState) -> Proposal:
        best = jnp.argmax(probabilities(state), axis=1).astype(jnp.int32)
        return proposal(jnp.where(has_started(groups, state.descent), best, UNDECIDED))

    def spread(state: SdrState) -> Proposal:
        wide = moments(space, probabilities(state), width)
        undecided = proposal(jnp.full(space.attributes, UNDECIDED))
        return choose(has_started(groups, state.descent), wide, undecided)

    return jitted(
        init, sample, update, solution, probabilities, spread, groups.updates, level=squared_reward
    )
