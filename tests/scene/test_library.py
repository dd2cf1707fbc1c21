"""Own assets: read from every format, put on the ground in metres, or refused by name."""

import io
import json
import re
import struct
from pathlib import Path
from unicodedata import normalize
from urllib.parse import unquote

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from scene.assets import catalogue, library
from scene.assets.library import FOLDERS, LibraryError, check, load, manifest, scan
from scene.look.materials import material_id
from scene.mesh.file import MeshError, from_trimesh, read_mesh
from scene.mesh.gltf import TexturePlacement
from tests.scene.conftest import refused, solid

CAR = (4.4, 1.8, 1.5)
"""Length, width and height of the box used as a car, metres."""
RED = (200, 40, 30, 255)
SUFFIXES = ["glb", "gltf", "obj", "ply", "stl"]
block = trimesh.creation.box
HEAD, ROW = "file,author,licence,source", "car/box.stl,A,B,C"


def car(extents=CAR):
    """A red box with z up, away from the origin."""
    mesh = block(extents)
    mesh.apply_translation((7, 3, 2))
    mesh.visual.vertex_colors = np.tile(RED, (8, 1))
    return mesh


def turned(mesh, rotation):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return mesh.apply_transform(matrix)


def y_up(mesh):
    """Turn a mesh to y up and front along z, as in glTF."""
    return turned(mesh, [[0, 1, 0], [0, 0, 1], [1, 0, 0]])


def only(folder, family="car"):
    (path,) = scan(folder)[family]
    return catalogue.asset(family, path)


def textured(mesh, uv, **material):
    mesh.visual = TextureVisuals(uv=uv, material=PBRMaterial(**material))
    return y_up(mesh)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_is_read_and_put_on_the_ground(shelf, suffix):
    mesh = y_up(car()) if suffix in ("glb", "gltf") else car()
    asset = only(shelf(f"car/box.{suffix}", mesh))
    bounds = np.array([[-2.2, -0.9, 0], [2.2, 0.9, 1.5]])
    assert asset.mesh.bounds == pytest.approx(bounds, abs=1e-5)
    assert len(asset.mesh.faces) == len(asset.color) == len(asset.material) == 12
    assert asset.color.dtype == np.float32 and asset.material.dtype == np.uint8


def test_colours_of_vertices_become_linear_those_of_gltf_are_and_clear_ones_are_glass(shelf):
    asset = only(shelf("car/box.ply", car()))
    expected = [((v / 255 + 0.055) / 1.055) ** 2.4 for v in RED[:2]]
    assert asset.color[:, :2] == pytest.approx(np.tile(expected, (12, 1)), abs=1e-3)
    mesh = textured(
        block((9, 2.5, 3)),
        np.zeros((8, 2)),
        baseColorFactor=[0.2, 0.4, 0.6, 0.5],
        alphaMode="BLEND",
    )
    asset = only(shelf("bus/box.glb", mesh), "bus")
    assert asset.color == pytest.approx(np.tile([0.2, 0.4, 0.6], (12, 1)), abs=3e-3)
    assert set(asset.material) == {material_id("glass")}


def card(opacity=255):
    """A square of two triangles standing in the x-z plane, its left half red, its right half blue."""
    picture = np.array([[(255, 0, 0, 255)] * 2 + [(0, 0, 255, opacity)] * 2] * 2, np.uint8)
    corners = np.array([[-1, 0, 0], [0, 0, 0], [0, 0, 2], [-1, 0, 2]], float)
    vertices = np.concatenate([corners, corners + [1, 0, 0]])
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    u = np.clip((vertices[:, 0] + 1) / 2, *np.repeat([[0.01, 0.51], [0.49, 0.99]], 4, axis=1))
    uv = np.column_stack([u, vertices[:, 2] / 2])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return textured(mesh, uv, baseColorTexture=Image.fromarray(picture), alphaMode="MASK")


