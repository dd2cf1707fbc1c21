"""Write images as PNG files, and read them with checks."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from common.files import read_bytes
from common.pictures import MOST_BYTES, too_large

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def encode(plane: np.ndarray) -> bytes:
    """Encode an image, u8 or u16, [h, w] or RGB [h, w, 3], as a PNG file."""
    done, data = cv2.imencode(".png", plane[..., ::-1] if plane.ndim == 3 else plane)
    if not done:
        raise ValueError(f"cannot encode an image of shape {plane.shape} and type {plane.dtype}")
    return data.tobytes()


def fault_of(data: bytes) -> str | None:
    """What is wrong with the bytes of a PNG file (not one, cut short, damaged), or None.

    Decoders silently pad a truncated file, so this checks chunks and checksums.
    """
    if not data.startswith(_SIGNATURE):
        return "is not a PNG file"
    at = len(_SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, end = data[at + 4 : at + 8], at + 12 + length
        if end > len(data):
            break
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(data[at + 4 : end - 4]) != checksum:
            return "is damaged"
        if kind == b"IEND":
            return None
        at = end
    return "is cut short"


def read_png(path: Path) -> np.ndarray:
    """Read an image that ``encode`` encoded.

    Raises:
        ValueError: it is not a complete PNG file; the message names it.
        OSError: it cannot be read.
    """
    return decode(read_bytes(path, MOST_BYTES), str(path))


def decode(data: bytes, name: str) -> np.ndarray:
    """Decode an image that ``encode`` encoded; raises ValueError with its name if it is damaged."""
    fault = fault_of(data)
    if fault is not None:
        raise ValueError(f"{name} {fault}")
    why = too_large(data)
    if why is not None:
        raise ValueError(f"{name}: {why}")
    plane = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if plane is None:
        raise ValueError(f"{name} cannot be decoded")
    return plane[..., ::-1] if plane.ndim == 3 else plane
