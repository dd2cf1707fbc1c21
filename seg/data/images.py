"""Decodes one image file into an array, or raises an error that says what is wrong with it."""

import io
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from seg.errors import DataError
from shell.errors import UserError
from shell.files import read_bytes
from shell.pictures import MOST_BYTES, too_large

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def read_file(path: Path) -> bytes:
    """Read the bytes of an image or a label file.

    Raises:
        DataError: it cannot be read, or is too large.
    """
    try:
        data = read_bytes(path, MOST_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from error
    except UserError as error:
        raise DataError(str(error)) from None
    why = too_large(data)
    if why is not None:
        raise DataError(f"{path}: {why}; expected a photograph, or labels, of a smaller size")
    return data


def _unreadable(path: Path, why: object) -> DataError:
    return DataError(
        f"{path}: not a readable image, broken or truncated ({why}); put an intact copy there"
    )


def decode(path: Path, data: bytes, flags: int) -> np.ndarray:
    """Decode the bytes of an image file into pixels in OpenCV's layout.

    Raises:
        DataError: they are no image, broken or truncated.
    """
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        raise _unreadable(path, error) from error
    if pixels is None:
        raise _unreadable(path, "decoding failed" if data else "the file is empty")
    return pixels


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read a photograph as RGB, turned as its EXIF orientation says.

    Grey becomes three equal channels, 16 bits become 8.

    Raises:
        DataError: the file is missing, not an image, broken or truncated.
    """
    data = read_file(path)
    if data.startswith(_JPEG_START) and not data.rstrip(b"\0\r\n").endswith(_JPEG_END):
        # OpenCV silently fills the lost part of a truncated JPEG with grey; Pillow reports it.
        try:
            Image.open(io.BytesIO(data)).load()
        except OSError as error:
            raise _unreadable(path, error) from error
    bgr = decode(path, data, cv2.IMREAD_COLOR)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
