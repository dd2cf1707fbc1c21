"""Reads VGG16's layers under the names of common files, and checks each one.

It knows torchvision's names (`features.0.weight`, `classifier.0.weight`), those of its `features` alone
(`0.weight`), timm's, which differ in the classifier (`pre_logits.fc1.weight`), and ours (`conv1_1/kernel`,
`fc6/kernel`). The classifier's fc6 and fc7
become convolutions of 7x7 and 1x1, as in FCN8s; its last layer, over ImageNet's classes, is left out. A file
may also hold the 13 convolutions alone.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from seg.errors import WeightsError
from seg.names import Normalisation

CONVS = tuple(
    f"conv{s}_{n}" for s, count in enumerate((2, 2, 3, 3, 3), 1) for n in range(1, count + 1)
)
"""The 13 convolutions, in order."""
LAYERS = (*CONVS, "fc6", "fc7")
PARTS = ("kernel", "bias")

_CHANNELS = (3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512)
_HIDDEN = 4096
_FEATURES = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
_TORCHVISION = (*(f"features.{i}" for i in _FEATURES), "classifier.0", "classifier.3")
_TIMM = (*_TORCHVISION[:13], "pre_logits.fc1", "pre_logits.fc2")
_IGNORED = ("classifier.6.", "head.", "fc8/")


class Scheme(NamedTuple):
    """One scheme of layer names."""

    name: str
    layers: tuple[str, ...]  # names of `LAYERS`, or of `CONVS` alone
    parts: tuple[str, str]  # suffixes of kernel and bias
    torch: bool  # kernels are [out, in, rows, columns], not [rows, columns, in, out]
    expects: Normalisation | None  # of images; None if names do not tell


SCHEMES = (
    Scheme("our own", LAYERS, ("/kernel", "/bias"), False, None),
    Scheme("torchvision", _TORCHVISION, (".weight", ".bias"), True, "torchvision"),
    Scheme("timm", _TIMM, (".weight", ".bias"), True, "torchvision"),
    Scheme("features", tuple(map(str, _FEATURES)), (".weight", ".bias"), True, None),
)


def shapes() -> dict[str, tuple[int, ...]]:
    """The shape of every array of VGG16 under our names."""
    sizes = {name: (3, 3, *pair) for name, pair in zip(CONVS, pairwise(_CHANNELS), strict=True)}
    sizes |= {"fc6": (7, 7, _CHANNELS[-1], _HIDDEN), "fc7": (1, 1, _HIDDEN, _HIDDEN)}
    array_shapes: dict[str, tuple[int, ...]] = {}
    for name, size in sizes.items():
        array_shapes |= {f"{name}/kernel": size, f"{name}/bias": size[-1:]}
    return array_shapes


def scheme_of(names: Iterable[str], where: str) -> Scheme:
    """Find the scheme of a file's names; WeightsError if it has none.

    Args:
        names: names of all its arrays.
        where: the file's name in messages.
    """
    have = set(names)
    hits = {scheme: sum(n + scheme.parts[0] in have for n in scheme.layers) for scheme in SCHEMES}
    best = max(hits, key=lambda scheme: hits[scheme])
    if not hits[best]:
        first = ", ".join(sorted(have)[:3]) or "nothing"
        raise WeightsError(
            f"{where}: no layer of VGG16 in it (it holds {first} ...); expected names such as "
            "features.0.weight (torchvision) or conv1_1/kernel"
        )
    return best


def layers(arrays: Mapping[str, np.ndarray], where: str) -> dict[str, np.ndarray]:
    """Read all layers of VGG16, or its 13 convolutions, as f32 with the names and shapes of `shapes()`.

    Args:
        arrays: the file's arrays.
        where: the file's name in messages.

    Raises:
        WeightsError: a layer is missing, has another shape or no finite values, or there are layers that
            VGG16 does not have.
    """
    scheme = scheme_of(arrays, where)
    file_names = {
        f"{layer}{part}": f"{file_layer}{suffix}"
        for layer, file_layer in zip(LAYERS, scheme.layers, strict=False)
        for part, suffix in zip(("/kernel", "/bias"), scheme.parts, strict=True)
    }
    if not any(n in arrays for name, n in file_names.items() if name.startswith("fc")):
        file_names = {name: n for name, n in file_names.items() if name.startswith("conv")}
    unknown = sorted(
        n for n in arrays if n not in file_names.values() and not n.startswith(_IGNORED)
    )
    normed = [n for n in unknown if n.endswith(("running_mean", "running_var"))]
    if normed:
        raise WeightsError(
            f"{where}: {normed[0]}: VGG16 has no batch normalisation; "
            "these weights are of another network (vgg16_bn, resnet?)"
        )
    missing = [n for n in file_names.values() if n not in arrays]
    if missing:
        more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise WeightsError(
            f"{where}: {missing[0]} is missing{more}; expected all of VGG16 (D), or its 13 convolutions"
        )
    if unknown:
        raise WeightsError(
            f"{where}: {unknown[0]}: VGG16 has no such layer; these weights are of another network"
        )
    expected_shapes = shapes()
    return {
        name: _array(arrays[n], name, expected_shapes[name], scheme, f"{where}: {n}")
        for name, n in file_names.items()
    }


def _array(
    array: np.ndarray, name: str, shape: tuple[int, ...], scheme: Scheme, where: str
) -> np.ndarray:
    allowed = [shape]
    if len(shape) == 4:
        rows, columns, c_in, c_out = shape
        # A convolution kernel and a fully connected one of the file: PyTorch flattens the input channel by
        # channel.
        allowed = [(c_out, c_in, rows, columns) if scheme.torch else shape]
        if name.startswith("fc") and scheme.torch:
            allowed.append((c_out, c_in * rows * columns))
    if array.shape not in allowed or array.dtype.kind != "f":
        raise WeightsError(
            f"{where}: {array.dtype}{list(array.shape)}; "
            f"expected float{' or '.join(str(list(size)) for size in allowed)}"
        )
    array = array.reshape(allowed[0])
    if scheme.torch and len(shape) == 4:
        array = array.transpose(2, 3, 1, 0)
    array = np.ascontiguousarray(array, np.float32)
    if not np.isfinite(array).all():
        raise WeightsError(f"{where}: holds values that are not finite")
    return array
