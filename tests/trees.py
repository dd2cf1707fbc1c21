"""Trees of arrays compared, for the tests of what JAX computes."""

from functools import partial

import jax
import numpy as np


def assert_same(a, b) -> None:
    """Equal arrays in equal trees."""
    jax.tree.map(np.testing.assert_array_equal, a, b)


def assert_close(a, b, rtol: float = 1e-7, atol: float = 0.0) -> None:
    """Nearly equal ones."""
    jax.tree.map(partial(np.testing.assert_allclose, rtol=rtol, atol=atol), a, b)
