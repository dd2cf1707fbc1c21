"""The versions that decide pictures on this machine."""

from __future__ import annotations

from functools import lru_cache

from common.files import versions
from scene.version import ENGINE, MAKERS


@lru_cache(maxsize=1)
def picture_versions() -> dict[str, int | str]:
    """The engine's version and those of the libraries that make pictures, by name."""
    return {"engine": ENGINE, **versions(MAKERS)}
