"""One compiled update of a network (augmentation, loss, gradient, optimiser), and its random numbers.

Compiled functions are kept until the process ends: a worker trains hundreds of networks on data of one shape.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Float32, Int32, PRNGKeyArray, UInt8, UInt32

from seg.augment import augment, draw
from seg.losses import cross_entropy, cross_entropy_sums, soft_jaccard
from seg.mixing import batch_indices
from seg.nets import net_of
from seg.nets.backbones import Params
from seg.nets.ops.resize import strided
from seg.optim import descend, optimizer, poly_schedule
from seg.settings import StepSpec, TrainSettings

Variables = Any  # a network's parameters and other collections, by name


class TrainState(NamedTuple):
    """The state between two updates."""

    params: Params  # of the network
    opt_state: optax.OptState  # of the optimiser
    step: Int32[Array, ""]  # updates so far
    mean: Params = None  # of the averaged parameters; None if the settings average nothing
    fixed: Variables = {}  # collections that no update changes; most networks have none

    @property
    def trained(self) -> Variables:
        """The variables of the trained network."""
        return {"params": self.params if self.mean is None else self.mean, **self.fixed}


class Data(NamedTuple):
    """The data that all updates of a training share; NumPy or JAX."""

    images: Any  # u8[n h w 3]; for a frozen backbone the `FeatureMaps` of all their views
    labels: UInt8[Any, "n h w"]
    class_weights: Float32[Any, " classes"]  # of the loss
    seed: UInt32[Any, ""]  # of dropout and noise


class Plan(NamedTuple):
    """The random or scheduled numbers of each update; NumPy on the host, traced inside the step."""

    batch_indices: Int32[Any, "*steps batch"]  # images of the batch
    draws: Float32[Any, "*steps batch draws"]  # of the augmentation
    lr: Float32[Any, "*steps"]
    weight: Float32[Any, "*steps"]  # of these parameters in the mean of all so far

    def rows(self, where: int | slice) -> "Plan":
        """The plan of one update, or of several."""
        return Plan(*(column[where] for column in self))


def plan(
    seed: int, counts: int | Sequence[int], settings: TrainSettings, share: float = 0.0
) -> Plan:
    """Draw all random numbers of a training, one row per update.

    Args:
        seed: 32 bits.
        counts: images of each part; for a frozen backbone, views.
        settings: settings of the training.
        share: share of the second part in the first batch; the settings say whether it changes.
    """
    rng = np.random.default_rng(seed)
    parts = (counts,) if isinstance(counts, int) else tuple(counts)
    indices = batch_indices(rng, parts, share, settings.steps * settings.batch, settings.last_share)
    return Plan(
        batch_indices=indices.reshape(settings.steps, settings.batch).astype(np.int32),
        draws=draw(rng, settings.steps, settings.batch),
        lr=poly_schedule(settings.lr, settings.steps, settings.power, settings.warmup),
        weight=_mean_weights(settings.steps, settings.average),
    )


def _mean_weights(steps: int, average: float) -> Float32[np.ndarray, " steps"]:
    """1/k for the k-th of the averaged steps, 0 for the steps before them."""
    averaged = max(round(average * steps), 1)
    k = np.arange(steps) - (steps - averaged) + 1
    return np.where(k > 0, 1 / np.maximum(k, 1), 0).astype(np.float32)


class Functions(NamedTuple):
    """The compiled functions; jit adds one version for each shape of the data."""

    init: Callable[..., TrainState]  # seed, images -> fresh state
    resume: Callable[..., TrainState]  # variables -> state with them
    step: Callable[..., tuple[TrainState, Array]]  # state, data, one row of the plan -> loss
    steps: Callable[..., tuple[TrainState, Array]]  # the same over many rows, scanned
    many: Callable[..., tuple[TrainState, Array]]  # `steps` of networks of axes sets and heads


def functions(settings: TrainSettings, classes: int) -> Functions:
    """The compiled functions for settings; settings that compile to the same share them."""
    return _compiled(settings.step_spec, classes)


def _single(parameter: Array) -> Array:
    """Parameters are float32, also where JAX's default is double precision (`jax_enable_x64`)."""
    return parameter.astype(jnp.float32) if parameter.dtype == jnp.float64 else parameter


