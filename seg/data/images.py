"""Decode one image or one label file into an array, or say clearly what is wrong with it."""

import io
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from seg.classes import ClassTable
from seg.errors import DataError
from shell.errors import UserError
from shell.files import read_bytes
from shell.pictures import MOST_BYTES, label_ids, too_large

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def _read_bytes(path: Path) -> bytes:
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


def _decode(path: Path, data: bytes, flags: int) -> np.ndarray:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        raise _unreadable(path, error) from error
    if pixels is None:
        raise _unreadable(path, "decoding failed" if data else "the file is empty")
    return pixels


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read a photograph as RGB; grey becomes three equal channels, 16 bits become 8.

    Raises:
        DataError: the file is missing, not an image, broken or truncated.
    """
    data = _read_bytes(path)
    if data.startswith(_JPEG_START) and not data.rstrip(b"\0\r\n").endswith(_JPEG_END):
        # OpenCV fills the lost part of a truncated JPEG with grey and says nothing; Pillow tells.
        try:
            Image.open(io.BytesIO(data)).load()
        except OSError as error:
            raise _unreadable(path, error) from error
    bgr = _decode(path, data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def read_label(path: Path, table: ClassTable) -> UInt8[np.ndarray, "h w"]:
    """Read a label file and map its values to the ids of a table, 255 for void.

    Args:
        path: PNG of one channel, grey of 1 to 16 bits or with a palette.
        table: which values are legal, and what they mean.

    Raises:
        DataError: the file is missing, broken, in colours, or holds a value outside the table.
    """
    data = _read_bytes(path)
    try:
        values = label_ids(data)
    except UserError as error:
        raise DataError(f"{path}: {error}") from error
    return _mapped(path, values, table)


def read_packed_label(path: Path, table: ClassTable) -> UInt8[np.ndarray, "h w"]:
    """Read a label file of SYNTHIA, 16 bits: class ids in the first channel, instances in the second.

    Args:
        path: PNG of three channels.
        table: which values are legal, and what they mean.

    Raises:
        DataError: the file is missing, broken, of other channels or bits, or holds a value outside the table.
    """
    channels = _decode(path, _read_bytes(path), cv2.IMREAD_UNCHANGED)
    if channels.ndim != 3 or channels.dtype != np.uint16:
        count = 1 if channels.ndim == 2 else channels.shape[2]
        raise DataError(
            f"{path}: {count} channel(s) of {8 * channels.itemsize} bits; expected three of 16, "
            "with class ids in the first (GT/LABELS of SYNTHIA, not GT/COLOR)"
        )
    return _mapped(path, channels[..., 2], table)  # OpenCV turns the channels round


def _mapped(path: Path, values: np.ndarray, table: ClassTable) -> np.ndarray:
    """Ids of the table from values in a file, if all are legal."""
    if values.max() > 255 or not table.legal[values].all():
        found = np.unique(values)
        wrong = [int(v) for v in found if v > 255 or not table.legal[v]]
        shown = ", ".join(map(str, wrong[:5])) + (", ..." if len(wrong) > 5 else "")
        raise DataError(
            f"{path}: label value {shown} lies outside the {table.name} table; "
            f"legal values are 0..{np.flatnonzero(table.legal)[-1]}"
        )
    return table.from_file[values]
