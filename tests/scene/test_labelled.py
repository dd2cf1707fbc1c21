"""Streets in a few lines of Python: sampled, extended with objects, and rendered from any camera."""

from functools import partial

import numpy as np
import pytest
import trimesh

import scene
from common.errors import UserError
from scene import RENDERERS, AssetPool, CameraResponse, RenderSettings, render_street, sample
from scene.assets.catalogue import bounds
from scene.labelled import PASSES
from scene.mesh.file import check_asset, from_trimesh
from scene.mesh.mesh import Mesh
from scene.street.camera import Camera
from tests.scene.conftest import chosen

SIZE, SEED, SHOTS = (96, 64), 7, 2
POOL = AssetPool(size=3)
FLAT = {"space": "extended", "bend": 0.0, "gradient": 0.0}
"""On a straight, level road, positions along the road are those of the world."""


@pytest.fixture(scope="module")
def street():
    return sample(SEED, assets=POOL, shots=SHOTS, tree_interval=8.0)


def test_a_street_is_the_first_of_a_dataset_with_its_seed(street):
    unit = scene.default_unit()
    unit[list(scene.BY_NAME).index("tree_interval")] = scene.BY_NAME["tree_interval"].to_unit(8.0)
    frames = render_street(unit, SEED, 0, SHOTS, RenderSettings(*SIZE), "embree", POOL)
    for camera, frame in enumerate(frames):
        rendered = street.render(camera, SIZE)
        for name, field in PASSES.items():
            np.testing.assert_array_equal(getattr(rendered, name), getattr(frame, field))


def test_the_table_has_every_object_that_is_seen(street):
    rendered = street.render(0, SIZE)
    ids, counts = np.unique(rendered.instances[rendered.instances > 0], return_counts=True)
    assert {row.id: row.pixels for row in rendered.table} == dict(zip(ids, counts, strict=True))
    for row in rendered.table:
        left, top, width, height = row.box
        rows, columns = np.nonzero(rendered.instances == row.id)
        assert (columns.min(), columns.max() + 1) == (left, left + width)
        assert (rows.min(), rows.max() + 1) == (top, top + height)


def test_only_the_passes_that_were_asked_for_are_there(street):
    rendered = street.render(0, SIZE, passes=("depth",))
    assert rendered.depth.shape == SIZE[::-1]
    assert rendered.image is rendered.classes is rendered.normals is rendered.instances is None


def test_an_added_mesh_is_labelled_and_nothing_else_moves():
    street = sample(SEED, assets=POOL, **FLAT)
    before = street.render(0, SIZE)
    box = trimesh.creation.box(
        (2, 2, 2), transform=trimesh.transformations.translation_matrix((0, 0, 1))
    )
    camera = street.street.cameras[0].position
    number = street.add(box, "car", (camera[0] + 8, camera[1]), yaw=30)
    after = street.render(0, SIZE)
    mask = after.instances == number
    assert 20 < mask.sum() and (after.classes[mask] == scene.CLASS_NAMES.index("car")).all()
    np.testing.assert_array_equal(after.classes[~mask], before.classes[~mask])
    [row] = [row for row in after.table if row.id == number]
    assert row.class_name == "car" and row.pixels == mask.sum()
    assert (after.depth[mask] <= before.depth[mask]).sum() + (
        before.depth[mask] == 0
    ).sum() == mask.sum()
    assert street.add(("car", np.int64(3)), "truck", (camera[0] + 12, camera[1])) == number + 1


def test_an_added_rider_has_a_machine_and_an_added_light_a_post():
    street = sample(SEED, assets=POOL, **FLAT)
    before = len(street.street.placements)
    for family in ("rider", "traffic light", "traffic sign", "car"):
        street.add((family, 1), family, (10, 2))
    added = street.street.placements[before:]
    families, numbers = [p.family for p in added], [p.instance for p in added]
    assert families[0] == "rider" and families[1] in ("bicycle", "motorcycle")
    assert families[2::2] == ["traffic light", "traffic sign", "car"] and families[3] == families[5]
    assert len(set(numbers)) == len(numbers) == 7
    low = [bounds(p.family, p.asset)[0, 2] for p in added]
    assert all(min(low[k], low[k + 1]) < 0.1 for k in (0, 2, 4))  # something stands on the ground


def test_one_pass_may_be_a_word(street):
    rendered = street.render(0, SIZE, passes="depth")
    assert rendered.depth is not None and rendered.image is None


