"""Images with their labels: in memory, or in files that all processes of a run read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seg.data import LabelledImages
from seg.nets.lite0 import Pyramid
from shell.errors import UserError
from shell.sent import here


def part_of(images: LabelledImages, indices: Sequence[int] | np.ndarray) -> LabelledImages:
    """Some of the images; files hold all of them, once."""
    picked = np.asarray(indices)
    return images.take(picked)._replace(origin=(images, tuple(picked.tolist())))


class Shared(NamedTuple):
    """A truth in folders of `experiments.reward.shelf`; what a task carries in its place."""

    images: str  # folder of images and labels
    features: str | None = None  # folder of their features
    picked: tuple[int, ...] | None = None  # of the images, by index; by default all

    def load(self) -> LabelledImages:
        """The truth, its files mapped into memory, once per process; what is picked of it is copied.

        Raises:
            UserError: a file is missing or cut off.
        """
        whole = _load(self._replace(picked=None))
        return whole if self.picked is None else part_of(whole, self.picked)


class StreetPool(NamedTuple):
    """Streets of one shot, drawn once and used by many nets."""

    name: str  # hash of their attributes and seed
    held: LabelledImages | Shared | None = (
        None  # images, labels and features; None while they are not made
    )


class Subset(NamedTuple):
    """Some streets of a pool."""

    pool: StreetPool
    picked: tuple[int, ...]  # by index

    @property
    def images(self) -> LabelledImages | Shared:
        """Their images, labels and features; of a pool that is made."""
        held = self.pool.held
        assert held is not None
        if isinstance(held, Shared):
            return held._replace(picked=self.picked)
        return part_of(held, self.picked)


class WithFew(NamedTuple):
    """A rendered dataset, and a few labelled images, so often that they are a share of all batches."""

    rendered: Any  # the streets that it is rendered from, or a subset of a pool
    few: LabelledImages | Shared
    share: float

    @property
    def arrays(self) -> LabelledImages:
        """The few images."""
        found: LabelledImages = loaded(self.few)
        return found


def rendered_of(source: Any) -> Any:
    """A source without the few images beside it."""
    return source.rendered if isinstance(source, WithFew) else source


def loaded(value: Any) -> Any:
    """A truth that is shared as arrays, also beside a dataset, anything else as it is."""
    if isinstance(value, WithFew):
        return value._replace(rendered=loaded(value.rendered), few=loaded(value.few))
    return value.load() if isinstance(value, Shared) else value


def removable(folder: str | Path) -> str:
    """What errors about a file of a shared folder end with."""
    return f"remove {folder}, and the same command writes it anew"


@lru_cache(maxsize=8)
def _load(shared: Shared) -> LabelledImages:
    images, labels = (_mapped(shared.images, name) for name in ("images", "labels"))
    if shared.features is None:
        return LabelledImages(images, labels)
    maps = Pyramid(*(_mapped(shared.features, name) for name in Pyramid._fields))
    return LabelledImages(images, labels, features=maps)


def _mapped(folder: str, name: str) -> np.ndarray:
    path = here(folder) / f"{name}.npy"
    try:
        return np.asarray(np.load(path, mmap_mode="r"))
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path} cannot be read ({error}); {removable(folder)}") from None
