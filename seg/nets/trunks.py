"""What nets see images by: trunks, each a function from an image to feature maps of a few strides.

A head is trained on the maps (`seg.nets.head`). A trunk of one's own is a function to a `Trunk` and a row of
`TRUNKS`.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

from flax import linen as nn

from seg.errors import WeightsError
from seg.nets.dinov2 import PATCH, VARIANTS, DinoV2
from seg.nets.lite import SIZES, STRIDES, Lite, blocks_of, channels_of
from seg.settings import WHOLE_NETS, TrainSettings
from seg.weights import dinov2, lite
from seg.weights.read import read
from shell.errors import UserError
from shell.files import file_digest
from shell.sent import here

Params = Any  # a pytree


class Trunk(NamedTuple):
    """A net that turns images into feature maps, and its weights."""

    module: nn.Module
    """From RGB f32[b, h, w, 3] in [0, 1] to a tuple of maps f32[b, rows, cols, channels], the finest first. A
    map of stride s has ceil(h / s) rows and ceil(w / s) columns. Its field `dtype` is what it computes in."""
    strides: tuple[int, ...]  # of the maps in pixels, each a multiple of the first
    channels: tuple[int, ...]  # of the maps
    load: Callable[[], Params]  # the module's parameters; WeightsError where they cannot be used
    source: Mapping[str, str]  # what the weights are; a saved head is used with no others

    @property
    def pixel_bytes(self) -> float:
        """Bytes of features for each pixel, in half precision."""
        own = zip(self.channels, self.strides, strict=True)
        return sum(2 * channels / stride**2 for channels, stride in own)


def _lite(net: str, weights: str | None) -> Trunk:
    blocks = blocks_of(SIZES[net])
    source = {"package": lite.package(net), "version": lite.VERSION, "sha256": lite.SHA256[net]}
    return Trunk(Lite(blocks), STRIDES, channels_of(blocks), lambda: lite.load(net).trunk, source)


def _dinov2(weights: str | None) -> Trunk:
    if weights is None:
        raise WeightsError("the net dinov2 needs a file of its weights: docs/howto/net.md")
    file = here(weights)
    found = dinov2.weights_of(read(file), str(file))
    name = f"DINOv2 {VARIANTS[found.channels].name}"
    source = {"name": name, "sha256": file_digest(file)}
    return Trunk(DinoV2(found.channels), (PATCH,), (found.channels,), lambda: found.params, source)


TRUNKS: dict[str, Callable[[str | None], Trunk]] = {
    **{net: partial(_lite, net) for net in SIZES},
    "dinov2": _dinov2,
}
"""Trunks by the name of the net that stands on them; each is made from the file that the settings name as
`weights`, or None. A function that needs no file takes no notice of it."""


def trunk_of(settings: TrainSettings) -> Trunk:
    """The trunk of the settings' net.

    Raises:
        UserError: the net has none.
        WeightsError: a file of weights that it needs cannot be used.
    """
    return trunk(settings.net, settings.weights)


@lru_cache(maxsize=4)
def trunk(net: str, weights: str | None = None) -> Trunk:
    """A trunk by the name of its net, made once for the same file.

    Args:
        net: one of `TRUNKS`.
        weights: the file of its weights, where it needs one.

    Raises:
        UserError: no trunk has that name.
        WeightsError: the file cannot be used.
    """
    if net not in TRUNKS:
        if net in WHOLE_NETS:
            raise UserError(f"there is no trunk {net}; known trunks: {', '.join(TRUNKS)}")
        known = ", ".join(sorted((*WHOLE_NETS, *TRUNKS)))
        raise UserError(f"unknown net {net!r}; known nets: {known}")
    found = TRUNKS[net](weights)
    if any(stride % found.strides[0] for stride in found.strides):
        raise ValueError(f"strides of {net} are {found.strides}; the first must divide the others")
    return found
