"""The views of training images for a frozen backbone: each image itself, then a number of augmented copies.

Features are computed once, so augmentation happens before training instead of in every step. Its random
numbers depend on the image and the settings alone: networks of all seeds share the same features, and the
features of a subset are among those of all images.
"""

import zlib
from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, UInt8, UInt32

from seg.augment import MIRROR, augment, draw
from seg.batches import in_batches, usual_batch
from seg.settings import AugmentSpec, TrainSettings

SEED = 2020
"""Seed of a view's random numbers, together with the view's number and the image's checksum."""
IMAGES, LABELS = (0,), (1,)
"""Indices of images and labels in a view."""
LOOKS = ("views", *AugmentSpec._fields)
"""The settings that decide what views show."""


def view_images(
    images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings
) -> UInt8[np.ndarray, "views_n h w 3"]:
    """Make all views of all images: first the images, then the second view of each, and so on."""
    labels = np.zeros(images.shape[:3], np.uint8)
    more_views = (_view(v, images, labels, settings, IMAGES) for v in range(1, settings.views))
    return np.concatenate([images, *(x for (x,) in more_views)])


def with_mirror(
    images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings
) -> UInt8[np.ndarray, "views_n h w 3"]:
    """The images of a test for a frozen backbone: the images, and mirrored ones if the settings say so."""
    return np.concatenate([images, images[:, :, ::-1]]) if settings.average_mirror else images


def view_labels(
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
) -> UInt8[np.ndarray, "views_n h w"]:
    """Make the labels of `view_images`; the margin of a shrunk image is ignored."""
    more_views = (_view(v, images, labels, settings, LABELS) for v in range(1, settings.views))
    return np.concatenate([labels, *(y for (y,) in more_views)])


def views(
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
) -> tuple[UInt8[np.ndarray, "views_n h w 3"], UInt8[np.ndarray, "views_n h w"]]:
    """Make the images of `view_images` and the labels of `view_labels` in one augmentation."""
    more_views = [
        _view(v, images, labels, settings, IMAGES + LABELS) for v in range(1, settings.views)
    ]
    pictures, truth = zip((images, labels), *more_views, strict=True)
    return np.concatenate(pictures), np.concatenate(truth)


def _view(
    view: int,
    images: np.ndarray,
    labels: np.ndarray,
    settings: TrainSettings,
    which: tuple[int, ...],
) -> tuple[np.ndarray, ...]:
    """Make one view of all images, of their labels, or of both."""
    sums = np.array([zlib.crc32(image.tobytes()) for image in images], np.uint32)
    draws = np.stack([_draws(view, int(checksum)) for checksum in sums])
    augment_batch = _viewer(settings.augment_spec, which)

    def batch(indices: np.ndarray) -> tuple[Array, ...]:
        return augment_batch(
            images[indices], labels[indices], draws[indices], sums[indices] ^ np.uint32(view)
        )

    return in_batches(batch, np.arange(len(images)), usual_batch(len(images)))


def _draws(view: int, checksum: int) -> Float32[np.ndarray, " draws"]:
    """Draw the numbers of `augment`; odd views are mirrored, even ones are not."""
    draws = draw(np.random.default_rng([SEED, view, checksum]))
    draws[MIRROR] = 0.25 if view % 2 else 0.75
    return draws


@lru_cache(maxsize=8)
def _viewer(spec: AugmentSpec, which: tuple[int, ...]) -> Callable[..., tuple[Array, ...]]:
    def view_of(image: Array, label: Array, draws: Array, number: Array) -> tuple[Array, ...]:
        key = jax.random.fold_in(jax.random.key(SEED), number)
        x, y = augment(image[None], label[None], draws[None], spec, key)
        view = jnp.round(255 * x[0]).astype(jnp.uint8), y[0]
        return tuple(view[k] for k in which)

    @jax.jit
    def augment_batch(
        images: UInt8[Array, "b h w 3"],
        labels: UInt8[Array, "b h w"],
        draws: Float[Array, "b draws"],
        numbers: UInt32[Array, " b"],
    ) -> tuple[UInt8[Array, "b h w *c"], ...]:
        return jax.vmap(view_of)(images, labels, draws, numbers)

    return augment_batch
