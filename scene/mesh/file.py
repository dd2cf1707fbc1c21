"""Mesh files as assets: one colour per face, metres, z up, front along x, standing on the ground.

Textures are sampled at a few points of each face, since the engine draws faces of one colour. glTF is y up
with its front along z and linear colours; in all other formats z is up, the front along x, and colours are
sRGB. There is no blending: a face is opaque, left out or glass.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from common.pictures import MOST_PIXELS
from scene.look.materials import MATERIALS, material_id
from scene.mesh.asset import Asset, merge
from scene.mesh.bombs import MeshError, gltf_content, refuse_bomb
from scene.mesh.gltf import TexturePlacement, readable
from scene.mesh.mesh import Mesh
from scene.mesh.mtl import Look, looks

if TYPE_CHECKING:
    import trimesh
    from PIL.Image import Image

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
"""Supported formats."""
GLTF = (".glb", ".gltf")
MOST_FACES = 200_000
"""A larger mesh is refused, since a street has hundreds of assets."""
AXES = {
    f"{sign}{name}": factor * np.eye(3)[k]
    for k, name in enumerate("xyz")
    for sign, factor in (("", 1), ("-", -1))
}
"""Names of directions in a file: x, -x, y, ..."""
GREY = (0.4, 0.4, 0.4)
"""Linear RGB of faces without a colour."""
SAMPLES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / [[3], [6], [6], [6]]
"""Barycentric coordinates at which the texture of a face is sampled."""
CLEAR = 0.9
"""Faces of one colour below this opacity are glass."""
HOLE = 0.5
"""Textured faces below this opacity are left out, such as gaps between leaves."""
CUTOFF = 0.5
"""Default opacity below which texels in glTF's mode MASK are transparent."""


def read_mesh(
    path: Path, *, up: str = "", forward: str = "", scale: float = 1.0, root: Path | None = None
) -> Asset:
    """Read the asset in a file, at its original position.

    Args:
        path: a file with one of ``SUFFIXES``.
        up: direction in the file that is up, one of ``AXES``; by default y in glTF and z elsewhere.
        forward: direction of its front; by default z in glTF and x elsewhere.
        scale: metres per unit of the file.
        root: folder that must contain the files it refers to; by default its own.

    Raises:
        MeshError: the file is broken or empty, a texture is missing or outside ``root``, it has too many
            faces, or the axes are invalid.
    """
    import trimesh  # takes a second, which streets of built-in assets do not need

    from scene.mesh.siblings import Siblings

    siblings = Siblings(path.parent, root or path.parent)
    refuse_bomb(path)
    try:
        for name in referenced(path):
            siblings.check(name)
        kind, gltf = path.suffix[1:].lower(), path.suffix.lower() in GLTF
        source, placements = readable(path) if gltf else (io.BytesIO(path.read_bytes()), [])
        loaded = trimesh.load_scene(source, file_type=kind, resolver=siblings, process=False)
        libraries = _looks(path) if kind == "obj" else {}
        pieces, left = [], MOST_FACES
        for geometry, matrix in _placed(loaded):
            left -= len(geometry.faces)
            if left < 0:  # a mesh may have many instances
                raise MeshError(f"has more than {MOST_FACES:,} faces, which is the limit")
            pieces.append(_piece(geometry, np.asarray(matrix), gltf, libraries, placements))
    except MeshError:
        raise
    except Exception as error:  # loaders raise all kinds of exceptions
        raise MeshError(f"broken: {error}") from error
    merged = _joined(pieces)
    vertices = merged.mesh.vertices @ (scale * _axes(path, up, forward)).T
    return check_asset(merged._replace(mesh=Mesh(vertices, merged.mesh.faces)))


