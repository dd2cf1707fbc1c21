"""Train a fresh net on a labelled set, predict with it, score it.

The step is one jitted function, called in a host loop: on XLA's CPU backend gradient convolutions
run ten times slower inside `lax.scan`. On accelerators the same step is scanned in chunks.
"""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Int64, UInt8

from seg import losses
from seg.batches import in_batches
from seg.classes import IGNORE_LABEL
from seg.metrics import confusion_matrix
from seg.nets import net, normalise
from seg.settings import Dtype, NetName, TrainSettings, check_settings
from seg.step import Data, Params, functions, plan
from seg.weights import load

_CHUNK = 50  # steps between two looks at the loss; also the length of a scan on an accelerator


class TrainingError(Exception):
    """Training went wrong in its numbers: the loss is no longer finite."""


@lru_cache(maxsize=32)
def _predictor(
    net_name: NetName, classes: int, dtype: Dtype, norm: bool
) -> Callable[[Params, ArrayLike], Array]:
    module = net(net_name, classes, dtype, norm)

    @jax.jit
    def predict_batch(params: Params, images: UInt8[Array, "b h w 3"]) -> UInt8[Array, "b h w"]:
        x = normalise(images.astype(jnp.float32) / 255)
        logits = module.apply({"params": params}, x, train=False)
        return jnp.argmax(logits, axis=-1).astype(jnp.uint8)

    return predict_batch


def _check(images: np.ndarray, labels: np.ndarray | None = None) -> None:
    if images.ndim != 4 or images.shape[-1] != 3 or images.dtype != np.uint8:
        raise ValueError(f"images must be u8[n, h, w, 3]; got {images.dtype}{list(images.shape)}")
    if len(images) == 0:
        raise ValueError("zero images; expected at least one")
    if labels is None:
        return
    if labels.dtype != np.uint8 or labels.shape != images.shape[:3]:
        raise ValueError(
            f"labels must be u8{list(images.shape[:3])}, one per pixel of the images; "
            f"got {labels.dtype}{list(labels.shape)}"
        )


def train(
    rng_seed: int,
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
    classes: int,
    progress: Callable[[int, float], None] | None = None,
    params: Params | None = None,
    stepwise: bool | None = None,
) -> Params:
    """Train a net; the same arguments give the same parameters.

    Args:
        rng_seed: 32 bits; decides initial parameters, order of the images, augmentation.
        images: RGB.
        labels: class ids, 255 for void.
        settings: everything else.
        classes: how many the net tells apart.
        progress: called every 50 steps with the steps done and the loss of the last one.
        params: start from these (they are not changed); None starts afresh: from the settings'
            `weights` as far as those go, and at random.
        stepwise: call the step from the host (True) or scan it in chunks (False); by default as
            suits the backend. The steps are the same.

    Returns:
        The parameters after the last step.

    Raises:
        ValueError: no images, shapes that do not match, labels outside the classes, or settings
            or a seed out of range.
        TrainingError: the loss is not finite.
        WeightsError: the settings' `weights` cannot be used.
    """
    _check(images, labels)
    check_settings(settings)
    if not 0 <= rng_seed < 2**32:
        raise ValueError(f"rng_seed must be in 0..2**32 - 1; got {rng_seed}")
    stray = labels[(labels >= classes) & (labels != IGNORE_LABEL)]
    if stray.size:
        raise ValueError(
            f"label {stray.max()} is none of {classes} classes; expected "
            f"0..{classes - 1}, or {IGNORE_LABEL} for void"
        )
    compiled = functions(settings, classes)
    rows = plan(rng_seed, len(images), settings)
    class_weights = np.ones(classes, np.float32)
    if settings.weighted:
        class_weights = losses.class_weights(labels, classes)
    seed = np.uint32(rng_seed)
    data = jax.device_put(Data(images, labels, class_weights, seed))
    if params is not None:
        # The step donates its state, so work on a copy.
        state = compiled.resume(jax.tree.map(jnp.array, params))
    else:
        state = compiled.init(seed, data.images)
        if settings.weights is not None:
            state = compiled.resume(load(settings.weights, settings.net, state.params))
    if stepwise is None:
        stepwise = jax.default_backend() == "cpu"
    for start in range(0, settings.steps, _CHUNK):
        stop = min(start + _CHUNK, settings.steps)
        if stepwise:
            for i in range(start, stop):
                state, loss = compiled.step(state, data, rows.rows(i))
        else:
            state, every_loss = compiled.steps(state, data, rows.rows(slice(start, stop)))
            loss = every_loss[-1]
        value = float(loss)
        if not np.isfinite(value):
            raise TrainingError(
                f"the loss is {value} after {stop} of {settings.steps} steps; "
                f"a lower learning rate than {settings.lr} may help"
            )
        if progress is not None:
            progress(stop, value)
    return state.params


def predict(
    params: Params, images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings, classes: int
) -> UInt8[np.ndarray, "n h w"]:
    """Segment images.

    Args:
        params: from `train`.
        images: RGB, of any size.
        settings: those the parameters were trained with.
        classes: how many the net tells apart.

    Returns:
        The most likely class of each pixel.

    Raises:
        ValueError: there are no images, or they are not RGB bytes.
    """
    _check(images)
    predict_batch = _predictor(settings.net, classes, settings.dtype, settings.norm)
    return in_batches(lambda batch: predict_batch(params, batch), images, settings.predict_batch)


def score(
    params: Params,
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
    classes: int,
) -> Int64[np.ndarray, "classes classes"]:
    """Predict and compare with the truth.

    Args:
        params: from `train`.
        images: RGB.
        labels: class ids, 255 for void.
        settings: those the parameters were trained with.
        classes: how many the net tells apart.

    Returns:
        Confusion matrix over all images; row: true class, column: predicted class.

    Raises:
        ValueError: no images, shapes that do not match, or labels outside the classes.
    """
    _check(images, labels)
    return confusion_matrix(labels, predict(params, images, settings, classes), classes)
