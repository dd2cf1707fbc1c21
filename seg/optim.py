"""The two optimisers: the paper's SGD with poly decay, and Adam with a short warm-up.

The learning rate of each step is an argument of the update and not part of the state: one compiled
step then serves any number of steps.
"""

import jax
import numpy as np
import optax
from jaxtyping import Float32

OPTIMIZERS = ("adam", "sgd")


def poly_schedule(
    lr: float, steps: int, power: float = 0.9, warmup: int = 0
) -> Float32[np.ndarray, " steps"]:
    """Learning rates lr * (1 - i / steps)^power, rising linearly over the first `warmup` steps.

    Step i < warmup has its rate scaled by (i + 1) / (warmup + 1); the rate is 0 at i = steps.

    Args:
        lr: the highest rate.
        steps: how many.
        power: 0.9 in the paper.
        warmup: steps of the rise; 0 in the paper.

    Returns:
        One rate per step.
    """
    i = np.arange(steps)
    rise = np.minimum(1.0, (i + 1) / (warmup + 1))
    return (lr * rise * (1 - i / steps) ** power).astype(np.float32)


def optimizer(
    name: str, momentum: float = 0.9, weight_decay: float = 0.0
) -> optax.GradientTransformation:
    """The direction of a step, before it is scaled by minus the learning rate.

    SGD: v <- momentum * v + g + weight_decay * p, as in the paper. Adam: decoupled decay (AdamW).

    Args:
        name: "sgd" or "adam".
        momentum: of SGD.
        weight_decay: 1e-4 in the paper.

    Returns:
        An optax transform; apply its updates with `descend`.

    Raises:
        ValueError: no optimiser has that name.
    """
    if name == "sgd":
        return optax.chain(optax.add_decayed_weights(weight_decay), optax.trace(momentum))
    if name == "adam":
        return optax.chain(optax.scale_by_adam(), optax.add_decayed_weights(weight_decay))
    raise ValueError(f"unknown optimizer {name!r}; known optimizers: {', '.join(OPTIMIZERS)}")


def descend(
    params: optax.Params, directions: optax.Updates, lr: jax.typing.ArrayLike
) -> optax.Params:
    """Step against the directions.

    Args:
        params: any pytree.
        directions: same structure.
        lr: f32[], the learning rate of this step.

    Returns:
        params - lr * directions.
    """
    return jax.tree.map(lambda p, d: p - lr * d, params, directions)
