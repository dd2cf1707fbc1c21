"""Converts a file of ImageNet weights into our format, and loads it into a network's parameters.

Our file is an `.npz` with the arrays of `seg.weights.vgg16.shapes()`, or the 13 convolutions, for images as
`seg.nets.normalise` makes them; with `source`, a description of the weights; and with `normalisation`, that
of their images before the conversion.
"""

import io
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from common.files import write
from common.sent import here
from seg.errors import WeightsError
from seg.names import Normalisation
from seg.settings import TrainSettings
from seg.weights.normalisation import from_bgr
from seg.weights.read import read, read_npz
from seg.weights.safetensors_file import source_of
from seg.weights.vgg16 import CONVS, LAYERS, PARTS, layers, scheme_of

_MARK = "normalisation"
_SOURCE = "source"
_WHOLE = "15 layers, fc6 and fc7 among them"
_ALONE = "the 13 convolutions alone, fc6 and fc7 start at random"
_OF_NET = {"deeplabv2": CONVS, "fcn8s": LAYERS}
"""The layers that each network takes. The four fc6 and fc7 of DeepLabv2 have another shape (3x3, 1024
channels); the authors made them by thinning out VGG16's, here they start at random."""


class Contents(NamedTuple):
    """The contents of a converted file."""

    source: str  # description of the weights
    normalisation: str  # of their images before the conversion
    whole: bool  # whether it has fc6 and fc7

    def __str__(self) -> str:
        return f"{self.source}; {_WHOLE if self.whole else _ALONE}"


def convert(source: Path, out: Path, normalisation: Normalisation | None = None) -> Contents:
    """Read and check ImageNet weights of VGG16, and write our file, whole or not at all.

    Args:
        source: `.pth`, `.safetensors` or `.npz`.
        out: the file to write.
        normalisation: that of the weights' images; None: torchvision's for names of torchvision and timm.

    Returns:
        The contents of the written file.

    Raises:
        WeightsError: the file cannot be read, or is not VGG16.
        OSError: `out` cannot be written.
    """
    arrays = read(source)
    converted = arrays.pop(_MARK, None)
    if converted is not None:
        raise WeightsError(f"{source}: is converted already; use it as it is")
    layer_arrays = layers(arrays, str(source))
    expected = normalisation or _default(arrays, source)
    if expected != "torchvision":
        kernel, bias = from_bgr(layer_arrays["conv1_1/kernel"], layer_arrays["conv1_1/bias"])
        layer_arrays |= {"conv1_1/kernel": kernel, "conv1_1/bias": bias}
    name = source_of(source) or f"VGG16 of {source.name}"
    content = io.BytesIO()
    np.savez(content, **layer_arrays, **{_MARK: np.array(expected), _SOURCE: np.array(name)})  # type: ignore[arg-type]
    write(out, content.getvalue())
    return Contents(name, expected, "fc7/bias" in layer_arrays)


def _default(arrays: Mapping[str, np.ndarray], source: Path) -> Normalisation:
    expects = scheme_of(arrays, str(source)).expects
    if expects is None:
        raise WeightsError(
            f"{source}: does not say which images it expects; pass --normalisation torchvision "
            "(RGB in [0, 1], mean and deviation) or caffe (BGR in 0..255, mean)"
        )
    return expects


def _contents(arrays: Mapping[str, np.ndarray], path: Path) -> Contents:
    if _MARK not in arrays:
        raise WeightsError(
            f"{path}: not converted yet: sdr-jax weights convert {shlex.quote(str(path))} --out vgg16.npz"
        )
    source = str(arrays.get(_SOURCE, "VGG16 of a file that was not noted"))
    return Contents(source, str(arrays[_MARK]), any(n.startswith("fc") for n in arrays))


def described(settings: TrainSettings) -> str | None:
    """Say in a sentence from what the settings' network starts; None without `weights`. Kernels are not read.

    Raises:
        WeightsError: there is no such file, or `convert` did not write it.
    """
    if settings.weights is None:
        return None
    path = Path(settings.weights)
    if settings.has_backbone:
        return f"{settings.net} uses the backbone weights of {path}"
    contents = _contents(read_npz(path, (_MARK, _SOURCE, "fc7/bias")), path)
    contents = contents._replace(whole=contents.whole and "fc6" in _OF_NET[settings.net])
    return f"{settings.net} starts from {path}: {contents}"


def load(path: str | Path, net_name: str, params: Any) -> Any:
    """Make parameters of a network whose backbone starts from a converted file.

    DeepLabv2 takes the 13 convolutions, FCN8s also fc6 and fc7 if the file has them. All other parameters
    stay as they are.

    Args:
        path: from `convert`.
        net_name: "deeplabv2" or "fcn8s".
        params: parameters of that network, which are not changed.

    Returns:
        New parameters of the same structure.

    Raises:
        WeightsError: there is no such file, `convert` did not write it, a layer is missing or has another
            shape, or the network has no VGG16 in it.
    """
    path = here(path)
    if net_name not in _OF_NET:
        raise WeightsError(
            f"{path}: the network {net_name} has no VGG16 in it; only {' and '.join(_OF_NET)} have"
        )
    names = tuple(f"{layer}/{part}" for layer in _OF_NET[net_name] for part in PARTS)
    arrays = read_npz(path, (*names, _MARK))
    layer_names = _OF_NET[net_name] if _contents(arrays, path).whole else CONVS
    params = {**params, "vgg16": dict(params["vgg16"])}
    for layer in layer_names:
        home = params["vgg16"] if layer in CONVS else params
        home[layer] = {
            part: _fitting(arrays, f"{layer}/{part}", home[layer][part].shape, path)
            for part in PARTS
        }
    return params


def check(settings: TrainSettings, classes: int) -> None:
    """Check before a search that the settings' weights fit their network; only files are read.

    Raises:
        WeightsError: they do not.
    """
    from seg.nets import net_of  # networks import their backbones' weights
    from seg.nets.backbones import backbone_of

    if settings.has_backbone:
        backbone_of(settings).load()
    elif settings.weights is not None:
        module = net_of(settings.net_spec, classes)
        blank = jax.ShapeDtypeStruct((1, 64, 64, 3), np.float32)
        shapes = jax.eval_shape(module.init, jax.random.key(0), blank)["params"]
        load(settings.weights, settings.net, shapes)


def _fitting(
    arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...], path: Path
) -> np.ndarray:
    if name not in arrays:
        raise WeightsError(f"{path}: {name} is missing; convert the weights again")
    array = arrays[name]
    if array.shape != shape or array.dtype != np.float32:
        raise WeightsError(
            f"{path}: {name}: {array.dtype}{list(array.shape)}; the network has float32{list(shape)}"
        )
    return array
