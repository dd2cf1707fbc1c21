"""Converts a first convolution that was trained on images normalised in another way.

torchvision: (RGB in [0, 1] - mean) / standard deviation, as in `seg.nets.normalise`. Caffe, and Keras after
it: BGR in 0..255 minus the mean colour. The conversion rewrites the latter weights, so that every network
takes one kind of image. With our image x = (r - m) / s, and W, b of the file with channels reversed:

    W' = 255 s W,    b' = b + sum over rows, columns, channels of W (255 m - mean)

This is exact inside the image. Both pad the border with 0, which stands for either convention's mean colour;
these differ by at most 0.5 of 255 (1.0 for HED, see `scripts/convert_weights.py`), which b' cannot undo:
beyond the border a layer sees a frame of a slightly different shade. On a photograph HED's features there
differ by at most 0.15 % of their largest value, elsewhere by the rounding of f32.

The numbers do not tell the kinds apart (kernels have similar sizes), so the file's names decide, or the user:
Caffe's weights also circulate under torchvision's names.
"""

import numpy as np
from jaxtyping import Float, Float32

from seg.nets.ops.normalise import MEAN, STD

CAFFE_MEANS = (103.939, 116.779, 123.68)
"""Mean colour of ImageNet's images; blue, green, red in 0..255."""


def from_bgr(
    kernel: Float[np.ndarray, "rows columns 3 c"],
    bias: Float[np.ndarray, " c"],
    means: tuple[float, float, float] = CAFFE_MEANS,
) -> tuple[Float32[np.ndarray, "rows columns 3 c"], Float32[np.ndarray, " c"]]:
    """Convert a first convolution for blue, green, red in 0..255 minus their means to our images."""
    rgb = kernel[:, :, ::-1].astype(np.float64)
    offset = 255 * np.array(MEAN) - np.array(means[::-1])
    scaled = rgb * (255 * np.array(STD))[None, None, :, None]
    shifted = bias + np.einsum("rcio,i->o", rgb, offset)
    return scaled.astype(np.float32), shifted.astype(np.float32)
