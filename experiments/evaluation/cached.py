"""Labelled images in folders of a cache, as tasks carry them to workers (`cache` writes the folders)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.errors import UserError
from common.sent import here
from seg.data import LabelledImages
from seg.mixing import TrainingSet


class Cached(NamedTuple):
    """Labelled images in folders of a cache; a task carries this instead of arrays."""

    images: str  # folder of images and labels
    features: str | None = None  # folder of their features
    picked: tuple[int, ...] | None = None  # of the images, by index; by default all

    def take(self, indices: Sequence[int] | np.ndarray) -> Cached:
        """Some of the images by index."""
        return self._replace(picked=tuple(np.asarray(indices).tolist()))

    def load(self) -> LabelledImages:
        """Load the images once per process as memory maps; picked images are copied.

        Raises:
            UserError: a file is missing or cut off.
        """
        whole = _load(self._replace(picked=None))
        return whole if self.picked is None else whole.take(self.picked)


def loaded(value: Any) -> Any:
    """Load cached images as arrays, also within a training set; other values stay as they are."""
    if isinstance(value, TrainingSet):
        return value._replace(parts=tuple(map(loaded, value.parts)))
    return value.load() if isinstance(value, Cached) else value


@lru_cache(maxsize=8)
def _load(cached: Cached) -> LabelledImages:
    images, labels = (_mapped(cached.images, name) for name in ("images", "labels"))
    if cached.features is None:
        return LabelledImages(images, labels)
    count = len(list(here(cached.features).glob("map*.npy")))
    maps = tuple(_mapped(cached.features, name) for name in map_names(count))
    return LabelledImages(images, labels, features=maps)


def map_names(maps: int) -> list[str]:
    """Names of the files of so many feature maps, without their endings."""
    return [f"map{k}" for k in range(max(maps, 1))]


def _mapped(folder: str, name: str) -> np.ndarray:
    path = here(folder) / f"{name}.npy"
    try:
        return np.asarray(np.load(path, mmap_mode="r"))
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path} cannot be read ({error}); {removable(folder)}") from None


def removable(folder: str | Path) -> str:
    """The end of errors about a file of a cache."""
    return f"remove {folder}, and run the same command again to replace it"
