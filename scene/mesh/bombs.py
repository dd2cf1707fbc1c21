"""Mesh files that say more than they hold, refused before a loader believes them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.files import parse_json

MOST_BYTES = 500_000_000
"""Of a mesh file, or of a texture beside it."""
MOST_NODES = 100_000
"""Places in a glTF scene."""


class MeshError(UserError):
    """A mesh file cannot be used; the message says why, but not which file."""


def refuse_bomb(path: Path) -> None:
    """Raise MeshError for a file whose counts its size cannot bear; OSError if it cannot be read."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise MeshError(f"has {size:,} bytes; at most {MOST_BYTES:,} are read")
    suffix = path.suffix.lower()
    if suffix == ".ply":
        for name, count in _elements(path):
            if count > size:  # each takes a byte at least
                raise MeshError(f"broken: says {count:,} of {name}, in {size:,} bytes")
    if suffix in (".glb", ".gltf"):
        _refuse_large_gltf(gltf_content(path))


def _elements(path: Path) -> Iterator[tuple[str, int]]:
    """What a PLY's header counts."""
    with path.open("rb") as file:
        for line in file:
            words = line.split()
            if words[:1] == [b"element"] and len(words) == 3 and words[2].isdigit():
                yield words[1].decode("utf-8", "replace"), int(words[2][:18])
            if words == [b"end_header"]:
                return


def gltf_content(path: Path) -> dict[str, Any]:
    """The JSON of a ``.gltf``, or of the first chunk of a ``.glb``.

    Raises:
        MeshError: there is none, or its lists are not of objects.
    """
    data = path.read_bytes()
    if path.suffix.lower() == ".glb":
        if len(data) < 20:
            raise MeshError("broken: cut short")
        data = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
    try:
        content = parse_json(data)
    except ValueError as error:
        raise MeshError(f"broken: {error}") from error
    if not isinstance(content, dict):
        raise MeshError("broken: its JSON is no object")
    for name in ("accessors", "buffers", "images", "nodes"):
        rows = content.get(name, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise MeshError(f"broken: {name} is no list of objects")
    for row in (*content.get("buffers", []), *content.get("images", [])):
        if not isinstance(row.get("uri", ""), str):
            raise MeshError("broken: a uri that is no text")
    return content


def _refuse_large_gltf(content: dict[str, Any]) -> None:
    """An accessor without bytes is zeros, so its count says how much memory it takes; nodes are a tree."""
    for row in content.get("accessors", []):
        count = row.get("count", 0)
        if not isinstance(count, int) or not 0 <= count <= MOST_BYTES // 64:
            raise MeshError(f"broken: an accessor of {count!r} elements")
    nodes = content.get("nodes", [])
    children: list[Any] = []
    for node in nodes:
        below = node.get("children", [])
        children += below if isinstance(below, list) else [below]
    if len(nodes) > MOST_NODES or len(children) > MOST_NODES:
        raise MeshError(f"has more than {MOST_NODES:,} nodes")
    if not all(isinstance(child, int) for child in children) or len(set(children)) < len(children):
        raise MeshError("broken: a node has two parents")
