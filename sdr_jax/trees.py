"""Slices and choices of whole pytrees, such as the learners of all groups, stacked on a leading axis."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree


def take(stacked: PyTree, index: Int[Array, ""]) -> Any:
    """Take one slice of every leaf along its leading axis."""
    return jax.tree.map(
        lambda leaf: jax.lax.dynamic_index_in_dim(leaf, index, keepdims=False), stacked
    )


def put(stacked: PyTree[Array], index: Int[Array, ""], part: PyTree[Array]) -> Any:
    """Replace one slice of every leaf along its leading axis."""
    return jax.tree.map(
        lambda leaf, new: jax.lax.dynamic_update_index_in_dim(leaf, new, index, axis=0),
        stacked,
        part,
    )


def where(condition: Bool[Array, "*shape"], if_true: PyTree, if_false: PyTree) -> Any:
    """`jnp.where` of every leaf."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), if_true, if_false)
