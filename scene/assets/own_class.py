"""A user's own class: its name, the file of its only asset, and where its objects stand."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.errors import UserError, hint
from scene.assets.library import LibraryError, path_of, refuse_changed, snapshot
from scene.classes import check_class_name
from scene.mesh.asset import Asset, translate
from scene.mesh.file import MeshError, check_asset, read_mesh, referenced
from scene.names import PLACES

FAMILY = "own class"
"""Used as the family of such objects; their index is the snapshot of the file."""
SUFFIX = ".glb"
"""The only accepted format, since a GLB includes its textures and workers then need no other file."""
LONGEST_SIDE = (0.05, 15.0)
"""Smallest and largest plausible length (metres)."""
_IN_MEMORY: dict[str, Asset] = {}
"""Assets without a file, by a digest of their arrays; known to this process only."""


class OwnClass(NamedTuple):
    """An additional class, with train id ``scene.classes.OWN``."""

    name: str
    file: str  # path of its GLB, or the snapshot of it (``library.snapshot``)
    place: str = "sidewalk"  # or "carriageway"


def check(own_class: OwnClass) -> None:
    """Check the name and place and load the asset once, so that errors come before the work.

    Raises:
        UserError: name or place is invalid.
        LibraryError: the file cannot be used.
    """
    check_class_name(own_class.name)
    if own_class.place not in PLACES:
        raise UserError(
            f"own class: place {own_class.place!r} is unknown; {hint(own_class.place, PLACES)}"
        )
    if Path(own_class.file).suffix.lower() != SUFFIX or not Path(own_class.file).is_file():
        reason = f"is not a {SUFFIX} file" if Path(own_class.file).exists() else "does not exist"
        name = own_class.file or "''"
        raise LibraryError(f"{name} {reason}; an own class needs a {SUFFIX} file of its asset")
    load(snapshot(own_class.file))


def load(ref: str) -> Asset:
    """Load the asset of a snapshot, centred, with its lowest point on the ground.

    Raises:
        LibraryError: the file is broken, has no triangles, needs other files, is of implausible size, or has
            changed; the message names it.
    """
    if ref in _IN_MEMORY:
        return _IN_MEMORY[ref]
    file = path_of(ref)
    try:
        asset = read_mesh(file)
        for name in referenced(file):
            raise MeshError(f"needs the separate file {name}; save everything in one {SUFFIX} file")
        asset = _on_ground(asset)
    except MeshError as error:
        raise LibraryError(f"{file}: {error}") from error
    except OSError as error:
        raise LibraryError(f"{file}: {error.strerror}") from error
    refuse_changed(ref, file)
    return asset


def in_memory(asset: Asset) -> str:
    """Register an asset without a file and return the name by which `load` finds it in this process.

    Raises:
        MeshError: implausible size, or see `check_asset`.
    """
    asset = _on_ground(check_asset(asset))
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
    """Centre an asset and put its lowest point on the ground; raise MeshError for an implausible size."""
    longest = float(np.ptp(asset.mesh.vertices, axis=0).max())
    low, high = LONGEST_SIDE
    if not low <= longest <= high:
        raise MeshError(
            f"is {longest:.4g} m long; an asset of an own class is {low:g} to {high:g} m long, and "
            "units of glTF are metres"
        )
    (left, back, bottom), (right, front, _) = asset.mesh.bounds.tolist()
    return translate(asset, (-(left + right) / 2, -(back + front) / 2, -bottom))
