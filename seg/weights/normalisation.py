"""Which colours the first convolution was trained on, and how ours are made of them.

torchvision: (RGB in [0, 1] - mean) / standard deviation, what `seg.nets.normalise` does. Caffe: BGR in 0..255
minus the mean colour. Weights of Caffe's kind are rewritten once, when they are converted, so that every net
sees one kind of image. With x = (r - m) / s, our image, and W, b of the file, channels in reverse:

    W' = 255 s W,    b' = b + sum over rows, columns, channels of W (255 m - mean)

This is exact inside the image. At the border both pad with 0, which means the mean colour in either
convention; the two means differ by 0.5 of 255 at most.

Nothing in the numbers tells the two apart (kernels have similar sizes), so the file's names decide, or the
user: Caffe's weights are also handed round under torchvision's names.
"""

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Float32

from seg.nets.ops.normalise import MEAN, STD

Normalisation = Literal["torchvision", "caffe"]
NORMALISATIONS = get_args(Normalisation)

CAFFE_MEAN = (103.939, 116.779, 123.68)
"""Of ImageNet's images; blue, green, red in 0..255."""


def from_caffe(
    kernel: Float[np.ndarray, "rows columns 3 c"], bias: Float[np.ndarray, " c"]
) -> tuple[Float32[np.ndarray, "rows columns 3 c"], Float32[np.ndarray, " c"]]:
    """The first convolution for our images, from one for Caffe's, whose channels are blue, green, red."""
    rgb = kernel[:, :, ::-1].astype(np.float64)
    offset = 255 * np.array(MEAN) - np.array(CAFFE_MEAN[::-1])
    scaled = rgb * (255 * np.array(STD))[None, None, :, None]
    shifted = bias + np.einsum("rcio,i->o", rgb, offset)
    return scaled.astype(np.float32), shifted.astype(np.float32)
