"""FCN8s on VGG16: class scores at 1/32, refined by those at 1/16 and 1/8.

Source: Long, Shelhamer, Darrell, "Fully convolutional networks for semantic segmentation" (2015).
Deviations: convolutions pad to keep the size, whereas the authors add 100 pixels around the image, let fc6
shrink the map, and crop the scores (same parameters, less work; scores differ where their 7x7 cells reach
over the border). The image is padded below and on the right to a multiple of 32 with the mean colour, and the
logits are cropped to its size. The scores of pool3 and pool4 are not rescaled. The last enlargement is
bilinear and fixed, as in the paper, but repeats the border, where a transposed convolution fades.
"""

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv
from seg.nets.ops.normalise import normalise
from seg.nets.ops.product_conv import patch_conv
from seg.nets.ops.resize import bilinear, pad_to_multiple
from seg.nets.vgg16 import VGG16


def bilinear_kernel(
    rng_key: Array, shape: tuple[int, ...], dtype: jax.typing.DTypeLike = jnp.float32
) -> Float[Array, "rows cols classes classes"]:
    """Initial kernel of a stride-2 transposed convolution that interpolates each class bilinearly.

    Its weights are 1/4 3/4 3/4 1/4 along each side; classes do not mix. The initialiser's key is not used.
    """
    del rng_key
    side = jnp.array([0.25, 0.75, 0.75, 0.25], dtype)
    square = (side[:, None] * side[None, :])[:, :, None, None]
    return square * jnp.eye(shape[2], shape[3], dtype=dtype)[None, None]


class FCN8s(nn.Module):
    """Logits at full resolution from images of any size.

    Parameters, for c classes: 14 714 688 (VGG16) + 102 764 544 (fc6: 7x7, 512 -> 4096)
    + 16 781 312 (fc7: 4096 -> 4096) + (4097 + 513 + 257) c (scores) + 2 * 16 c^2 (upsampling).

    Attributes:
        classes: the number of classes.
        width: channels of the first stage of VGG16.
        hidden: channels of fc6 and fc7.
        norm: GroupNorm after each convolution of VGG16, for training from scratch; not published.
        dtype: the type of computation; None for float32. Logits are float32.
    """

    classes: int
    width: int = 64
    hidden: int = 4096
    norm: bool = False
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(
        self, images: Float[Array, "b h w 3"], train: bool = False
    ) -> Float[Array, "b h w classes"]:
        """Logits of RGB in [0, 1].

        With `train`, half of the features after fc6 and fc7 are dropped; that needs `rngs={"dropout": key}`.
        """

        def score(x: Array, name: str) -> Array:
            zeros = nn.initializers.zeros
            conv = nn.Conv(self.classes, (1, 1), kernel_init=zeros, dtype=self.dtype, name=name)
            return conv(x)

        def double(x: Array, name: str) -> Array:
            return nn.ConvTranspose(
                self.classes,
                (4, 4),
                strides=(2, 2),
                use_bias=False,
                kernel_init=bilinear_kernel,
                dtype=self.dtype,
                name=name,
            )(x)

        _, h, w, _ = images.shape
        backbone = VGG16(self.width, norm=self.norm, dtype=self.dtype, name="vgg16")
        pools = backbone(pad_to_multiple(normalise(images), 32))
        x = pools[4]
        for name, side in (("fc6", 7), ("fc7", 1)):
            x = Conv(self.hidden, patch_conv, side=side, dtype=self.dtype, name=name)(x)
            x = nn.Dropout(0.5, deterministic=not train)(nn.relu(x))
        x = double(score(x, "score_fr"), "upscore2") + score(pools[3], "score_pool4")
        x = double(x, "upscore_pool4") + score(pools[2], "score_pool3")
        return bilinear(x.astype(jnp.float32), 8)[:, :h, :w]
