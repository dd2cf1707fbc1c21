"""The convolutions of VGG16, plain or atrous.

Source: Simonyan, Zisserman, "Very deep convolutional networks" (2015), configuration D; the atrous form is
from Chen et al., "DeepLab" (2018), section 3.1. Layers have the names of the published weights.
"""

from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv, conv
from seg.nets.ops.group_norm import GroupNorm
from seg.nets.ops.max_pool import max_pool

_CONVS = (2, 2, 3, 3, 3)  # of each stage
_WIDTHS = (1, 2, 4, 8, 8)  # channels of each stage, relative to the first
_GROUPS = 8


class VGG16(nn.Module):
    """13 convolutions of 3x3, with biases, in five stages that each end in max pooling.

    With 64 channels in the first stage: 14 714 688 parameters, the sum over the convolutions of
    9 * channels in * channels out + channels out.

    Attributes:
        width: channels of the first stage.
        atrous: keep an eighth of the resolution: the last two poolings have stride 1 and the fifth
            stage is dilated by 2 (poolings are then 3x3). Otherwise the last map is at 1/32.
        norm: GroupNorm after each convolution, for training from scratch; not part of VGG16.
        dtype: the type of computation; None for float32.
    """

    width: int = 64
    atrous: bool = False
    norm: bool = False
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, images: Float[Array, "b h w 3"]) -> tuple[Float[Array, "b _h _w _c"], ...]:
        """The five pooled stages, of strides 2, 4, 8, 16, 32, or 2, 4, 8, 8, 8 if atrous.

        Args:
            images: normalised RGB; sides are multiples of 32, or of 8 if atrous.
        """
        x, pools = images, []
        for stage, (convs, factor) in enumerate(zip(_CONVS, _WIDTHS, strict=True), 1):
            for number in range(1, convs + 1):
                x = Conv(
                    factor * self.width,
                    conv,
                    rate=2 if self.atrous and stage == 5 else 1,
                    dtype=self.dtype,
                    name=f"conv{stage}_{number}",
                )(x)
                if self.norm:
                    x = GroupNorm(_GROUPS, dtype=self.dtype, name=f"norm{stage}_{number}")(x)
                x = nn.relu(x)
            if self.atrous:
                x = max_pool(x, 3, 2 if stage <= 3 else 1)
            else:
                x = max_pool(x, 2, 2)
            pools.append(x)
        return tuple(pools)