def from_trimesh(mesh: trimesh.Trimesh | trimesh.Scene) -> Asset:
    """Convert a mesh in memory to an asset: metres, z up, front along x; colours are sRGB.

    Raises:
        MeshError: see `check_asset`.
    """
    import trimesh

    loaded = mesh if isinstance(mesh, trimesh.Scene) else trimesh.Scene(mesh)
    geometries = list(_placed(loaded))
    if sum(len(geometry.faces) for geometry, _ in geometries) > MOST_FACES:
        raise MeshError(f"has more than {MOST_FACES:,} faces, which is the limit")
    for geometry, _ in geometries:
        _check_faces(geometry.faces, geometry.vertices)
    return _joined(
        [_piece(geometry, np.asarray(matrix), False, {}, []) for geometry, matrix in geometries]
    )


def check_asset(asset: Asset) -> Asset:
    """Return an asset as compiled code needs it, which follows its arrays without any checks.

    Its arrays have the types of `Asset`, and vertices without a face are removed.

    Raises:
        MeshError: it has no faces, too many, one with a missing vertex or an unknown material, numbers that
            are not finite, or arrays of other types, shapes or lengths.
    """
    count = len(asset.mesh.faces)
    if not count:
        raise MeshError("has no faces")
    if count > MOST_FACES:
        raise MeshError(f"has more than {MOST_FACES:,} faces, which is the limit")
    vertices = _array("vertices", asset.mesh.vertices, "fiu", (3,)).astype(np.float64)
    faces = _array("faces", asset.mesh.faces, "iu", (3,))
    color = _array("colours", asset.color, "fiu", (3,)).astype(np.float32)
    material = _array("materials", asset.material, "iu", ())
    ignored = None
    if asset.ignored is not None:
        ignored = _array("labels", asset.ignored, "biu", ()).astype(bool)
    of_faces = (color, material, *([] if ignored is None else [ignored]))
    if any(len(array) != count for array in of_faces):
        lengths = ", ".join(str(len(array)) for array in of_faces)
        raise MeshError(f"has {count} faces, but colours, materials and labels of {lengths}")
    _check_faces(faces, vertices)
    for what, numbers in (("vertices", vertices), ("colours", color)):
        if not np.isfinite(numbers).all():
            raise MeshError(f"has {what} that are not finite numbers")
    for number in (material.min(), material.max()):
        if not 0 <= number < len(MATERIALS):
            raise MeshError(f"has material {number}; the last is {len(MATERIALS) - 1}")
    used, index = np.unique(faces, return_inverse=True)
    mesh = Mesh(vertices[used], index.reshape(faces.shape).astype(np.int64))
    return Asset(mesh, color, material.astype(np.uint8), ignored)


def _array(what: str, values: Any, kinds: str, shape: tuple[int, ...]) -> np.ndarray:
    """The values as an array [n, *shape] with a type of one of these kinds; MeshError if they are none."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise MeshError(f"has {what} that are no array") from None
    if array.dtype.kind not in kinds or array.shape[1:] != shape or not array.ndim:
        number = "numbers" if "f" in kinds else "whole numbers"
        needed = "n, 3" if shape else "n"
        raise MeshError(
            f"has {what} of type {array.dtype} and shape {array.shape}; they must be {number} of shape "
            f"[{needed}]"
        )
    return array


def _check_faces(faces: np.ndarray, vertices: np.ndarray) -> None:
    """Raise MeshError if a face has a vertex that does not exist."""
    if len(faces) and (np.min(faces) < 0 or np.max(faces) >= len(vertices)):
        raise MeshError(f"has a face with a vertex index outside of its {len(vertices)} vertices")


def _joined(pieces: list[Asset]) -> Asset:
    """Merge the pieces that have faces; raise MeshError if none has, or one is broken."""
    pieces = [check_asset(piece) for piece in pieces if len(piece.color)]
    if not pieces:
        raise MeshError("has no faces")
    return merge(*pieces)


def _axes(path: Path, up: str, forward: str) -> np.ndarray:
    """Rotation f64[3, 3] from the file's axes to x forward, y left, z up."""
    gltf = path.suffix.lower() in GLTF
    up = up or ("y" if gltf else "z")
    if not forward:
        forward = "z" if up.endswith("y") else "x" if up.endswith("z") else "y"
    for column, value in (("up", up), ("forward", forward)):
        if value not in AXES:
            raise MeshError(f"{column} is {value!r}; known: {', '.join(AXES)}")
    if up[-1] == forward[-1]:
        raise MeshError(f"up {up} and forward {forward} are the same axis")
    z, x = AXES[up], AXES[forward]
    return np.stack([x, np.cross(z, x), z])


