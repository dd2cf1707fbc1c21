"""Features of glTF that its loader does not read: they are refused by name, or rewritten so that it does.

Source: the glTF 2.0 specification, sections 3.6.2 (accessors), 3.7.2 (meshes) and 3.9 (materials), and its
extension KHR_texture_transform.
"""

from __future__ import annotations

import io
import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from scene.mesh.bombs import MeshError, gltf_content

READ = ("KHR_texture_transform", "EXT_texture_webp", "KHR_materials_")
"""Extensions that a file may require; of material extensions only the base colour is used."""
FLOAT = 5126
"""Component type of an accessor of floats."""
JSON_CHUNK = b"JSON"


class TexturePlacement(NamedTuple):
    """The transform of a material's texture coordinates."""

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0  # radians, counter-clockwise
    scale: tuple[float, float] = (1.0, 1.0)
    textured: bool = False  # whether the material has a texture in a form that the loader reads

    def of(self, uv: np.ndarray) -> np.ndarray:
        """Transform coordinates f64[n, 2] of a mesh to those of the texture, with v up as in the loader."""
        u, v = (np.column_stack([uv[:, 0], 1 - uv[:, 1]]) * self.scale).T
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        across, down = cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]
        return np.column_stack([across, 1 - down])


def readable(path: Path) -> tuple[io.BytesIO, list[TexturePlacement]]:
    """The file for the loader, and the texture placement of each material; material names become indices.

    A primitive without a material gets the default one of the standard, which is white. If the texture of the
    base colour uses another set of coordinates than the first, it replaces the first.

    Raises:
        MeshError: it needs a feature that is not supported.
    """
    content = gltf_content(path)
    try:
        _refuse_unread(content)
        placements = _rewrite(content)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise MeshError(f"broken: its JSON is not valid glTF ({error})") from error
    text = json.dumps(content).encode()
    if path.suffix.lower() != ".glb":
        return io.BytesIO(text), placements
    data = path.read_bytes()
    text += b" " * (-len(text) % 4)
    rest = data[20 + struct.unpack_from("<I", data, 12)[0] :]
    body = struct.pack("<I", len(text)) + JSON_CHUNK + text + rest
    return io.BytesIO(data[:8] + struct.pack("<I", 12 + len(body)) + body), placements


def _refuse_unread(content: dict[str, Any]) -> None:
    for name in content.get("extensionsRequired", []):
        if not str(name).startswith(READ):
            raise MeshError(f"requires {name}, which is not supported; export it without")
    accessors = content.get("accessors", [])
    for primitive in _primitives(content):
        used = [*primitive["attributes"].values(), primitive.get("indices", -1)]
        if any("sparse" in accessors[k] for k in used if k >= 0):
            raise MeshError("has sparse accessors, which are not supported; export it without")
        for name, k in primitive["attributes"].items():
            of_place = name == "POSITION" or name.startswith("TEXCOORD_")
            if of_place and accessors[k]["componentType"] != FLOAT:
                raise MeshError(f"has {name} as integers, which are not supported; export floats")


def _primitives(content: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for mesh in content.get("meshes", []):
        yield from mesh["primitives"]


def _rewrite(content: dict[str, Any]) -> list[TexturePlacement]:
    """Number the materials, give one to every primitive, and put the coordinates in use first.

    Names of files are decoded, since the loader takes them as they are.
    """
    for row in (*content.get("buffers", []), *content.get("images", [])):
        if "uri" in row and not row["uri"].startswith("data:"):
            row["uri"] = unquote(row["uri"])
    materials = content.setdefault("materials", [])
    if any("material" not in primitive for primitive in _primitives(content)):
        for primitive in _primitives(content):
            primitive.setdefault("material", len(materials))
        materials.append({})
    placements, sets = [], []
    for k, material in enumerate(materials):
        material["name"] = str(k)
        look = material.setdefault("pbrMetallicRoughness", {})
        specular = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        if specular is None:
            look.setdefault("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
            info = look.get("baseColorTexture")
        else:
            info = specular.get("diffuseTexture")
        info = info or {}
        if "index" in info:
            _refuse_texture(content, content["textures"][info["index"]])
        lay = info.get("extensions", {}).get("KHR_texture_transform", {})
        sets.append(int(lay.get("texCoord", info.get("texCoord", 0))))
        offset, scale = lay.get("offset", (0.0, 0.0)), lay.get("scale", (1.0, 1.0))
        placements.append(
            TexturePlacement(
                (float(offset[0]), float(offset[1])),
                float(lay.get("rotation", 0.0)),
                (float(scale[0]), float(scale[1])),
                specular is None and "index" in info,
            )
        )
    for primitive in _primitives(content):
        attributes, used = primitive["attributes"], sets[primitive["material"]]
        if used:
            attributes["TEXCOORD_0"] = attributes[f"TEXCOORD_{used}"]
    return placements


def _refuse_texture(content: dict[str, Any], texture: dict[str, Any]) -> None:
    """Raise MeshError for a texture without an image in a supported format."""
    others = [name for name in texture.get("extensions", {}) if name not in READ]
    if "source" not in texture and others:
        raise MeshError(f"has a texture in {others[0]}, which is not supported; export PNG or JPEG")
    if "source" in texture and content["images"][texture["source"]].get("mimeType") == "image/ktx2":
        raise MeshError("has a texture in KTX2, which is not supported; export PNG or JPEG")
