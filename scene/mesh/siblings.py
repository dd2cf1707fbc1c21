"""The files next to a mesh for its loader: none outside a folder, none from a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from trimesh.resolvers import Resolver

from common.files import leads_out, plain_path, read_bytes, spelled
from scene.mesh.bombs import MOST_BYTES, MeshError
from scene.mesh.mtl import texture


def sibling_path(folder: Path, name: str) -> Path:
    """The path of a file that a mesh names, also with backslashes or other Unicode forms of accents."""
    path = folder / plain_path(name)
    return spelled(path) or path


class Siblings(Resolver):
    """Gives a loader the bytes of files by name.

    Args:
        folder: folder that names are relative to.
        root: folder that they must not lead out of.
    """

    def __init__(self, folder: Path, root: Path) -> None:
        self._folder, self._root = folder, root

    def check(self, name: str) -> Path:
        """The path of a file by name; MeshError if it does not exist or is outside the root."""
        path = sibling_path(self._folder, name)
        if leads_out(self._root, str(path.absolute())):
            raise MeshError(f"refers to {name}, which leads out of {self._root}")
        if not path.is_file():
            raise MeshError(f"refers to {name}, which does not exist")
        return path

    def get(self, name: str) -> bytes:
        """The bytes of a file; the OBJ loader passes all text after `map_Kd` as the name of a texture."""
        return read_bytes(self.check(texture(name).texture), MOST_BYTES)

    def keys(self) -> list[str]:
        """Names of all files; unused, since loaders ask by name only."""
        return []

    def namespaced(self, namespace: str) -> Any:
        """Files of a sub-folder."""
        return Siblings(self._folder / namespace, self._root)

    def write(self, name: str, data: bytes) -> None:
        """Refuse to write."""
        raise MeshError("writes a file")
