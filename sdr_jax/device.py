"""Where a search computes."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import jax


@contextmanager
def on_cpu() -> Iterator[None]:
    """Let JAX compute on the CPU, even where there is a GPU, if it may use both.

    Compiling one update of a model for a GPU takes XLA more than a minute of CPU time, and such small
    arrays gain nothing there.
    """
    try:
        place = jax.default_device(jax.local_devices(backend="cpu")[0])
    except RuntimeError:  # JAX_PLATFORMS leaves it out
        place = nullcontext()
    with place:
        yield