def test_intrinsics_and_pose_are_those_of_the_image(street):
    first = street.render(0, SIZE)
    by_matrices = street.render((first.intrinsics, first.pose), SIZE)
    np.testing.assert_allclose(by_matrices.intrinsics, first.intrinsics, rtol=1e-12)
    np.testing.assert_allclose(by_matrices.pose, first.pose, atol=1e-12)
    for name in PASSES:
        np.testing.assert_array_equal(getattr(by_matrices, name), getattr(first, name))
    assert by_matrices.table == first.table
    # A point of the depth map, seen from a camera one metre further on, is where the camera model says.
    moved = first.pose.copy()
    moved[:3, 3] += first.pose[:3, 2]
    ahead = street.render((first.intrinsics, moved), SIZE)
    road = np.argwhere((first.classes == 0) & (first.depth > 8) & (first.depth < 20))
    checked = 0
    for y, x in road[:: max(len(road) // 50, 1)]:
        ray = np.linalg.solve(first.intrinsics, (x, y, 1.0))
        u, v, w = first.intrinsics @ (ray * first.depth[y, x] - (0, 0, 1))
        column, row = round(u / w), round(v / w)
        if 0 <= column < SIZE[0] and 0 <= row < SIZE[1] and ahead.classes[row, column] == 0:
            checked += 1
            assert ahead.depth[row, column] == pytest.approx(first.depth[y, x] - 1, rel=0.15)
    assert checked > 10


@pytest.mark.parametrize("name", RENDERERS)
def test_a_shifted_principal_point_renders_a_part_of_a_larger_image(name, street, monkeypatch):
    # Without the response of the camera, which depends on all that is visible.
    response = CameraResponse(noise=0, meter=0, vignette=0, variation=0)
    monkeypatch.setattr("scene.labelled.RenderSettings", partial(RenderSettings, response=response))
    chosen(name)
    # Multiples of eight, since rays of light go out from every second or fourth pixel.
    (width, height), (left, top), (wide, high) = SIZE, (16, 32), (160, 112)
    pose = street.render(0, SIZE, passes=()).pose
    whole_k = np.array([[80.0, 0, (wide - 1) / 2], [0, 80.0, (high - 1) / 2], [0, 0, 1]])
    part_k = whole_k - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    larger = street.render((whole_k, pose), (wide, high), renderer_name=name)
    part = street.render((part_k, pose), SIZE, renderer_name=name)
    np.testing.assert_allclose(part.intrinsics, part_k, atol=1e-9)
    window = np.s_[top : top + height, left : left + width]
    for field in ("classes", "instances"):
        assert (getattr(part, field) != getattr(larger, field)[window]).mean() < 0.002
    same = part.instances == larger.instances[window]
    for field in ("depth", "normals"):
        a, b = getattr(part, field)[same], getattr(larger, field)[window][same]
        assert (np.abs(a - b) <= 1e-3 * np.abs(a) + 1e-4).mean() > 0.998
    # OpenGL finds occluders in the image only, so more differs along its edges.
    most = {"embree": 1, "opengl": 3}[name]
    assert (np.abs(part.image - larger.image[window].astype(float))[same]).mean() < most


EYE = np.eye(4)
K = np.array([[60.0, 0, 47.5], [0, 60.0, 31.5], [0, 0, 1]])
BOX = trimesh.creation.box((1, 1, 1))
ASSET = from_trimesh(BOX)


def broken(faces):
    return trimesh.Trimesh(BOX.vertices, faces, process=False)


@pytest.mark.parametrize(("work", "words"), [
    (lambda _: sample(tree_intervall=3), "did you mean tree_interval"),
    (lambda _: sample(tree_interval=-3), "tree_interval must be a number from"),
    (lambda _: sample(tree_interval="dense"), "to 40 \\(m\\), not 'dense'"),
    (lambda _: sample(bend=1), "space scenex has no attribute bend; space extended does"),
    (lambda _: sample(weather="hail"), "hail"),
    (lambda _: sample(-1), "seed must lie in 0..4294967295, not -1"),
    (lambda _: sample(2**32 + 5), "seed must lie in 0..4294967295, not 4294967301"),
    (lambda s: s.add(BOX, "lorry", (3, 0)), "class_name 'lorry' is unknown"),
    (lambda s: s.add(BOX, "sky", (3, 0)), "class_name 'sky' is what no object covers"),
    (lambda s: s.add(3, "car", (3, 0)), "mesh must be a trimesh mesh, a file or an asset, not int"),
    (lambda s: s.add("no.glb", "car", (3, 0)), "no.glb is not a file"),
    (lambda s: s.add(("carr", 1), "car", (3, 0)), "families: "),
    (lambda s: s.add(broken(faces=[[0, 1, 99]]), "car", (3, 0)), "has a face with a vertex index outside"),
    (lambda s: s.add(broken(faces=[[0, 1, -1]]), "car", (3, 0)), "has a face with a vertex index outside"),
    (lambda s: s.add(ASSET._replace(material=ASSET.material + 200), "car", (3, 0)), "mesh has material 200"),
    *((lambda s, v=v: s.add(ASSET._replace(**v), "car", (3, 0)), f"mesh has {words}; they") for v, words in (
        ({"mesh": Mesh(BOX.vertices, np.zeros((12, 4), int))}, r"faces of type int64 and shape \(12, 4\)"),
        ({"mesh": Mesh(BOX.vertices, BOX.faces.astype(float))}, "faces of type float64 and shape .*"),
        ({"color": np.ones((12, 4))}, r"colours of type float64 and shape \(12, 4\)"),
        ({"material": np.ones(12)}, r"materials of type float64 and shape \(12,\)"),
        ({"ignored": np.ones(12)}, r"labels of type float64 and shape \(12,\)"),
    )),
    (lambda s: s.add(ASSET._replace(material=[-1] * 12), "car", (3, 0)), "mesh has material -1"),
    (lambda s: s.add(ASSET._replace(color=ASSET.color[1:]), "car", (3, 0)), "has 12 faces, but colours"),
    (lambda s: s.add(ASSET._replace(color=ASSET.color * np.nan), "car", (3, 0)), "has colours that are not"),
    (lambda s: s.add(ASSET._replace(mesh=Mesh(ASSET.mesh.vertices, ASSET.mesh.faces - 9)), "car", (3, 0)),
     "has a face with a vertex index outside"),
    (lambda s: s.add(BOX, "car", "abc"), "position must be 2 or 3 finite numbers in metres, not 'abc'"),
    (lambda s: s.add(BOX, "car", (3, 0), yaw="90"), "yaw must be a finite number of degrees, not '90'"),
    (lambda s: s.add(BOX, "car", (900, 0)), "position 900 along the road must lie in -80..700 metres"),
    (lambda s: s.add(BOX, "car", (3,)), "position must be 2 or 3 finite numbers"),
    (lambda s: s.add(BOX, "car", (3, 0), yaw=np.inf), "yaw must be a finite number"),
    (lambda s: s.render(0, SIZE, passes=("flow",)), "passes: 'flow' is unknown"),
    (lambda s: s.render(0, (1, 1)), "size"),
    (lambda s: s.render(9, SIZE), "the street has 0 to 1"),
    (lambda s: s.render("front", SIZE), "camera must be a number"),
    (lambda s: s.render((K, np.eye(3)), SIZE), r"pose must be finite numbers of shape \(4, 4\), not shape"),
    (lambda s: s.render(Camera((np.nan, 0, 1.5), 0, 0), SIZE), "camera: position must be 3 finite numbers"),
    (lambda s: s.render(Camera((0, 0, 1.5), 0, 0, 0, 3.0), SIZE), "camera: fov must lie in 5..150"),
    (lambda s: s.render(Camera("abc", 0, 0), SIZE), "position must be 3 finite numbers, not 'abc'"),
    (lambda s: s.render(0, (64.5, 48)), "size .*: width must be a whole number, not 64.5"),
    (lambda s: s.render((K * np.nan, EYE), SIZE), r"numbers of shape \(3, 3\), not NaN or infinite"),
    (lambda s: s.render((K, 2 * EYE), SIZE), "camera pose must be a rotation"),
    (lambda s: s.render((K * [[1], [2], [1]], EYE), SIZE), "one focal length above 0, not fx 60 and fy 120"),
    (lambda s: s.render((K + np.eye(3, k=1), EYE), SIZE), "intrinsics must be .*, not .*1.0"),
    (lambda s: s.render((K - 90 * (K == 47.5), EYE), SIZE), r"point \(-42.5, 31.5\) is outside of"),
])  # fmt: skip
def test_what_cannot_be_is_one_line(work, words, street):
    with pytest.raises(UserError, match=words) as refused:
        work(street)
    assert "\n" not in str(refused.value)


def test_an_asset_may_have_lists_and_whole_numbers_for_flags():
    rows = {"color": [[1, 0, 0]] * 12, "material": [0] * 12, "ignored": [1] + [0] * 11}
    asset = check_asset(ASSET._replace(**rows))
    assert asset.color.dtype == np.float32 and asset.material.dtype == np.uint8
    assert asset.ignored.dtype == bool and asset.ignored.sum() == asset.ignored[0] == 1


@pytest.mark.parametrize("workers", [0, 1])
def test_samples_of_a_stream_hold_the_passes_that_were_asked_for(workers):
    options = {"settings": RenderSettings(*SIZE), "pool": POOL, "images": 2, "shots": 2}
    for number, stream_sample in enumerate(
        scene.stream(
            "default", SEED, passes=("depth", "instances", "camera"), workers=workers, **options
        )
    ):
        image, label, unit = stream_sample
        [*_, frame] = render_street(unit, SEED, 0, 2, options["settings"], "embree", POOL)[
            : number + 1
        ]
        np.testing.assert_array_equal(image, frame.image)
        np.testing.assert_array_equal(label, frame.label)
        np.testing.assert_array_equal(stream_sample.depth, frame.depth)
        np.testing.assert_array_equal(stream_sample.instances, frame.instance)
        assert stream_sample.camera == frame.camera and stream_sample.normals is None
        relabelled = stream_sample._replace(label=label + 1, normals=frame.normal)
        assert relabelled.depth is stream_sample.depth and relabelled.normals is frame.normal
        np.testing.assert_array_equal(relabelled.label, label + 1)
    assert number == 1
    with pytest.raises(UserError, match="passes: 'flow' is unknown"):
        next(scene.stream(passes=("flow",)))
