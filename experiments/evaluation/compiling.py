"""Compilation for GPUs: one trainer of a machine compiles, the others wait and read XLA's persistent cache.

Next to that cache lie an empty file for each kind of network that was compiled, and a lock for each that is
being compiled.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from filelock import FileLock

from common.files import digest
from experiments.evaluation.job import Recipe
from seg.recipes import recipe_for

VARIABLE = "JAX_COMPILATION_CACHE_DIR"
"""The environment variable that names XLA's persistent cache."""
SECONDS = {"lite0-frozen": 21, "lite0-heads": 21, "lite0-tuned": 140}
"""Approximate seconds of compilation by recipe, measured on an H200."""
OTHER_SECONDS = 25
"""Those of FCN8s, which stand for all other networks."""


def marker(recipe: Recipe, environment: Mapping[str, str]) -> Path | None:
    """The file that exists once a recipe's networks are compiled for the GPUs of this machine.

    It is None on other backends, and without a persistent cache.
    """
    folder = environment.get(VARIABLE)
    if not folder or dict(recipe.made_with).get("backend", "cpu") == "cpu":
        return None
    decides = [dict(recipe.made_with), asdict(recipe.fidelity), recipe.table, recipe.checkpoints]
    return Path(folder) / f"sdr-jax-{digest(decides)[:16]}"


def announcement(recipe: Recipe, environment: Mapping[str, str]) -> str | None:
    """What to say before a recipe's first network is trained on this machine; None if it is compiled."""
    path = marker(recipe, environment)
    if path is None or path.exists():
        return None
    seconds = SECONDS.get(recipe_for(recipe.fidelity.train), OTHER_SECONDS)
    return f"Compiling {recipe.fidelity.train.net} for the GPU (once): about {seconds} s"


@contextmanager
def compiled_once(recipe: Recipe) -> Iterator[None]:
    """Wait while another trainer makes a recipe's first network; or be the one that others wait for."""
    path = marker(recipe, os.environ)
    if path is None or path.exists():
        yield
        return
    lock = FileLock(path.with_suffix(".lock"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except OSError:  # nothing can be written there, so XLA has no cache to share either
        yield
        return
    try:
        if path.exists():
            lock.release()
        yield
        with suppress(OSError):
            path.touch()
    finally:
        lock.release()
