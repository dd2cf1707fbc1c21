"""What a frozen trunk looks at: each training image as it is, then augmented, so and so often.

Features are computed once, so augmentation happens before training instead of in every step. Its random
numbers depend on the settings and on an image's place alone: nets of all seeds share the same features.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int32, UInt8, UInt32

from seg.augment import MIRROR, augment, draw
from seg.batches import in_batches
from seg.settings import TrainSettings

SEED = 2020
"""Of the numbers that augment a view, with the view's own."""
BATCH = 8
"""Images that are augmented at once."""


def view_images(
    images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings
) -> UInt8[np.ndarray, "views_n h w 3"]:
    """All views of all images: first the images, then the second view of each, and so on."""
    labels = np.zeros(images.shape[:3], np.uint8)
    return _views(images, lambda v: _each(v, images, labels, settings, 0), settings)


def view_labels(
    labels: UInt8[np.ndarray, "n h w"], settings: TrainSettings
) -> UInt8[np.ndarray, "views_n h w"]:
    """The labels of `view_images`; beside a picture that was shrunk they are void."""
    images = np.zeros((*labels.shape[:1], 1, 1, 3), np.uint8)
    return _views(labels, lambda v: _each(v, images, labels, settings, 1), settings)


def _views(
    first: np.ndarray, other: Callable[[int], np.ndarray], settings: TrainSettings
) -> np.ndarray:
    return np.concatenate([first, *(other(v) for v in range(1, settings.views))])


def _each(
    view: int, images: np.ndarray, labels: np.ndarray, settings: TrainSettings, which: int
) -> np.ndarray:
    """One view of all images (`which` 0) or labels (1)."""
    draws = _draws(view, len(labels))
    see = _viewer(_augmentation(settings), which)

    def some(picks: np.ndarray) -> Array:
        return see(images[picks], labels[picks], draws[picks], np.uint32(view), picks[0])

    return in_batches(some, np.arange(len(labels), dtype=np.int32), min(BATCH, len(labels)))


def _draws(view: int, count: int) -> Float32[np.ndarray, "count draws"]:
    """Numbers of `augment`, image by image. Odd views are mirrored, even ones are not: half of all."""
    draws = draw(np.random.default_rng([SEED, view]), count)
    draws[:, MIRROR] = 0.25 if view % 2 else 0.75
    return draws


def _augmentation(settings: TrainSettings) -> TrainSettings:
    names = ("mirror", "scale", "colour", "mix", "blur", "noise")
    return replace(TrainSettings(), **{name: getattr(settings, name) for name in names})


@lru_cache(maxsize=8)
def _viewer(settings: TrainSettings, which: int) -> Callable[..., Array]:
    @jax.jit
    def see(
        images: UInt8[Array, "b _h _w 3"],
        labels: UInt8[Array, "b h w"],
        draws: Float[Array, "b draws"],
        view: UInt32[Array, ""],
        first: Int32[Array, ""],
    ) -> UInt8[Array, "b h w *c"]:
        if which == 1:  # pixels do not matter
            images = jnp.zeros((*labels.shape, 3), jnp.uint8)
        key = jax.random.fold_in(jax.random.fold_in(jax.random.key(SEED), view), first)
        x, y = augment(images, labels, draws, settings, key)
        return y if which else jnp.round(255 * x).astype(jnp.uint8)

    return see