def test_a_texture_gives_each_face_its_colour_and_leaves_out_what_is_clear(shelf):
    asset = only(shelf("tree/card.glb", card()), "tree")
    left = solid(asset.mesh).triangles_center[:, 0] < 0
    assert (asset.color[left] == [1, 0, 0]).all() and (asset.color[~left] == [0, 0, 1]).all()
    asset = only(shelf("bush/card.glb", card(opacity=0)), "bush")
    assert (asset.color == [1, 0, 0]).all() and len(asset.color) == 2
    assert solid(asset.mesh).extents == pytest.approx([1, 0, 2])
    mesh, picture = block(CAR), Image.new("RGB", (2, 2), (0, 255, 0))  # and of OBJ
    mesh.visual = TextureVisuals(uv=np.full((8, 2), 0.3), material=SimpleMaterial(image=picture))
    assert (only(shelf("car/box.obj", mesh)).color == [0, 1, 0]).all()


def glb(material, alpha=None):
    """A handwritten file of two triangles.

    The first has the material, and with `alpha` a texture of that opacity; the second has none.
    """
    corners, uv = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.zeros((3, 2), np.float32)
    parts = [corners.tobytes(), uv.tobytes()]
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}}
    content = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{**primitive, "material": 0}, primitive]}], "materials": [material],
        "accessors": [{"bufferView": k, "componentType": 5126, "count": 3, "type": f"VEC{3 - k}"}
                      for k in range(2)],
    }  # fmt: skip
    if alpha is not None:
        Image.new("RGBA", (1, 1), (255, 0, 0, alpha)).save(picture := io.BytesIO(), "PNG")
        parts.append(picture.getvalue())
        content["images"] = [{"bufferView": 2, "mimeType": "image/png"}]
        content["textures"] = [{"source": 0}]
        look = {"baseColorTexture": {"index": 0}, **material.get("pbrMetallicRoughness", {})}
        content["materials"] = [{**material, "pbrMetallicRoughness": look}]
    data = b"".join(parts)
    starts = [data.index(part) for part in parts]
    content["bufferViews"] = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
        for start, part in zip(starts, parts, strict=True)
    ]
    content["buffers"] = [{"byteLength": len(data)}]
    chunks = (b"JSON", json.dumps(content).encode(), b" "), (b"BIN\0", data, b"\0")
    body = b""
    for kind, text, space in chunks:
        text += space * (-len(text) % 4)
        body += struct.pack("<I", len(text)) + kind + text
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def base(alpha):
    return {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, alpha]}}


MASK, BLEND = {"alphaMode": "MASK"}, {"alphaMode": "BLEND"}


@pytest.mark.parametrize(("material", "alpha", "expected"), [
    *((mode, 0, "plain") for mode in ({}, {"alphaMode": "OPAQUE"})),  # of textures
    (MASK, 127, None), (MASK, 128, "plain"), (MASK | {"alphaCutoff": 0.2}, 52, "plain"),
    (MASK | {"alphaCutoff": 0.2}, 50, None), (MASK | {"alphaCutoff": 0}, 0, "plain"),
    (MASK | base(0.5), 200, None),  # 0.39 in all
    (BLEND, 100, None), (BLEND, 200, "plain"),
    *((mode | base(0), None, "plain") for mode in ({}, {"alphaMode": "OPAQUE"})),  # of colours
    (MASK | base(0.6), None, "plain"), (MASK | base(0.4), None, None),
    (BLEND | base(0.6), None, "glass"), (BLEND | base(1), None, "plain"),
])  # fmt: skip
def test_gltf_says_what_opacity_means(tmp_path, material, alpha, expected):
    (path := tmp_path / "two.glb").write_bytes(glb(material, alpha))
    asset = read_mesh(path)
    red = asset.color[:, 1] == 0
    assert (~red).sum() == 1 and red.sum() == (expected is not None)
    assert set(asset.material[red]) == ({material_id(expected)} if expected else set())


