"""Group coordinate descent: it optimises one group of attributes after the other and holds the rest.

With theta'_g drawn from the policy of group g, and theta_g the random attributes of a later group, group i
is optimised under

    J_i = Score(concat[theta'_1, ..., theta'_i, theta_(i+1), ..., theta_n])

The groups before i are fixed at the arg max of their policies.

Every group's learner has the same shapes (`policy.init_policies` pads them), and all are stacked on a
leading axis, so that one jitted update serves all groups. It takes out the active group's slice and puts it
back. Masking gradients would not be enough, since under Adam a zero gradient still moves a parameter.

Source: section "SDR in Groups"; Wright 2015, "Coordinate descent algorithms".
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, PyTree

from sdr_jax.relaxation import UNDECIDED
from sdr_jax.space import Space


class Groups(NamedTuple):
    """The groups of a space as a table [groups size], where size is the largest group's (constants)."""

    members: Int[np.ndarray, "groups size"]  # attribute of each slot; `attributes` for padding
    valid_mask: Bool[np.ndarray, "groups size"]  # false for padding
    bin_mask: Bool[np.ndarray, "groups size bins"]  # bins the slot's attribute has; all for padding
    group_of: Int[np.ndarray, "attributes"]  # the group of each attribute
    slot_of: Int[np.ndarray, "attributes"]  # its slot in the group
    updates_per_group: int

    @property
    def updates(self) -> int:
        """The number of updates of the whole descent."""
        return len(self.members) * self.updates_per_group


class Descent(NamedTuple):
    """The progress of the descent."""

    fixed: Int[Array, "attributes"]  # arg max of finished groups, -1 for the others
    updates: Int[Array, ""]  # updates made so far


def lay_out(space: Space, updates_per_group: int) -> Groups:
    """Lays out a space's groups as [groups size], where size is the largest group's."""
    size = max(map(len, space.groups))
    members = np.full((len(space.groups), size), space.attributes, np.int32)
    bin_mask = np.ones((len(space.groups), size, space.max_bins), bool)
    group_of = np.zeros(space.attributes, np.int32)
    slot_of = np.zeros(space.attributes, np.int32)
    for group, indices in enumerate(space.groups):
        for slot, attribute in enumerate(indices):
            members[group, slot] = attribute
            bin_mask[group, slot, space.bins[attribute] :] = False
            group_of[attribute], slot_of[attribute] = group, slot
    valid_mask = members < space.attributes
    return Groups(members, valid_mask, bin_mask, group_of, slot_of, updates_per_group)


def begin(groups: Groups) -> Descent:
    """The descent before its first update, when nothing is fixed."""
    undecided = jnp.full(len(groups.group_of), UNDECIDED, jnp.int32)
    return Descent(undecided, jnp.zeros((), jnp.int32))


def active_group(groups: Groups, descent: Descent) -> Int[Array, ""]:
    """The group that the next update optimises; after the end it is the last one."""
    turn = descent.updates // groups.updates_per_group
    return jnp.minimum(turn, len(groups.members) - 1)


def has_started(groups: Groups, descent: Descent) -> Bool[Array, "attributes"]:
    """The mask of the attributes whose group has had an update."""
    return jnp.asarray(groups.group_of) * groups.updates_per_group < descent.updates


def concat(
    groups: Groups, descent: Descent, sampled: Int[Array, "n size"]
) -> Int[Array, "n attributes"]:
    """The equation's concat: finished groups are fixed, the active one is sampled, others are -1.

    After the end all groups are fixed, and the sampled bins play no part.
    """
    members = jnp.asarray(groups.members)[active_group(groups, descent)]
    fixed = jnp.broadcast_to(descent.fixed, (len(sampled), len(descent.fixed)))
    # Padded slots lie out of bounds and are dropped.
    actions = fixed.at[:, members].set(sampled, mode="drop")
    return jnp.where(descent.updates < groups.updates, actions, fixed)


def descend(
    groups: Groups,
    descent: Descent,
    learners: PyTree[Array],
    learn: Callable[[Any, Int[Array, ""]], tuple[Any, Int[Array, "size"], Any]],
) -> tuple[Descent, Any, Any]:
    """Makes one update of the active group; its last update fixes the group at its best bins.

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
    learner, best, info = learn(take(learners, group), group)
    ends = (descent.updates + 1) % groups.updates_per_group == 0
    members = jnp.asarray(groups.members)[group]
    fixed = descent.fixed.at[members].set(best, mode="drop")
    moved = Descent(jnp.where(ends, fixed, descent.fixed), descent.updates + 1)
    before, after = (descent, learners), (moved, _put(learners, group, learner))
    return *choose(descent.updates < groups.updates, after, before), info


def take(stacked: PyTree, group: Int[Array, ""]) -> Any:
    """One group's slice of a stacked pytree."""
    return jax.tree.map(
        lambda leaf: jax.lax.dynamic_index_in_dim(leaf, group, keepdims=False), stacked
    )


def choose(condition: Array, if_true: PyTree, if_false: PyTree) -> Any:
    """`jnp.where` for pytrees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), if_true, if_false)


def _put(stacked: PyTree[Array], group: Int[Array, ""], part: PyTree[Array]) -> Any:
    return jax.tree.map(
        lambda leaf, new: jax.lax.dynamic_update_index_in_dim(leaf, new, group, axis=0),
        stacked,
        part,
    )
