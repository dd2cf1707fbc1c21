"""EfficientNet-Lite0 up to its last block, and a light head that segments by its features at 1/8.

Source: Tan, Le, "EfficientNet" (2019), in the form "Lite" of its authors: no squeeze and excitation, ReLU6,
the stem's 32 and the last 1280 channels not scaled. Batch normalisation is folded into kernels and biases
(`seg.weights.lite0`): with statistics fixed it is nothing else. The head is ours.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv
from seg.nets.ops.depthwise import depthwise, pointwise, pointwise_conv, strided_conv
from seg.nets.ops.dropout import dropout
from seg.nets.ops.normalise import denormalise
from seg.nets.ops.resize import bilinear, pad_to_multiple

SMALLEST = 32
"""The last stride: an image that is lower or narrower has not one whole cell there."""
STEM = 32  # channels


class Block(NamedTuple):
    """An inverted residual: 1x1 to `expand` times the channels, depthwise, 1x1 to `features`."""

    side: int
    stride: int
    expand: int
    features: int


_STAGES = (  # blocks, and the first of them; the others have stride 1
    (1, Block(3, 1, 1, 16)),
    (2, Block(3, 2, 6, 24)),
    (2, Block(5, 2, 6, 40)),
    (3, Block(3, 2, 6, 80)),
    (3, Block(5, 1, 6, 112)),
    (4, Block(5, 2, 6, 192)),
    (1, Block(3, 1, 6, 320)),
)
BLOCKS = tuple(
    first if i == 0 else first._replace(stride=1) for count, first in _STAGES for i in range(count)
)
TAPS = (2, 4, 10, 15)
"""The last blocks at strides 4, 8, 16 and 32."""
CHANNELS = tuple(BLOCKS[i].features for i in TAPS)
STATISTICS = "statistics"
"""The collection of variables that the head normalises features by."""


class Pyramid(NamedTuple):
    """What the head sees of images; arrays of NumPy or JAX."""

    eighth: Float[Any, "n rows cols 64"]  # 24 of stride 4, averaged over 2x2 cells; 40 of stride 8
    sixteenth: Float[Any, "n rows16 cols16 112"]
    thirtysecond: Float[Any, "n rows32 cols32 320"]


def pyramid(maps: tuple[Float[Array, "b _h _w _c"], ...]) -> Pyramid:
    """The features of the four strides as the head wants them: none finer than 1/8."""
    fine, eighth, sixteenth, thirtysecond = maps
    b, h, w, c = fine.shape
    # Bilinear interpolation at half the resolution is this average.
    halved = fine.reshape(b, h // 2, 2, w // 2, 2, c).mean(axis=(2, 4))
    return Pyramid(jnp.concatenate([halved, eighth], axis=-1), sixteenth, thirtysecond)


_pointwise = partial(Conv, convolve=pointwise_conv, side=1)


class _Spatial(nn.Module):
    """The stem, or a depthwise convolution (`features` None)."""

    side: int
    stride: int
    features: int | None = None
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        sizes = (1, x.shape[-1]) if self.features is None else (x.shape[-1], self.features)
        shape = (self.side, self.side, *sizes)
        kernel = self.param("kernel", nn.initializers.he_normal(), shape)
        bias = self.param("bias", nn.initializers.zeros, sizes[-1:])
        x, kernel, bias = nn.dtypes.promote_dtype(x, kernel, bias, dtype=self.dtype)
        convolve = depthwise if self.features is None else strided_conv
        return convolve(x, kernel, self.stride) + bias[None, None, None]


class _Block(nn.Module):
    shape: Block
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        side, stride, expand, features = self.shape
        y = x
        if expand > 1:
            y = _relu6(_pointwise(expand * x.shape[-1], dtype=self.dtype, name="expand")(y))
        y = _relu6(_Spatial(side, stride, dtype=self.dtype, name="depthwise")(y))
        y = _pointwise(features, dtype=self.dtype, name="project")(y)
        return y + x if y.shape == x.shape and stride == 1 else y


@jax.custom_vjp
def _relu6(x: Array) -> Array:
    """The gradient of `jnp.clip` divides it between equal values; here it is 0 at 0 and 6, as in PyTorch."""
    return jnp.clip(x, 0, 6)


def _relu6_forward(x: Array) -> tuple[Array, Array]:
    y = _relu6(x)
    return y, y


def _relu6_backward(y: Array, grad: Array) -> tuple[Array]:
    return (jnp.where((y > 0) & (y < 6), grad, 0),)


_relu6.defvjp(_relu6_forward, _relu6_backward)


class Trunk(nn.Module):
    """EfficientNet-Lite0 without its last layers; 2 939 120 parameters.

    Attributes:
        dtype: what it computes in; None for float32.
    """

    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, images: Float[Array, "b h w 3"]) -> tuple[Float[Array, "b _h _w _c"], ...]:
        """Features at strides 4, 8, 16, 32: 24, 40, 112, 320 channels, before any ReLU.

        Images are filled up below and on the right to a multiple of 8 with the grey that is 0 to the net.

        Args:
            images: RGB in [0, 1].
        """
        x = pad_to_multiple((255 * images - 127) / 128, 8)
        cpu = jax.default_backend() == "cpu"
        if cpu and len(images) > 1 and not self.is_initializing():
            maps = _image_by_image(self, x)
        else:
            maps = _fine(self, x)
        coarse = _blocks(self, maps[-1], range(_FINE, len(BLOCKS)))
        return tuple(m.astype(jnp.float32) for m in (*maps, *coarse))


_FINE = TAPS[1] + 1  # blocks up to stride 8


def _blocks(trunk: Trunk, x: Array, numbers: range) -> tuple[Array, ...]:
    maps = []
    for number in numbers:
        x = _Block(BLOCKS[number], trunk.dtype, name=f"block{number}")(x)
        if number in TAPS:
            maps.append(x)
    return tuple(maps)


def _fine(trunk: Trunk, x: Array) -> tuple[Array, ...]:
    """The features at strides 4 and 8."""
    x = _relu6(_Spatial(3, 2, STEM, trunk.dtype, name="stem")(x))
    return _blocks(trunk, x, range(_FINE))


def _image_by_image(trunk: Trunk, x: Array) -> tuple[Array, ...]:
    """The same, computed again for the gradient: at these resolutions one image fits a CPU's cache.

    An update at 240x176, batch 8, takes a sixth less time so.
    """

    def one(trunk: Trunk, _: None, image: Array) -> tuple[None, tuple[Array, ...]]:
        maps = nn.remat(_fine, prevent_cse=False)(trunk, image[None])
        return None, tuple(m[0] for m in maps)

    scan = nn.scan(one, variable_broadcast="params", split_rngs={"params": False})
    _, maps = scan(trunk, None, x)
    return maps


class _Projection(nn.Module):
    """A 1x1 convolution of the four strides resized to 1/8 and concatenated.

    Convolved first and resized then, which is the same and a quarter of the work.
    """

    features: int
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, maps: Pyramid) -> Float[Array, "b rows cols features"]:
        channels = [m.shape[-1] for m in maps]
        shape = (1, 1, sum(channels), self.features)
        kernel = self.param("kernel", nn.initializers.he_normal(), shape)
        bias = self.param("bias", nn.initializers.zeros, (self.features,))
        *given, kernel, bias = nn.dtypes.promote_dtype(*maps, kernel, bias, dtype=self.dtype)
        _, rows, cols, _ = maps.eighth.shape
        start, total = 0, bias[None, None, None]
        for features, times in zip(given, (1, 2, 4), strict=True):
            stop = start + features.shape[-1]
            part = pointwise(features, kernel[0, 0, start:stop])
            total = total + (bilinear(part, times)[:, :rows, :cols] if times > 1 else part)
            start = stop
        return total


class Head(nn.Module):
    """Logits at full resolution from a pyramid: 1x1, 3x3, 1x1 at 1/8, then bilinear interpolation.

    The 3x3 convolution is separable, a depthwise one and a 1x1 one: an update takes half the time of one with
    a whole 3x3 kernel, and nets trained on renders are no worse.

    It normalises features channel by channel, by `mean` and `deviation` in the collection `statistics`: no
    training step changes these.

    Attributes:
        classes: how many classes.
        width: channels between the convolutions.
        dropout: share of the features before the last convolution that a training step leaves out.
        dtype: what it computes in; None for float32. Logits are float32.
    """

    classes: int
    width: int = 64
    dropout: float = 0.0
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(
        self, maps: Pyramid, size: tuple[int, int], train: bool = False, stride: int = 1
    ) -> Float[Array, "b rows cols classes"]:
        """Logits of images of a size in pixels (rows, columns); of the pixels that `strided` takes."""
        channels = [m.shape[-1] for m in maps]
        mean = self.variable(STATISTICS, "mean", jnp.zeros, (sum(channels),)).value
        deviation = self.variable(STATISTICS, "deviation", jnp.ones, (sum(channels),)).value
        cuts = (channels[0], channels[0] + channels[1])
        normal = Pyramid(
            *(
                (m.astype(jnp.float32) - centre[None, None, None]) / scale[None, None, None]
                for m, centre, scale in zip(
                    maps, jnp.split(mean, cuts), jnp.split(deviation, cuts), strict=True
                )
            )
        )
        x = nn.relu(_Projection(self.width, self.dtype, name="project")(normal))
        x = _Spatial(3, 1, dtype=self.dtype, name="depthwise")(x)
        x = nn.relu(_pointwise(self.width, dtype=self.dtype, name="mix")(x))
        if self.dropout and train:
            x = dropout(self.make_rng("dropout"), x, self.dropout)
        x = _pointwise(self.classes, dtype=self.dtype, name="score")(x)
        rows, cols = (len(range(stride // 2, n, stride)) for n in size)
        return bilinear(x.astype(jnp.float32), 8, stride)[:, :rows, :cols]


class Lite0(nn.Module):
    """Trunk and head: logits at full resolution from images of at least 32x32 pixels.

    Attributes:
        classes: how many classes.
        width: of the head.
        dropout: of the head.
        dtype: what it computes in; None for float32. Logits are float32.
    """

    classes: int
    width: int = 64
    dropout: float = 0.0
    dtype: DTypeLike | None = None

    def setup(self) -> None:
        """The two parts; parameters of the trunk are needed where it is called only."""
        self.trunk = Trunk(self.dtype)
        self.head = Head(self.classes, self.width, self.dropout, self.dtype)

    def __call__(
        self, images: Float[Array, "b h w 3"], train: bool = False, stride: int = 1
    ) -> Float[Array, "b rows cols classes"]:
        """Logits of normalised RGB; with `train` and dropout this needs `rngs={"dropout": key}`."""
        maps = pyramid(self.trunk(denormalise(images)))
        return self.head(maps, (images.shape[1], images.shape[2]), train, stride)

    def from_pyramid(
        self, maps: Pyramid, size: tuple[int, int], train: bool = False, stride: int = 1
    ) -> Float[Array, "b rows cols classes"]:
        """Logits of images of a size, of which the trunk's features are there already."""
        return self.head(maps, size, train, stride)


def statistics(maps: Pyramid) -> tuple[Float[Array, " c"], Float[Array, " c"]]:
    """A head's `mean` and `deviation`: those of each channel over all images and cells."""

    def of(features: Any) -> tuple[Array, Array]:
        x = jnp.asarray(features, jnp.float32)
        mean = jnp.mean(x, axis=(0, 1, 2))
        spread = jnp.mean((x - mean[None, None, None]) ** 2, axis=(0, 1, 2))
        return mean, jnp.maximum(jnp.sqrt(spread), 1e-3)

    means, deviations = zip(*(of(m) for m in maps), strict=True)
    return jnp.concatenate(means), jnp.concatenate(deviations)
