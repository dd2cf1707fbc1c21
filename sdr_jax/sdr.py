"""SDR, scalable discretization and relaxation: REINFORCE over bins, one group after the other."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, Key, PyTree

from sdr_jax import bins
from sdr_jax import groups as grouping
from sdr_jax import policy as policies
from sdr_jax.baseline import Baseline, BaselineState, ema
from sdr_jax.baseline import normalise as normalised
from sdr_jax.method import Info, Method, jitted
from sdr_jax.reinforce import reinforce_loss
from sdr_jax.rewards import identity, mean_known, only_finite
from sdr_jax.space import (
    UNDECIDED,
    Proposal,
    Space,
    check_relaxation,
    relax,
)

PAPER_OPTIMIZER = optax.adam(1e-2)
PAPER_BASELINE = ema(decay=0.9)


class SdrState(NamedTuple):
    """All that SDR knows."""

    params: PyTree[Array]  # the groups' policies, stacked on a leading groups axis
    opt_state: PyTree[Array]  # their optimiser states, stacked likewise
    inputs: Float[Array, "groups size"]  # the policies' random inputs, drawn once
    baseline: BaselineState  # of the active group; starts afresh with every group
    learnt: Int[Array, "attributes"]  # arg max of finished groups, -1 for the others
    updates: Int[Array, ""]  # updates made so far


def sdr(
    space: Space,
    optimizer: optax.GradientTransformation = PAPER_OPTIMIZER,
    *,
    updates_per_group: int = 50,
    hidden: int = 256,
    baseline: Baseline = PAPER_BASELINE,
    transform: Callable[[Array], Array] = identity,
    normalise: bool = False,
    width: float | tuple[float, ...] | None = None,
    unoptimised: str = "random",
) -> Method:
    """Scalable discretization and relaxation, in groups.

    Each group's policy is trained by REINFORCE for `updates_per_group` updates, with the groups
    before it fixed at their arg max and those after it random. `update` moves on to the next group
    by itself. After the last, `sample` proposes the answer and `update` returns the state as it is.

    Only the active group's parameters and optimiser state are touched. Masking gradients would not
    do: under Adam, a zero gradient still moves a parameter.

    The actions of `sample` hold sampled bins for the active group, learnt ones for finished groups,
    and -1 for groups still to come. `solution` is the arg max of every group that has been begun;
    `spread` the uniform with the policy's mean and standard deviation:

        centre = sum_k p_k c_k,  width = sqrt(12 sum_k p_k (c_k - centre)^2 + w^2)

    with c_k the bins' centres and w their (relaxed) width, slid into [0, 1]. A uniform policy gives
    all of [0, 1], a certain one its relaxed bin.

    Args:
        space: the attributes, their bins and groups.
        optimizer: any optax transformation; a schedule in it starts afresh with every group.
        updates_per_group: how long each group is optimised (the paper: "up to 50").
        hidden: hidden units of each policy.
        baseline: `ema()`, `ema(includes_current=True)` (the authors' code) or `leave_one_out()`.
        transform: applied to rewards first: `identity` or `squared_percent` (the authors' code).
        normalise: whether to divide advantages by their size.
        width: of the relaxed bins, see `relax`.
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
    layout = grouping.layout(space)
    total = len(space.groups) * updates_per_group
    net = policies.Policy(layout.slots.members.shape[1], space.max_bins, hidden)

    def active(state: SdrState) -> Int[Array, ""]:
        return jnp.minimum(state.updates // updates_per_group, len(space.groups) - 1)

    def begun(state: SdrState) -> Array:  # bool[attributes]
        return jnp.asarray(layout.group) * updates_per_group < state.updates

    def logits_of(params: PyTree, inputs: Array, bins: Array) -> Array:
        return policies.mask_logits(net.apply(params, inputs), bins)

    def proposal(actions: Array) -> Proposal:
        return relax(space, actions, width, unoptimised)

    def init(rng_key: Key[Array, ""]) -> SdrState:
        params, inputs = grouping.init_policies(rng_key, space, hidden)
        return SdrState(
            params=params,
            opt_state=jax.vmap(optimizer.init)(params),
            inputs=inputs,
            baseline=baseline.init(),
            learnt=jnp.full(space.attributes, UNDECIDED, jnp.int32),
            updates=jnp.zeros((), jnp.int32),
        )

    def sample(
        rng_key: Key[Array, ""], state: SdrState, n: int
    ) -> tuple[Int[Array, "n attributes"], Proposal]:
        params, inputs, slots = grouping.take(
            (state.params, state.inputs, layout.slots), active(state)
        )
        sampled = policies.sample(rng_key, logits_of(params, inputs, slots.bins), n)
        learnt = jnp.broadcast_to(state.learnt, (n, space.attributes))
        # Padded slots lie out of bounds and are dropped.
        actions = learnt.at[:, slots.members].set(sampled, mode="drop")
        actions = jnp.where(state.updates < total, actions, learnt)
        return actions, proposal(actions)

    def update(
        state: SdrState, actions: Int[Array, "n attributes"], rewards: Float[Array, "n"]
    ) -> tuple[SdrState, Info]:
        group = active(state)
        params, opt_state, inputs, slots = grouping.take(
            (state.params, state.opt_state, state.inputs, layout.slots), group
        )
        group_actions = jnp.take(actions, slots.members, axis=1, mode="clip")
        transformed = only_finite(transform(rewards))
        known = ~jnp.isnan(transformed)
        raw_advantages, baseline_state = baseline.advantage(state.baseline, transformed)
        advantages = normalised(raw_advantages) if normalise else raw_advantages

        def loss(params: PyTree) -> tuple[Array, Array]:
            logits = logits_of(params, inputs, slots.bins)
            log_probs = policies.log_prob(logits, group_actions, slots.present)
            entropy = policies.entropy(logits, slots.present)
            return reinforce_loss(log_probs, advantages), entropy

        grads, entropy = jax.grad(loss, has_aux=True)(params)
        steps, next_opt_state = optimizer.update(grads, opt_state, params)
        params, opt_state, baseline_state = _choose(
            known.sum() >= baseline.least,
            (optax.apply_updates(params, steps), next_opt_state, baseline_state),
            (params, opt_state, state.baseline),
        )

        ends_group = (state.updates + 1) % updates_per_group == 0
        best = jnp.argmax(logits_of(params, inputs, slots.bins), axis=1).astype(jnp.int32)
        learnt = state.learnt.at[slots.members].set(best, mode="drop")
        next_state = SdrState(
            params=grouping.put(state.params, group, params),
            opt_state=grouping.put(state.opt_state, group, opt_state),
            inputs=state.inputs,
            baseline=_choose(ends_group, baseline.init(), baseline_state),
            learnt=jnp.where(ends_group, learnt, state.learnt),
            updates=state.updates + 1,
        )
        info = Info(
            reward_mean=mean_known(rewards),
            reward_best=jnp.nanmax(rewards),
            baseline=mean_known(transformed - raw_advantages),
            advantages=jnp.where(known, advantages, 0.0),
            entropy=entropy,
            grad_norm=_norm(grads),
            group=group,
        )
        return _choose(state.updates < total, next_state, state), info

    def probabilities(state: SdrState) -> Float[Array, "attributes bins"]:
        logits = jax.vmap(logits_of)(state.params, state.inputs, jnp.asarray(layout.slots.bins))
        return jax.nn.softmax(logits)[layout.group, layout.slot]

    def solution(state: SdrState) -> Proposal:
        best = jnp.argmax(probabilities(state), axis=1).astype(jnp.int32)
        return proposal(jnp.where(begun(state), best, UNDECIDED))

    def spread(state: SdrState) -> Proposal:
        wide = bins.spread(space, probabilities(state), width)
        return _choose(begun(state), wide, proposal(jnp.full(space.attributes, UNDECIDED)))

    return jitted(
        init=init,
        sample=sample,
        update=update,
        solution=solution,
        spread=spread,
        probabilities=probabilities,
        updates=total,
    )


def _norm(tree: PyTree) -> Array:
    return jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(tree)))


def _choose(condition: Array, if_true: PyTree, if_false: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), if_true, if_false)
