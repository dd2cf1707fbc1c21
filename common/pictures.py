"""Image files of any origin: their size, checked before they are decoded, and the ids in a label file."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from common.errors import UserError

MOST_PIXELS, MOST_BYTES = 50_000_000, 500_000_000
"""Limits of an image and its file; the engine renders no larger ones."""


def too_large(image_file: bytes | Path) -> str | None:
    """Explain why an image file, or its bytes, must not be decoded; None if it may be.

    What is not an image is left to the decoder, whose message is better.
    """
    from PIL import Image  # only for programs that read images

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            file = image_file if isinstance(image_file, Path) else io.BytesIO(image_file)
            with Image.open(file) as image:
                width, height = image.size
    except Image.DecompressionBombError:
        return f"more than {MOST_PIXELS:,} pixels"
    except Exception:  # Pillow has many errors
        return None
    if width * height > MOST_PIXELS:
        return f"{width}x{height} is more than {MOST_PIXELS:,} pixels"
    return None


def _as_stored(data: bytes, values: np.ndarray) -> np.ndarray:
    """Decode the channels of an image with all of their bits; grey with alpha has four channels."""
    import cv2  # only for files of 16 bits and of other formats than PNG

    stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return values if stored is None or stored.ndim != 3 else stored


def unreadable(why: object) -> str:
    """Say that an image is broken; an error of Pillow that would repeat its path or buffer is shortened."""
    from PIL import UnidentifiedImageError

    why = "unknown format" if isinstance(why, UnidentifiedImageError) else why
    return f"not a readable image, broken or truncated ({why}); replace it with an intact copy"


def label_ids(data: bytes) -> np.ndarray:
    """Decode the ids of a label file as they are stored, u8[h, w], or u16[h, w] for 16 bits.

    Ids of a palette are its indices. Pillow spreads grey of 2 and 4 bits over 0..255; this is undone. Grey in
    three equal channels, or with transparency, is ids, too.

    Raises:
        UserError: the file is broken or in colours; the message does not name it.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:
            mode, kind = image.mode, image.format
            values = np.asarray(image)
    except Exception as error:  # Pillow has many errors
        raise UserError(unreadable(error)) from error
    if mode in ("LA", "RGB", "RGBA"):
        if kind != "PNG" or data[24] == 16:  # in the header; Pillow halves the bits of colours
            values = _as_stored(data, values)
        colours = values[..., : 1 if mode == "LA" and values.shape[-1] == 2 else 3]
        if (colours == values[..., :1]).all():
            return values[..., 0]
    if mode.startswith("F"):
        raise UserError(
            f"has floating-point values (mode {mode}); save class ids as whole numbers, in a PNG"
        )
    if mode not in ("P", "L", "1") and not mode.startswith("I"):
        raise UserError(f"a label in colours (mode {mode}); expected one channel of class ids")
    if mode == "L" and kind == "PNG":
        bits = data[24]  # in the header
        return values // (255 // (2**bits - 1))
    return values.astype(np.uint8) if mode == "1" else values