@lru_cache(maxsize=32)
def _compiled(spec: StepSpec, classes: int) -> Functions:
    module = net_of(spec.net, classes)
    transform = optimizer(*spec.optim)

    def resume(variables: Variables) -> TrainState:
        fixed = dict(variables)
        params = fixed.pop("params")
        mean = jax.tree.map(jnp.zeros_like, params) if spec.averages else None
        return TrainState(params, transform.init(params), jnp.int32(0), mean, fixed)

    # Under `vmap` this generator has other numbers for the same seed, so that seeds go one by one.
    @jax.custom_batching.sequential_vmap
    def init(seed: UInt32[Array, ""], images: Any) -> TrainState:
        blank = jax.tree.map(lambda a: jnp.zeros((1, *a.shape[1:])), images)
        # The default generator takes four times as long to compile (unrolled, once per kernel).
        key = jax.random.key(seed, impl="rbg")
        return resume(jax.tree.map(_single, module.init(key, blank)))

    def logits_of(variables: Variables, x: Any, dropout: PRNGKeyArray) -> Array:
        stride = {} if spec.net.backbone is None else {"stride": spec.loss_stride}
        return module.apply(variables, x, train=True, rngs={"dropout": dropout}, **stride)

    def batch_of(data: Data, row: Plan, key: PRNGKeyArray) -> tuple[Any, Array]:
        x, y = jax.tree.map(lambda all_: all_[row.batch_indices], (data.images, data.labels))
        return (x, y) if spec.augment is None else augment(x, y, row.draws, spec.augment, key)

    def step(state: TrainState, data: Data, row: Plan) -> tuple[TrainState, Float[Array, ""]]:
        key: PRNGKeyArray = jax.random.fold_in(jax.random.key(data.seed), state.step)
        dropout, noise = jax.random.split(key)
        x, y = batch_of(data, row, noise)
        y = strided(y, spec.loss_stride)

        def loss_of(params: Params) -> Float[Array, ""]:
            variables = {"params": params, **state.fixed}
            logits = logits_of(variables, x, dropout)
            loss = cross_entropy(logits, y, data.class_weights)
            return loss + spec.jaccard * soft_jaccard(logits, y) if spec.jaccard else loss

        def sums_of(params: Params, x: Any, y: Array, part: Array) -> tuple[Array, Array]:
            key = jax.random.fold_in(dropout, part)
            variables = {"params": params, **state.fixed}
            return cross_entropy_sums(logits_of(variables, x, key), y, data.class_weights)

        if spec.accumulate == 1:
            loss, gradients = jax.value_and_grad(loss_of)(state.params)
        else:
            loss, gradients = accumulated(sums_of, state.params, x, y, spec.accumulate)
        directions, opt_state = transform.update(gradients, state.opt_state, state.params)
        params = descend(state.params, directions, row.lr)
        mean = state.mean
        if mean is not None:
            # Unlike a weighted sum, this keeps an unchanged parameter to the last bit.
            mean = jax.tree.map(lambda m, p: m + row.weight * (p - m), mean, params)
        return TrainState(params, opt_state, state.step + 1, mean, state.fixed), loss

    def steps(
        state: TrainState, data: Data, rows: Plan
    ) -> tuple[TrainState, Float[Array, " steps"]]:
        return jax.lax.scan(lambda carry, row: step(carry, data, row), state, rows)

    # All networks share one array of images, which their indices refer to, and the schedule.
    of_heads = jax.vmap(step, in_axes=(0, Data(None, None, None, 0), Plan(0, 0, None, None)))
    of_sets = jax.vmap(of_heads, in_axes=(0, Data(None, None, 0, 0), Plan(0, 0, None, None)))

    def many(
        states: TrainState, data: Data, rows: Plan
    ) -> tuple[TrainState, Float[Array, "steps sets heads"]]:
        return jax.lax.scan(lambda carry, row: of_sets(carry, data, row), states, rows)

    return Functions(
        init=jax.jit(init),
        resume=jax.jit(resume),
        step=jax.jit(step, donate_argnums=0),
        steps=jax.jit(steps, donate_argnums=0),
        many=jax.jit(many, donate_argnums=0),
    )


def accumulated(
    sums_of: Callable[[Params, Any, Array, Array], tuple[Array, Array]],
    params: Params,
    x: Any,
    y: UInt8[Array, "b h w"],
    parts: int,
) -> tuple[Float[Array, ""], Params]:
    """Compute loss and gradient of a batch, one part after the other.

    sum_k grad s_k / sum_k t_k, where part k has the loss s_k / t_k: parts with more labelled pixels have more
    weight, as in the whole batch.

    Args:
        sums_of: (params, images, labels, number of the part) -> (s_k, t_k).
        params: parameters at which the gradient is taken.
        x: images, or their feature maps.
        y: their labels.
        parts: number of parts, which divides the batch.

    Returns:
        The loss of the whole batch, and its gradient.
    """

    def add(carry: tuple[Array, Array, Params], part: tuple[Array, ...]) -> Any:
        (nats, total), gradient = jax.value_and_grad(sums_of, has_aux=True)(params, *part)
        return jax.tree.map(jnp.add, carry, (nats, total, gradient)), None

    cut = jax.tree.map(lambda a: a.reshape(parts, a.shape[0] // parts, *a.shape[1:]), (x, y))
    zero = (jnp.float32(0), jnp.float32(0), jax.tree.map(jnp.zeros_like, params))
    rows = (*cut, jnp.arange(parts))

    def sums(unroll: int) -> Callable[..., Any]:
        return lambda zero, rows: jax.lax.scan(add, zero, rows, unroll=unroll)[0]

    # Gradient convolutions are slow inside a loop of XLA's CPU backend.
    nats, total, gradient = jax.lax.platform_dependent(zero, rows, cpu=sums(parts), default=sums(1))
    total = jnp.where(total > 0, total, 1)
    return nats / total, jax.tree.map(lambda g: g / total, gradient)
