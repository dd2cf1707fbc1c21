"""Changes of resolution that the nets share."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def pad_to_multiple(x: Float[Array, "b h w c"], multiple: int) -> Float[Array, "b rows cols c"]:
    """Add zeros at the bottom and on the right until the size is a multiple.

    Args:
        x: normalised images, for which 0 is the mean colour.
        multiple: of height and width, in pixels.

    Returns:
        rows and cols are the next multiples of h and w.
    """
    _, h, w, _ = x.shape
    return jnp.pad(x, [(0, 0), (0, -h % multiple), (0, -w % multiple), (0, 0)])


def bilinear(x: Float[Array, "b h w c"], times: int) -> Float[Array, "b rows cols c"]:
    """Enlarge by bilinear interpolation between pixel centres.

    Args:
        x: logits.
        times: factor, along each side.

    Returns:
        rows = times * h, cols = times * w.
    """
    b, h, w, c = x.shape
    return jax.image.resize(x, (b, times * h, times * w, c), "bilinear")


def repeat_pixels(x: Float[Array, "b h w c"], times: int) -> Float[Array, "b rows cols c"]:
    """Enlarge by repeating pixels.

    Args:
        x: features.
        times: factor, along each side.

    Returns:
        rows = times * h, cols = times * w.
    """
    b, h, w, c = x.shape
    blocks = jnp.broadcast_to(x[:, :, None, :, None, :], (b, h, times, w, times, c))
    return blocks.reshape(b, times * h, times * w, c)


def space_to_depth(x: Float[Array, "b h w c"], cell: int) -> Float[Array, "b rows cols depth"]:
    """Fold each cell x cell square of pixels into channels.

    Args:
        x: height and width are multiples of `cell`.
        cell: pixels along a side.

    Returns:
        rows = h / cell, cols = w / cell, depth = cell * cell * c.
    """
    b, h, w, c = x.shape
    cells = x.reshape(b, h // cell, cell, w // cell, cell, c).transpose(0, 1, 3, 2, 4, 5)
    return cells.reshape(b, h // cell, w // cell, cell * cell * c)
