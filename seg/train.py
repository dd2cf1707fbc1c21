"""Train a fresh net on a labelled set, predict with it, score it.

The step is one jitted function, called in a host loop: on XLA's CPU backend gradient convolutions
run ten times slower inside `lax.scan`. On accelerators the same step is scanned in chunks. What is
compiled is kept for the life of the process: a worker trains hundreds of nets on data of one shape.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32, Int32, Int64, PRNGKeyArray, UInt8, UInt32

from seg.augment import augment, draw
from seg.classes import IGNORE_LABEL, class_table
from seg.losses import class_weights, cross_entropy
from seg.metrics import confusion_matrix
from seg.nets import net, normalise
from seg.optim import descend, optimizer, poly_schedule

Params = Any  # the pytree of a net's parameters

_CHUNK = 50  # steps between two looks at the loss; also the length of a scan on an accelerator


class TrainingError(Exception):
    """Training went wrong in its numbers: the loss is no longer finite."""


@dataclass(frozen=True)
class TrainSettings:
    """All that decides how a net is trained, apart from the data and the seed.

    Attributes:
        net: name of the net, see `seg.net`.
        table: name of the class table, see `seg.class_table`.
        optimizer: "adam" or "sgd".
        lr: highest learning rate. Paper (SGD): 5e-4.
        steps: how many updates. Paper: 1000 per reward, 20 000 at the end.
        batch: images per update. Paper: 4.
        warmup: updates over which the rate rises. Paper: 0.
        power: of the poly decay.
        momentum: of SGD.
        weight_decay: Paper: 1e-4.
        mirror: swap left and right of half of the images.
        colour: vary gamma, gain, contrast, saturation.
        blur: mix with a blur.
        weighted: balance rare classes in the loss by `class_weights`.
        predict_batch: images per call of the net in `predict`.
    """

    net: str = "compact"
    table: str = "camvid"
    optimizer: str = "adam"
    lr: float = 1e-2
    steps: int = 200
    batch: int = 8
    warmup: int = 20
    power: float = 0.9
    momentum: float = 0.9
    weight_decay: float = 0.0
    mirror: bool = True
    colour: bool = True
    blur: bool = True
    weighted: bool = True
    predict_batch: int = 16

    @property
    def classes(self) -> int:
        """How many classes the table has."""
        return len(class_table(self.table).classes)


class TrainState(NamedTuple):
    """What one update hands to the next."""

    params: Params  # of the net
    moments: optax.OptState  # of the optimiser
    step: Int32[Array, ""]  # updates so far


class _Plan(NamedTuple):
    """What is random or scheduled in each update; NumPy on the host, traced inside the step."""

    picks: Int32[Any, "*steps batch"]  # images of the batch
    draws: Float32[Any, "*steps batch draws"]  # of the augmentation
    lr: Float32[Any, "*steps"]

    def rows(self, where: int | slice) -> "_Plan":
        return _Plan(*(column[where] for column in self))


def _plan(seed: int, count: int, settings: TrainSettings) -> _Plan:
    rng = np.random.default_rng(seed)
    needed = settings.steps * settings.batch
    # Permutations, one after the other: every image is seen equally often.
    epochs = [rng.permutation(count) for _ in range(-(-needed // count))]
    picks = np.concatenate(epochs)[:needed].reshape(settings.steps, settings.batch)
    return _Plan(
        picks=picks.astype(np.int32),
        draws=draw(rng, settings.steps, settings.batch),
        lr=poly_schedule(settings.lr, settings.steps, settings.power, settings.warmup),
    )


class _Functions(NamedTuple):
    """The compiled parts; jit adds one version for each shape of the data."""

    init: Callable[..., TrainState]  # seed, images -> fresh state
    resume: Callable[..., TrainState]  # params -> state with these parameters
    step: Callable[..., tuple[TrainState, Array]]  # state, data, one row of the plan -> loss
    steps: Callable[..., tuple[TrainState, Array]]  # the same over many rows, scanned


@lru_cache(maxsize=32)
def _functions(
    net_name: str,
    classes: int,
    optimizer_name: str,
    momentum: float,
    weight_decay: float,
    flip: bool,
    colours: bool,
    blurs: bool,
) -> _Functions:
    module = net(net_name, classes)
    transform = optimizer(optimizer_name, momentum, weight_decay)

    def resume(params: Params) -> TrainState:
        return TrainState(params, transform.init(params), jnp.int32(0))

    def init(seed: UInt32[Array, ""], images: UInt8[Array, "n h w 3"]) -> TrainState:
        blank = jnp.zeros((1, *images.shape[1:]))
        # The default generator compiles four times longer here (unrolled, once per kernel).
        return resume(module.init(jax.random.key(seed, impl="rbg"), blank)["params"])

    def step(
        state: TrainState,
        images: UInt8[Array, "n h w 3"],
        labels: UInt8[Array, "n h w"],
        weights: Float32[Array, " classes"],
        seed: UInt32[Array, ""],
        row: _Plan,
    ) -> tuple[TrainState, Float[Array, ""]]:
        x, y = augment(images[row.picks], labels[row.picks], row.draws, flip, colours, blurs)
        dropout: PRNGKeyArray = jax.random.fold_in(jax.random.key(seed), state.step)

        def loss_of(params: Params) -> Float[Array, ""]:
            logits = module.apply(
                {"params": params}, normalise(x), train=True, rngs={"dropout": dropout}
            )
            return cross_entropy(logits, y, weights)

        loss, gradients = jax.value_and_grad(loss_of)(state.params)
        directions, moments = transform.update(gradients, state.moments, state.params)
        params = descend(state.params, directions, row.lr)
        return TrainState(params, moments, state.step + 1), loss

    def steps(
        state: TrainState, images: Array, labels: Array, weights: Array, seed: Array, rows: _Plan
    ) -> tuple[TrainState, Float[Array, " steps"]]:
        return jax.lax.scan(
            lambda carry, row: step(carry, images, labels, weights, seed, row), state, rows
        )

    return _Functions(
        init=jax.jit(init),
        resume=jax.jit(resume),
        step=jax.jit(step, donate_argnums=0),
        steps=jax.jit(steps, donate_argnums=0),
    )


@lru_cache(maxsize=32)
def _predictor(net_name: str, classes: int) -> Callable[[Params, ArrayLike], Array]:
    module = net(net_name, classes)

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
    progress: Callable[[int, float], None] | None = None,
    params: Params | None = None,
    stepwise: bool | None = None,
) -> Params:
    """Train a net; the same arguments give the same parameters.

    Args:
        rng_seed: 32 bits; decides initial parameters, order of the images, augmentation.
        images: RGB.
        labels: ids of the class table of the settings, 255 for void.
        settings: everything else.
        progress: called every 50 steps with the steps done and the loss of the last one.
        params: start from these (they are not changed); None starts afresh.
        stepwise: call the step from the host (True) or scan it in chunks (False); by default as
            suits the backend. The steps are the same.

    Returns:
        The parameters after the last step.

    Raises:
        ValueError: no images, shapes that do not match, label ids outside the table, or settings
            or a seed out of range.
        TrainingError: the loss is not finite.
    """
    _check(images, labels)
    if settings.steps < 1 or settings.batch < 1:
        raise ValueError(
            f"steps and batch must be at least 1; got {settings.steps} and {settings.batch}"
        )
    if not 0 <= rng_seed < 2**32:
        raise ValueError(f"rng_seed must be in 0..2**32 - 1; got {rng_seed}")
    stray = labels[(labels >= settings.classes) & (labels != IGNORE_LABEL)]
    if stray.size:
        raise ValueError(
            f"label {stray.max()} lies outside the {settings.table} table: expected "
            f"0..{settings.classes - 1}, or {IGNORE_LABEL} for void"
        )
    functions = _functions(
        settings.net,
        settings.classes,
        settings.optimizer,
        settings.momentum,
        settings.weight_decay,
        settings.mirror,
        settings.colour,
        settings.blur,
    )
    plan = _plan(rng_seed, len(images), settings)
    weights = np.ones(settings.classes, np.float32)
    if settings.weighted:
        weights = class_weights(labels, settings.classes)
    seed = np.uint32(rng_seed)
    data = jax.device_put((images, labels, weights, seed))
    if params is None:
        state = functions.init(seed, data[0])
    else:
        # The step donates its state, so work on a copy.
        state = functions.resume(jax.tree.map(jnp.array, params))
    if stepwise is None:
        stepwise = jax.default_backend() == "cpu"
    for start in range(0, settings.steps, _CHUNK):
        stop = min(start + _CHUNK, settings.steps)
        if stepwise:
            for i in range(start, stop):
                state, loss = functions.step(state, *data, plan.rows(i))
        else:
            state, losses = functions.steps(state, *data, plan.rows(slice(start, stop)))
            loss = losses[-1]
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
    params: Params, images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings
) -> UInt8[np.ndarray, "n h w"]:
    """Segment images, in batches of a fixed size (the last one padded): one compilation per shape.

    Args:
        params: from `train`.
        images: RGB, of any size.
        settings: those the parameters were trained with.

    Returns:
        The most likely class of each pixel.

    Raises:
        ValueError: there are no images, or they are not RGB bytes.
    """
    _check(images)
    predict_batch = _predictor(settings.net, settings.classes)
    size = settings.predict_batch
    parts = []
    for start in range(0, len(images), size):
        batch = images[start : start + size]
        padding = [(0, size - len(batch)), (0, 0), (0, 0), (0, 0)]
        parts.append(np.asarray(predict_batch(params, np.pad(batch, padding))))
    return np.concatenate(parts)[: len(images)]


def score(
    params: Params,
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
) -> Int64[np.ndarray, "classes classes"]:
    """Predict and compare with the truth.

    Args:
        params: from `train`.
        images: RGB.
        labels: ids of the class table, 255 for void.
        settings: those the parameters were trained with.

    Returns:
        Confusion matrix over all images; row: true class, column: predicted class.

    Raises:
        ValueError: no images, shapes that do not match, or label ids outside the table.
    """
    _check(images, labels)
    return confusion_matrix(labels, predict(params, images, settings), settings.classes)
