"""Changes of resolution that the networks share."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Shaped


def pad_to_multiple(x: Float[Array, "b h w c"], multiple: int) -> Float[Array, "b rows cols c"]:
    """Pad with zeros, the mean colour, below and on the right until height and width are multiples."""
    _, h, w, _ = x.shape
    return jnp.pad(x, [(0, 0), (0, -h % multiple), (0, -w % multiple), (0, 0)])


def _interpolation(n: int, times: int, stride: int = 1) -> Float32[np.ndarray, "large n"]:
    """Every `stride`-th row of the matrix that enlarges n samples; rows sum to 1, the ends repeat."""
    centres = np.clip((np.arange(times * n) + 0.5) / times - 0.5, 0, n - 1)
    distance = np.abs(centres[stride // 2 :: stride, None] - np.arange(n)[None, :])
    return np.maximum(0, 1 - distance).astype(np.float32)


@partial(jax.custom_vjp, nondiff_argnums=(1, 2))
def bilinear(
    x: Float[Array, "b h w c"], times: int, stride: int = 1
) -> Float[Array, "b rows cols c"]:
    """Enlarge by bilinear interpolation between pixel centres, and keep every `stride`-th row and column.

    It equals `jax.image.resize` and then `strided`, but computes only what is kept. XLA gets two products
    with constant matrices; on CPUs sums of shifted copies take a quarter of the time.

    Args:
        x: features, or scores of classes.
        times: factor of height and width.
        stride: distance of the rows and columns that are kept.
    """
    by_products = partial(_by_products, times=times, stride=stride)
    if times % stride:
        return by_products(x)

    def by_shifts(x: Array) -> Array:
        return _enlarge(_enlarge(x, 2, times, stride), 1, times, stride)

    return jax.lax.platform_dependent(x, cpu=by_shifts, default=by_products)


def _by_products(x: Array, times: int, stride: int) -> Array:
    rows, cols = (_interpolation(n, times, stride) for n in x.shape[1:3])
    exact = jax.lax.Precision.HIGHEST
    x = jnp.einsum("Hh,bhwc->bHwc", rows, x, precision=exact)
    return jnp.einsum("Ww,bhwc->bhWc", cols, x, precision=exact)


def _enlarge(x: Array, axis: int, times: int, stride: int) -> Array:
    """Enlarge along one axis: each new sample is a weighted sum of an old one and its neighbours."""
    before, n, behind = x.shape[:axis], x.shape[axis], x.shape[axis + 1 :]
    centres = (np.arange(times)[stride // 2 :: stride] + 0.5) / times + 0.5
    weights = np.maximum(0, 1 - np.abs(centres[None] - np.arange(3)[:, None])).astype(np.float32)
    x = x.reshape(math.prod(before), n, math.prod(behind))
    # Otherwise each of the sums would compute the edge again.
    x = jax.lax.optimization_barrier(jnp.pad(x, [(0, 0), (1, 1), (0, 0)], mode="edge"))
    total = sum(x[:, i : i + n, None] * weights[i][None, None, :, None] for i in range(3))
    return total.reshape(*before, n * len(centres), *behind)


_CLASSES = 32
"""Arrays with fewer channels count as scores of classes."""


def _forward(x: Array, times: int, stride: int) -> tuple[Array, tuple[int, ...]]:
    """Lay scores out class by class in memory, as `seg.losses` reads them."""
    if times % stride or x.shape[-1] >= _CLASSES:
        return bilinear(x, times, stride), x.shape

    def by_planes(x: Array) -> Array:
        cols = _interpolation(x.shape[2], times, stride)
        exact = jax.lax.Precision.HIGHEST
        planes = jnp.einsum("bhwc,Ww->cbhW", x, cols, precision=exact)
        return jnp.moveaxis(_enlarge(planes, 2, times, stride), 0, -1)

    by_products = partial(_by_products, times=times, stride=stride)
    return jax.lax.platform_dependent(x, cpu=by_planes, default=by_products), x.shape


def _backward(times: int, stride: int, shape: tuple[int, ...], grad: Array) -> tuple[Array]:
    rows, cols = (_interpolation(n, times, stride) for n in shape[1:3])
    exact = jax.lax.Precision.HIGHEST

    def by_planes(grad: Array) -> Array:
        # Columns first, which are contiguous; moved here, since einsum would copy them.
        planes = jnp.einsum("cbHW,Ww->cbHw", jnp.moveaxis(grad, -1, 0), cols, precision=exact)
        return jnp.einsum("cbHw,Hh->bhwc", planes, rows, precision=exact)

    def by_products(grad: Array) -> Array:
        grad = jnp.einsum("Ww,bhWc->bhwc", cols, grad, precision=exact)
        return jnp.einsum("Hh,bHwc->bhwc", rows, grad, precision=exact)

    if shape[-1] >= _CLASSES:
        return (by_products(grad),)
    return (jax.lax.platform_dependent(grad, cpu=by_planes, default=by_products),)


bilinear.defvjp(_forward, _backward)


def strided(x: Shaped[Array, "b h w *c"], stride: int) -> Shaped[Array, "b rows cols *c"]:
    """Take rows and columns `stride` apart, from the middle of the first stride x stride pixels on."""
    return x[:, stride // 2 :: stride, stride // 2 :: stride]


def repeat_pixels(x: Float[Array, "b h w c"], times: int) -> Float[Array, "b rows cols c"]:
    """Enlarge by repeating pixels."""
    b, h, w, c = x.shape
    blocks = jnp.broadcast_to(x[:, :, None, :, None, :], (b, h, times, w, times, c))
    return blocks.reshape(b, times * h, times * w, c)


def space_to_depth(x: Float[Array, "b h w c"], cell: int) -> Float[Array, "b rows cols depth"]:
    """Fold each square of cell x cell pixels into channels."""
    b, h, w, c = x.shape
    cells = x.reshape(b, h // cell, cell, w // cell, cell, c).transpose(0, 1, 3, 2, 4, 5)
    return cells.reshape(b, h // cell, w // cell, cell * cell * c)
