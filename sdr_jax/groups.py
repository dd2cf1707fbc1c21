"""One policy per group, padded to the largest group and stacked, so that one jit serves them all.

Padding is exact: a group's padded policy has the parameters of its own-size policy and zeros around
them. Zero inputs and masked logits give these zeros no gradient, so they stay zero.
"""

from collections import defaultdict
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from sdr_jax.policy import Policy
from sdr_jax.space import Space


class Slots(NamedTuple):
    """What the slots of the stacked policies stand for."""

    members: Int[np.ndarray, "groups size"]  # attribute of each slot; `attributes` for padding
    present: Bool[np.ndarray, "groups size"]  # false for padding
    bins: Bool[np.ndarray, "groups size bins"]  # bins the slot's attribute has; all for padding


class Layout(NamedTuple):
    """Where each attribute lies in the stacked policies (constants of a space)."""

    slots: Slots
    group: Int[np.ndarray, "attributes"]  # the group of each attribute
    slot: Int[np.ndarray, "attributes"]  # its slot in the group


def layout(space: Space) -> Layout:
    """Lays a space's groups out on [groups size], size being that of the largest group."""
    size = max(map(len, space.groups))
    members = np.full((len(space.groups), size), space.attributes, np.int32)
    bins = np.ones((len(space.groups), size, space.max_bins), bool)
    group_of = np.zeros(space.attributes, np.int32)
    slot_of = np.zeros(space.attributes, np.int32)
    for group, indices in enumerate(space.groups):
        for slot, attribute in enumerate(indices):
            members[group, slot] = attribute
            bins[group, slot, space.bins[attribute] :] = False
            group_of[attribute], slot_of[attribute] = group, slot
    return Layout(Slots(members, members < space.attributes, bins), group_of, slot_of)


def init_policies(
    rng_key: Key[Array, ""], space: Space, hidden: int
) -> tuple[PyTree[Array], Float[Array, "groups size"]]:
    """Initialises every group's policy at its own size, pads and stacks them.

    Args:
        rng_key: consumed.
        space: the attribute space.
        hidden: hidden units of each policy.

    Returns:
        The parameters, with a leading groups axis on every leaf, for `Policy(size, max_bins)`;
        and the policies' inputs, random attribute values in [0, 1), zero where padded.
    """
    alike: dict[tuple[int, int], list[int]] = defaultdict(list)  # these share a compilation
    for index, group in enumerate(space.groups):
        alike[len(group), max(space.bins[attribute] for attribute in group)].append(index)
    size = max(map(len, space.groups))
    shapes = jax.eval_shape(lambda key: _init_policy(key, size, space.max_bins, hidden), rng_key)
    keys = jax.random.split(rng_key, len(space.groups))
    parts = []
    for (attributes, bins), indices in alike.items():
        own_init = partial(_init_policy, attributes=attributes, bins=bins, hidden=hidden)
        part = jax.vmap(own_init)(keys[np.asarray(indices)])
        parts.append(jax.tree.map(_pad, part, shapes))
    order = np.argsort(np.concatenate(list(alike.values())))
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[order], *parts)


def take(stacked: PyTree, group: Int[Array, ""]) -> Any:
    """One group's slice of a stacked pytree."""
    return jax.tree.map(
        lambda leaf: jax.lax.dynamic_index_in_dim(leaf, group, keepdims=False), stacked
    )


def put(stacked: PyTree[Array], group: Int[Array, ""], part: PyTree[Array]) -> Any:
    """Replaces one group's slice; every other group stays bitwise equal."""
    return jax.tree.map(
        lambda leaf, new: jax.lax.dynamic_update_index_in_dim(leaf, new, group, axis=0),
        stacked,
        part,
    )


def _init_policy(
    rng_key: Key[Array, ""], attributes: int, bins: int, hidden: int
) -> tuple[PyTree[Array], Float[Array, "attributes"]]:
    input_key, params_key = jax.random.split(rng_key)
    inputs = jax.random.uniform(input_key, (attributes,))
    return Policy(attributes, bins, hidden).init(params_key, inputs), inputs


def _pad(stacked: Array, like: jax.ShapeDtypeStruct) -> Array:
    sizes = zip(stacked.shape[1:], like.shape, strict=True)
    return jnp.pad(stacked, [(0, 0), *((0, to - size) for size, to in sizes)])
