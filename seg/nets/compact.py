"""A compact network that trains in seconds on one CPU core.

It works at a quarter of the resolution (space to depth), with one dilated stage at an eighth for context,
and a skip connection between the two. One channel holds the row, because street scenes are ordered from top
to bottom. GroupNorm has no statistics that would differ between synthetic and real images.
"""

from collections.abc import Callable
from functools import partial

import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv, conv, xla_conv
from seg.nets.ops.depthwise import pointwise_conv, strided_conv
from seg.nets.ops.group_norm import GroupNorm
from seg.nets.ops.normalise import normalise
from seg.nets.ops.resize import bilinear, pad_to_multiple, repeat_pixels, space_to_depth

_CELL = 4  # pixels of a space-to-depth cell, along each side
_GROUPS = 8
_LECUN = nn.initializers.lecun_normal()

Convolve = Callable[[Array, Array, int], Array]  # of features, kernel and rate


def _first_conv(x: Array, kernel: Array, rate: int) -> Array:
    """Convolve the last channel alone: it is equal in all images, and XLA is faster for 48 than for 49."""
    colours, row = x[..., :-1], x[:1, ..., -1:]
    return conv(colours, kernel[:, :, :-1], rate) + strided_conv(row, kernel[:, :, -1:], 1)


class _ConvNormRelu(nn.Module):
    features: int
    convolve: Convolve = conv
    dilation: int = 1
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        convolution = Conv(
            self.features,
            self.convolve,
            rate=self.dilation,
            use_bias=False,
            dtype=self.dtype,
        )
        return nn.relu(GroupNorm(_GROUPS, self.dtype)(convolution(x)))


class Compact(nn.Module):
    """Logits at full resolution from images of any size.

    Attributes:
        classes: the number of classes.
        width: channels at a quarter of the resolution, a multiple of 8; twice as many at an eighth.
        dtype: the type of computation; None for float32.
    """

    classes: int
    width: int = 24
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(
        self, images: Float[Array, "b h w 3"], train: bool = False
    ) -> Float[Array, "b h w classes"]:
        """Logits of RGB in [0, 1]; `train` has no effect in a network without dropout."""
        block = partial(_ConvNormRelu, dtype=self.dtype)
        project = partial(
            Conv, convolve=pointwise_conv, side=1, kernel_init=_LECUN, dtype=self.dtype
        )
        _, h, w, _ = images.shape
        x = space_to_depth(pad_to_multiple(normalise(images), 2 * _CELL), _CELL)
        b, rows, cols, _ = x.shape
        row = jnp.linspace(-1.0, 1.0, rows)[None, :, None, None]
        x = jnp.concatenate([x, jnp.broadcast_to(row, (b, rows, cols, 1))], axis=-1)
        x = block(self.width, _first_conv)(x)
        skip = block(self.width)(x)
        x = block(2 * self.width, partial(xla_conv, stride=2))(skip)
        x = x + block(2 * self.width, dilation=2)(x)
        x = x + block(2 * self.width, dilation=2)(x)
        x = repeat_pixels(project(self.width)(x), 2)
        x = block(self.width)(x + skip)
        logits = project(self.classes)(x).astype(jnp.float32)
        # Bilinear logits: 1 point of mIoU more than repeated ones, for 5 % more time per step.
        return bilinear(logits, _CELL)[:, :h, :w]
