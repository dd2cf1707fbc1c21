"""Random changes of images and labels: mirror, scale and crop, colour, blur, noise.

The randomness is an argument: `draw` makes uniform numbers on the host, `augment` is pure in images,
numbers and (for noise, which has one number per value) a key, and runs inside the jitted training step.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Integer, PRNGKeyArray, UInt8

from seg.classes import IGNORE_LABEL
from seg.settings import AugmentSpec

# One column of the numbers per effect; MIX has six.
MIRROR, GAIN, GAMMA, CONTRAST, SATURATION, BLUR, NOISE, SCALE, DOWN, RIGHT, MIX = range(11)
DRAWS = MIX + 6

MAX_GAIN = 1.4  # brightness is multiplied by 1/1.4 .. 1.4
MAX_GAMMA = 1.4  # values are raised to a power of 1/1.4 .. 1.4
MAX_CONTRAST = 0.3  # distance from the image's mean is scaled by 0.7 .. 1.3
MAX_SATURATION = 0.5  # distance from grey is scaled by 0.5 .. 1.5
MAX_MIX = 0.25  # -0.25 .. 0.25 of each other channel's difference is added to a channel
MAX_NOISE = 0.04  # standard deviation of the noise, of the range from black to white
MAX_SCALE = 2.0  # sizes are multiplied by 1/2 .. 2
GREY = 0.45  # fills the margin of a shrunk image; about ImageNet's mean


def draw(rng: np.random.Generator, *shape: int) -> Float32[np.ndarray, "*shape draws"]:
    """Draw the numbers in [0, 1) that `augment` needs for a shape of images such as (steps, batch)."""
    return rng.random((*shape, DRAWS), dtype=np.float32)


def _between(u: Float[Array, " b"], low: float, high: float) -> Float[Array, "b 1 1 1"]:
    return (low + u * (high - low))[:, None, None, None]


def mirrored(
    images: Float[Array, "b h w c"], labels: Integer[Array, "b h w"], u: Float[Array, " b"]
) -> tuple[Float[Array, "b h w c"], Integer[Array, "b h w"]]:
    """Swap left and right of image and label where u < 0.5."""
    swap = (u < 0.5)[:, None, None]
    return (
        jnp.where(swap[..., None], images[:, :, ::-1], images),
        jnp.where(swap, labels[:, :, ::-1], labels),
    )


def scaled(
    images: Float[Array, "b h w c"], labels: Integer[Array, "b h w"], draws: Float[Array, "b draws"]
) -> tuple[Float[Array, "b h w c"], Integer[Array, "b h w"]]:
    """Enlarge or shrink each image about a random point, and cut it to its size; draws of 0.5 change nothing.

    Images are interpolated, labels are taken from the nearest pixel. The margin is grey and has the ignore
    label.
    """
    _, h, w, _ = images.shape
    times = MAX_SCALE ** (2 * draws[:, SCALE] - 1)
    # The excess is cut off, or the margin filled, on both sides in a random proportion.
    down, right = ((1 - times) * n * draws[:, u] for n, u in ((h, DOWN), (w, RIGHT)))

    def one(image: Array, label: Array, times: Array, down: Array, right: Array) -> Any:
        factors, shift = jnp.stack([times, times]), jnp.stack([down, right])
        moved = jax.image.scale_and_translate(
            image - GREY, image.shape, (0, 1), factors, shift, "linear", antialias=True
        )
        rows, cols = (
            jnp.floor((jnp.arange(n) + 0.5 - offset) / times).astype(jnp.int32)
            for n, offset in ((h, down), (w, right))
        )
        inside = ((rows >= 0) & (rows < h))[:, None] & ((cols >= 0) & (cols < w))[None, :]
        moved_label = label[jnp.clip(rows, 0, h - 1)][:, jnp.clip(cols, 0, w - 1)]
        return moved + GREY, jnp.where(inside, moved_label, jnp.asarray(IGNORE_LABEL, label.dtype))

    return jax.vmap(one)(images, labels, times, down, right)


def coloured(
    images: Float[Array, "b h w 3"], draws: Float[Array, "b draws"]
) -> Float[Array, "b h w 3"]:
    """Vary gamma, gain, contrast and saturation of each image; draws of 0.5 leave them as they are."""
    gamma = MAX_GAMMA ** _between(draws[:, GAMMA], -1.0, 1.0)
    gain = MAX_GAIN ** _between(draws[:, GAIN], -1.0, 1.0)
    contrast = _between(draws[:, CONTRAST], 1 - MAX_CONTRAST, 1 + MAX_CONTRAST)
    saturation = _between(draws[:, SATURATION], 1 - MAX_SATURATION, 1 + MAX_SATURATION)
    x = gain * jnp.maximum(images, 1e-4) ** gamma
    grey = jnp.mean(x, axis=-1, keepdims=True)
    x = grey + saturation * (x - grey)
    mean = jnp.mean(grey, axis=(1, 2), keepdims=True)
    return jnp.clip(mean + contrast * (x - mean), 0, 1)


def mixed(
    images: Float[Array, "b h w 3"], draws: Float[Array, "b draws"]
) -> Float[Array, "b h w 3"]:
    """Mix the colour channels of each image; greys stay, and draws of 0.5 change nothing.

    x_i + sum_j m_ij (x_j - x_i), with m_ij in -0.25..0.25 for j != i.
    """
    shares = MAX_MIX * (2 * draws[:, MIX:] - 1)
    others = ((1, 2), (0, 2), (0, 1))
    channels = []
    for i, (j, k) in enumerate(others):
        x, u = images[..., i], shares[:, None, None, 2 * i : 2 * i + 2]
        x = x + u[..., 0] * (images[..., j] - x) + u[..., 1] * (images[..., k] - x)
        channels.append(x)
    return jnp.clip(jnp.stack(channels, axis=-1), 0, 1)


def blurred(images: Float[Array, "b h w c"], u: Float[Array, " b"]) -> Float[Array, "b h w c"]:
    """Mix each image with its 3x3 binomial blur (1 2 1 along each axis); u is the blur's share."""
    padded = jnp.pad(images, [(0, 0), (1, 1), (1, 1), (0, 0)], mode="edge")
    rows = 0.25 * (padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:])
    soft = 0.25 * (rows[:, :, :-2] + 2 * rows[:, :, 1:-1] + rows[:, :, 2:])
    return images + u[:, None, None, None] * (soft - images)


