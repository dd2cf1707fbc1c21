"""The layers that are written otherwise than XLA would have them, beside XLA's own.

    python -m benchmarks.layers

Each row is one pass of one layer: forward, and the gradients by its features and by its kernel, once as
`seg.nets.ops` has them, once as XLA and JAX have them. `ratio_to_xla` is XLA's time over ours.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from flax import linen as nn

from benchmarks.report import Row, parser, report
from benchmarks.train import Runs, count, medians
from seg.nets.ops.conv import conv, xla_conv
from seg.nets.ops.max_pool import max_pool
from seg.nets.ops.product_conv import patch_conv, product_conv

Function = Callable[..., jax.Array]


class Layer(NamedTuple):
    """A layer in two ways, and the shapes of its features and, for a convolution, its kernel."""

    name: str
    ours: Function
    xlas: Function
    shapes: tuple[tuple[int, ...], ...]


def xla_pool(x: jax.Array, side: int, stride: int) -> jax.Array:
    """As XLA does by itself."""
    return nn.max_pool(x, (side, side), (stride, stride), [((side - 1) // 2,) * 2] * 2)


def convolution(
    name: str, ours: Function, map_: tuple[int, ...], kernel: tuple[int, ...], rate: int = 1
) -> Layer:
    """A layer from the shapes of its features and kernel."""
    return Layer(name, partial(ours, rate=rate), partial(xla_conv, rate=rate), (map_, kernel))


def pooling(name: str, map_: tuple[int, ...], side: int, stride: int) -> Layer:
    """A layer from the shape of its features."""
    ours, xlas = (partial(pool, side=side, stride=stride) for pool in (max_pool, xla_pool))
    return Layer(name, ours, xlas, (map_,))


LAYERS = (
    convolution("VGG16 conv1_2, 480x360", conv, (1, 360, 480, 64), (3, 3, 64, 64)),
    convolution("VGG16 conv3_2, 480x360", conv, (1, 90, 120, 256), (3, 3, 256, 256)),
    convolution("DeepLabv2 fc6_2, 480x360", product_conv, (1, 45, 60, 512), (3, 3, 512, 1024), 12),
    convolution("DeepLabv2 fc7_2, 480x360", patch_conv, (1, 45, 60, 1024), (1, 1, 1024, 1024)),
    convolution("FCN8s fc6, 128x96", patch_conv, (4, 3, 4, 512), (7, 7, 512, 4096)),
    pooling("FCN8s pool1, 480x360", (1, 360, 480, 64), 2, 2),
    pooling("DeepLabv2 pool1, 480x360", (1, 360, 480, 64), 3, 2),
    pooling("DeepLabv2 pool5, 480x360", (1, 45, 60, 512), 3, 1),
)


def passes(function: Function, values: tuple[np.ndarray, ...]) -> Runs:
    """Forward, and the gradient by each of the values; each run waits for its result."""
    given = jax.device_put(values)

    def gradient(number: int, weight: jax.Array, *values: jax.Array) -> jax.Array:
        def of(value: jax.Array) -> jax.Array:
            return function(*values[:number], value, *values[number + 1 :])

        (found,) = jax.vjp(of, values[number])[1](weight)
        return found

    def timed(compiled: Function, *arguments: Any) -> Callable[[], Any]:
        return lambda: compiled(*arguments).block_until_ready()

    forward = jax.jit(function)
    yield "forward", timed(forward, *given)
    weight = jax.numpy.ones_like(forward(*given))
    for number, name in enumerate(("features", "kernel")[: len(values)]):
        compiled = jax.jit(partial(gradient, number))
        yield f"gradient by {name}", timed(compiled, weight, *given)


def rows_of(layer: Layer, repeats: int) -> Iterator[Row]:
    """One row for each pass."""
    rng = np.random.default_rng(0)
    values = tuple(rng.normal(size=shape).astype(np.float32) for shape in layer.shapes)
    ours = medians(passes(layer.ours, values), repeats)
    xlas = medians(passes(layer.xlas, values), repeats)
    for name, ms in ours.items():
        yield {
            "layer": layer.name,
            "pass": name,
            "ms": ms,
            "xla_ms": xlas[name],
            "ratio_to_xla": xlas[name] / ms,
        }


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    command.add_argument("--repeats", type=count, default=7, help="at least 2")
    options = command.parse_args(arguments)
    report([row for layer in LAYERS for row in rows_of(layer, options.repeats)], options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
