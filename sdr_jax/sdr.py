"""SDR, scalable discretization and relaxation: REINFORCE over the bins of one group after the other."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PyTree

from sdr_jax import trees
from sdr_jax.baseline import Baseline
from sdr_jax.coordinate_descent import (
    Descent,
    active_group,
    concat,
    descend,
    init_descent,
)
from sdr_jax.distributions import entropy, moments
from sdr_jax.layout import by_attribute, init_policies, lay_out
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.policy import Policy, log_prob, mask_logits, sample_bins
from sdr_jax.reinforce import Learner, Rule, adam, has_learned, init_learner, learn
from sdr_jax.relaxation import UNDECIDED, check_relaxation, relax
from sdr_jax.rewards import squared_percent
from sdr_jax.space import Proposal, Space, Width
from sdr_jax.variance_reduction import baseline_of


class SdrState(NamedTuple):
    """The state of SDR: the learners of its groups, and the progress of the descent."""

    learners: Learner  # phi_1, ..., phi_n, stacked on a leading groups axis
    inputs: Float[Array, "groups size"]  # theta, the policies' random inputs, drawn once
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
    """Scalable discretization and relaxation, in groups: the paper's method.

    REINFORCE trains each group's policy for `updates_per_group` updates, with the earlier groups
    fixed at their arg max and the later ones random (`coordinate_descent.py`). `update`
    moves on to the next group by itself. After the last, `sample` proposes the answer and `update`
    returns the state as it is.

    The actions of `sample` are sampled bins for the active group, fixed ones for finished groups,
    and -1 for later groups. `solution` is the arg max of every group that has started; `spread` has the
    moments of the policy: with the default width, a uniform policy gives all of [0, 1], a certain one its
    bin.

    An update without a reward, or with only one under `leave_one_out()`, changes no policy; it still
    counts, so that the descent moves on. A group that has had no other updates stays random.

    The paper leaves open, or we do differently:

    - the policies' inputs theta: random as in the paper, but drawn once; the paper draws new ones each
      time, which the policy must learn to ignore;
    - the first logits: Flax's own (Lecun normal weights), with which the likeliest of ten bins has a
      probability of about 0.18 at first, not 0.10;
    - the order of the groups: that of the space.

    Args:
        space: the attributes, their bins and groups.
        width: width of the relaxed bins, see `relax`.
        updates_per_group: number of updates of each group (the paper: "up to 50").
        hidden: hidden units of each policy.
        learning_rate: Adam's, or any optax transformation in its place; a schedule in it starts again with
            every group.
        baseline: "ema", "ema_current" (the authors' code), "leave_one_out", or a `Baseline` such as
            `ema(0.5)`; it starts again with every group.
        normalise: whether to divide advantages by their root mean square.
        squared_reward: whether to learn from `sign(r) (100 r)^2` of rewards r (the authors' code).
        unoptimised: "random" (the paper) or "half" (the authors' code), see `relax`.

    Returns:
        The method; it takes groups x updates_per_group updates.

    Raises:
        ValueError: an option out of range.

    Source: sections "Scalable Discretization-and-Relaxation" and "SDR in Groups".
    """
    if updates_per_group < 1:
        raise ValueError(f"updates_per_group is {updates_per_group}, but must be at least 1")
    if hidden < 1:
        raise ValueError(f"hidden is {hidden}, but must be at least 1")
    check_relaxation(space, width, unoptimised)
    groups = lay_out(space, updates_per_group)
    rule = Rule(adam(learning_rate), baseline_of(baseline), normalise)
    net = Policy(groups.members.shape[1], space.max_bins, hidden)

    def logits_of(phi: PyTree, theta: Array, bins: Array) -> Array:
        return mask_logits(net.apply(phi, theta), bins)

    def proposal(actions: Array) -> Proposal:
        return relax(space, actions, width, unoptimised)

    def init(rng_key: RngKey) -> SdrState:
        params, inputs = init_policies(rng_key, space, hidden)
        learners = jax.vmap(lambda phi: init_learner(rule, phi))(params)
        return SdrState(learners, inputs, init_descent(space))

    def sample(rng_key: RngKey, state: SdrState, n: int) -> tuple[Bins, Proposal]:
        stacked = state.learners.params, state.inputs, groups.bin_mask
        logits = logits_of(*trees.take(stacked, active_group(groups, state.descent)))
        actions = concat(groups, state.descent, sample_bins(rng_key, logits, n))
        return actions, proposal(actions)

    def update(state: SdrState, actions: Bins, rewards: Rewards) -> tuple[SdrState, Info]:
        scores = squared_percent(rewards) if squared_reward else rewards

        def learn_group(
            learner: Learner, group: Int[Array, ""]
        ) -> tuple[Learner, Int[Array, "size"], Info]:
            theta, members, bins = trees.take((state.inputs, *groups[:2]), group)
            # Padding takes its one bin, whose log-probability is 0.
            sampled = jnp.take(actions, members, axis=1, mode="fill", fill_value=0)

            def log_probs_of(phi: PyTree) -> Float[Array, "n"]:
                return log_prob(logits_of(phi, theta, bins), sampled)

            policy = jax.nn.softmax(logits_of(learner.params, theta, bins))
            info = basic_info(rewards, entropy(policy))._replace(group=group)
            learner, info = learn(rule, learner, log_probs_of, scores, info)
            best = jnp.argmax(logits_of(learner.params, theta, bins), axis=1).astype(jnp.int32)
            return learner, jnp.where(has_learned(learner), best, UNDECIDED), info

        descent, learners, info = descend(groups, state.descent, state.learners, learn_group)
        return SdrState(learners, state.inputs, descent), info

    def probabilities(state: SdrState) -> Float[Array, "attributes bins"]:
        bins = jnp.asarray(groups.bin_mask)
        logits = jax.vmap(logits_of)(state.learners.params, state.inputs, bins)
        return by_attribute(groups, jax.nn.softmax(logits), space.attributes)

    def decided(state: SdrState) -> Bool[Array, "attributes"]:
        learned = jnp.broadcast_to(has_learned(state.learners)[:, None], groups.members.shape)
        return by_attribute(groups, learned, space.attributes)

    def solution(state: SdrState) -> Proposal:
        best = jnp.argmax(probabilities(state), axis=1).astype(jnp.int32)
        return proposal(jnp.where(decided(state), best, UNDECIDED))

    def spread(state: SdrState) -> Proposal:
        undecided = proposal(jnp.full(space.attributes, UNDECIDED))
        return trees.where(decided(state), moments(space, probabilities(state), width), undecided)

    return jit_method(
        init, sample, update, solution, probabilities, spread,
        updates=groups.updates, shift_invariant=not squared_reward,
    )  # fmt: skip
