"""What trainers need of this machine's GPUs: what is refused, from what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from common.errors import UserError
from common.memory import in_words
from experiments.config import Fidelity
from experiments.config.limits import training_bytes


class Device(NamedTuple):
    """The device of a trainer, as its JAX reports it."""

    backend: str  # such as cpu or gpu
    name: str  # such as NVIDIA H200
    memory: int | None  # bytes that JAX may use; None if unknown


def device() -> Device:
    """The device of this process; runs on a trainer."""
    import jax  # the main process asks a trainer

    first = jax.devices()[0]
    memory = (first.memory_stats() or {}).get("bytes_limit")
    return Device(jax.default_backend(), first.device_kind, memory)


def refuse_unusable(used: Device, names: Sequence[str], trained: Mapping[str, Fidelity]) -> None:
    """Raise UserError for a trainer without the GPU that it was given, or with too little memory.

    Args:
        used: the trainer's device.
        names: the GPUs that JAX is to use.
        trained: the fidelities at which it trains, by field.
    """
    if used.backend == "cpu" and names:
        raise UserError(
            f"JAX cannot start CUDA although the driver lists GPU {', '.join(names)}: check that nvidia-smi "
            "works and shows CUDA version 12 or later, then pip install -U 'sdr-jax[cuda]'; or train on the "
            "CPU with JAX_PLATFORMS=cpu"
        )
    if used.backend == "cpu" or used.memory is None:
        return
    for name, fidelity in trained.items():
        need = training_bytes(fidelity)
        if need > used.memory:
            raise UserError(
                f"--{name}: training on {fidelity.images} images of {fidelity.size} takes at least "
                f"{in_words(need)} of GPU memory, and {used.name} offers {in_words(used.memory)}: use a "
                f"smaller --{name}.width and --{name}.height, or JAX_PLATFORMS=cpu"
            )


def out_of_memory(used: Device, fidelity: Fidelity) -> UserError:
    """The error of a trainer whose GPU ran out of memory."""
    memory = "its memory" if used.memory is None else f"its {in_words(used.memory)} of memory"
    return UserError(
        f"{used.name} ran out of {memory} while training {fidelity.train.net} on images of {fidelity.size}, "
        f"{fidelity.train.batch} at a time: end other programs that use it (nvidia-smi lists them), or use "
        "smaller images or batches"
    )
