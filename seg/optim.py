"""The two optimisers: the paper's SGD with poly decay, and Adam with a short warm-up; rates by layer.

The learning rate is an argument of the update and not part of the state, so that one compiled step serves
trainings of any length.
"""

from collections.abc import Callable
from typing import get_args

import jax
import numpy as np
import optax
from flax.traverse_util import path_aware_map
from jaxtyping import Float32

from seg.settings import Multipliers, OptimizerName

Path = tuple[str, ...]
"""The path of a parameter in its network, such as ("vgg16", "conv1_1", "kernel")."""


def poly_schedule(
    lr: float, steps: int, power: float = 0.9, warmup: int = 0
) -> Float32[np.ndarray, " steps"]:
    """Learning rates lr * (1 - i / steps)^power, rising linearly over the first `warmup` steps.

    Step i < warmup has its rate scaled by (i + 1) / (warmup + 1); the rate is 0 at i = steps.

    Args:
        lr: the highest rate.
        steps: the number of steps.
        power: 0.9 in the paper.
        warmup: the number of rising steps; 0 in the paper.

    Returns:
        One rate per step.
    """
    i = np.arange(steps)
    rise = np.minimum(1.0, (i + 1) / (warmup + 1))
    return (lr * rise * (1 - i / steps) ** power).astype(np.float32)


def deeplab_multiplier(path: Path) -> float:
    """DeepLab's factor on a parameter's learning rate: 10 in fc8, otherwise 1; twice that for biases.

    Source: `lr_mult` in the train.prototxt that Chen et al. (2018) publish, where only fc8 is new.
    """
    layer, part = path[-2:]
    return (10.0 if layer.startswith("fc8") else 1.0) * (2.0 if part == "bias" else 1.0)


def backbone_multiplier(path: Path) -> float:
    """The factor on a parameter's learning rate: 0.1 for the pre-trained backbone, otherwise 1."""
    return 0.1 if "backbone" in path else 1.0


def scale_by_path(multiplier: Callable[[Path], float]) -> optax.GradientTransformation:
    """Scale each parameter's update by a factor that depends on its path in a tree of dictionaries."""
    return optax.stateless(
        lambda updates, _: path_aware_map(lambda path, u: u * multiplier(path), updates)
    )


def optimizer(
    name: str,
    momentum: float = 0.9,
    weight_decay: float = 0.0,
    lr_multipliers: Multipliers = "none",
) -> optax.GradientTransformation:
    """Make the optimiser, which gives the direction of a step without the factor of minus the learning rate.

    SGD: v <- momentum * v + g + weight_decay * p, as in the paper. Adam: decoupled decay (AdamW).
    With "deeplab" the direction is scaled by `deeplab_multiplier`, and biases do not decay; with "backbone",
    for networks with a backbone, it is scaled by `backbone_multiplier`.
    Caffe includes the rate in v, which gives slightly other steps under a falling rate.

    Args:
        name: "sgd" or "adam".
        momentum: momentum of SGD.
        weight_decay: 1e-4 in the paper.
        lr_multipliers: "none", "deeplab" or "backbone".

    Returns:
        An optax transform; apply its updates with `descend`.

    Raises:
        ValueError: no optimiser has that name.
    """
    if name not in get_args(OptimizerName):
        names = ", ".join(get_args(OptimizerName))
        raise ValueError(f"unknown optimizer {name!r}; known optimizers: {names}")
    decay, scale = optax.add_decayed_weights(weight_decay), []
    if lr_multipliers == "deeplab":
        decay = optax.add_decayed_weights(
            weight_decay,
            mask=lambda params: path_aware_map(lambda path, _: path[-1] != "bias", params),
        )
        scale = [scale_by_path(deeplab_multiplier)]
    elif lr_multipliers == "backbone":
        scale = [scale_by_path(backbone_multiplier)]
    if name == "sgd":
        return optax.chain(decay, optax.trace(momentum), *scale)
    return optax.chain(optax.scale_by_adam(), decay, *scale)


def descend(
    params: optax.Params, directions: optax.Updates, lr: jax.typing.ArrayLike
) -> optax.Params:
    """Step against the directions: params - lr * directions."""
    return jax.tree.map(lambda p, d: p - lr * d, params, directions)
