"""Pictures of any origin: how large one is, before its pixels take memory, and the ids in a label file."""

from __future__ import annotations

import io
import warnings

import numpy as np

from shell.errors import UserError

MOST_PIXELS, MOST_BYTES = 50_000_000, 500_000_000
"""Of one picture and its file; the engine renders none that is larger."""


def too_large(data: bytes) -> str | None:
    """Why the bytes of an image file are not to be decoded; None for those that may be.

    What is no image is left to the decoder, whose message is better.
    """
    from PIL import Image  # not for programs that read none

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as picture:
                width, height = picture.size
    except Image.DecompressionBombError:
        return f"more than {MOST_PIXELS:,} pixels"
    except Exception:  # Pillow has many
        return None
    if width * height > MOST_PIXELS:
        return f"{width}x{height} is more than {MOST_PIXELS:,} pixels"
    return None


def label_ids(data: bytes) -> np.ndarray:
    """Ids u8[h, w], or u16 where there are 16 bits, in the bytes of a label file, as they were stored.

    In a palette they are its places. Pillow spreads grey of 2 and 4 bits over 0..255; that is undone.

    Raises:
        UserError: a broken file, or one in colours; the message does not say which file.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as picture:
            mode, kind = picture.mode, picture.format
            values = np.asarray(picture)
    except Exception as error:  # Pillow has many
        why = f"not a readable image, broken or truncated ({error})"
        raise UserError(f"{why}; put an intact copy there") from error
    if mode not in ("P", "L", "1") and not mode.startswith("I"):
        raise UserError(
            f"a label of mode {mode}, that is colours; expected one channel of class ids"
        )
    if mode == "L" and kind == "PNG":
        bits = data[24]  # of the header, which comes first
        return values // (255 // (2**bits - 1))
    return values.astype(np.uint8) if mode == "1" else values
