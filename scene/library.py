"""A user's own assets."""

from scene.asset import Asset


class LibraryError(ValueError):
    """A folder of own assets cannot be used."""


def check(folder: str) -> None:
    """Nothing yet."""


def scan(folder: str) -> dict[str, tuple[str, ...]]:
    """Nothing yet."""
    return {}


def load(family: str, path: str) -> Asset:
    """Nothing yet."""
    raise LibraryError(path)