def changed(change, material=None, alpha=None):
    """The file of ``glb`` with its JSON changed in place by ``change``."""
    data = glb(material or {}, alpha)
    end = 20 + struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20:end])
    change(content)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + b"JSON" + text + data[end:]
    return data[:8] + struct.pack("<I", 12 + len(body)) + body


@pytest.mark.parametrize(("change", "complaint"), [
    (lambda c: c.update(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco"),
    (lambda c: c.update(extensionsRequired=["EXT_meshopt_compression"]), "EXT_meshopt"),
    (lambda c: c.update(extensionsRequired=["KHR_mesh_quantization"]), "KHR_mesh_quantization"),
    (lambda c: c["accessors"][0].update(sparse={"count": 1}), "sparse"),
    (lambda c: c["accessors"][1].update(componentType=5121, normalized=True), "TEXCOORD_0"),
    (lambda c: c["images"][0].update(mimeType="image/ktx2"), "KTX2"),
    (lambda c: c["images"][0].update(bufferView=0), "has a texture that cannot be read"),
])  # fmt: skip
def test_unsupported_features_of_gltf_are_refused_by_name(tmp_path, change, complaint):
    (path := tmp_path / "two.glb").write_bytes(changed(change, alpha=255))
    with pytest.raises(MeshError, match=complaint):
        read_mesh(path)


def test_gltf_without_a_colour_is_white_and_colours_of_vertices_tint_a_material(tmp_path):
    (path := tmp_path / "two.glb").write_bytes(glb({}))
    assert read_mesh(path).color == pytest.approx(1.0)

    def tint(content):  # the corners, as colours: their mean is a third red and green
        content["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 0

    path.write_bytes(changed(tint, base(1)))
    assert read_mesh(path).color[0] == pytest.approx([1 / 3, 0, 0], abs=1e-3)


def test_a_texture_of_gltf_is_moved_and_turned_by_its_transform():
    uv = np.array([[0.0, 1.0], [0.5, 0.75]])  # the loader's v is up: (0, 0) and (0.5, 0.25) of glTF
    moved = TexturePlacement((0.1, 0.2), 0.0, (2.0, 4.0)).of(uv)
    assert moved == pytest.approx(np.array([[0.1, 0.8], [1.1, -0.2]]))
    turned = TexturePlacement(rotation=np.pi / 2).of(uv)
    assert turned == pytest.approx(np.array([[0.0, 1.0], [0.25, 1.5]]))


@pytest.mark.parametrize("name", ["my%20paint.png", "gr%C3%BCn.png", "grün.png"])
def test_a_texture_of_gltf_may_have_a_name_in_percent_code(tmp_path, name):
    data = glb({}, 255)
    end = 20 + struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20:end])
    (tmp_path / "my mesh.bin").write_bytes(data[end + 8 :])
    Image.new("RGB", (1, 1), (0, 0, 255)).save(tmp_path / unquote(name))
    content["images"], content["buffers"][0]["uri"] = [{"uri": name}], "my%20mesh.bin"
    (path := tmp_path / "two.gltf").write_text(json.dumps(content))
    assert (read_mesh(path).color[0] == BLUE).all()


def test_grey_of_16_bits_is_grey():
    picture = Image.fromarray(np.full((2, 2), 128 * 256, np.uint16))
    mesh = textured(block(CAR), np.full((8, 2), 0.3), baseColorTexture=picture)
    assert from_trimesh(mesh).color == pytest.approx(0.2158, abs=1e-3)


def test_meshes_in_memory_have_no_glass_by_default_as_in_gltf_and_no_vertices_without_a_face():
    mesh = textured(block(CAR), np.zeros((8, 2)), baseColorFactor=[255, 0, 0, 128])
    assert set(from_trimesh(mesh).material) == {material_id("plain")}
    far = trimesh.Trimesh([*block(CAR).vertices, (0, 0, 90)], block(CAR).faces, process=False)
    assert np.ptp(from_trimesh(far).mesh.vertices, axis=0) == pytest.approx(CAR)


def obj(folder, library, picture="my paint.png"):
    """Read a handwritten file of a square with texture coordinates 0.25."""
    pixels = np.uint8([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]])
    Image.fromarray(pixels).save(folder / picture)
    (folder / "all of it.mtl").write_text(f"newmtl two words\n{library}\n")
    (path := folder / "square.obj").write_text(
        "mtllib all of it.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt .25 .25\n"
        "usemtl two words\nf 1/1 2/1 3/1 4/1\n"
    )
    return read_mesh(path)


