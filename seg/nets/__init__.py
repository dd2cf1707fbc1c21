"""Segmentation nets as Flax modules: images f32[b, h, w, 3] -> logits f32[b, h, w, classes]."""

from collections.abc import Callable

from flax import linen as nn

from seg.nets.compact import Compact
from seg.nets.deeplabv2 import DeepLabV2
from seg.nets.fcn8s import FCN8s
from seg.nets.normalise import normalise
from seg.nets.vgg16 import VGG16

_NETS: dict[str, Callable[..., nn.Module]] = {
    "compact": Compact,
    "deeplabv2": DeepLabV2,
    "fcn8s": FCN8s,
}


def net(name: str, classes: int) -> nn.Module:
    """Make a net by name.

    Args:
        name: one of the known nets.
        classes: how many classes it tells apart.

    Returns:
        A Linen module, called as `apply({"params": ...}, images, train=False)`.

    Raises:
        ValueError: no net has that name (the message lists those that exist), or classes < 1.
    """
    if name not in _NETS:
        raise ValueError(f"unknown net {name!r}; known nets: {', '.join(sorted(_NETS))}")
    if classes < 1:
        raise ValueError(f"a net needs at least one class; got {classes}")
    return _NETS[name](classes=classes)


__all__ = ["VGG16", "Compact", "DeepLabV2", "FCN8s", "net", "normalise"]