def referenced(path: Path) -> Iterator[str]:
    """Names of the files that a mesh file refers to."""
    suffix = path.suffix.lower()
    if suffix in GLTF:
        content = gltf_content(path)
        uris = [row.get("uri", "") for k in ("buffers", "images") for row in content.get(k, [])]
        yield from (unquote(uri) for uri in uris if uri and not uri.startswith("data:"))
    if suffix == ".obj":
        yield from _words_after(path, "mtllib")
        yield from (look.texture for look in _looks(path).values() if look.texture)
    if suffix == ".ply":
        yield from _words_after(path, "comment TextureFile")


def _looks(path: Path) -> dict[str, Look]:
    """Read the material libraries of an OBJ file: materials by name."""
    looks_by_name: dict[str, Look] = {}
    from scene.mesh.siblings import sibling_path

    for library in _words_after(path, "mtllib"):
        with sibling_path(path.parent, library).open(encoding="utf-8", errors="replace") as file:
            looks_by_name |= looks(file)
    return looks_by_name


def _words_after(path: Path, keyword: str) -> Iterator[str]:
    """The text after a keyword at the start of lines; in binary files, of the header."""
    with path.open("rb") as file:
        for line in file:
            text = line.decode("utf-8", "replace").strip()
            if text.startswith(keyword + " ") and text[len(keyword) :].strip():
                yield text[len(keyword) :].strip()
            if text == "end_header":  # data follows in a PLY file
                return


def _placed(loaded: trimesh.Scene) -> Iterator[tuple[trimesh.Trimesh, np.ndarray]]:
    """Every mesh of a loaded file with its pose; points and lines are skipped."""
    import trimesh

    for node in loaded.graph.nodes_geometry:
        matrix, name = loaded.graph[node]
        geometry = loaded.geometry[name]
        if isinstance(geometry, trimesh.Trimesh):
            yield geometry, matrix


def _piece(
    mesh: trimesh.Trimesh,
    matrix: np.ndarray,
    gltf: bool,
    libraries: dict[str, Look],
    placements: list[TexturePlacement],
) -> Asset:
    """Convert one mesh of a file, in the file's axes, without transparent faces."""
    loaded_material = getattr(mesh.visual, "material", None)
    look = libraries.get(getattr(loaded_material, "name", ""), Look())
    placement = (
        placements[int(loaded_material.name)] if gltf and loaded_material is not None else None
    )
    rgba, textured = _colors(mesh, gltf, look, placement)
    of_gltf = gltf or hasattr(loaded_material, "alphaMode")
    mode = getattr(loaded_material, "alphaMode", None) or ("OPAQUE" if of_gltf else "BLEND")
    if mode == "OPAQUE":
        rgba[..., 3] = 1
    if mode == "MASK":
        cutoff = getattr(loaded_material, "alphaCutoff", None)
        rgba[..., 3] = rgba[..., 3] >= (CUTOFF if cutoff is None else cutoff)
    rgba = rgba.mean(axis=1)
    cut = textured or mode == "MASK"
    keep = (rgba[:, 3] >= HOLE) | (not cut)
    clear = (rgba[:, 3] < CLEAR) & (not cut) | (look.opacity < CLEAR)
    vertices = np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
    material = np.where(clear, material_id("glass"), material_id("plain")).astype(np.uint8)
    return Asset(
        Mesh(vertices, np.asarray(mesh.faces)[keep]),
        np.clip(rgba[keep, :3], 0, 1).astype(np.float32),
        material[keep],
    )