CRIMSON, GREEN, BLUE, WHITE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)


@pytest.mark.parametrize(("options", "colour"), [
    ("", BLUE), ("-bm 0.5 -clamp on ", BLUE), ("-blendu off -mm 0 1 -texres 64 -imfchan l ", BLUE),
    ("-o 0.5 ", WHITE), ("-o 0 .5 ", CRIMSON), ("-s 3 3 1 ", GREEN), ("-s 1 3 -o 5e-1 0 0 ", GREEN),
    ("-t 0.1 0 0 -boost 2 -cc on -type sphere ", BLUE),
])  # fmt: skip
def test_a_texture_of_obj_may_have_options_and_spaces_in_its_name(tmp_path, options, colour):
    asset = obj(tmp_path, f"map_Kd {options}my paint.png")
    assert (asset.color == colour).all() and len(asset.color) == 2


@pytest.mark.parametrize(("library", "expected"), [
    ("d 0.3", "glass"), ("Tr 0.7", "glass"), ("d -halo 0.3", "glass"), ("Tr 0.7\nd 1", "plain"),
    ("d 1\nTr 0.7", "plain"), ("d 1", "plain"), ("Tr 0", "plain"), ("d 0.3\nmap_Kd my paint.png", "glass"),
])  # fmt: skip
def test_a_material_of_obj_that_is_clear_is_glass(tmp_path, library, expected):
    asset = obj(tmp_path, f"Kd 1 0 0\n{library}")
    assert set(asset.material) == {material_id(expected)} and len(asset.material) == 2
    assert (asset.color == (BLUE if "map" in library else CRIMSON)).all()


@pytest.mark.parametrize(("library", "complaint"), [
    ("d clear", "broken: could not convert string to float: 'clear'"),
    ("map_Kd all of it.mtl", "has a texture that cannot be read"),
    ("map_Kd -bm 1 ../my paint.png", r"refers to \.\./my paint\.png, which leads out of"),
])  # fmt: skip
def test_a_bad_material_of_obj_is_refused(tmp_path, library, complaint):
    refused(MeshError, complaint, obj, tmp_path, library)


def test_a_class_folder_may_be_written_with_an_underscore_or_be_a_family(shelf):
    shelf("traffic_sign/stop.stl", block((0.02, 0.7, 0.7)))
    shelf("vegetation/oak.stl", block((3, 3, 6)))
    folder = shelf("bush/box.stl", block((1, 1, 1)))
    counts = {family: len(paths) for family, paths in scan(folder).items()}
    assert counts == {"traffic sign": 1, "tree": 1, "bush": 1}
    Path(folder, "bush/._box.stl").write_bytes(b"of the system")
    assert check(folder) == 3
    assert set(catalogue.FAMILIES) == set(FOLDERS.values())


@pytest.mark.parametrize("family", catalogue.FAMILIES)
def test_built_in_assets_have_plausible_sizes(family, shelf):
    built_in = solid(catalogue.asset(family, 0).mesh)
    (path,) = scan(shelf(f"{family}/ours.stl", built_in))[family]
    loaded = solid(load(family, path).mesh)
    assert sorted(loaded.extents) == pytest.approx(sorted(built_in.extents), rel=1e-4)


