"""Reads `.safetensors` with its library, also element types that NumPy lacks."""

from pathlib import Path

import numpy as np
from safetensors import SafetensorError, deserialize, safe_open

from common.files import read_bytes
from seg.errors import WeightsError
from seg.weights.tensors import LARGEST, from_bytes

_DTYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "BF16": "bfloat16", "I64": "<i8"}


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """Read all tensors, by name.

    Raises:
        WeightsError: the file is damaged, or has an element type that no weights have.
        OSError: the file cannot be read.
    """
    try:
        tensors = dict(deserialize(read_bytes(path, LARGEST)))
    except SafetensorError as error:
        raise WeightsError(f"{path}: damaged, or no safetensors file ({error})") from None
    for name, tensor in tensors.items():
        if tensor["dtype"] not in _DTYPES:
            names = ", ".join(_DTYPES)
            raise WeightsError(
                f"{path}: {name}: elements of type {tensor['dtype']}; expected {names}"
            )
    return {
        name: from_bytes(memoryview(tensor["data"]), _DTYPES[tensor["dtype"]]).reshape(
            tensor["shape"]
        )
        for name, tensor in tensors.items()
    }


def source_of(path: Path) -> str | None:
    """The description of the weights in a file's metadata; None without one, or for another kind of file."""
    try:
        with safe_open(path, "np") as file:
            return (file.metadata() or {}).get("source")
    except SafetensorError:
        return None
