"""Convolutions as matrix products, for kernels about as large as the map."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Cell = tuple[int, int, tuple[slice, slice], tuple[slice, slice]]


def patch_conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side c features"], rate: int = 1
) -> Float[Array, "b h w features"]:
    """`conv` by one product of all patches with the kernel; f32, since many terms are summed.

    It reads the kernel once, and writes its gradient once, which suits kernels larger than the patches, such
    as those of fully connected layers.
    """
    b, h, w, c = x.shape
    side, _, _, features = kernel.shape
    around = (side // 2 * rate,) * 2
    x = jnp.pad(x, [(0, 0), around, around, (0, 0)])
    starts = [(i * rate, j * rate) for i in range(side) for j in range(side)]
    cells = [x[:, down : down + h, right : right + w] for down, right in starts]
    patches = jnp.concatenate(cells, axis=-1).reshape(b * h * w, side * side * c)
    flat = kernel.reshape(side * side * c, features)
    product = jnp.matmul(patches, flat, preferred_element_type=jnp.float32)
    return product.reshape(b, h, w, features)


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def product_conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side c features"], rate: int = 1
) -> Float[Array, "b h w features"]:
    """`conv` by one product for each cell of the kernel; f32, since many terms are summed.

    It leaves out cells that lie outside the map for every position of the kernel (at 1/8 of 128x96, with rate
    18, all but the centre), and the outer part of other cells. It suits cells far apart, for which XLA's CPU
    backend is slow, most of all backwards.
    """
    size = x.shape[1:3]
    total = jnp.zeros((*x.shape[:3], kernel.shape[-1]), jnp.float32)
    for i, j, read, centres in _cells(x, kernel, rate):
        product = jnp.einsum(
            "bhwc,cd->bhwd", x[:, *read], kernel[i, j], preferred_element_type=jnp.float32
        )
        around = [(part.start, n - part.stop) for part, n in zip(centres, size, strict=True)]
        total += jnp.pad(product, [(0, 0), *around, (0, 0)])
    return total


def _cells(x: Array, kernel: Array, rate: int) -> list[Cell]:
    """Row and column of each cell that can lie inside, the part that it reads, and its centre's positions."""
    _, h, w, _ = x.shape
    side = kernel.shape[0]

    def along(cell: int, size: int) -> tuple[slice, slice]:
        offset = (cell - side // 2) * rate
        read = slice(max(offset, 0), size + min(offset, 0))
        return read, slice(read.start - offset, read.stop - offset)

    rows, columns = ([along(cell, size) for cell in range(side)] for size in (h, w))
    return [
        (i, j, (top, left), (from_top, from_left))
        for i, (top, from_top) in enumerate(rows)
        for j, (left, from_left) in enumerate(columns)
        if top.start < top.stop and left.start < left.stop
    ]


def _forward(x: Array, kernel: Array, rate: int) -> tuple[Array, tuple[Array, Array]]:
    return product_conv(x, kernel, rate), (x, kernel)


def _backward(rate: int, saved: tuple[Array, Array], grad: Array) -> tuple[Array, Array]:
    x, kernel = saved
    to_x = product_conv(grad, kernel[::-1, ::-1].swapaxes(2, 3), rate)
    # JAX would write each cell into a kernel of zeros and add all of these.
    gradients = {
        (i, j): jnp.einsum(
            "bhwc,bhwd->cd", x[:, *read], grad[:, *centres], preferred_element_type=jnp.float32
        )
        for i, j, read, centres in _cells(x, kernel, rate)
    }
    outside = jnp.zeros(kernel.shape[2:], jnp.float32)
    side = range(kernel.shape[0])
    to_kernel = jnp.stack([jnp.stack([gradients.get((i, j), outside) for j in side]) for i in side])
    return to_x.astype(x.dtype), to_kernel.astype(kernel.dtype)


product_conv.defvjp(_forward, _backward)
