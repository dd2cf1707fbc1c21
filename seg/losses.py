"""Cross-entropy over labelled pixels, and the weights that balance rare classes."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Integer

from seg.classes import IGNORE_LABEL


def cross_entropy_sums(
    logits: Float[Array, "*shape classes"],
    labels: Integer[Array, "*shape"],
    class_weights: Float[Array, " classes"] | None = None,
    ignore: int = IGNORE_LABEL,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Numerator and denominator of `cross_entropy`; those of the parts of a batch add up.

    sum_i w[y_i] * -log p_i[y_i] and sum_i w[y_i], over the pixels that are not void.
    """
    labelled = labels != ignore
    target = jnp.where(labelled, labels, 0).astype(jnp.int32)
    picked = jax.nn.one_hot(target, logits.shape[-1], dtype=logits.dtype)
    weight = labelled.astype(logits.dtype)
    if class_weights is not None:
        weight = weight * (picked @ class_weights)
    nats = jax.nn.logsumexp(logits, axis=-1) - jnp.sum(picked * logits, axis=-1)
    return jnp.sum(weight * nats), jnp.sum(weight)


def cross_entropy(
    logits: Float[Array, "*shape classes"],
    labels: Integer[Array, "*shape"],
    class_weights: Float[Array, " classes"] | None = None,
    ignore: int = IGNORE_LABEL,
) -> Float[Array, ""]:
    """Weighted mean of -log softmax(logits)[label] over the pixels that are not void.

    sum_i w[y_i] * -log p_i[y_i] / sum_i w[y_i]; exactly 0, with gradient 0, where all is void.

    Args:
        logits: one vector per pixel.
        labels: class ids; `ignore` for void.
        class_weights: None for equal ones.
        ignore: the void label.

    Returns:
        The loss, in nats.
    """
    nats, total = cross_entropy_sums(logits, labels, class_weights, ignore)
    return nats / jnp.where(total > 0, total, 1)


def class_weights(
    labels: Integer[np.ndarray, "n h w"], classes: int, ignore: int = IGNORE_LABEL
) -> Float32[np.ndarray, " classes"]:
    """Weights that lift rare classes: (f + 0.01)^-0.75, scaled to mean 1.

    f is the share of a class in the labelled pixels.

    Args:
        labels: of the training set.
        classes: how many classes there are.
        ignore: the void label.

    Returns:
        One weight per class; all 1 where every pixel is void.
    """
    counts = np.bincount(labels[labels != ignore].ravel(), minlength=classes)
    share = counts / max(counts.sum(), 1)
    weights = (share + 0.01) ** -0.75
    return (weights / weights.mean()).astype(np.float32)
