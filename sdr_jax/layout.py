"""The groups of a space in one layout: a table [groups size], padded to the largest group.

All groups share the shapes of their policies, so one compiled update serves them all.
"""

from collections import defaultdict
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PyTree, Shaped

from sdr_jax.bins import bin_mask
from sdr_jax.policy import Policy
from sdr_jax.space import Space


class Groups(NamedTuple):
    """The groups as a table [groups size], where size is that of the largest group (constants)."""

    members: Int[np.ndarray, "groups size"]  # the attribute of each slot; N for padding
    bin_mask: Bool[np.ndarray, "groups size bins"]  # its bins; only the first for padding
    updates_per_group: int

    @property
    def updates(self) -> int:
        """The number of updates of the whole descent."""
        return len(self.members) * self.updates_per_group


def lay_out(space: Space, updates_per_group: int) -> Groups:
    """Lay out the groups of a space as a table. A padded slot has one bin, and so nothing to learn."""
    size = max(map(len, space.groups))
    members = np.full((len(space.groups), size), space.attributes, np.int32)
    for group, attributes in enumerate(space.groups):
        members[group, : len(attributes)] = attributes
    padding = np.arange(space.max_bins) == 0
    return Groups(members, np.vstack([bin_mask(space), padding])[members], updates_per_group)


def by_attribute(
    groups: Groups, values: Shaped[Array, "groups size *rest"], attributes: int
) -> Shaped[Array, "attributes *rest"]:
    """Reorder the values of all slots by attribute; those of padding are dropped."""
    table = jnp.zeros((attributes, *values.shape[2:]), values.dtype)
    return table.at[groups.members].set(values, mode="drop")


def init_policies(
    rng_key: Key[Array, ""], space: Space, hidden: int
) -> tuple[PyTree[Array], Float[Array, "groups size"]]:
    """Initialise every group's policy at its own size, pad and stack them.

    Padding is exact: a padded policy has the parameters of the policy of its own size, with zeros around
    them. Zero inputs and masked logits give these zeros no gradient, so they stay zero.

    Args:
        rng_key: consumed.
        space: the attributes, their bins and groups.
        hidden: hidden units of each policy.

    Returns:
        The parameters phi, with a leading groups axis on every leaf, for `Policy(size, max_bins)`;
        and the policies' inputs theta, random attribute values in [0, 1), zero where padded.
    """
    alike: dict[tuple[int, int], list[int]] = defaultdict(list)  # groups that share a compilation
    for index, group in enumerate(space.groups):
        alike[len(group), max(space.bins[attribute] for attribute in group)].append(index)
    size = max(map(len, space.groups))
    shapes = jax.eval_shape(lambda key: _init_policy(key, size, space.max_bins, hidden), rng_key)
    keys = jax.random.split(rng_key, len(space.groups))
    parts = []
    for (attributes, bins), indices in alike.items():
        init_group = partial(_init_policy, attributes=attributes, bins=bins, hidden=hidden)
        part = jax.vmap(init_group)(keys[np.asarray(indices)])
        parts.append(jax.tree.map(_pad, part, shapes))
    order = np.argsort(np.concatenate(list(alike.values())))
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[order], *parts)


def _init_policy(
    rng_key: Key[Array, ""], attributes: int, bins: int, hidden: int
) -> tuple[PyTree[Array], Float[Array, "attributes"]]:
    theta_key, phi_key = jax.random.split(rng_key)
    theta = jax.random.uniform(theta_key, (attributes,), jnp.float32)
    return Policy(attributes, bins, hidden).init(phi_key, theta), theta


def _pad(stacked: Array, shape: jax.ShapeDtypeStruct) -> Array:
    sizes = zip(stacked.shape[1:], shape.shape, strict=True)
    return jnp.pad(stacked, [(0, 0), *((0, to - size) for size, to in sizes)])
