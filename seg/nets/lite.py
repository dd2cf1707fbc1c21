"""The EfficientNet-Lites up to their last block: feature maps at 1/8, 1/16 and 1/32.

Source: Tan, Le, "EfficientNet" (2019), in the authors' form "Lite": no squeeze and excitation, ReLU6, a stem
of 32 and a last layer of 1280 channels in all sizes, and a first and last stage of the same depth in all
sizes. Batch normalisation with fixed statistics is folded into kernels and biases (`seg.weights.lite`).
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.depthwise import Pointwise, Spatial
from seg.nets.ops.resize import pad_to_multiple

STEM = 32
"""Channels of the first convolution."""
STRIDES = (8, 16, 32)
"""Strides of the maps that a head takes."""


class Block(NamedTuple):
    """An inverted residual: 1x1 to `expand` times the channels, depthwise, 1x1 to `features`."""

    side: int
    stride: int
    expand: int
    features: int


_STAGES = (  # number of blocks, and the first block; the others have stride 1
    (1, Block(3, 1, 1, 16)),
    (2, Block(3, 2, 6, 24)),
    (2, Block(5, 2, 6, 40)),
    (3, Block(3, 2, 6, 80)),
    (3, Block(5, 1, 6, 112)),
    (4, Block(5, 2, 6, 192)),
    (1, Block(3, 1, 6, 320)),
)


class Size(NamedTuple):
    """The size of a network of the family, relative to the smallest."""

    width: float  # factor of the channels, which are rounded to multiples of 8
    depth: float  # factor of the blocks of a stage, which are rounded up


SIZES = {"lite0": Size(1.0, 1.0), "lite1": Size(1.0, 1.1), "lite2": Size(1.1, 1.2)}


def blocks_of(size: Size) -> tuple[Block, ...]:
    """The blocks of a network in order."""

    def scaled(channels: int) -> int:
        return int(channels * size.width + 4) // 8 * 8

    end_stages = (0, len(_STAGES) - 1)
    return tuple(
        first._replace(stride=first.stride if i == 0 else 1, features=scaled(first.features))
        for stage, (count, first) in enumerate(_STAGES)
        for i in range(count if stage in end_stages else math.ceil(count * size.depth))
    )


def taps_of(blocks: tuple[Block, ...]) -> tuple[int, ...]:
    """The indices of the last blocks at strides 4, 8, 16 and 32."""
    falls = [number for number, block in enumerate(blocks) if block.stride == 2]
    return *(number - 1 for number in falls[1:]), len(blocks) - 1


def channels_of(blocks: tuple[Block, ...]) -> tuple[int, ...]:
    """Channels of the maps at 1/8, 1/16 and 1/32."""
    fine, eighth, *coarse = (blocks[i].features for i in taps_of(blocks))
    return fine + eighth, *coarse


class _Block(nn.Module):
    shape: Block
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        side, stride, expand, features = self.shape
        y = x
        if expand > 1:
            y = relu6(Pointwise(expand * x.shape[-1], dtype=self.dtype, name="expand")(y))
        y = relu6(Spatial(side, stride, dtype=self.dtype, name="depthwise")(y))
        y = Pointwise(features, dtype=self.dtype, name="project")(y)
        return y + x if y.shape == x.shape and stride == 1 else y


@jax.custom_vjp
def relu6(x: Array) -> Array:
    """ReLU6 whose gradient at 0 and 6 is 0, as in PyTorch; that of `jnp.clip` is divided there."""
    return jnp.clip(x, 0, 6)


def _relu6_forward(x: Array) -> tuple[Array, Array]:
    y = relu6(x)
    return y, y


def _relu6_backward(y: Array, grad: Array) -> tuple[Array]:
    return (jnp.where((y > 0) & (y < 6), grad, 0),)


relu6.defvjp(_relu6_forward, _relu6_backward)


class Lite(nn.Module):
    """An EfficientNet-Lite without its last layers; Lite0 has 2 939 120 parameters.

    Attributes:
        blocks: from `blocks_of`.
        dtype: the type of computation; None for float32.
    """

    blocks: tuple[Block, ...]
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, images: Float[Array, "b h w 3"]) -> tuple[Float[Array, "b _h _w _c"], ...]:
        """Compute features at strides 8, 16 and 32, before any ReLU.

        Features at stride 4 are averaged over 2x2 cells and come before those at stride 8. Images are padded
        below and on the right to a multiple of 8 with the grey that the network normalises to 0.

        Args:
            images: RGB in [0, 1].
        """
        x = pad_to_multiple((255 * images - 127) / 128, 8)
        if len(images) == 1 or self.is_initializing():
            maps = _fine(self, x)
        else:
            maps = self._by_platform(x)
        coarse = _blocks(self, maps[-1], range(_fine_blocks(self), len(self.blocks)))
        fine, *others = (m.astype(jnp.float32) for m in (*maps, *coarse))
        b, h, w, c = fine.shape
        # Bilinear interpolation at half the resolution is this average.
        halved = fine.reshape(b, h // 2, 2, w // 2, 2, c).mean(axis=(2, 4))
        return jnp.concatenate([halved, others[0]], axis=-1), *others[1:]

    @nn.nowrap
    def _by_platform(self, x: Array) -> tuple[Array, ...]:
        fine = _Fine(self.blocks, self.dtype, parent=None)
        weights = {"params": self.variables["params"]}
        # One image fits a CPU's cache, and is recomputed for the gradient: an update at 240x176 with a batch
        # of 8 then takes a sixth less time.
        image = jax.checkpoint(fine.apply, prevent_cse=False)

        def one_by_one(weights: Any, x: Array) -> tuple[Array, ...]:
            maps = jax.lax.map(lambda row: image(weights, row[None]), x)
            return tuple(m[:, 0] for m in maps)

        return jax.lax.platform_dependent(weights, x, cpu=one_by_one, default=fine.apply)


class _Fine(nn.Module):
    """The layers up to stride 8, to be applied to the weights of the whole backbone."""

    blocks: tuple[Block, ...]
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w 3"]) -> tuple[Array, ...]:
        return _fine(self, x)


def _fine_blocks(backbone: Lite | _Fine) -> int:
    """The number of blocks up to stride 8."""
    return taps_of(backbone.blocks)[1] + 1


def _blocks(backbone: Lite | _Fine, x: Array, numbers: range) -> tuple[Array, ...]:
    maps = []
    for number in numbers:
        x = _Block(backbone.blocks[number], backbone.dtype, name=f"block{number}")(x)
        if number in taps_of(backbone.blocks):
            maps.append(x)
    return tuple(maps)


def _fine(backbone: Lite | _Fine, x: Array) -> tuple[Array, ...]:
    """The features at strides 4 and 8."""
    x = relu6(Spatial(3, 2, STEM, backbone.dtype, name="stem")(x))
    return _blocks(backbone, x, range(_fine_blocks(backbone)))
