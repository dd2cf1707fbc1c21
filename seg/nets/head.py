"""A light head that segments from a backbone's feature maps, and the network of backbone and head."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from flax import struct
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.depthwise import Pointwise, Spatial, pointwise
from seg.nets.ops.dropout import dropout
from seg.nets.ops.resize import bilinear

STATISTICS = "statistics"
"""The collection of variables with which the head normalises features."""
Maps = tuple[Float[Any, "_n _rows _cols _c"], ...]
"""The head's input: a backbone's feature maps, the finest first; arrays of NumPy or JAX."""


class FeatureMaps(struct.PyTreeNode):
    """A frozen backbone's maps of images, from which a network on that backbone gets its logits.

    Attributes:
        maps: the backbone's feature maps.
        size: rows and columns of the images.
    """

    maps: tuple[Any, ...]  # `Maps`, or what a transformation of JAX puts in their place
    size: tuple[int, int] = struct.field(pytree_node=False)


class _Projection(nn.Module):
    """A 1x1 convolution of all maps resized to the finest and concatenated.

    It convolves first and resizes afterwards, with the same result for a quarter of the work.
    """

    features: int
    strides: tuple[int, ...]
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, maps: Maps) -> Float[Array, "b rows cols features"]:
        channels = [m.shape[-1] for m in maps]
        shape = (1, 1, sum(channels), self.features)
        kernel = self.param("kernel", nn.initializers.he_normal(), shape)
        bias = self.param("bias", nn.initializers.zeros, (self.features,))
        *inputs, kernel, bias = nn.dtypes.promote_dtype(*maps, kernel, bias, dtype=self.dtype)
        _, rows, cols, _ = inputs[0].shape
        start, total = 0, bias[None, None, None]
        for features, stride in zip(inputs, self.strides, strict=True):
            stop, times = start + features.shape[-1], stride // self.strides[0]
            part = pointwise(features, kernel[0, 0, start:stop])
            total = total + (bilinear(part, times)[:, :rows, :cols] if times > 1 else part)
            start = stop
        return total


class Head(nn.Module):
    """Scores of classes at the finest of some feature maps: 1x1, 3x3, 1x1 convolutions.

    The 3x3 convolution is separable, a depthwise one and a 1x1 one: an update takes half the time of a whole
    3x3 kernel's, and networks trained on renders are no worse.

    It normalises each channel of the features by `mean` and `deviation` of the collection `statistics`, which
    no training step changes.

    Attributes:
        classes: the number of classes.
        strides: strides of the maps in pixels, each a multiple of the first.
        width: channels between the convolutions.
        dropout: share of the features before the last convolution that a training step leaves out.
        dtype: the type of computation; None for float32. Scores are float32.
    """

    classes: int
    strides: tuple[int, ...]
    width: int = 64
    dropout: float = 0.0
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, maps: Maps, train: bool = False) -> Float[Array, "b rows cols classes"]:
        """One vector of scores for each cell of the finest map."""
        channels = [m.shape[-1] for m in maps]
        mean = self.variable(STATISTICS, "mean", jnp.zeros, (sum(channels),)).value
        deviation = self.variable(STATISTICS, "deviation", jnp.ones, (sum(channels),)).value
        cuts = tuple(np.cumsum(channels)[:-1].tolist())
        normal = tuple(
            (m.astype(jnp.float32) - centre[None, None, None]) / scale[None, None, None]
            for m, centre, scale in zip(
                maps, jnp.split(mean, cuts), jnp.split(deviation, cuts), strict=True
            )
        )
        x = nn.relu(_Projection(self.width, self.strides, self.dtype, name="project")(normal))
        x = Spatial(3, 1, dtype=self.dtype, name="depthwise")(x)
        x = nn.relu(Pointwise(self.width, dtype=self.dtype, name="mix")(x))
        if self.dropout and train:
            x = dropout(self.make_rng("dropout"), x, self.dropout)
        return Pointwise(self.classes, dtype=self.dtype, name="score")(x).astype(jnp.float32)


class OnBackbone(nn.Module):
    """Backbone and head: logits at full resolution from images, or from feature maps computed before.

    Attributes:
        classes: the number of classes.
        backbone: maps RGB in [0, 1] to feature maps, see `seg.nets.backbones.Backbone`.
        strides: strides of the maps in pixels.
        width: width of the head.
        dropout: dropout of the head.
        dtype: the head's type of computation; None for float32. Logits are float32.
    """

    classes: int
    backbone: nn.Module
    strides: tuple[int, ...]
    width: int = 64
    dropout: float = 0.0
    dtype: DTypeLike | None = None

    def setup(self) -> None:
        """Make the head; the backbone's parameters are needed only where it is called."""
        self.head = Head(self.classes, self.strides, self.width, self.dropout, self.dtype)

    def __call__(
        self,
        inputs: Float[Array, "b h w 3"] | FeatureMaps,
        train: bool = False,
        stride: int = 1,
    ) -> Float[Array, "b rows cols classes"]:
        """Logits of RGB in [0, 1], or of the backbone's maps.

        With `train` and dropout this needs `rngs={"dropout": key}`.
        """
        if not isinstance(inputs, FeatureMaps):
            size = (inputs.shape[1], inputs.shape[2])
            inputs = FeatureMaps(self.backbone(inputs), size)
        return self.enlarged(self.scores(inputs.maps, train), inputs.size, stride)

    def scores(self, maps: Maps, train: bool = False) -> Float[Array, "b rows cols classes"]:
        """The head's scores at the finest map."""
        return self.head(maps, train)

    def enlarged(
        self, scores: Float[Array, "b _rows _cols classes"], size: tuple[int, int], stride: int = 1
    ) -> Float[Array, "b rows cols classes"]:
        """Logits of images of a size from scores, by bilinear interpolation.

        Args:
            scores: of the head, or a mean over heads.
            size: rows and columns in pixels.
            stride: distance of the pixels that `strided` takes.
        """
        rows, cols = (len(range(stride // 2, n, stride)) for n in size)
        return bilinear(scores, self.strides[0], stride)[:, :rows, :cols]


def statistics(maps: Maps) -> tuple[Float[Array, " c"], Float[Array, " c"]]:
    """Compute a head's `mean` and `deviation` of each channel over all images and cells."""

    def of_map(features: Any) -> tuple[Array, Array]:
        x = jnp.asarray(features, jnp.float32)
        mean = jnp.mean(x, axis=(0, 1, 2))
        spread = jnp.mean((x - mean[None, None, None]) ** 2, axis=(0, 1, 2))
        return mean, jnp.maximum(jnp.sqrt(spread), 1e-3)

    means, deviations = zip(*(of_map(m) for m in maps), strict=True)
    return jnp.concatenate(means), jnp.concatenate(deviations)
