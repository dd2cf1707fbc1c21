"""Segments, masks, encodings and files of a dataset, without rendering."""

import json
import struct
import zlib
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from pycocotools import mask as coco_mask
from scipy.spatial.transform import Rotation

from scene.dataset.description import outcome
from scene.dataset.edges import overlap
from scene.dataset.formats import coco, planes, png, rle, shot
from scene.dataset.formats.labels import engine_labels
from scene.dataset.formats.layout import FORMATS, layout
from scene.dataset.formats.segments import label_ids, panoptic_ids, segments
from scene.ground.path import height_at, nearest, to_world
from scene.render import RenderSettings
from scene.street.camera import camera_axes
from tests.scene.conftest import DEFAULT, SEEDS, refused, street

ROAD, SKY, PERSON, CAR = 0, 10, 11, 13


def picture(seed, height=12, width=17):
    """Labels and instances of blocks of things on a road under a sky."""
    rng = np.random.default_rng(seed)
    instance = np.where(np.arange(height)[:, None] < height // 2, 0, 1).repeat(width, axis=1)
    train_of = np.concatenate([[SKY, ROAD, 1, 9], rng.integers(0, 19, 30)])
    for _ in range(12):
        y, x = rng.integers(0, height), rng.integers(0, width)
        instance[y : y + rng.integers(1, 5), x : x + rng.integers(1, 5)] = rng.integers(4, 34)
    return train_of[instance].astype(np.uint8), instance.astype(np.uint16)


def test_segments_by_hand():
    label = np.array([[SKY, SKY, CAR, CAR], [ROAD, PERSON, CAR, CAR], [ROAD, 255, CAR, 255]])
    instance = np.array([[0, 0, 9, 7], [1, 30, 9, 7], [1, 5, 9, 5]])
    ids = panoptic_ids(label.astype(np.uint8), instance.astype(np.uint16))
    assert ids.tolist() == [[23, 23, 26001, 26000], [7, 24000, 26001, 26000], [7, 0, 26001, 0]]
    assert [tuple(s) for s in segments(ids)] == [
        (7, 7, 2, (0, 1, 1, 2)), (23, 23, 2, (0, 0, 2, 1)), (24000, 24, 1, (1, 1, 1, 1)),
        (26000, 26, 2, (3, 0, 1, 2)), (26001, 26, 3, (2, 0, 1, 3)),
    ]  # fmt: skip
    many = np.arange(4, 1604, dtype=np.uint16).reshape(40, 40)
    label = np.full((40, 40), CAR, np.uint8)
    refused(ValueError, "more than 1000 objects of train id 13", panoptic_ids, label, many)


@given(SEEDS)
def test_every_object_has_one_id_and_every_id_one_object(seed):
    label, instance = picture(seed)
    ids = panoptic_ids(label, instance)
    things = label >= PERSON
    pairs = {*zip(ids[things].tolist(), instance[things].tolist(), strict=True)}
    assert len(pairs) == len({i for i, _ in pairs}) == len({k for _, k in pairs})
    assert ids.max() < 2**16  # fits Cityscapes' picture
    np.testing.assert_array_equal(label_ids(ids)[~things], ids[~things])
    assert sum(s.area for s in segments(ids)) == ids.size


@given(SEEDS)
def test_masks_are_those_of_the_coco_api(seed):
    counts = np.random.default_rng(seed).integers(0, 10**7, 5).tolist()
    assert rle.decode(rle.encode(counts)) == counts
    ids = panoptic_ids(*picture(seed))
    runs = rle.Runs(ids)
    for segment in segments(ids):
        reference = coco_mask.encode(np.asfortranarray(ids == segment.id).astype(np.uint8))
        text = rle.encode(runs.counts(segment.id))
        assert text == reference["counts"].decode()
        assert coco_mask.toBbox(reference).tolist() == list(segment.box)
        assert coco_mask.area(reference) == segment.area
        np.testing.assert_array_equal(rle.mask(rle.decode(text), *ids.shape), ids == segment.id)


def test_encodings_by_hand_and_bad_masks_are_refused():
    depth = np.array([[0, 0.001, 1, 12.344, 655.35, 5000]], np.float32)
    assert planes.depth_plane(depth).tolist() == [[0, 1, 100, 1234, 65535, 65535]]
    settings = RenderSettings(2048, 1024, fov=90)  # focal length 1024
    depth = np.array([[0, 0.1, 21.4]], np.float32)
    [[sky, near, far]] = planes.disparity_plane(depth, settings).tolist()
    assert (sky, near) == (0, 65535)
    assert (far - 1) / 256 == pytest.approx(0.209313 * 1024 / 21.4, abs=1 / 256)
    normal = np.array([[[0, 0, 0], [1, 0, 0], [0, -1, 0]]], np.float32)
    assert planes.normals_plane(normal).tolist() == [[[0, 0, 0], [255, 128, 128], [128, 0, 128]]]
    assert planes.panoptic_plane(np.array([[26001]])).tolist() == [[[145, 101, 0]]]
    assert rle.Runs(np.ones((2, 3), np.int32)).counts(7) == [6]
    for text, message in (("P", "ends within a number"), ("0 ", "is not valid")):
        refused(ValueError, message, rle.decode, text)
    refused(ValueError, "runs of 5 pixels do not fill an image of 3x2", rle.mask, [2, 3], 2, 3)


@given(SEEDS)
def test_encodings_come_back(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(5, 4, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    np.testing.assert_allclose(planes.normals_of(planes.normals_plane(normal)), normal, atol=0.0040)
    ids = rng.integers(0, 2**24, (5, 4), dtype=np.int32)
    np.testing.assert_array_equal(planes.ids_of(planes.panoptic_plane(ids)), ids)
    data = png.encode(rng.integers(0, 256, (9, 9), dtype=np.uint8))
    cut = data[: rng.integers(len(data))]
    assert png.fault_of(data) is None and png.fault_of(cut) is not None


def test_pictures_come_back_from_their_files_and_damage_is_found(tmp_path):
    for shape, dtype in product(((5, 7), (5, 7, 3)), (np.uint8, np.uint16)):
        plane = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape).astype(dtype)
        (tmp_path / "a.png").write_bytes(png.encode(plane))
        np.testing.assert_array_equal(png.read_png(tmp_path / "a.png"), plane)
    data = png.encode(np.zeros((9, 9), np.uint8))
    middle = data.index(b"IDAT") + 6
    broken = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
    assert [*map(png.fault_of, (broken, b"GIF89a"))] == ["is damaged", "is not a PNG file"]
    empty = struct.pack(">I", 0) + b"IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
    (tmp_path / "a.png").write_bytes(data[:8] + empty)
    refused(ValueError, r"a\.png cannot be decoded", png.read_png, tmp_path / "a.png")


def test_outcome_by_hand_and_lists_written_in_pieces():
    image = np.zeros((2, 2, 3), np.uint8)
    image[..., 0] = 100
    label = np.array([[SKY, SKY], [ROAD, CAR]], np.uint8)
    records = [
        shot.image_record(image, label, panoptic_ids(label, label.astype(np.uint16))),
        shot.image_record(0 * image, np.full_like(label, SKY), np.full((2, 2), 23, np.int32)),
    ]
    for record, camera in zip(records, ((0, False), (4, True)), strict=True):
        record["retaken"], record["refused"] = camera
    statistics = outcome(
        [{"placed": {"car": 2}, "images": records}], pixels=4, labels=engine_labels(True)
    )
    assert (
        statistics["class_frequency"]["sky"] == 0.75
        and statistics["class_frequency"]["car"] == 0.125
    )
    assert (
        statistics["images_with_class"]["sky"] == 2 and statistics["images_with_class"]["bus"] == 0
    )
    assert (statistics["shots_retaken"], statistics["shots_refused"]) == (0.5, 0.5)
    assert statistics["mean_rgb"] == [50, 0, 0] and statistics["placed"] == {"car": 2}
    assert [("rle" in s) for s in records[0]["segments"]] == [False, False, True]
    members = {"a": [], "b": [1], "c": [{"x": "é"}, None]}
    assert json.loads("".join(coco.json_lines(members))) == members
    refused(ValueError, "", list, coco.json_lines({"a": [float("nan")]}))


def test_outlines_of_labels_meet_those_of_depth_and_categories_are_those_of_cityscapes():
    ids, depth = np.zeros((60, 60), np.int32), np.full((60, 60), 900.0)
    for k, x in enumerate(range(3, 55, 11)):
        ids[10:50, x : x + 5], depth[10:50, x : x + 5] = 26000 + k, 300
    assert overlap(ids, depth).lift > 10 and overlap(np.roll(ids, 2, axis=1), depth).lift < 1
    assert overlap(ids, np.where(ids > 0, 0, depth)).aligned == 0  # the sky's does not count
    from cityscapesscripts.helpers.labels import name2label

    assert len(coco.SUPERCATEGORIES) == 19
    for entry in coco.categories(engine_labels(True)):
        label = name2label[entry["name"]]
        assert entry == {
            "id": label.id, "name": label.name, "supercategory": label.category,
            "isthing": int(label.hasInstances), "color": list(label.color),
        }  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_no_two_files_of_a_format_share_a_path(name):
    files_layout = layout(name)
    paths = [path for stem in "ab" for path in files_layout.paths("train", stem).values()]
    paths += files_layout.summary_paths("train").values()
    assert len(set(paths)) == len(paths)
    refused(ValueError, "unknown format 'voc'; known: cityscapes, coco, folders", layout, "voc")


@pytest.mark.parametrize("course", [
    {}, {"bend": 25.0}, {"gradient": 10.0}, {"bend": 25.0, "gradient": 10.0},
])  # fmt: skip
def test_the_camera_is_where_it_is_on_its_car_whichever_way_the_road_goes(course):
    height, yaw, pitch, roll = 1.6, 0.1, 0.05, 0.04
    params = DEFAULT._replace(
        camera_position_y=height, camera_rotation_y=yaw, camera_rotation_x=pitch, camera_roll=roll,
        **course,
    )  # fmt: skip
    drawn_streets = [street(params, seed, shots=8) for seed in (0, 3, 4)]
    for sampled in drawn_streets:
        path = sampled.ground.path
        for camera in sampled.cameras:
            extrinsic = shot.camera_entry(camera, path, RenderSettings())["extrinsic"]
            assert extrinsic["x"] == extrinsic["y"] == 0
            angles = [extrinsic[name] for name in ("yaw", "pitch", "roll")]
            assert angles == pytest.approx([-yaw, pitch, roll], abs=2e-3)  # right is negative
            # The car: from the road a metre before and after it.
            [x], _ = nearest(path, np.array([camera.position[:2]]))
            ends = x + np.array([-1.0, 1.0])
            before, after = np.column_stack([to_world(path, ends, 0.0), height_at(path, ends)])
            ahead = (after - before) / np.linalg.norm(after - before)
            left = np.cross([0, 0, 1], ahead) / np.hypot(*ahead[:2])
            car = np.stack([ahead, left, np.cross(ahead, left)], axis=1)
            assert extrinsic["z"] == pytest.approx(height * car[2, 2], abs=1e-4)
            right, up, forward = camera_axes(camera)
            turn = car @ Rotation.from_euler("ZYX", angles).as_matrix()
            np.testing.assert_allclose(turn.T, [forward, -right, up], atol=1e-3)
    places = np.array([(*c.position, c.yaw) for d in drawn_streets for c in d.cameras])
    assert (np.ptp(places[:, 3]) > 0.3) == ("bend" in course)
    assert (np.ptp(places[:, 2]) > 1.0) == ("gradient" in course)


def test_angles_are_those_of_published_calibrations():
    """Yaw -0.0195, pitch 0.038: the camera looks 0.0195 to the right and 0.038 down."""
    camera = street(
        DEFAULT._replace(camera_rotation_y=0.0195, camera_rotation_x=0.038, camera_roll=0.0)
    )
    extrinsic = shot.camera_entry(camera.cameras[0], camera.ground.path, RenderSettings())[
        "extrinsic"
    ]
    assert [extrinsic[k] for k in ("yaw", "pitch", "roll")] == pytest.approx([-0.0195, 0.038, 0])
    forward = [0.99909, -0.01948, -0.03799]
    assert camera_axes(camera.cameras[0])[2] == pytest.approx(forward, abs=1e-5)
