"""Refuse mesh files that declare more than they hold, before a loader allocates memory for them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.files import parse_json

MOST_BYTES = 500_000_000
"""Largest size of a mesh file or its texture."""
MOST_NODES = 100_000
"""Largest number of nodes in a glTF scene."""


class MeshError(UserError):
    """A mesh file cannot be used; the message says why, without naming the file."""


def refuse_bomb(path: Path) -> None:
    """Raise MeshError for a file with counts that its size cannot hold; OSError if it cannot be read."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise MeshError(f"has {size:,} bytes; the limit is {MOST_BYTES:,}")
    suffix = path.suffix.lower()
    if suffix == ".ply":
        for name, count in _elements(path):
            if count > size:  # each takes at least a byte
                raise MeshError(f"broken: declares {count:,} of {name} in {size:,} bytes")
    if suffix in (".glb", ".gltf"):
        _refuse_large_gltf(gltf_content(path))


def _elements(path: Path) -> Iterator[tuple[str, int]]:
    """Names and counts of the elements in a PLY header."""
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
        MeshError: it is missing or malformed.
    """
    data = path.read_bytes()
    if path.suffix.lower() == ".glb":
        if len(data) < 20:
            raise MeshError("broken: truncated")
        data = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
    try:
        content = parse_json(data)
    except ValueError as error:
        raise MeshError(f"broken: {error}") from error
    if not isinstance(content, dict):
        raise MeshError("broken: its JSON is not an object")
    for name in ("accessors", "buffers", "images", "nodes"):
        rows = content.get(name, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise MeshError(f"broken: {name} is not a list of objects")
    for row in (*content.get("buffers", []), *content.get("images", [])):
        if not isinstance(row.get("uri", ""), str):
            raise MeshError("broken: a uri is not a string")
    return content


def _refuse_large_gltf(content: dict[str, Any]) -> None:
    """Check counts: an accessor without bytes means zeros, so its count alone takes memory."""
    for row in content.get("accessors", []):
        count = row.get("count", 0)
        if not isinstance(count, int) or not 0 <= count <= MOST_BYTES // 64:
            raise MeshError(f"broken: an accessor with {count!r} elements")
    nodes = content.get("nodes", [])
    children: list[Any] = []
    for node in nodes:
        below = node.get("children", [])
        children += below if isinstance(below, list) else [below]
    if len(nodes) > MOST_NODES or len(children) > MOST_NODES:
        raise MeshError(f"has more than {MOST_NODES:,} nodes")
    if not all(isinstance(child, int) for child in children) or len(set(children)) < len(children):
        raise MeshError("broken: a node has two parents")
