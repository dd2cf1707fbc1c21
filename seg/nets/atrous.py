"""A dilated convolution as one matrix product for each cell of its kernel."""

import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float


def atrous(
    x: Float[Array, "b h w c"], kernel: Float[Array, "3 3 c features"], rate: int
) -> Float[Array, "b h w features"]:
    """Convolve with a kernel whose cells lie `rate` apart; zeros around, the size is kept.

    The same as `lax.conv_general_dilated`. Cells that lie outside the map wherever the centre is (at
    1/8 of 128x96 all but the centre of those with rate 18) are left out, and what remains are large
    matrix products, which XLA's CPU backend does faster than a dilated convolution, above all backwards.

    Args:
        x: features.
        kernel: rows, columns, channels in, channels out.
        rate: distance of the cells.

    Returns:
        f32, whatever the type of x, since nine products are summed.
    """
    _, h, w, _ = x.shape
    total = jnp.zeros((*x.shape[:3], kernel.shape[-1]), jnp.float32)
    for i in range(3):
        for j in range(3):
            down, right = (i - 1) * rate, (j - 1) * rate
            if abs(down) >= h or abs(right) >= w:
                continue
            seen = x[:, max(down, 0) : h + min(down, 0), max(right, 0) : w + min(right, 0)]
            product = jnp.einsum(
                "bhwc,cd->bhwd", seen, kernel[i, j], preferred_element_type=jnp.float32
            )
            rows, columns = (max(-down, 0), max(down, 0)), (max(-right, 0), max(right, 0))
            total = total + jnp.pad(product, [(0, 0), rows, columns, (0, 0)])
    return total


class AtrousConv(nn.Module):
    """A 3x3 convolution with a large dilation; parameters as those of `nn.Conv`.

    Attributes:
        features: channels out.
        rate: distance of the kernel's cells.
        dtype: of the products; None for float32.
    """

    features: int
    rate: int
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b h w features"]:
        """Convolve.

        Args:
            x: features.

        Returns:
            Features of the same size, in `dtype`.
        """
        shape = (3, 3, x.shape[-1], self.features)
        kernel = self.param("kernel", nn.initializers.he_normal(), shape)
        bias = self.param("bias", nn.initializers.zeros, (self.features,))
        x, kernel, bias = nn.dtypes.promote_dtype(x, kernel, bias, dtype=self.dtype)
        return atrous(x, kernel, self.rate).astype(x.dtype) + bias[None, None, None, :]
