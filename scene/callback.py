"""The renderer as a JAX function from unit attributes and seeds to images and labels.

This is the only file of the engine that uses JAX. The renderer is pure and has no gradient, so it is called
through ``jax.pure_callback``, on the host, once per batch.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8, UInt32

from scene.assets.catalogue import AssetPool, check_pool
from scene.attributes import space_of
from scene.dataset.render import render_street
from scene.render import RenderSettings, check_settings, renderer

RenderFn = Callable[
    [Float[Array, "n attributes"], UInt32[Array, " n"]],
    tuple[UInt8[Array, "n shots h w 3"], UInt8[Array, "n shots h w"]],
]


def render_fn(
    settings: RenderSettings,
    *,
    shots: int = 1,
    renderer_name: str = "embree",
    pool: AssetPool | None = None,
) -> RenderFn:
    """Make a function ``(unit f32[n, attributes], seeds u32[n]) -> (images, labels)`` for use inside jit.

    Values outside [0, 1] are clipped, since an exception inside a callback breaks the surrounding program;
    NaN becomes 0.5.

    Raises:
        ValueError, LibraryError: settings, shots or the pool are out of range or cannot be used, or the
            renderer is unknown; raised here, not in the callback.
    """
    check_settings(settings)
    renderer(renderer_name)
    if shots < 1:
        raise ValueError(f"shots per street must be 1 or more, not {shots}")
    assets = check_pool(pool or AssetPool())
    size = (shots, settings.height, settings.width)

    def on_host(unit: np.ndarray, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        unit = np.clip(np.nan_to_num(np.asarray(unit, np.float32), nan=0.5), 0, 1)
        images = np.empty((len(unit), *size, 3), np.uint8)
        labels = np.empty((len(unit), *size), np.uint8)
        for i, (row, seed) in enumerate(zip(unit, np.asarray(seeds).tolist(), strict=True)):
            frames = render_street(row, seed, 0, shots, settings, renderer_name, assets)
            images[i] = [f.image for f in frames]
            labels[i] = [f.label for f in frames]
        return images, labels

    def render(
        unit: Float[Array, "n attributes"], seeds: UInt32[Array, " n"]
    ) -> tuple[UInt8[Array, "n shots h w 3"], UInt8[Array, "n shots h w"]]:
        space_of(unit.shape[-1])
        if unit.ndim != 2 or seeds.shape != unit.shape[:1]:
            raise ValueError(
                f"expected unit [n, attributes] and seeds [n], got {unit.shape} and {seeds.shape}"
            )
        n = unit.shape[0]
        shapes = (
            jax.ShapeDtypeStruct((n, *size, 3), jnp.uint8),
            jax.ShapeDtypeStruct((n, *size), jnp.uint8),
        )
        return jax.pure_callback(on_host, shapes, unit, seeds, vmap_method="sequential")

    return render
