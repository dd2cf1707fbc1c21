"""A convolution as one matrix product for each cell of its kernel."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def product_conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side c features"], rate: int = 1
) -> Float[Array, "b h w features"]:
    """Convolve with a kernel whose cells lie `rate` apart; zeros around, the size is kept.

    The same as `lax.conv_general_dilated`. Cells that lie outside the map wherever the centre is (at
    1/8 of 128x96 all but the centre of those with rate 18) are left out, and what remains are large
    matrix products, which XLA's CPU backend does faster than a dilated convolution or one with a kernel
    about as large as the map, above all backwards.

    Args:
        x: features.
        kernel: rows, columns (as many, an odd number), channels in, channels out.
        rate: distance of the cells.

    Returns:
        f32, whatever the type of x, since many products are summed.
    """
    _, h, w, _ = x.shape
    side = kernel.shape[0]
    total = jnp.zeros((*x.shape[:3], kernel.shape[-1]), jnp.float32)
    for i in range(side):
        for j in range(side):
            down, right = (i - side // 2) * rate, (j - side // 2) * rate
            if abs(down) >= h or abs(right) >= w:
                continue
            seen = x[:, max(down, 0) : h + min(down, 0), max(right, 0) : w + min(right, 0)]
            product = jnp.einsum(
                "bhwc,cd->bhwd", seen, kernel[i, j], preferred_element_type=jnp.float32
            )
            rows, columns = (max(-down, 0), max(down, 0)), (max(-right, 0), max(right, 0))
            total = total + jnp.pad(product, [(0, 0), rows, columns, (0, 0)])
    return total
