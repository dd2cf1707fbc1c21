"""How many processes train networks, and on which GPUs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.metadata import entry_points

from common.errors import UserError
from common.workers.pool import gpus
from experiments.config.config import Config


def jax_supports_cuda() -> bool:
    """Whether JAX is to use NVIDIA GPUs: its plugin is installed, and JAX_PLATFORMS allows it."""
    platforms = os.environ.get("JAX_PLATFORMS", "")
    allowed = not platforms or bool({"cuda", "gpu"} & set(platforms.split(",")))
    return allowed and any("cuda" in plugin.name for plugin in entry_points(group="jax_plugins"))


def usable_gpus() -> list[str]:
    """The GPUs of this machine that JAX is to use, by their CUDA names."""
    return gpus() if jax_supports_cuda() else []


def trainers_of(requested: int | None, names: Sequence[str]) -> int | None:
    """The number of separate trainers of this machine; None where workers render and train.

    Args:
        requested: the value of ``--trainers``.
        names: the GPUs that JAX is to use.

    Raises:
        UserError: there are more trainers than GPUs.
    """
    if not names or requested is None:
        return requested or len(names) or None
    if requested > len(names):
        count = "1 GPU" if len(names) == 1 else f"{len(names)} GPUs"
        raise UserError(
            f"--trainers {requested}: this machine has {count} (CUDA device {', '.join(names)}), and each "
            f"trainer needs its own; use --trainers {len(names)}"
        )
    return requested


def training_processes(config: Config) -> tuple[str, int]:
    """Count the processes of this machine that train, each with a training set of its own.

    Returns:
        The flag that sets their number, and the number.

    Raises:
        UserError: as `trainers_of`.
    """
    trainers = trainers_of(config.trainers, usable_gpus())
    return ("--workers", max(config.workers, 1)) if trainers is None else ("--trainers", trainers)
