"""COCO's run-length masks: columns from left to right as alternating runs of off and on, in a short text.

Source: ``rleToString`` and ``rleFrString`` of the COCO API (maskApi.c), whose text is identical.
"""

from __future__ import annotations

import numpy as np


class Runs:
    """The runs of equal ids in one image, computed once for all its segments.

    Args:
        ids: i32[h, w] segment ids.
    """

    def __init__(self, ids: np.ndarray) -> None:
        flat = ids.T.ravel()
        self._starts = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1])
        self._lengths = np.diff(np.append(self._starts, flat.size))
        self._values = flat[self._starts]
        self._size = flat.size

    def counts(self, segment: int) -> list[int]:
        """Lengths of the runs off, on, off, ... of one segment's mask."""
        in_segment = self._values == segment
        if not in_segment.any():
            return [self._size]
        starts, lengths = self._starts[in_segment], self._lengths[in_segment]
        ends = starts + lengths
        gaps = starts - np.append(0, ends[:-1])
        runs = np.stack([gaps, lengths], axis=1).ravel().tolist()
        rest = self._size - int(ends[-1])
        return [*runs, rest] if rest else runs


def encode(counts: list[int]) -> str:
    """Encode runs as text: the difference of each count to the one two before, in groups of five bits."""
    letters = []
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        more = True
        while more:
            bits = value & 0x1F
            value >>= 5
            more = value != (-1 if bits & 0x10 else 0)
            letters.append(chr(48 + (bits | (0x20 if more else 0))))
    return "".join(letters)


def decode(text: str) -> list[int]:
    """The inverse of ``encode``.

    Raises:
        ValueError: the text ends within a number or contains invalid letters.
    """
    counts: list[int] = []
    value, shift = 0, 0
    for letter in text:
        bits = ord(letter) - 48
        if not 0 <= bits < 64:
            raise ValueError(f"{letter!r} is not valid in a run-length mask")
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            continue
        if bits & 0x10:
            value -= 1 << shift
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        value, shift = 0, 0
    if shift:
        raise ValueError("a run-length mask ends within a number")
    return counts


def mask(counts: list[int], height: int, width: int) -> np.ndarray:
    """The mask bool[h, w] of runs.

    Raises:
        ValueError: the runs do not fill the image.
    """
    if sum(counts) != height * width or min(counts, default=0) < 0:
        raise ValueError(f"runs of {sum(counts)} pixels do not fill an image of {width}x{height}")
    on = np.resize(np.array([False, True]), len(counts))
    return np.repeat(on, counts).reshape(width, height).T
