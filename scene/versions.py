"""The versions that determine images on this machine."""

from __future__ import annotations

from functools import lru_cache

from common.files import versions
from scene.version import ENGINE, MAKERS


@lru_cache(maxsize=1)
def picture_versions() -> dict[str, int | str]:
    """Versions of the engine and of the libraries that determine images, by name."""
    return {"engine": ENGINE, **versions(MAKERS)}
