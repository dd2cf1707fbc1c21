"""The networks' convolution, whose kernel gradient is computed by matrix products on CPUs."""

from collections.abc import Callable, Iterable
from functools import partial

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side c features"], rate: int = 1
) -> Float[Array, "b h w features"]:
    """Convolve with zero padding that keeps the size.

    Result and gradient equal those of `lax.conv_general_dilated`. On CPUs the kernel's gradient is one
    product over all pixels for each kernel row, two to seven times as fast as XLA's convolution with an image
    as kernel.

    Args:
        x: features.
        kernel: rows, columns (the same odd number), channels in, channels out.
        rate: distance of the kernel's cells.

    Returns:
        Features in the type of x.
    """
    return xla_conv(x, kernel, rate)


def xla_conv(x: Array, kernel: Array, rate: int = 1, stride: int = 1) -> Array:
    """As `conv`, with the gradients of JAX and with a stride."""
    return jax.lax.conv_general_dilated(
        x,
        kernel,
        (stride, stride),
        "SAME",
        rhs_dilation=(rate, rate),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )


def _forward(x: Array, kernel: Array, rate: int) -> tuple[Array, tuple[Array, Array]]:
    return xla_conv(x, kernel, rate), (x, kernel)


def _backward(rate: int, saved: tuple[Array, Array], grad: Array) -> tuple[Array, Array]:
    x, kernel = saved
    to_x = xla_conv(grad, kernel[::-1, ::-1].swapaxes(2, 3), rate)

    def by_convolution(x: Array, grad: Array) -> Array:
        _, back = jax.vjp(lambda kernel: xla_conv(x, kernel, rate), kernel)
        (gradient,) = back(grad)
        return gradient

    def by_products(x: Array, grad: Array) -> Array:
        return kernel_gradient(x, grad, kernel.shape[0], rate).astype(kernel.dtype)

    to_kernel = jax.lax.platform_dependent(x, grad, cpu=by_products, default=by_convolution)
    return to_x, to_kernel


conv.defvjp(_forward, _backward)


def kernel_gradient(
    x: Float[Array, "b h w c"], grad: Float[Array, "b h w features"], side: int, rate: int
) -> Float[Array, "side side c features"]:
    """Compute the gradient of a convolution's kernel by one matrix product for each kernel row.

    Copies of the narrower array, shifted by each of the kernel's columns, are concatenated, which copies
    little and makes the products large. It works image by image, so that copies stay in the cache, unless
    summing over kernels of this size would take longer.

    Args:
        x: the convolution's input.
        grad: gradient of the convolution's result.
        side: side of the kernel in cells; odd.
        rate: distance of the kernel's cells.

    Returns:
        f32, whatever the type of x, since many products are summed.
    """
    b, h, w, c = x.shape
    features = grad.shape[-1]
    if b > 1 and side**2 * c * features < h * w * max(c, features):

        def add(total: Array, image: tuple[Array, Array]) -> tuple[Array, None]:
            return total + kernel_gradient(image[0][None], image[1][None], side, rate), None

        zero = jnp.zeros((side, side, c, features), jnp.float32)
        return jax.lax.scan(add, zero, (x, grad))[0]
    around = (side // 2 * rate,) * 2
    total = partial(jnp.matmul, preferred_element_type=jnp.float32)

    def side_by_side(values: Array, order: Iterable[int]) -> Array:
        values = jnp.pad(values, [(0, 0), (0, 0), around, (0, 0)])
        return jnp.concatenate([values[:, :, j * rate : j * rate + w] for j in order], axis=-1)

    def rows(values: Array) -> list[Array]:
        values = jnp.pad(values, [(0, 0), around, (0, 0), (0, 0)])
        return [flat(values[:, i * rate : i * rate + h]) for i in range(side)]

    def flat(values: Array) -> Array:
        return values.reshape(b * h * w, values.shape[-1])

    if c < features:
        products = [total(row.T, flat(grad)) for row in rows(side_by_side(x, range(side)))]
        return jnp.stack(products).reshape(side, side, c, -1)
    columns = flat(side_by_side(grad, reversed(range(side))))
    products = [total(row.T, columns) for row in rows(x)]
    return jnp.stack(products).reshape(side, c, side, -1).swapaxes(1, 2)


class Conv(nn.Module):
    """A convolution with the parameters of `nn.Conv`; it keeps the size if `convolve` does.

    Attributes:
        features: channels out.
        convolve: a function of features, kernel and rate: `conv`, `patch_conv` or `product_conv`.
        side: side of the kernel in cells; odd.
        rate: distance of the kernel's cells.
        use_bias: whether to add a number to each channel.
        kernel_init: initialiser of the kernel.
        dtype: the type of computation; None for float32.
    """

    features: int
    convolve: Callable[[Array, Array, int], Array]
    side: int = 3
    rate: int = 1
    use_bias: bool = True
    kernel_init: nn.initializers.Initializer = nn.initializers.he_normal()
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        """Features in `dtype`."""
        shape = (self.side, self.side, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape)
        bias = (
            self.param("bias", nn.initializers.zeros, (self.features,)) if self.use_bias else None
        )
        x, kernel, bias = nn.dtypes.promote_dtype(x, kernel, bias, dtype=self.dtype)
        y = self.convolve(x, kernel, self.rate).astype(x.dtype)
        return y if bias is None else y + bias[None, None, None, :]
