"""Libraries that only some methods need."""

import importlib
from typing import Any


def needs(module: str, method: str) -> Any:
    """Imports what a method needs from the optional extra `search`.

    Raises:
        ImportError: it is not installed; says what to install.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:  # it is there and lacks something of its own
            raise
        raise ModuleNotFoundError(
            f"{method} needs the package {module}: pip install 'sdr-jax[search]'", name=module
        ) from None
