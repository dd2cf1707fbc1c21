"""Which colours the first convolution was trained on, and how ours are made of them.

torchvision: (RGB in [0, 1] - mean) / standard deviation, what `seg.nets.normalise` does. Caffe, and Keras
after it: BGR in 0..255 minus the mean colour; HED: the same with a mean of its own. Weights of these kinds
are rewritten once, when they are converted, so that every net sees one kind of image. With x = (r - m) / s,
our image, and W, b of the file, channels in reverse:

    W' = 255 s W,    b' = b + sum over rows, columns, channels of W (255 m - mean)

This is exact inside the image. Around it both pad with 0, which means the mean colour in either convention;
these differ by 0.5 (Caffe) or 1.0 (HED) of 255 at most, and b' cannot undo that: where a layer sees over the
border, it sees a frame of a slightly other shade. On a photograph HED's features then differ by 0.15 % of
their largest at most, elsewhere by the rounding of f32.

Nothing in the numbers tells the kinds apart (kernels have similar sizes), so the file's names decide, or the
user: Caffe's weights are also handed round under torchvision's names.
"""

import numpy as np
from jaxtyping import Float, Float32

from seg.names import Normalisation
from seg.nets.ops.normalise import MEAN, STD

BGR_MEANS = {"caffe": (103.939, 116.779, 123.68), "hed": (104.00699, 116.66877, 122.67892)}
"""The mean colours, of ImageNet's images; blue, green, red in 0..255."""


def from_bgr(
    kernel: Float[np.ndarray, "rows columns 3 c"],
    bias: Float[np.ndarray, " c"],
    normalisation: Normalisation,
) -> tuple[Float32[np.ndarray, "rows columns 3 c"], Float32[np.ndarray, " c"]]:
    """The first convolution for our images, from one for blue, green, red in 0..255 minus their means."""
    rgb = kernel[:, :, ::-1].astype(np.float64)
    offset = 255 * np.array(MEAN) - np.array(BGR_MEANS[normalisation][::-1])
    scaled = rgb * (255 * np.array(STD))[None, None, :, None]
    shifted = bias + np.einsum("rcio,i->o", rgb, offset)
    return scaled.astype(np.float32), shifted.astype(np.float32)
