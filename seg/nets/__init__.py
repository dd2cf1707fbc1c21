"""Segmentation nets as Flax modules: images f32[b, h, w, 3] -> logits f32[b, h, w, classes]."""

from collections.abc import Callable

import jax.numpy as jnp
from flax import linen as nn

from seg.nets.compact import Compact
from seg.nets.deeplabv2 import DeepLabV2
from seg.nets.fcn8s import FCN8s
from seg.nets.ops.normalise import normalise
from seg.nets.vgg16 import VGG16
from seg.settings import Dtype

_NETS: dict[str, Callable[..., nn.Module]] = {
    "compact": Compact,
    "deeplabv2": DeepLabV2,
    "fcn8s": FCN8s,
}
_DTYPES = {"float32": None, "bfloat16": jnp.bfloat16}  # Flax's None: that of the parameters


def net(name: str, classes: int, dtype: Dtype = "float32", norm: bool = False) -> nn.Module:
    """Make a net by name.

    Args:
        name: one of the known nets.
        classes: how many classes it tells apart.
        dtype: what it computes in; parameters and logits are float32.
        norm: GroupNorm after the convolutions of VGG16; the compact net has it in any case.

    Returns:
        A Linen module, called as `apply({"params": ...}, images, train=False)`.

    Raises:
        ValueError: no net has that name (the message lists those that exist), or classes < 1.
    """
    if name not in _NETS:
        raise ValueError(f"unknown net {name!r}; known nets: {', '.join(sorted(_NETS))}")
    if classes < 1:
        raise ValueError(f"a net needs at least one class; got {classes}")
    options = {} if name == "compact" else {"norm": norm}
    return _NETS[name](classes=classes, dtype=_DTYPES[dtype], **options)


__all__ = ["VGG16", "Compact", "DeepLabV2", "FCN8s", "net", "normalise"]
