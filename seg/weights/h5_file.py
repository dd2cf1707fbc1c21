"""Reads the layers of a Keras `.h5` file under Keras's names of VGG16's layers.

It knows the layouts of Keras 1 (`block1_conv1/block1_conv1_W_1:0`), of Keras 2, saved as weights or as a
model (`model_weights/block1_conv1/block1_conv1/kernel:0`), and of Keras 3's `.weights.h5` with the layer's
name (`.../vars/0`). It reads arrays alone, not a model's configuration, which may hold code.
"""

import re
from io import BufferedIOBase
from typing import Any

import numpy as np

from seg.errors import WeightsError

_LAYER = re.compile(r"block\d+_conv\d+|fc\d+|predictions")
_PARTS = {"W": "kernel", "b": "bias", "0": "kernel", "1": "bias"}
_OPTIMISER = ("optimizer", "optimizer_weights")
_LARGEST = 2**30  # bytes of all arrays: VGG16 has 553 MB


def read_h5(file: BufferedIOBase, where: str) -> dict[str, np.ndarray]:
    """Read all float arrays except the optimiser's; known layers are named as `block1_conv1/kernel`.

    Args:
        file: the file's bytes.
        where: the file's name in messages.

    Raises:
        WeightsError: the extra `h5` is not installed, or the file is damaged or holds more than arrays.
    """
    try:
        import h5py
    except ImportError:
        raise WeightsError(
            f"{where}: Keras's .h5 needs the package h5py: pip install 'sdr-jax[h5]'"
        ) from None
    arrays: dict[str, np.ndarray] = {}

    def visit(path: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or path.split("/")[0] in _OPTIMISER:
            return
        if item.dtype.kind != "f":
            return
        name = _name(path, item.parent.attrs.get("name"))
        if name in arrays:
            raise WeightsError(f"{where}: {name} is there twice; expected one VGG16")
        if item.is_virtual or item.external:
            raise WeightsError(f"{where}: {path}: lies in another file, or is no layer of VGG16")
        if sum(a.nbytes for a in arrays.values()) + item.nbytes > _LARGEST:
            raise WeightsError(f"{where}: {path}: larger than VGG16; expected its weights")
        arrays[name] = item[()]

    try:
        with h5py.File(file, "r") as opened:
            opened.visititems(visit)
    except WeightsError:
        raise
    except Exception as error:  # HDF5 has many kinds of error; none names the file
        raise WeightsError(f"{where}: a damaged .h5 ({error})") from None
    return arrays


def _name(path: str, noted: Any) -> str:
    """The name `layer/part`, or the path itself if the layer is unknown."""
    *groups, last = path.split("/")
    # If Keras 3 names groups by the layer's class, it notes the layer's name beside the arrays.
    known = [name for name in (*groups, str(noted)) if _LAYER.fullmatch(name)]
    if not known:
        return path
    part = last.removeprefix(f"{known[-1]}_").removesuffix(":0").removesuffix("_1")
    part = _PARTS.get(part, part)
    return f"{known[-1]}/{part}" if part in ("kernel", "bias") else path
