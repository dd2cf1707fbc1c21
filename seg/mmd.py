"""Maximum mean discrepancy: a distance between two sets of vectors, without labels."""

import numpy as np
from jaxtyping import Float, Float64

DEGREE = 3
"""The degree of the polynomial kernel, as in KID."""


def polynomial_kernel(
    x: Float[np.ndarray, "n d"], y: Float[np.ndarray, "m d"]
) -> Float64[np.ndarray, "n m"]:
    """The kernel of every pair of rows, k(x, y) = (x . y / d + 1)^3.

    Source: Bińkowski et al. (2018), "Demystifying MMD GANs".
    """
    d = x.shape[1]
    return (x.astype(np.float64) @ y.astype(np.float64).T / d + 1) ** DEGREE


def mmd2(x: Float[np.ndarray, "n d"], y: Float[np.ndarray, "m d"]) -> float:
    """The unbiased squared discrepancy; its mean is 0 if both sets are from one distribution.

    sum_{i != j} k(x_i, x_j) / (n (n - 1)) + sum_{i != j} k(y_i, y_j) / (m (m - 1))
    - 2 sum_{i, j} k(x_i, y_j) / (n m). It may be a little below 0.

    Raises:
        ValueError: a set has fewer than two vectors (rows).

    Source: Gretton et al. (2012), "A Kernel Two-Sample Test", equation 3.
    """
    if min(len(x), len(y)) < 2:
        raise ValueError(f"both sets need at least two vectors; got {len(x)} and {len(y)}")

    def mean_within(z: Float[np.ndarray, "n d"]) -> float:
        kernel = polynomial_kernel(z, z)
        return float((kernel.sum() - np.trace(kernel)) / (len(z) * (len(z) - 1)))

    return mean_within(x) + mean_within(y) - 2 * float(polynomial_kernel(x, y).mean())
