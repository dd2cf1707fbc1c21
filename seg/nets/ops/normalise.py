"""The normalisation of images with which networks begin."""

import jax.numpy as jnp
from jaxtyping import Array, Float

# Mean and standard deviation of ImageNet, RGB in [0, 1], as pre-trained weights assume.
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)


def normalise(images: Float[Array, "b h w 3"]) -> Float[Array, "b h w 3"]:
    """Centre and scale each channel of RGB in [0, 1] by the statistics of ImageNet."""
    shape = (1, 1, 1, 3)
    return (images - jnp.reshape(jnp.array(MEAN), shape)) / jnp.reshape(jnp.array(STD), shape)
