"""Segmentation nets as Flax modules: images f32[b, h, w, 3] -> logits f32[b, h, w, classes]."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from seg.nets.compact import Compact
from seg.nets.deeplabv2 import DeepLabV2
from seg.nets.fcn8s import FCN8s
from seg.nets.lite0 import STATISTICS, Lite0
from seg.nets.ops.normalise import normalise
from seg.nets.vgg16 import VGG16
from seg.settings import VGG_NETS, Dtype, TrainSettings

_NETS: dict[str, Callable[..., nn.Module]] = {
    "compact": Compact,
    "deeplabv2": DeepLabV2,
    "fcn8s": FCN8s,
    "lite0": Lite0,
}
_DTYPES = {"float32": None, "bfloat16": jnp.bfloat16}  # Flax's None: that of the parameters


def net(
    name: str,
    classes: int,
    dtype: Dtype = "float32",
    norm: bool = False,
    **options: Any,
) -> nn.Module:
    """Make a net by name.

    Args:
        name: one of the known nets.
        classes: how many classes it tells apart.
        dtype: what it computes in; parameters and logits are float32.
        norm: GroupNorm after the convolutions of VGG16; the compact net has it in any case.
        options: other attributes of the net, such as the `width` and `dropout` of lite0's head.

    Returns:
        A Linen module, called as `apply(variables, images, train=False)`. Its variables are
        `{"params": ...}`; lite0 has the collection `statistics`, too.

    Raises:
        ValueError: no net has that name (the message lists those that exist), or classes < 1.
    """
    if name not in _NETS:
        raise ValueError(f"unknown net {name!r}; known nets: {', '.join(sorted(_NETS))}")
    if classes < 1:
        raise ValueError(f"a net needs at least one class; got {classes}")
    if name in VGG_NETS:
        options["norm"] = norm
    return _NETS[name](classes=classes, dtype=_DTYPES[dtype], **options)


def net_of(settings: TrainSettings, classes: int) -> nn.Module:
    """The net that some settings train."""
    head = {"width": settings.head_width, "dropout": settings.head_dropout}
    options = head if settings.net == "lite0" else {}
    return net(settings.net, classes, settings.dtype, settings.norm, **options)


def variables_of(trained: Any) -> Any:
    """The variables of a trained net, by collection.

    Args:
        trained: these, or the tree of a version that had no collections: parameters alone, and among those
            of lite0's head its statistics.
    """
    if "params" in trained:
        return trained
    head = trained.get("head", {})
    names = ("mean", "deviation")
    if not set(names) <= set(head):
        return {"params": trained}
    own = {name: leaf for name, leaf in head.items() if name not in names}
    statistics = {"head": {name: head[name] for name in names}}
    return {"params": {**trained, "head": own}, STATISTICS: statistics}


__all__ = [
    "VGG16",
    "Compact",
    "DeepLabV2",
    "FCN8s",
    "Lite0",
    "net",
    "net_of",
    "normalise",
    "variables_of",
]
