"""Group coordinate descent: one group of attributes is optimised after the other, the rest are fixed.

With theta'_g sampled from the policy of group g, and theta_g the random attributes of a later group,
group i is optimised under

    J_i = Score(concat[theta'_1, ..., theta'_i, theta_(i+1), ..., theta_n])

where theta'_1, ..., theta'_(i-1) are fixed at the arg max of their policies.

The learners of all groups have the same shapes (`layout.py` pads them) and are stacked on a
leading axis, so one jitted update serves all groups: it takes the active group's slice and puts it back.
Masking gradients would not be enough: under Adam a zero gradient still moves a parameter.

Source: section "SDR in Groups"; Wright 2015, "Coordinate descent algorithms".
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree

from sdr_jax import trees
from sdr_jax.layout import Groups
from sdr_jax.relaxation import UNDECIDED
from sdr_jax.space import Space


class Descent(NamedTuple):
    """The progress of the descent."""

    fixed: Int[Array, "attributes"]  # best bins of finished groups, -1 for the others
    updates: Int[Array, ""]  # updates made so far


def init_descent(space: Space) -> Descent:
    """The progress before the first update, when nothing is fixed."""
    undecided = jnp.full(space.attributes, UNDECIDED, jnp.int32)
    return Descent(undecided, jnp.zeros((), jnp.int32))


def active_group(groups: Groups, descent: Descent) -> Int[Array, ""]:
    """The group i that the next update optimises; after the end it is the last one."""
    return jnp.minimum(descent.updates // groups.updates_per_group, len(groups.members) - 1)


def concat(
    groups: Groups, descent: Descent, sampled: Int[Array, "n size"]
) -> Int[Array, "n attributes"]:
    """The concat of J_i: fixed bins of finished groups, sampled ones of the active group, -1 for theta.

    After the end all groups are fixed, and the sampled bins have no effect.

    Args:
        groups: the constants.
        descent: the progress so far.
        sampled: theta'_i, the bins of the active group's slots in each of n data sets.
    """
    members = jnp.asarray(groups.members)[active_group(groups, descent)]
    fixed = jnp.broadcast_to(descent.fixed, (len(sampled), len(descent.fixed)))
    actions = fixed.at[:, members].set(sampled, mode="drop")  # padding is out of bounds
    return jnp.where(descent.updates < groups.updates, actions, fixed)


def descend(
    groups: Groups,
    descent: Descent,
    learners: PyTree[Array],
    learn: Callable[[Any, Int[Array, ""]], tuple[Any, Int[Array, "size"], Any]],
) -> tuple[Descent, Any, Any]:
    """Update the active group; its last update fixes it at its best bins.

    Args:
        groups: the constants.
        descent: the progress so far.
        learners: the learners of all groups, stacked on a leading groups axis.
        learn: `(learner, group) -> (learner, best bins of its slots, info)` for one group.

    Returns:
        The new progress, the learners (all but the active one bitwise equal) and the info. After the
        end nothing changes.
    """
    group = active_group(groups, descent)
    learner, best, info = learn(trees.take(learners, group), group)
    ends = (descent.updates + 1) % groups.updates_per_group == 0
    members = jnp.asarray(groups.members)[group]
    fixed = jnp.where(ends, descent.fixed.at[members].set(best, mode="drop"), descent.fixed)
    after = Descent(fixed, descent.updates + 1), trees.put(learners, group, learner)
    running = descent.updates < groups.updates
    return *trees.where(running, after, (descent, learners)), info