@pytest.mark.parametrize(("up", "forward"), [("y", "z"), ("z", "-y"), ("-x", "y"), ("x", "")])
def test_the_manifest_defines_the_axes(shelf, up, forward):
    def axis(name):
        return (-1 if name.startswith("-") else 1) * np.eye(3)["xyz".index(name[-1])]

    z, x = axis(up), axis(forward or "y")
    mesh = turned(car(), np.stack([x, np.cross(z, x), z]).T)
    folder = shelf("car/box.stl", mesh, up=up, forward=forward)
    assert solid(only(folder).mesh).extents == pytest.approx(CAR, abs=1e-5)


def test_the_manifest_scales_a_sign_hangs_on_its_pole_and_a_house_looks_at_the_road(shelf):
    folder = shelf("car/box.stl", car(1000 * np.array(CAR)), scale="0.001", author="B. Other")
    assert solid(only(folder).mesh).extents == pytest.approx(CAR, abs=1e-5)
    ((file, author, licence, source, *_),) = manifest(folder)
    assert (file, author, licence, source) == ("car/box.stl", "B. Other", "CC0-1.0", "own work")
    folder = shelf("traffic sign/stop.stl", block((0.02, 0.7, 0.7)))
    low, high = only(folder, "traffic sign").mesh.bounds
    assert (low[2], high[0]) == pytest.approx((library.HUNG, -library.POLE_RADIUS))
    house = shelf("building/h.stl", block((8, 12, 9)))  # 8 deep, its front along x
    bounds = only(house, "building").mesh.bounds
    assert bounds == pytest.approx(np.array([[-6, 0, 0], [6, 8, 9]]), abs=1e-6)


@pytest.mark.parametrize(("file", "content", "complaint"), [
    ("car/box.stl", car(100 * np.array(CAR)), r"is 440 m long.*scale 0\.01 \(centimetres\)"),
    ("person/p.stl", block((0.5, 1.8, 0.3)), ".*column 'up'"),  # on its side
    *((f"car/bad.{suffix}", content, "(broken|has no faces)")
      for suffix in SUFFIXES for content in (b"", b"garbage\x00\xff" * 9)),
    ("car/cut.glb", y_up(car()).export(file_type="glb")[:-40], "broken"),
    ("car/empty.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "(has no faces|broken)"),
    ("car/nan.ply", car((np.nan, 1, 1)), "has vertices that are not finite"),
    ("car/index.glb", re.sub(b"(?s)BIN\0....", b"BIN\0\0\1\0\0", block(CAR).export(file_type="glb")),
     "has a face with a vertex index outside of its 8"),
    ("car/many.ply", b"ply\nformat ascii 1.0\nelement vertex 90000000000\nend_header\n", "broken: declares "),
    ("car/zeros.gltf", b'{"accessors": [{"count": 900000000000}]}', "broken: an accessor with 9000"),
    ("car/twice.gltf", b'{"nodes": [{"children": [1, 1]}, {}]}', "broken: a node has two parents"),
    ("car/deep.gltf", b"[" * 100_000, "broken: it is nested too deeply"),
    ("car/out.obj", b"mtllib ../../secret.mtl\n", r"refers to \.\./\.\./secret\.mtl, which leads out of"),
    ("car/out.gltf", b'{"buffers": [{"uri": "/etc/passwd"}]}', "refers to /etc/passwd, which leads out"),
    ("car/fine.stl", trimesh.creation.icosphere(), "has more than 100 faces"),
])  # fmt: skip
def test_a_bad_file_is_refused_by_name(shelf, file, content, complaint, monkeypatch):
    monkeypatch.setattr("scene.mesh.file.MOST_FACES", 100)
    refused(LibraryError, rf"{Path(file).name}: {complaint}", check, shelf(file, content))


def test_a_missing_texture_is_named(shelf, tmp_path):
    text = b"mtllib box.mtl\nusemtl a\nv 0 0 0\nv 4 0 0\nv 0 2 1\nvt 0 0\nf 1/1 2/1 3/1\n"
    folder = shelf("car/box.obj", text)
    for name in ("box.mtl", "paint.png"):
        refused(LibraryError, rf"box\.obj: refers to {name}, which does not exist", check, folder)
        (tmp_path / "own/car/box.mtl").write_text("newmtl a\nmap_Kd paint.png\n")
    path = Path(shelf("bus/box.gltf", y_up(car())), "bus/box.gltf")
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "images": [{"uri": "my%20paint.png"}]}))
    message = r"box\.gltf: refers to my paint\.png, which does not exist"
    refused(LibraryError, message, load, "bus", scan(folder)["bus"][0])


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_a_manifest_as_spreadsheets_and_other_systems_write_it(shelf, tmp_path, form):
    folder = shelf("car/grün.stl", car())
    disk, rows = normalize(form, "grün.stl"), normalize("NFC", ".\\car\\grün.stl")
    (tmp_path / "own/car/grün.stl").rename(tmp_path / "own/car" / disk)
    text = f"{HEAD};scale\n{rows};A, B;B;C;1,1\n".replace(",licence,source", ";licence;source")
    (tmp_path / "own/assets.csv").write_text("\ufeff" + text.replace("file,", "file;"), "utf-8")
    [row] = manifest(folder)
    assert row[:4] == (f"car/{disk}", "A, B", "B", "C") and row.scale == 1.1
    assert only(folder).mesh.bounds[1][2] == pytest.approx(1.1 * CAR[2], rel=1e-4)


