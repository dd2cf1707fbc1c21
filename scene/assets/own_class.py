"""A class of the user's own: its name, the file of its one asset, and where its objects stand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.errors import UserError
from scene.assets.library import LibraryError, path_of, refuse_changed, snapshot
from scene.classes import check_class_name
from scene.mesh.asset import Asset, translate
from scene.mesh.file import MeshError, read_mesh, referenced
from scene.names import PLACES

FAMILY = "own class"
"""What takes the place of a family where such an object stands; its index is the file's snapshot."""
SUFFIX = ".glb"
"""Files that hold all that they need, so that workers elsewhere need no other."""
LONGEST_SIDE = (0.05, 15.0)
"""Metres from, to."""


class OwnClass(NamedTuple):
    """A class beside the engine's, with train id ``scene.classes.OWN``."""

    name: str
    file: str  # GLB of its asset, or the file's snapshot, see ``library.snapshot``
    place: str = "sidewalk"  # or "carriageway"

    def called(self, naming: Callable[[str], str]) -> OwnClass:
        """The same class, its file by the name that ``naming`` gives it."""
        return self._replace(file=naming(self.file))


def check(own: OwnClass) -> None:
    """Load the asset once, so that errors come before the work.

    Raises:
        UserError: name or place cannot be.
        LibraryError: the file cannot be used.
    """
    check_class_name(own.name)
    if own.place not in PLACES:
        raise UserError(f"own class: place {own.place!r} is unknown; known: {', '.join(PLACES)}")
    if Path(own.file).suffix.lower() != SUFFIX or not Path(own.file).is_file():
        why = "is not there" if not Path(own.file).exists() else f"is no {SUFFIX} file"
        raise LibraryError(f"{own.file} {why}; an own class needs the {SUFFIX} file of its asset")
    load(snapshot(own.file))


def load(ref: str) -> Asset:
    """The asset in a file, by its snapshot, standing on the ground around its own middle.

    Raises:
        LibraryError: broken, without triangles, not complete in itself, of no plausible size, or not the
            file any more that it was; the message names the file.
    """
    file = path_of(ref)
    try:
        asset = read_mesh(file)
        for name in referenced(file):
            raise MeshError(f"needs {name} beside it; save all in one {SUFFIX} file")
        longest = float(np.ptp(asset.mesh.vertices, axis=0).max())
        low, high = LONGEST_SIDE
        if not low <= longest <= high:
            raise MeshError(
                f"is {longest:.4g} m long; an asset of an own class is {low:g} to {high:g} m long, and "
                "units of glTF are metres"
            )
    except MeshError as error:
        raise LibraryError(f"{file}: {error}") from error
    except OSError as error:
        raise LibraryError(f"{file}: {error.strerror}") from error
    refuse_changed(ref, file)
    (left, back, bottom), (right, front, _) = asset.mesh.bounds.tolist()
    return translate(asset, (-(left + right) / 2, -(back + front) / 2, -bottom))
