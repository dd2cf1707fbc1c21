"""Images with their labels: in memory, or in files that all processes of a run read."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seg.nets.lite0 import Pyramid
from shell.errors import UserError


class Truth(NamedTuple):
    """Images and their labels, ids of the target's table."""

    images: np.ndarray  # u8[n, h, w, 3]
    labels: np.ndarray  # u8[n, h, w]
    features: Pyramid | None = None
    """Of a frozen trunk, if they are known: of the images for scoring, of all their views for training."""

    def between(self, first: int, end: int) -> Truth:
        """Images from the first up to the end, of a truth that scores; nothing is copied."""
        own = self.features and Pyramid(*(maps[first:end] for maps in self.features))
        return Truth(self.images[first:end], self.labels[first:end], own)


class Shared(NamedTuple):
    """A truth in folders of `experiments.reward.shelf`; what a task carries in its place."""

    images: str  # folder of images and labels
    features: str | None = None  # folder of their features

    def load(self) -> Truth:
        """The truth, its files mapped into memory; once per process.

        Raises:
            UserError: a file is missing or cut off.
        """
        return _load(self)


def loaded(value: Any) -> Any:
    """A truth that is shared as arrays, anything else as it is."""
    return value.load() if isinstance(value, Shared) else value


def removable(folder: str | Path) -> str:
    """What errors about a file of a shared folder end with."""
    return f"remove {folder}, and the same command writes it anew"


@lru_cache(maxsize=8)
def _load(shared: Shared) -> Truth:
    images, labels = (_mapped(shared.images, name) for name in ("images", "labels"))
    if shared.features is None:
        return Truth(images, labels)
    maps = Pyramid(*(_mapped(shared.features, name) for name in Pyramid._fields))
    return Truth(images, labels, maps)


def _mapped(folder: str, name: str) -> np.ndarray:
    path = Path(folder) / f"{name}.npy"
    try:
        return np.asarray(np.load(path, mmap_mode="r"))
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path} cannot be read ({error}); {removable(folder)}") from None