def _colors(
    mesh: trimesh.Trimesh, linear: bool, look: Look, placement: TexturePlacement | None
) -> tuple[np.ndarray, bool]:
    """Linear RGB and opacity f64[faces, points, 4] of a mesh, and whether they come from a texture."""
    rgba, textured = _of_material(mesh, linear, look, placement)
    vertex_attributes = getattr(mesh.visual, "vertex_attributes", {})
    if linear and "color" in vertex_attributes:  # glTF multiplies the two
        rgba = rgba * _of_vertices(mesh, np.asarray(vertex_attributes["color"]))[:, None]
    return rgba, textured


def _of_vertices(mesh: trimesh.Trimesh, colors: np.ndarray) -> np.ndarray:
    """Mean linear RGB and opacity f64[faces, 4] of the corners of each face."""
    shares = colors / np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else colors
    if not np.isfinite(shares).all():
        raise MeshError("has vertex colours that are not finite numbers")
    opaque = np.ones((len(shares), 4))
    opaque[:, : shares.shape[1]] = shares
    return opaque[np.asarray(mesh.faces)].mean(axis=1)


def _of_material(
    mesh: trimesh.Trimesh, linear: bool, look: Look, placement: TexturePlacement | None
) -> tuple[np.ndarray, bool]:
    """Linear RGB and opacity f64[faces, points, 4] by colour and texture, and whether it has a texture."""
    count = len(mesh.faces)
    visual = mesh.visual
    grey = np.tile((*GREY, 1.0), (count, 1, 1))
    if visual.kind in ("vertex", "face"):
        return _linear(np.asarray(visual.face_colors, float)[:, None] / 255, linear), False
    if visual.kind != "texture":
        return grey, False
    material = getattr(visual, "material", None)
    texture_image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    factor = getattr(material, "baseColorFactor", None)
    if factor is None and texture_image is None:
        factor = getattr(material, "diffuse", None)
    tint = (
        np.ones(4) if factor is None else _linear(np.asarray(factor, float)[None] / 255, linear)[0]
    )
    wanted = look.texture or (placement is not None and placement.textured)
    if texture_image is None and visual.uv is not None and wanted:
        raise MeshError("has a texture that cannot be read; save it as PNG or JPEG")
    if texture_image is None or visual.uv is None:
        return (np.tile(tint, (count, 1, 1)) if factor is not None else grey), False
    if texture_image.width * texture_image.height > MOST_PIXELS:
        raise MeshError(f"has a texture of more than {MOST_PIXELS:,} pixels")
    pixels = _pixels(texture_image)
    uv = np.asarray(visual.uv)[:, :2] * look.scale + look.offset
    uv = uv if placement is None else placement.of(uv)
    uv = np.einsum("sk,fkc->fsc", SAMPLES, uv[np.asarray(mesh.faces)])
    if not np.isfinite(uv).all():
        raise MeshError("has texture coordinates that are not finite numbers")
    height, width = pixels.shape[:2]
    columns = np.floor((uv[..., 0] % 1) * width).astype(int) % width
    rows = np.floor(((1 - uv[..., 1]) % 1) * height).astype(int) % height
    return _linear(pixels[rows, columns] / 255, False) * tint, True


def _pixels(image: Image) -> np.ndarray:
    """A texture as u8[h, w, 4]; Pillow clips grey of 16 bits at 255, so its low bits are removed first."""
    if not image.mode.startswith("I"):
        return np.asarray(image.convert("RGBA"))
    grey = (np.asarray(image).clip(0, 65535) >> 8).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])


def _linear(rgba: np.ndarray, linear: bool) -> np.ndarray:
    """Decode sRGB colours unless they are ``linear``; opacity stays."""
    if linear:
        return rgba
    rgb = rgba[..., :3]
    decoded = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.concatenate([decoded, rgba[..., 3:]], axis=-1)
