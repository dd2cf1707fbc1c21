"""Reads an image file as an array, or raises an error that says what is wrong with it."""

import io
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from common.errors import UserError
from common.files import read_bytes
from common.pictures import MOST_BYTES, too_large, unreadable
from seg.errors import DataError

# Warnings on damaged files do not say which; our errors do.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
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
        raise DataError(f"{path}: {why}; resize it")
    return data


_ORIENTATION = 0x112
"""EXIF's tag of the orientation of an image."""
_BITS = 258
"""TIFF's tag of the bits per channel."""


class Header(NamedTuple):
    """What the header of an image file says."""

    stored: tuple[int, int]  # width and height of the stored pixels
    orientation: int  # of EXIF, 1 for none; values from 5 on swap width and height

    @property
    def size(self) -> tuple[int, int]:
        """Width and height as `read_image` rotates the image."""
        width, height = self.stored
        return (height, width) if self.orientation >= 5 else (width, height)


def read_header(path: Path) -> Header:
    """Read the size of an image without decoding it.

    Raises:
        DataError: the file cannot be read, is not an image, or has too many pixels.
    """
    if why := too_large(path):
        raise DataError(f"{path}: {why}; resize it")
    try:
        with Image.open(path) as picture:
            orientation = picture.getexif().get(_ORIENTATION, 1)
            header = Header(picture.size, orientation if isinstance(orientation, int) else 1)
            # Pillow gives the size of a TIFF as rotated.
            return header._replace(stored=header.size) if picture.format == "TIFF" else header
    except Exception as error:  # Pillow has many errors
        if isinstance(error, OSError) and error.strerror:  # the disk's, not Pillow's
            raise DataError(f"{path}: cannot be read ({error.strerror})") from None
        raise _unreadable(path, error) from None


def is_deep(path: Path) -> bool:
    """Whether an image file has 16 bits per channel, by its header. Raises OSError if it cannot be opened."""
    with Image.open(path) as picture:
        if picture.format == "PNG":
            with path.open("rb") as file:
                return file.read(25)[24:] == b"\x10"
        if picture.format == "TIFF":
            bits = picture.tag_v2.get(_BITS, (8,))  # type: ignore[attr-defined]
            return max(bits if isinstance(bits, tuple) else (bits,)) == 16
    return False


def check_end(path: Path) -> None:
    """Refuse a truncated image: a PNG or a JPEG by its last bytes alone, others by decoding them.

    Raises:
        DataError: the file is truncated or broken.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(8)
        file.seek(max(path.stat().st_size - 1024, 0))
        end = file.read()
    if start.startswith(b"\x89PNG") and b"IEND" not in end:
        raise _unreadable(path, "its end is missing")
    if not start.startswith((b"\x89PNG", _JPEG_START)):
        read_image(path)
    if start.startswith(_JPEG_START):
        _check_jpeg(path, path, end)


def _check_jpeg(path: Path, source: Path | io.BytesIO, end: bytes) -> None:
    """Refuse a truncated JPEG, whose lost part OpenCV silently fills with grey; Pillow reports it."""
    if not end.rstrip(b"\0\r\n").endswith(_JPEG_END):
        try:
            Image.open(source).load()
        except Exception as error:  # Pillow has many errors
            raise _unreadable(path, error) from error


def _unreadable(path: Path, why: object) -> DataError:
    return DataError(f"{path}: {unreadable(why)}")


def decode(path: Path, data: bytes, flags: int) -> np.ndarray:
    """Decode the bytes of an image file into pixels in OpenCV's layout.

    Raises:
        DataError: they are not an image, or are broken or truncated.
    """
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        raise _unreadable(path, error) from error
    if pixels is None:
        mode = _mode(data)
        if mode.startswith("F"):
            raise DataError(
                f"{path}: has floating-point values (mode {mode}); expected 8 or 16 bits per channel"
            )
        raise _unreadable(path, "decoding failed" if data else "the file is empty")
    return pixels


def _mode(data: bytes) -> str:
    """Pillow's mode of an intact image file, such as RGB, or F for floating point; else empty."""
    try:
        with Image.open(io.BytesIO(data)) as picture:
            picture.load()
            return picture.mode
    except Exception:  # Pillow has many errors
        return ""


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read a photograph as RGB, rotated as its EXIF orientation says.

    Grey becomes three equal channels, 16 bits become 8.

    Raises:
        DataError: the file is missing, not an image, broken or truncated.
    """
    data = read_file(path)
    if data.startswith(_JPEG_START):
        _check_jpeg(path, io.BytesIO(data), data[-1024:])
    bgr = decode(path, data, cv2.IMREAD_COLOR)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
