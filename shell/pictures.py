"""How large a picture is, by its header: looked at before its pixels take memory."""

from __future__ import annotations

import io
import warnings

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
