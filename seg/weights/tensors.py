"""Tensors as files describe them: an offset in a flat storage, a shape and strides."""

import math
from typing import NamedTuple

import numpy as np

from seg.errors import WeightsError

DTYPES = {
    "BFloat16": "bfloat16",
    "Double": "<f8",
    "Float": "<f4",
    "Half": "<f2",
    "Long": "<i8",
    "Int": "<i4",
    "Short": "<i2",
    "Char": "<i1",
    "Byte": "<u1",
    "Bool": "|b1",
}
"""Element types by PyTorch's names of storages; NumPy has no bfloat16."""

LARGEST = 2**31
"""The most bytes of a file of weights, or of its arrays: VGG16 has 553 MB, twice that in double precision."""


def item_size(dtype: str) -> int:
    """Bytes of one element."""
    return 2 if dtype == "bfloat16" else np.dtype(dtype).itemsize


def from_bytes(data: bytes | memoryview, dtype: str) -> np.ndarray:
    """Read the elements of a storage; bfloat16 becomes float32, which holds it exactly."""
    if dtype == "bfloat16":
        upper = np.frombuffer(data, "<u2").astype("<u4") << 16
        return upper.view("<f4")
    return np.frombuffer(data, dtype)


class Tensor(NamedTuple):
    """A pickle's description of a tensor before its storage is read."""

    storage: str  # key
    dtype: str  # of `DTYPES`
    elements: int  # of the storage
    offset: int  # of the first element
    shape: tuple[int, ...]
    strides: tuple[int, ...]  # in elements

    def check(self, where: str) -> None:
        """Raise WeightsError unless the tensor lies within its storage."""
        numbers = (self.elements, self.offset, *self.shape, *self.strides)
        sound = len(self.shape) == len(self.strides) and all(n >= 0 for n in numbers)
        if sound and 0 not in self.shape:
            reach = sum((n - 1) * s for n, s in zip(self.shape, self.strides, strict=True))
            # With strides of 0 a few bytes could become a tensor of any size.
            sound = self.offset + reach < self.elements >= math.prod(self.shape)
        if not sound:
            raise WeightsError(f"{where}: the tensor lies outside its storage; the file is damaged")

    def view(self, storage: np.ndarray) -> np.ndarray:
        """The tensor as a view into the elements of its storage."""
        strides = [s * storage.itemsize for s in self.strides]
        return np.lib.stride_tricks.as_strided(
            storage[self.offset :], self.shape, strides, writeable=False
        )