def noisy(
    rng_key: PRNGKeyArray, images: Float[Array, "b h w c"], u: Float[Array, " b"]
) -> Float[Array, "b h w c"]:
    """Add normal noise to every value, with a standard deviation of up to 0.04 per image."""
    size = MAX_NOISE * u[:, None, None, None]
    return jnp.clip(images + size * jax.random.normal(rng_key, images.shape), 0, 1)


def augment(
    images: UInt8[Array, "b h w 3"],
    labels: UInt8[Array, "b h w"],
    draws: Float[Array, "b draws"],
    spec: AugmentSpec,
    rng_key: PRNGKeyArray | None = None,
) -> tuple[Float[Array, "b h w 3"], UInt8[Array, "b h w"]]:
    """Augment a batch.

    Args:
        images: RGB.
        labels: class ids.
        draws: from `draw`.
        spec: the changes to make.
        rng_key: the key of the noise; needed only for noise.

    Returns:
        RGB in [0, 1], and labels.
    """
    x = images.astype(jnp.float32) / 255
    if spec.mirror:
        x, labels = mirrored(x, labels, draws[:, MIRROR])
    if spec.scale:
        x, labels = scaled(x, labels, draws)
    if spec.colour:
        x = coloured(x, draws)
    if spec.mix:
        x = mixed(x, draws)
    if spec.blur:
        x = blurred(x, draws[:, BLUR])
    if spec.noise:
        assert rng_key is not None
        x = noisy(rng_key, x, draws[:, NOISE])
    return x, labels