@pytest.mark.parametrize("name", ["parts\\grün.png", "./parts//grün.png", "parts/gru\u0308n.png"])
def test_a_texture_may_be_named_in_other_ways(tmp_path, name):
    (tmp_path / "parts").mkdir()
    obj(tmp_path, "Kd 1 0 0", "parts/grün.png")
    asset = obj(tmp_path, f"map_Kd {name}", "parts/grün.png")
    assert (asset.color == BLUE).all()


@pytest.mark.parametrize(("text", "complaint"), [
    ("file,author,licence\ncar/box.stl,A,B\n", "no column 'source'"),
    (f"{HEAD}\ncar/box.stl,A,,C\n", "line 2: licence is empty"), (None, "assets.csv is missing"),
    (f"{HEAD}\n", "has no row for car/box.stl"), ("", "has no row for car/box.stl"),
    (f"{HEAD}\n{ROW}\ncar/gone.stl,A,B,C\n", "lists car/gone.stl, which does not exist"),
    (f"{HEAD}\n{ROW}\n{ROW}\n", "line 3: car/box.stl is listed twice"),
    (f"{HEAD},scale\n{ROW},-1\n", "line 2: scale must be a positive number, not '-1'"),
    (f"{HEAD},up\n{ROW},north\n", "box.stl: up is 'north'; known: x, -x"),
    (f"{HEAD},up,forward\n{ROW},z,-z\n", "box.stl: up z and forward -z are the same axis"),
])  # fmt: skip
def test_a_wrong_manifest_is_named(shelf, tmp_path, text, complaint):
    folder, listing = shelf("car/box.stl", car()), tmp_path / "own/assets.csv"
    listing.unlink() if text is None else listing.write_text(text)
    caught = refused(LibraryError, "", check, folder)
    assert complaint in str(caught) and str(tmp_path / "own") in str(caught)


@pytest.mark.parametrize(("name", "complaint"), [
    ("nowhere", "does not exist"), ("file", "is not a folder"), ("empty", "has no mesh file"),
    ("own", "spaceship is not named after a class or family of assets; known: b"),
])  # fmt: skip
def test_wrong_folders_are_named(shelf, tmp_path, name, complaint):
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    shelf("spaceship/x.stl", car())
    refused(LibraryError, complaint, check, str(tmp_path / name))
