"""DINOv2, a vision transformer, whose patch tokens describe 14x14 pixels each.

Source: Oquab et al., "DINOv2: Learning Robust Visual Features without Supervision" (2023), as in
`Dinov2Model` of `transformers`: position embeddings are interpolated bicubically to the image's patches.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Float32

from seg.nets.ops.normalise import normalise
from seg.nets.ops.resize import pad_to_multiple, space_to_depth

PATCH = 14
"""Pixels along a side of a patch."""
GRID = 37
"""Patches along a side of the images on which position embeddings were trained."""
HEAD = 64
"""Channels of one head of attention."""
MLP = 4
"""Channels within an MLP, as a multiple of the token's."""


class Variant(NamedTuple):
    """One size of the network."""

    name: str
    depth: int  # layers


VARIANTS = {384: Variant("ViT-S/14", 12), 768: Variant("ViT-B/14", 12)}
"""The sizes by the channels of a token."""


def bicubic(n: int, size: int) -> Float32[np.ndarray, "size n"]:
    """The matrix that resizes n samples to `size` by PyTorch's bicubic interpolation, A = -0.75, ends repeat.

    Source: Keys, "Cubic convolution interpolation for digital image processing" (1981).
    """
    centres = (np.arange(size) + 0.5) * n / size - 0.5
    first = np.floor(centres).astype(int) - 1
    matrix = np.zeros((size, n))
    for k in range(4):
        x = np.abs(centres - (first + k))
        near = (1.25 * x - 2.25) * x**2 + 1
        far = -0.75 * (((x - 5) * x + 8) * x - 4)
        weights = np.where(x <= 1, near, far)
        np.add.at(matrix, (np.arange(size), np.clip(first + k, 0, n - 1)), weights)
    return matrix.astype(np.float32)


class _Layer(nn.Module):
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b tokens c"]) -> Float[Array, "b tokens c"]:
        b, tokens, c = x.shape

        def dense(features: int, name: str) -> nn.Dense:
            return nn.Dense(features, dtype=self.dtype, name=name)

        def scaled(y: Array, name: str) -> Array:
            return y * self.param(name, nn.initializers.ones, (c,)).astype(y.dtype)[None, None]

        y = _norm(self.dtype, "norm1")(x)
        query, key, value = (
            dense(c, name)(y).reshape(b, tokens, c // HEAD, HEAD)
            for name in ("query", "key", "value")
        )
        y = jax.nn.dot_product_attention(query, key, value).reshape(b, tokens, c)
        x = x + scaled(dense(c, "out")(y), "scale1")
        y = dense(MLP * c, "fc1")(_norm(self.dtype, "norm2")(x))
        return x + scaled(dense(c, "fc2")(nn.gelu(y, approximate=False)), "scale2")


def _norm(dtype: DTypeLike | None, name: str) -> nn.LayerNorm:
    return nn.LayerNorm(epsilon=1e-6, dtype=dtype, use_fast_variance=False, name=name)


class DinoV2(nn.Module):
    """The last layer's patch tokens, normalised, as one feature map of stride 14.

    Attributes:
        channels: channels of a token; one of `VARIANTS`.
        dtype: the type of computation; None for float32.
    """

    channels: int
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(
        self, images: Float[Array, "b h w 3"]
    ) -> tuple[Float[Array, "b rows cols channels"]]:
        """Compute the tokens of all patches.

        Images are padded below and on the right to a multiple of 14 with ImageNet's mean colour.

        Args:
            images: RGB in [0, 1].
        """
        c = self.channels
        x = space_to_depth(pad_to_multiple(normalise(images), PATCH), PATCH)
        x = nn.Dense(c, dtype=self.dtype, name="patch")(x)
        b, rows, cols, _ = x.shape
        start = nn.initializers.normal(0.02)
        embeddings = self.param("positions", start, (GRID, GRID, c))
        exact = jax.lax.Precision.HIGHEST
        down, across = bicubic(GRID, rows), bicubic(GRID, cols)
        positions = jnp.einsum("Rr,Cc,rcd->RCd", down, across, embeddings, precision=exact)
        x = (x + positions[None].astype(x.dtype)).reshape(b, rows * cols, c)
        # The class token with its position.
        first = self.param("first", start, (c,)).astype(x.dtype)
        x = jnp.concatenate([jnp.broadcast_to(first, (b, 1, c)), x], axis=1)
        for number in range(VARIANTS[c].depth):
            x = _Layer(self.dtype, name=f"layer{number}")(x)
        x = _norm(self.dtype, "norm")(x)[:, 1:]
        return (x.reshape(b, rows, cols, c).astype(jnp.float32),)
