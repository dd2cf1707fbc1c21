"""DeepLabv2 on VGG16: atrous features at 1/8, then atrous spatial pyramid pooling (ASPP).

Source: Chen et al., "DeepLab: semantic image segmentation with deep convolutional nets, atrous
convolution, and fully connected CRFs" (2018), section 3.2, ASPP-L on VGG16; no CRF, one scale.
Deviations: the authors enlarge the scores with aligned corners (a side of 8 n + 1 pixels becomes n + 1 cells;
the layer `Interp`), and train at full size on labels thinned to 1/8. Here cells are squares of 8x8 pixels:
the image is padded below and on the right to a multiple of 8 with the mean colour, logits are interpolated
between the cells' centres and cropped, and the loss is over every pixel.
"""

import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv
from seg.nets.ops.normalise import normalise
from seg.nets.ops.product_conv import patch_conv, product_conv
from seg.nets.ops.resize import bilinear, pad_to_multiple
from seg.nets.vgg16 import VGG16

_RATES = (6, 12, 18, 24)


class DeepLabV2(nn.Module):
    """Logits at full resolution from images of any size.

    Parameters, for c classes: 14 714 688 (VGG16) + 4 branches * (4 719 616 (fc6: 3x3, 512 -> 1024)
    + 1 049 600 (fc7: 1024 -> 1024) + 1025 c (fc8)).

    Attributes:
        classes: the number of classes.
        width: channels of the first stage of VGG16.
        hidden: channels of fc6 and fc7 in each branch.
        norm: GroupNorm after each convolution of VGG16, for training from scratch; not published.
        dtype: the type of computation; None for float32. Logits are float32.
    """

    classes: int
    width: int = 64
    hidden: int = 1024
    norm: bool = False
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(
        self, images: Float[Array, "b h w 3"], train: bool = False
    ) -> Float[Array, "b h w classes"]:
        """Logits of RGB in [0, 1]: the sum of four branches, whose fc6 is dilated by 6, 12, 18 and 24.

        With `train`, half of the features after fc6 and fc7 are dropped; that needs `rngs={"dropout": key}`.
        """
        _, h, w, _ = images.shape
        backbone = VGG16(self.width, True, self.norm, self.dtype, name="vgg16")
        features = backbone(pad_to_multiple(normalise(images), 8))[-1]
        branches = []
        for number, rate in enumerate(_RATES, 1):
            x = features
            fc6 = Conv(self.hidden, product_conv, rate=rate, dtype=self.dtype, name=f"fc6_{number}")
            fc7 = Conv(self.hidden, patch_conv, side=1, dtype=self.dtype, name=f"fc7_{number}")
            for layer in (fc6, fc7):
                x = nn.Dropout(0.5, deterministic=not train)(nn.relu(layer(x)))
            score = nn.Conv(
                self.classes,
                (1, 1),
                kernel_init=nn.initializers.normal(0.01),
                dtype=self.dtype,
                name=f"fc8_{number}",
            )
            branches.append(score(x).astype(jnp.float32))
        return bilinear(sum(branches), 8)[:, :h, :w]
