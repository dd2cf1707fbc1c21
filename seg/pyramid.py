"""Features of a frozen backbone, computed once, kept as float16, and shared by all steps, seeds and heads."""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float32, UInt8

from seg.batches import in_batches, usual_batch
from seg.nets.backbones import Params, backbone_of, make_backbone
from seg.nets.head import Maps, statistics
from seg.settings import BackboneSpec, TrainSettings
from seg.views import view_images, with_mirror


def check_size(images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings) -> None:
    """Raise ValueError for images that are smaller than the backbone's largest stride."""
    (h, w), coarsest = images.shape[1:3], max(backbone_of(settings).strides)
    if min(h, w) < coarsest:
        raise ValueError(
            f"images of {w}x{h} pixels are too small for {settings.net}: its backbone has a stride of "
            f"{coarsest}, so both sides must be at least {coarsest}"
        )


def backbone_params(settings: TrainSettings) -> Params:
    """The backbone's weights on the device; WeightsError if there are none."""
    return _params(settings.net, settings.weights)


@lru_cache(maxsize=2)
def _params(net: str, weights: str | None) -> Params:
    return jax.device_put(make_backbone(net, weights).load())


def maps_of(params: Params, images: UInt8[Array, "b h w 3"], spec: BackboneSpec) -> Maps:
    """Compute features of images with the backbone's weights, inside a compiled function."""
    module = make_backbone(spec.net, spec.weights).module
    if spec.dtype == "bfloat16":
        module = module.clone(dtype=jnp.bfloat16)
    maps = module.apply({"params": params}, images.astype(jnp.float32) / 255)
    return tuple(m.astype(jnp.float16) for m in maps)


@lru_cache(maxsize=2)
def _extractor(spec: BackboneSpec) -> Callable[[Params, ArrayLike], Maps]:
    @jax.jit
    def extract(params: Params, images: UInt8[Array, "b h w 3"]) -> Maps:
        def whole_batch(params: Params, images: Array) -> Maps:
            return maps_of(params, images, spec)

        def one_by_one(params: Params, images: Array) -> Maps:
            # One image fits a CPU's cache, which takes a third less time than eight at once.
            maps = jax.lax.map(lambda image: maps_of(params, image[None], spec), images)
            return jax.tree.map(lambda m: m[:, 0], maps)

        return jax.lax.platform_dependent(params, images, cpu=one_by_one, default=whole_batch)

    return extract


def features(
    images: UInt8[np.ndarray, "n h w 3"],
    settings: TrainSettings,
    batch: int | None = None,
) -> Maps:
    """Compute the backbone's maps of images, as float16 in NumPy.

    Those of lite0 take about 3.5 bytes per pixel: 150 kB for an image of 240x176, 620 kB for one of 480x360.
    A Lite is not symmetric ("SAME" padding puts the odd cell after): the features of a mirrored image are the
    mirrored features shifted by 7 pixels at stride 8.

    Args:
        images: RGB, no side shorter than the largest stride.
        settings: they name the backbone, its weights and its type of computation.
        batch: images per call of the backbone; the default suits the backend.

    Raises:
        ValueError: the images are too small.
        WeightsError: the backbone's weights cannot be used.
    """
    check_size(images, settings)
    extract = _extractor(BackboneSpec(settings.net, settings.weights, settings.dtype))
    params = backbone_params(settings)
    size = usual_batch(len(images)) if batch is None else min(batch, len(images))
    return in_batches(lambda part: extract(params, part), images, size)


def training_features(images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings) -> Maps:
    """Compute the features that `train` takes: of all views of each image. Errors are those of `features`."""
    return features(view_images(images, settings), settings)


def prediction_features(images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings) -> Maps:
    """Compute the features that `predict` and `score` take: of images, and of mirror images if they count.

    Errors are those of `features`.
    """
    return features(with_mirror(images, settings), settings)


def check_features(
    maps: Maps, images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings, views: int = 1
) -> None:
    """Raise ValueError unless features have the number and sizes of so many views of images."""
    count, h, w, _ = images.shape
    backbone = backbone_of(settings)
    cells = zip(backbone.strides, backbone.channels, strict=True)
    expected = [(views * count, -(-h // stride), -(-w // stride), c) for stride, c in cells]
    if [m.shape for m in maps] != expected or any(m.dtype != np.float16 for m in maps):
        shapes = ", ".join(f"{m.dtype}{list(m.shape)}" for m in maps)
        raise ValueError(
            f"features are {shapes}; expected float16 {', '.join(str(list(s)) for s in expected)}, "
            f"those of {settings.net} in {len(images)} images of {w}x{h}"
            + (f", {views} views of each" if views > 1 else "")
        )


Statistics = tuple[Float32[np.ndarray, " channels"], Float32[np.ndarray, " channels"]]
"""Mean and standard deviation of each channel."""


def channel_statistics(maps: Maps) -> Statistics:
    """Mean and standard deviation of each channel over all images and cells, for the head of `train`."""
    mean, deviation = jax.jit(statistics)(maps)
    return np.asarray(mean), np.asarray(deviation)
