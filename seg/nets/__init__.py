"""Segmentation networks as Flax modules: RGB in [0, 1], f32[b, h, w, 3] -> logits f32[b, h, w, classes]."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from seg.classes import IGNORE_LABEL
from seg.nets.backbones import BACKBONES, make_backbone
from seg.nets.compact import Compact
from seg.nets.deeplabv2 import DeepLabV2
from seg.nets.fcn8s import FCN8s
from seg.nets.head import STATISTICS, FeatureMaps, OnBackbone
from seg.nets.ops.normalise import normalise
from seg.nets.vgg16 import VGG16
from seg.settings import VGG_NETS, Dtype, NetSpec

_NETS: dict[str, Callable[..., nn.Module]] = {
    "compact": Compact,
    "deeplabv2": DeepLabV2,
    "fcn8s": FCN8s,
}
_DTYPES = {"float32": None, "bfloat16": jnp.bfloat16}  # Flax's None: that of the parameters


def net(
    name: str,
    classes: int,
    dtype: Dtype = "float32",
    norm: bool = False,
    weights: str | None = None,
    **options: Any,
) -> nn.Module:
    """Make a network by name.

    Args:
        name: a known network: one without a backbone, or a backbone of `seg.nets.backbones` with a head.
        classes: its number of classes.
        dtype: its type of computation; parameters and logits are float32.
        norm: GroupNorm after the convolutions of VGG16; the compact network has it in any case.
        weights: the file of a backbone's weights, for a backbone that has its size from it.
        options: other attributes of the network, such as the `width` and `dropout` of a head.

    Returns:
        A Linen module, called as `apply(variables, images, train=False)`. Its variables are
        `{"params": ...}`; a network on a backbone has the collection `statistics`, too, and takes
        `FeatureMaps` in place of images.

    Raises:
        ValueError: no network has that name (the message lists the known ones), or classes are not 1 to 255.
        WeightsError: the backbone's file of weights cannot be used.
    """
    if name not in _NETS and name not in BACKBONES:
        names = ", ".join(sorted((*_NETS, *BACKBONES)))
        raise ValueError(f"unknown network {name!r}; known networks: {names}")
    if not 1 <= classes <= IGNORE_LABEL:  # predictions are bytes
        raise ValueError(f"a network has 1 to {IGNORE_LABEL} classes; got {classes}")
    computed = _DTYPES[dtype]
    if name in BACKBONES:
        module, strides, *_ = make_backbone(name, weights)
        module = module if computed is None else module.clone(dtype=computed)
        return OnBackbone(classes, module, strides, dtype=computed, **options)
    if name in VGG_NETS:
        options["norm"] = norm
    return _NETS[name](classes=classes, dtype=computed, **options)


def net_of(spec: NetSpec, classes: int) -> nn.Module:
    """The network that some settings train, from their `net_spec`."""
    if spec.backbone is None:
        return net(spec.net, classes, spec.dtype, spec.norm)
    return net(
        spec.net,
        classes,
        spec.dtype,
        weights=spec.backbone.weights,
        width=spec.head_width,
        dropout=spec.head_dropout,
    )


def variables_of(trained: Any) -> Any:
    """The variables of a trained network, by collection.

    Args:
        trained: the variables; or a tree from a version without collections, which holds parameters and,
            among those of a head, its statistics.
    """
    if "params" in trained:
        return trained
    head = trained.get("head", {})
    names = ("mean", "deviation")
    if not set(names) <= set(head):
        return {"params": trained}
    head_params = {name: leaf for name, leaf in head.items() if name not in names}
    statistics = {"head": {name: head[name] for name in names}}
    return {"params": {**trained, "head": head_params}, STATISTICS: statistics}


__all__ = [
    "VGG16",
    "Compact",
    "DeepLabV2",
    "FCN8s",
    "FeatureMaps",
    "OnBackbone",
    "net",
    "net_of",
    "normalise",
    "variables_of",
]
