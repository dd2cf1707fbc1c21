"""Reads weights of DINOv2 from a file in Hugging Face's layout and checks each tensor, without a download."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from seg.errors import WeightsError
from seg.nets.dinov2 import GRID, MLP, PATCH, VARIANTS
from seg.weights.named import Named

_NAMES = " or ".join(
    f"{variant.name} with {channels} channels" for channels, variant in VARIANTS.items()
)
_FIRST = "embeddings.cls_token"
_LINEAR = {
    "query": "attention.attention.query",
    "key": "attention.attention.key",
    "value": "attention.attention.value",
    "out": "attention.output.dense",
    "fc1": "mlp.fc1",
    "fc2": "mlp.fc2",
}
"""Linear parts of one of our layers, and their names in the file."""


class Weights(NamedTuple):
    """The contents of a file."""

    channels: int  # of a token
    params: dict[str, Any]  # of `seg.nets.dinov2.DinoV2`


def weights_of(arrays: Mapping[str, np.ndarray], where: str) -> Weights:
    """Check every tensor's name and shape, and convert the tensors to our layout.

    Args:
        arrays: the file's arrays.
        where: the file's name in messages.

    Raises:
        WeightsError: a tensor is missing, misshapen or not finite, or of another network.
    """
    first_token = arrays.get(_FIRST)
    c = first_token.shape[-1] if first_token is not None and first_token.ndim else 0
    if c not in VARIANTS:
        problem = " is missing" if first_token is None else f": {list(first_token.shape)}"
        raise WeightsError(
            f"{where}: {_FIRST}{problem}; expected DINOv2 in Hugging Face's layout, {_NAMES}"
        )
    tensors = Named(arrays, where, f"DINOv2 {VARIANTS[c].name}", unused=["embeddings.mask_token"])

    def linear(name: str, inner: int, outer: int) -> dict[str, np.ndarray]:
        kernel = tensors.take(f"{name}.weight", (outer, inner)).T
        return {"kernel": kernel, "bias": tensors.take(f"{name}.bias", (outer,))}

    def norm(name: str) -> dict[str, np.ndarray]:
        return {
            "scale": tensors.take(f"{name}.weight", (c,)),
            "bias": tensors.take(f"{name}.bias", (c,)),
        }

    def layer(at: str) -> dict[str, Any]:
        sizes = {"fc1": (c, MLP * c), "fc2": (MLP * c, c)}
        return {
            **{k: linear(f"{at}.{v}", *sizes.get(k, (c, c))) for k, v in _LINEAR.items()},
            **{f"norm{k}": norm(f"{at}.norm{k}") for k in (1, 2)},
            **{f"scale{k}": tensors.take(f"{at}.layer_scale{k}.lambda1", (c,)) for k in (1, 2)},
        }

    positions = tensors.take("embeddings.position_embeddings", (1, 1 + GRID * GRID, c))[0]
    projection = "embeddings.patch_embeddings.projection"
    kernel = tensors.take(f"{projection}.weight", (c, 3, PATCH, PATCH))
    params = {
        "patch": {
            "kernel": kernel.transpose(2, 3, 1, 0).reshape(-1, c),
            "bias": tensors.take(f"{projection}.bias", (c,)),
        },
        "positions": positions[1:].reshape(GRID, GRID, c),
        "first": tensors.take(_FIRST, (1, 1, c))[0, 0] + positions[0],
        **{f"layer{k}": layer(f"encoder.layer.{k}") for k in range(VARIANTS[c].depth)},
        "norm": norm("layernorm"),
    }
    tensors.refuse_others()
    return Weights(c, params)
