"""Facts of this machine: versions, cores, GPU, renderers, extras."""

from __future__ import annotations

import platform
from importlib.util import find_spec
from typing import NamedTuple

from common.files import versions
from common.memory import in_words, memory
from common.workers.pool import cores
from experiments.app.doctor.installed import DRIVER, EXTRAS
from scene.render import RENDERERS, RendererError, renderer

PACKAGES = (
    "sdr-jax", "jax", "jaxlib", "flax", "optax", "numpy", "numba", "embreex", "opencv-python-headless",
)  # fmt: skip
Facts = list[tuple[str, str]]


class Machine(NamedTuple):
    """Facts in the order of the report, optional extras, and problems."""

    facts: Facts
    extras: Facts
    problems: list[str]


def look() -> Machine:
    """Collect all facts; starts JAX."""
    problems: list[str] = []
    installed = versions(PACKAGES)
    facts: Facts = [
        ("Python", platform.python_version()),
        ("versions", ", ".join(f"{name} {version}" for name, version in installed.items())),
        ("CPU", f"{cores()} cores, {in_words(memory())} of memory"),
        ("GPU", _gpu(problems)),
    ]
    for name in RENDERERS:
        try:
            renderer(name)
            facts.append((f"renderer {name}", "works"))
        except RendererError as error:
            facts.append((f"renderer {name}", f"does not work: {error}"))
    extras: Facts = []
    for name, (module, purpose) in EXTRAS.items():
        state = (
            "installed" if find_spec(module) else f"not installed: pip install 'sdr-jax[{name}]'"
        )
        extras.append((f"extra {name}", f"{state} ({purpose})"))
    if dict(facts)[f"renderer {RENDERERS[0]}"] != "works":
        problems.append(
            f"the renderer {RENDERERS[0]}, which all commands use, does not work on this machine"
        )
    return Machine(facts, extras, problems)


def _gpu(problems: list[str]) -> str:
    import jax  # slow to load: not for --help

    try:
        kinds = [device.device_kind for device in jax.devices() if device.platform != "cpu"]
    except RuntimeError as error:
        problems.append(f"JAX finds no device: {' '.join(str(error).split())}")
        return "JAX cannot start"
    if kinds:
        return ", ".join(kinds)
    if DRIVER.is_file():
        problems.append(
            "this machine has an NVIDIA GPU, but JAX does not use it: pip install 'sdr-jax[cuda]', and unset "
            "JAX_PLATFORMS"
        )
        return "NVIDIA, not used by JAX"
    return "none; networks train on the CPU"
