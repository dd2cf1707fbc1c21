"""The data of a whole dataset, from which summary files are made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from scene.dataset.formats.labels import Labels

CITY = "scenex"
"""First part of all image names, like the city in Cityscapes."""


class About(NamedTuple):
    """The data of a dataset for its summary files."""

    records: Callable[[], Iterable[dict[str, Any]]]  # iterates over the records of all images
    split: str
    size: tuple[int, int]  # width, height in pixels
    labels: Labels
    description: dict[str, Any]  # dataset.json


def stem(street: int, shot: int) -> str:
    """The name of one image in the form of Cityscapes' frames of a sequence."""
    return f"{CITY}_{street:06d}_{shot:06d}"
