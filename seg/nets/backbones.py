"""Backbones: functions from an image to feature maps of a few strides.

A head is trained on the maps (`seg.nets.head`). To add a backbone, write a function that returns a
`Backbone`, and a row of `BACKBONES`.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

from flax import linen as nn

from common.errors import UserError
from common.files import file_digest
from common.sent import here
from seg.errors import WeightsError
from seg.nets.dinov2 import PATCH, VARIANTS, DinoV2
from seg.nets.lite import SIZES, STRIDES, Lite, blocks_of, channels_of
from seg.settings import WHOLE_NETS, TrainSettings
from seg.weights import dinov2, lite
from seg.weights.read import read

Params = Any  # the pytree of a network's parameters


class Backbone(NamedTuple):
    """A network that turns images into feature maps, and its weights."""

    module: nn.Module
    """Maps RGB f32[b, h, w, 3] in [0, 1] to a tuple of maps f32[b, rows, cols, channels], the finest first. A
    map of stride s has ceil(h / s) rows and ceil(w / s) columns. Its field `dtype` is the type of
    computation."""
    strides: tuple[int, ...]  # of the maps in pixels, each a multiple of the first
    channels: tuple[int, ...]  # of the maps
    load: Callable[[], Params]  # gives the module's parameters; WeightsError if they cannot be used
    source: Mapping[str, str]  # identifies the weights; a saved head needs the same ones

    @property
    def pixel_bytes(self) -> float:
        """Bytes of features per pixel in half precision."""
        maps = zip(self.channels, self.strides, strict=True)
        return sum(2 * channels / stride**2 for channels, stride in maps)


def _lite(net: str, weights: str | None) -> Backbone:
    blocks = blocks_of(SIZES[net])
    source = {"package": lite.package(net), "version": lite.VERSION, "sha256": lite.SHA256[net]}
    return Backbone(Lite(blocks), STRIDES, channels_of(blocks), lambda: lite.load(net), source)


def _dinov2(weights: str | None) -> Backbone:
    if weights is None:
        raise WeightsError("the network dinov2 needs a file of its weights: docs/howto/net.md")
    file = here(weights)
    contents = dinov2.weights_of(read(file), str(file))
    name = f"DINOv2 {VARIANTS[contents.channels].name}"
    source = {"name": name, "sha256": file_digest(file)}
    return Backbone(
        DinoV2(contents.channels), (PATCH,), (contents.channels,), lambda: contents.params, source
    )


BACKBONES: dict[str, Callable[[str | None], Backbone]] = {
    **{net: partial(_lite, net) for net in SIZES},
    "dinov2": _dinov2,
}
"""Backbones by the names of their networks. A function makes a backbone from the file of `weights` in the
settings, or None; a function that needs no file ignores it."""


def backbone_of(settings: TrainSettings) -> Backbone:
    """The backbone of the settings' network.

    Raises:
        UserError: the network has no backbone.
        WeightsError: the backbone's file of weights cannot be used.
    """
    return make_backbone(settings.net, settings.weights)


def check_name(net: str) -> None:
    """Raise UserError unless a backbone has the name of its network."""
    if net not in BACKBONES:
        if net in WHOLE_NETS:
            raise UserError(f"there is no backbone {net}; known backbones: {', '.join(BACKBONES)}")
        names = ", ".join(sorted((*WHOLE_NETS, *BACKBONES)))
        raise UserError(f"unknown network {net!r}; known networks: {names}")


@lru_cache(maxsize=4)
def make_backbone(net: str, weights: str | None = None) -> Backbone:
    """Make a backbone by the name of its network, once for each file.

    Args:
        net: one of `BACKBONES`.
        weights: the file of its weights, if it needs one.

    Raises:
        UserError: no backbone has that name.
        WeightsError: the file cannot be used.
    """
    check_name(net)
    backbone = BACKBONES[net](weights)
    if any(stride % backbone.strides[0] for stride in backbone.strides):
        raise ValueError(
            f"strides of {net} are {backbone.strides}; the first must divide the others"
        )
    return backbone
