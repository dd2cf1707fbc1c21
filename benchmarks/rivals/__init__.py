"""Search methods of other libraries, with which ours are compared; `sdr-jax study searches` has them, too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sdr_jax
from benchmarks.rivals.cma_es import cma_es
from benchmarks.rivals.gaussian_process import gaussian_process
from benchmarks.rivals.tpe import tpe
from sdr_jax import registry
from sdr_jax.space import Width

RIVALS: dict[str, Callable[..., sdr_jax.Method]] = {
    "cma_es": cma_es,
    "tpe": tpe,
    "gaussian_process": gaussian_process,
}
"""The methods of other libraries by name: functions of a space and, by keyword, a width."""
METHODS = {**sdr_jax.METHODS, **RIVALS}
"""All methods by name."""


def make(name: str, space: sdr_jax.Space, width: Width = None, **options: Any) -> sdr_jax.Method:
    """Make a method, as `sdr_jax.registry.make`."""
    if name in RIVALS:
        return RIVALS[name](space, width=width, **options)
    return registry.make(name, space, width, **options)
