"""Reads `.safetensors`: the length of a JSON header, the header, then the tensors' bytes."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from seg.errors import WeightsError
from seg.weights.tensors import from_bytes, item_size
from shell.files import parse_json, read_bytes

_DTYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "BF16": "bfloat16", "I64": "<i8"}
_LARGEST = 2**31  # bytes of the file: VGG16 in double precision has 1.1 GB
_MAX_HEADER = 100_000_000  # bytes, as in the format's own reader


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """Read all tensors, by name.

    Raises:
        WeightsError: damaged, or an element type that no weights have.
        OSError: it cannot be read.

    Source: https://huggingface.co/docs/safetensors
    """
    data = memoryview(read_bytes(path, _LARGEST))
    length = int.from_bytes(data[:8], "little")
    if length > min(len(data) - 8, _MAX_HEADER):
        raise WeightsError(f"{path}: cut short, or no safetensors file")
    try:
        header = parse_json(bytes(data[8 : 8 + length]))
    except ValueError:
        raise WeightsError(f"{path}: its header is not JSON; damaged, or no safetensors") from None
    if not isinstance(header, dict):
        raise WeightsError(f"{path}: its header is no JSON object; expected names of tensors")
    header.pop("__metadata__", None)
    body = data[8 + length :]
    arrays: dict[str, np.ndarray] = {}
    left = 2 * len(body)  # bfloat16 doubles
    for name, entry in header.items():
        arrays[name] = _array(f"{path}: {name}", entry, body)
        left -= arrays[name].nbytes
        if left < 0:
            raise WeightsError(f"{path}: {name} shares its bytes with others; it is damaged")
    return arrays


def _array(where: str, entry: Any, body: memoryview) -> np.ndarray:
    try:
        dtype, shape = str(entry["dtype"]), [int(n) for n in entry["shape"]]
        begin, end = (int(n) for n in entry["data_offsets"])
    except (KeyError, TypeError, ValueError):
        raise WeightsError(f"{where}: its entry in the header is damaged") from None
    if dtype not in _DTYPES:
        raise WeightsError(f"{where}: elements of type {dtype}; expected {', '.join(_DTYPES)}")
    size = math.prod(shape) * item_size(_DTYPES[dtype])
    if min([*shape, begin], default=0) < 0 or end - begin != size or end > len(body):
        raise WeightsError(f"{where}: lies outside the file; it is cut short or damaged")
    return from_bytes(body[begin:end], _DTYPES[dtype]).reshape(shape)
