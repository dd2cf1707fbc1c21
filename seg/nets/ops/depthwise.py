"""Convolutions of the EfficientNets: one kernel per channel, and TensorFlow's "SAME" padding."""

from contextvars import ContextVar
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from seg.nets.ops.conv import Conv

ON_ACCELERATORS: ContextVar[Literal["grouped", "shifts"]] = ContextVar(
    "depthwise", default="grouped"
)
"""Whether accelerators take XLA's grouped convolution or sums of shifted copies; read while JAX traces.

On an H200 a step of lite0-tuned with grouped convolutions takes 130 to 150 s to compile, and 8 to 10 ms
(480x360, a batch of 16, bfloat16). Shifts are ordinary fused loops, which need no autotuning, but nobody has
measured them on a GPU yet: `python -m benchmarks.gpu` measures both.
"""


def same(size: int, side: int, stride: int) -> tuple[int, int]:
    """Cells that "SAME" padding adds before and after; an odd cell comes after, as in TensorFlow."""
    total = max((-(-size // stride) - 1) * stride + side - size, 0)
    return total // 2, total - total // 2


def pointwise(
    x: Float[Array, "b h w c"], kernel: Float[Array, "c features"]
) -> Float[Array, "b h w features"]:
    """A 1x1 convolution as one product over all pixels."""
    b, h, w, c = x.shape
    return (x.reshape(b * h * w, c) @ kernel).reshape(b, h, w, kernel.shape[-1])


def pointwise_conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "1 1 c features"], _: int = 1
) -> Float[Array, "b h w features"]:
    """`pointwise` with the arguments of other convolutions; a rate has no meaning."""
    return pointwise(x, kernel[0, 0])


def strided_conv(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side c features"], stride: int
) -> Float[Array, "b rows cols features"]:
    """A convolution by one product of all patches, for few channels in; "SAME" padding."""
    side, _, c, features = kernel.shape
    patches = jnp.concatenate([cell for row in _cells(x, side, stride) for cell in row], axis=-1)
    return pointwise(patches, kernel.reshape(side * side * c, features))


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def depthwise(
    x: Float[Array, "b h w c"], kernel: Float[Array, "side side 1 c"], stride: int = 1
) -> Float[Array, "b rows cols c"]:
    """Convolve each channel with its own kernel; "SAME" padding.

    Result and gradient equal those of `lax.conv_general_dilated` with as many groups as channels. On CPUs it
    is a sum of shifted copies times cells of the kernel, ten times as fast as XLA's grouped convolution. On
    accelerators `ON_ACCELERATORS` chooses.

    Args:
        x: features.
        kernel: rows, columns (the same odd number), 1, channels.
        stride: distance of the kernel's positions.
    """
    return _forward(x, kernel, stride)[0]


def xla_depthwise(x: Array, kernel: Array, stride: int = 1) -> Array:
    """As `depthwise`, with the gradients of JAX."""
    return jax.lax.conv_general_dilated(
        x,
        kernel,
        (stride, stride),
        "SAME",
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
        feature_group_count=x.shape[-1],
    )


def _cells(x: Array, side: int, stride: int) -> list[list[Array]]:
    """The input of each cell of the kernel, by row and column."""
    _, h, w, _ = x.shape
    x = jnp.pad(x, [(0, 0), same(h, side, stride), same(w, side, stride), (0, 0)])
    down, right = ((-(-n // stride) - 1) * stride + 1 for n in (h, w))
    return [
        [x[:, i : i + down : stride, j : j + right : stride] for j in range(side)]
        for i in range(side)
    ]


def _times(x: Array, kernel: Array, i: int, j: int) -> Array:
    return x * kernel[i, j, 0][None, None, None]


def _forward(x: Array, kernel: Array, stride: int) -> tuple[Array, tuple[Array, Array]]:
    def by_shifts(x: Array, kernel: Array) -> Array:
        cells = _cells(x, kernel.shape[0], stride)
        total = _times(cells[0][0], kernel, 0, 0)
        for i, row in enumerate(cells):
            for j, cell in enumerate(row):
                total = total + _times(cell, kernel, i, j) if i or j else total
        return total

    by_xla = partial(xla_depthwise, stride=stride)
    default = by_shifts if ON_ACCELERATORS.get() == "shifts" else by_xla
    return jax.lax.platform_dependent(x, kernel, cpu=by_shifts, default=default), (x, kernel)


def _backward(stride: int, saved: tuple[Array, Array], grad: Array) -> tuple[Array, Array]:
    def by_shifts(x: Array, kernel: Array, grad: Array) -> tuple[Array, Array]:
        to_kernel = _to_kernel(x, grad, kernel.shape[0], stride).astype(kernel.dtype)
        return _to_x(x, kernel, grad, stride), to_kernel

    def by_xla(x: Array, kernel: Array, grad: Array) -> tuple[Array, Array]:
        to_x, to_kernel = jax.vjp(partial(xla_depthwise, stride=stride), x, kernel)[1](grad)
        return to_x, to_kernel

    def by_sums(x: Array, kernel: Array, grad: Array) -> tuple[Array, Array]:
        sums = [
            [jnp.sum(cell * grad, (0, 1, 2), jnp.float32) for cell in row]
            for row in _cells(x, kernel.shape[0], stride)
        ]
        to_kernel = jnp.stack([jnp.stack(row) for row in sums])[:, :, None]
        return _to_x(x, kernel, grad, stride), to_kernel.astype(kernel.dtype)

    default = by_sums if ON_ACCELERATORS.get() == "shifts" else by_xla
    return jax.lax.platform_dependent(*saved, grad, cpu=by_shifts, default=default)


def _to_kernel(x: Array, grad: Array, side: int, stride: int) -> Array:
    """Sum row by row, so that data stay in the cache, and along columns only at the end."""
    b, h, w, c = x.shape
    _, rows, cols, _ = grad.shape
    x = jnp.pad(x, [(0, 0), same(h, side, stride), same(w, side, stride), (0, 0)])
    right = (cols - 1) * stride + 1

    def add(sums: tuple[Array, ...], number: Array) -> tuple[tuple[Array, ...], None]:
        image, row = number // rows, number % rows
        at = (image, row * stride, 0, 0)
        window = jax.lax.dynamic_slice(x, at, (1, side, x.shape[2], c))[0].astype(jnp.float32)
        grad_row = jax.lax.dynamic_slice(grad, (image, row, 0, 0), (1, 1, cols, c))[0].astype(
            jnp.float32
        )
        parts = (window[:, j : j + right : stride] * grad_row for j in range(side))
        return tuple(total + part for total, part in zip(sums, parts, strict=True)), None

    zero = jnp.zeros((side, cols, c), jnp.float32)  # for each column of the kernel
    sums, _ = jax.lax.scan(add, (zero,) * side, jnp.arange(b * rows))
    return jnp.stack([jnp.sum(total, axis=1) for total in sums], axis=1)[:, :, None]


def _to_x(x: Array, kernel: Array, grad: Array, stride: int) -> Array:
    """Gather for each cell of x from the positions that read it, which depend on its place % stride."""
    b, h, w, c = x.shape
    side = reach = kernel.shape[0]
    rows, cols = grad.shape[1:3]
    grad = jnp.pad(grad, [(0, 0), (reach, reach), (reach, reach), (0, 0)])

    def places(phase: int, size: int) -> list[tuple[int, int]]:
        offsets = [(i, phase + same(size, side, stride)[0] - i) for i in range(side)]
        return [(i, reach + at // stride) for i, at in offsets if at % stride == 0]

    def gathered(row: int, col: int) -> Array:
        total = jnp.zeros((b, rows, cols, c), grad.dtype)
        for i, down in places(row, h):
            for j, right in places(col, w):
                part = grad[:, down : down + rows, right : right + cols]
                total = total + _times(part, kernel, i, j)
        return total

    phases = [
        jnp.stack([gathered(row, col) for col in range(stride)], axis=3) for row in range(stride)
    ]
    whole = jnp.stack(phases, axis=2).reshape(b, rows * stride, cols * stride, c)
    return whole[:, :h, :w]


depthwise.defvjp(_forward, _backward)


Pointwise = partial(Conv, convolve=pointwise_conv, side=1)


class Spatial(nn.Module):
    """A depthwise convolution, or with `features` a full one for few channels in; "SAME" padding."""

    side: int
    stride: int
    features: int | None = None
    dtype: DTypeLike | None = None

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b rows cols features"]:
        """Features in `dtype`."""
        sizes = (1, x.shape[-1]) if self.features is None else (x.shape[-1], self.features)
        shape = (self.side, self.side, *sizes)
        kernel = self.param("kernel", nn.initializers.he_normal(), shape)
        bias = self.param("bias", nn.initializers.zeros, sizes[-1:])
        x, kernel, bias = nn.dtypes.promote_dtype(x, kernel, bias, dtype=self.dtype)
        convolve = depthwise if self.features is None else strided_conv
        return convolve(x, kernel, self.stride) + bias[None, None, None]
