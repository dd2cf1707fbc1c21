"""Images and labels of noise, for benchmarks of time, in which their values do not matter."""

from __future__ import annotations

import numpy as np

from seg.data import LabelledImages

CLASSES = 11


def noise(count: int, size: tuple[int, int], classes: int = CLASSES) -> LabelledImages:
    """Make so many images of a height and width."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (count, *size, 3), np.uint8)
    return LabelledImages(images, rng.integers(0, classes, (count, *size), np.uint8))
