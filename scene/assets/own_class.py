"""A class of the user's own: its name, the file of its one asset, and where its objects stand."""

from __future__ import annotations

import hashlib
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
_IN_MEMORY: dict[str, Asset] = {}
"""Assets of this process without a file, by a digest of their arrays."""


class OwnClass(NamedTuple):
    """A class beside the engine's, with train id ``scene.classes.OWN``."""

    name: str
    file: str  # GLB of its asset, or the file's snapshot, see ``library.snapshot``
    place: str = "sidewalk"  # or "carriageway"

    def with_path(self, naming: Callable[[str], str]) -> OwnClass:
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
    if ref in _IN_MEMORY:
        return _IN_MEMORY[ref]
    file = path_of(ref)
    try:
        asset = read_mesh(file)
        for name in referenced(file):
            raise MeshError(f"needs {name} beside it; save all in one {SUFFIX} file")
        asset = _on_ground(asset)
    except MeshError as error:
        raise LibraryError(f"{file}: {error}") from error
    except OSError as error:
        raise LibraryError(f"{file}: {error.strerror}") from error
    refuse_changed(ref, file)
    return asset


def in_memory(asset: Asset) -> str:
    """A name by which `load` finds an asset without a file, in this process.

    Raises:
        MeshError: it is of no plausible size.
    """
    asset = _on_ground(asset)
    arrays = (*(asset.mesh.vertices, asset.mesh.faces), asset.color, asset.material)
    content = hashlib.sha256()
    for array in arrays:
        content.update(np.ascontiguousarray(array).tobytes())
    if asset.ignored is not None:
        content.update(asset.ignored.tobytes())
    name = f"mesh {content.hexdigest()[:16]}"
    _IN_MEMORY[name] = asset
    return name


def _on_ground(asset: Asset) -> Asset:
    """The asset on the ground around its own middle, if its size is plausible."""
    longest = float(np.ptp(asset.mesh.vertices, axis=0).max())
    low, high = LONGEST_SIDE
    if not low <= longest <= high:
        raise MeshError(
            f"is {longest:.4g} m long; an asset of an own class is {low:g} to {high:g} m long, and "
            "units of glTF are metres"
        )
    (left, back, bottom), (right, front, _) = asset.mesh.bounds.tolist()
    return translate(asset, (-(left + right) / 2, -(back + front) / 2, -bottom))
