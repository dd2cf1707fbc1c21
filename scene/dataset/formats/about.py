"""What is known of a whole dataset when the files about all its images are written."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from scene.dataset.formats.labels import Labels

CITY = "scenex"
"""What all images are called after, as those of Cityscapes after their city."""


class About(NamedTuple):
    """A dataset, as the files about all images see it."""

    records: Callable[[], Iterable[dict[str, Any]]]  # begins anew: what is known of each image
    split: str
    size: tuple[int, int]  # width, height in pixels
    labels: Labels
    description: dict[str, Any]  # dataset.json


def stem(street: int, shot: int) -> str:
    """The name of one image, as Cityscapes would name a frame of a sequence."""
    return f"{CITY}_{street:06d}_{shot:06d}"
