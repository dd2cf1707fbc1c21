"""Features of lite0's frozen trunk: computed once, kept as float16, shared by all steps, seeds and heads."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float32, UInt8

from seg.nets.lite0 import SMALLEST, Pyramid, Trunk, pyramid, statistics
from seg.settings import Dtype
from seg.weights import lite0

BATCH = 8
"""Images per call of the trunk."""
CHANNELS = (64, 112, 320)
"""Of the maps at strides 8, 16 and 32."""
Params = Any  # a pytree


def check_size(images: UInt8[np.ndarray, "n h w 3"]) -> None:
    """Raise ValueError for images that the trunk is too coarse for."""
    h, w = images.shape[1:3]
    if min(h, w) < SMALLEST:
        raise ValueError(
            f"images of {w}x{h} pixels are too small for lite0: its trunk has a stride of "
            f"{SMALLEST}, so both sides must be at least {SMALLEST}"
        )


@lru_cache(maxsize=2)
def trunk_params() -> Params:
    """The trunk's ImageNet weights on the device; WeightsError where there are none."""
    return jax.device_put(lite0.load().trunk)


def maps_of(params: Params, images: UInt8[Array, "b h w 3"], dtype: Dtype = "float32") -> Pyramid:
    """Features of images, with the trunk's weights; part of a compiled function."""
    trunk = Trunk(jnp.bfloat16 if dtype == "bfloat16" else None)
    maps = pyramid(trunk.apply({"params": params}, images.astype(jnp.float32) / 255))
    return jax.tree.map(lambda m: m.astype(jnp.float16), maps)


@lru_cache(maxsize=2)
def _extractor(dtype: Dtype) -> Callable[[Params, ArrayLike], Pyramid]:
    @jax.jit
    def extract(params: Params, images: UInt8[Array, "b h w 3"]) -> Pyramid:
        if jax.default_backend() != "cpu":
            return maps_of(params, images, dtype)
        # One image fits the cache: a third less time than eight at once.
        maps = jax.lax.map(lambda image: maps_of(params, image[None], dtype), images)
        return jax.tree.map(lambda m: m[:, 0], maps)

    return extract


def features(images: UInt8[np.ndarray, "n h w 3"], dtype: Dtype = "float32") -> Pyramid:
    """What the ImageNet trunk sees in images: maps at strides 8, 16 and 32, float16, in NumPy.

    About 3.6 bytes per pixel: 150 kB for an image of 240x176, 620 kB for one of 480x360. The trunk is not
    symmetric ("SAME" padding puts the odd cell after): features of a mirrored image are not its
    features mirrored, but 7 pixels off at stride 8.

    Args:
        images: RGB, at least 32x32.
        dtype: what the trunk computes in.

    Raises:
        ValueError: the images are too small.
        WeightsError: the trunk's weights cannot be used.
    """
    check_size(images)
    extract, params = _extractor(dtype), trunk_params()
    count = len(images)
    found: Pyramid | None = None
    for start in range(0, count, BATCH):
        batch = images[start : start + BATCH]
        there = slice(start, start + len(batch))
        batch = np.pad(batch, [(0, min(BATCH, count) - len(batch)), (0, 0), (0, 0), (0, 0)])
        maps = [np.asarray(m) for m in extract(params, batch)]
        if found is None:
            found = Pyramid(*(np.empty((count, *m.shape[1:]), np.float16) for m in maps))
        for into, m in zip(found, maps, strict=True):
            into[there] = m[: there.stop - there.start]
    assert found is not None
    return found


def check_features(maps: Pyramid, images: UInt8[np.ndarray, "n h w 3"], views: int = 1) -> None:
    """Raise ValueError unless features are, in number and size, those of some images, so many of each."""
    count, h, w, _ = images.shape
    count *= views
    rows, cols = -(-h // 8), -(-w // 8)
    for name, m, times, c in zip(Pyramid._fields, maps, (1, 2, 4), CHANNELS, strict=True):
        expected = (count, -(-rows // times), -(-cols // times), c)
        if m.shape != expected or m.dtype != np.float16:
            raise ValueError(
                f"features: {name} is {m.dtype}{list(m.shape)}; expected float16{list(expected)}, "
                f"those of {len(images)} images of {w}x{h}"
                + (f", {views} views of each" if views > 1 else "")
            )


Statistics = tuple[Float32[np.ndarray, " channels"], Float32[np.ndarray, " channels"]]
"""Mean and standard deviation of each channel."""


def channel_statistics(maps: Pyramid) -> Statistics:
    """Mean and standard deviation of each channel over all images and cells, for `train`'s head."""
    mean, deviation = jax.jit(statistics)(maps)
    return np.asarray(mean), np.asarray(deviation)
