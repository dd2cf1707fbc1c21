"""Random mirror, colour and blur: a few numbers per image, no noise per pixel (that costs more).

The randomness is an argument: `draw` makes uniform numbers on the host, `augment` is pure in images
and numbers, and runs inside the jitted training step.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Integer, UInt8

# One column of the numbers per effect.
MIRROR, GAIN, GAMMA, CONTRAST, SATURATION, BLUR = range(6)
DRAWS = 6

MAX_GAIN = 1.4  # brightness is multiplied by 1/1.4 .. 1.4
MAX_GAMMA = 1.4  # and raised to a power of 1/1.4 .. 1.4
MAX_CONTRAST = 0.3  # distance from the image's mean is scaled by 0.7 .. 1.3
MAX_SATURATION = 0.5  # distance from grey is scaled by 0.5 .. 1.5


def draw(rng: np.random.Generator, *shape: int) -> Float32[np.ndarray, "*shape draws"]:
    """Draw the numbers in [0, 1) that `augment` needs, for images of some shape such as (steps, batch)."""
    return rng.random((*shape, DRAWS), dtype=np.float32)


def _between(u: Float[Array, " b"], low: float, high: float) -> Float[Array, "b 1 1 1"]:
    return (low + u * (high - low))[:, None, None, None]


def mirrored(
    images: Float[Array, "b h w c"], labels: Integer[Array, "b h w"], u: Float[Array, " b"]
) -> tuple[Float[Array, "b h w c"], Integer[Array, "b h w"]]:
    """Swap left and right, in image and label, where u < 0.5."""
    swap = (u < 0.5)[:, None, None]
    return (
        jnp.where(swap[..., None], images[:, :, ::-1], images),
        jnp.where(swap, labels[:, :, ::-1], labels),
    )


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


def blurred(images: Float[Array, "b h w c"], u: Float[Array, " b"]) -> Float[Array, "b h w c"]:
    """Mix each image with its 3x3 binomial blur (1 2 1 along each axis); u is the blur's share."""
    padded = jnp.pad(images, [(0, 0), (1, 1), (1, 1), (0, 0)], mode="edge")
    rows = 0.25 * (padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:])
    soft = 0.25 * (rows[:, :, :-2] + 2 * rows[:, :, 1:-1] + rows[:, :, 2:])
    return images + u[:, None, None, None] * (soft - images)


def augment(
    images: UInt8[Array, "b h w 3"],
    labels: UInt8[Array, "b h w"],
    draws: Float[Array, "b draws"],
    mirror: bool = True,
    colour: bool = True,
    blur: bool = True,
) -> tuple[Float[Array, "b h w 3"], UInt8[Array, "b h w"]]:
    """Mirror, colour and blur a batch.

    Args:
        images: RGB.
        labels: class ids.
        draws: from `draw`.
        mirror: swap left and right of half of the images.
        colour: vary gamma, gain, contrast, saturation.
        blur: mix with a blur.

    Returns:
        RGB in [0, 1], and labels.
    """
    x = images.astype(jnp.float32) / 255
    if mirror:
        x, labels = mirrored(x, labels, draws[:, MIRROR])
    if colour:
        x = coloured(x, draws)
    if blur:
        x = blurred(x, draws[:, BLUR])
    return x, labels
