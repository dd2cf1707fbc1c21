"""Labelled images as their targets' files name them: small folders in published layouts, and real ones."""

import codecs
import hashlib
import json
import re

import msgspec
import numpy as np
import pytest
from cityscapesscripts.helpers.annotation import Annotation
from cityscapesscripts.preparation.json2labelImg import createLabelImage
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from pycocotools import mask as coco_mask

from common.errors import UserError
from common.labels.target_file import find_target, parse_target, shipped
from common.pictures import label_ids
from seg.classes import CAMVID_11, CITYSCAPES_19, IGNORE_LABEL, LABELMEFACADE_6, class_table
from seg.data import (
    LabelReader,
    fitted,
    list_split,
    load,
    read_split,
    read_target,
    refuse_shared,
    subset,
)
from seg.data.labelled import _fit, cut, resize_image
from seg.model import classes_of
from tests.conftest import ROOT
from tests.layouts import FACADE, FACADE_IDS, LAYOUTS, SIZE, save, write, write_packed

from .conftest import pixels, refuses, refuses_file

DIGESTS = {
    "camvid train - - -": "f634e62fb9c5c91d",
    "camvid test - - -": "021c41ffc9f366e1",
    "cityscapes train 6 8 -": "355dc0eff693f990",
    "cityscapes val 6 8 -": "2767ede807c4a473",
    "labelmefacade train 24 32 2": "6d61715a092f68a4",
    "labelmefacade test 24 32 2": "f2521a1c23af076c",
    "gta5 train 6 8 -": "b40d21b2cbbfa180",
    "synthia train 24 32 2": "c82cd4661099d0c6",
}  # layout, split, height, width, limit
"""Of the images, labels, names and sequences that the readers gave before targets were files."""


def digest(data) -> str:
    content = hashlib.sha256("\n".join([*data.names, *data.sequences]).encode())
    for array in (data.images, data.labels):
        content.update(str(array.shape).encode())
        content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()[:16]


def target_of(text: str, classes: str = "{road: {ids: [1]}, sky: {ids: [0, 2]}}"):
    return parse_target(
        f"images: i/{{name}}\nlabels: l/{{name}}\n{text}\nclasses: {classes}", "t.yaml"
    )


@pytest.mark.parametrize("layout", sorted({key.partition(" ")[0] for key in DIGESTS}))
def test_the_same_is_read_as_by_the_readers_of_each_data_set_before(layout, tmp_path):
    write(layout, tmp_path)
    for key, expected in DIGESTS.items():
        name, split, height, width, limit = key.split()
        if name == layout:
            size = None if height == "-" else (int(height), int(width))
            data = read_split(
                layout, tmp_path, split, size, None if limit == "-" else int(limit), 5
            )
            assert digest(data) == expected, key


@pytest.mark.parametrize(("split", "images", "expected"), [
    ("train", 367, "fe00fbd778cce776"), ("val", 101, "56b78803f2fc53c2"), ("test", 233, "36ba3cb47f5fc8ac"),
])  # fmt: skip
def test_real_camvid_is_read_as_before(camvid_dir, split, images, expected):
    data = read_split("camvid", camvid_dir, split, (96, 128))
    assert len(data.names) == images and digest(data) == expected


@pytest.mark.parametrize(("split", "images", "expected"), [
    ("train", 100, "26cab174e53bd81d"), ("test", 300, "9124509d09c078a7"),
])  # fmt: skip
def test_real_labelmefacade_is_read_as_before(labelmefacade_dir, split, images, expected):
    data = read_split("labelmefacade", labelmefacade_dir, split, (96, 128))
    assert len(data.names) == images and digest(data) == expected


@pytest.mark.parametrize("layout", ["idd-lite", "camvid-32"])
def test_published_layouts_that_had_no_reader(layout, tmp_path):
    write(layout, tmp_path)
    *_, splits, values = LAYOUTS[layout]
    target = shipped(layout)
    data = read_target(target, tmp_path, SIZE)
    assert list(data.splits) == list(splits)
    for split, images in data.splits.items():
        entries = list_split(target, tmp_path, split)
        for entry, ids, pixels_ in zip(entries, images.labels, images.images, strict=True):
            raw = np.asarray(Image.open(entry.label_path))
            if layout == "camvid-32":
                names = ["Road", "Sidewalk", "Train", None, "Pedestrian"]
                places = (raw[:, :, None] == values).all(axis=-1).argmax(axis=-1)
                class_ids = [255 if n is None else target.class_names.index(n) for n in names]
                raw = np.array(class_ids)[places]
            np.testing.assert_array_equal(ids, raw)
            np.testing.assert_array_equal(pixels_, np.asarray(Image.open(entry.image_path)))
    assert not data.notes and data.table.classes == target.class_names


def test_lists_that_share_groups_are_noted_once(tmp_path):
    write("camvid", tmp_path)
    image, label = (Image.open(p) for p in sorted(tmp_path.glob("test*/*.png")))
    save(tmp_path / "test" / "0001TP_9.png", np.asarray(image) // 2)
    save(tmp_path / "testannot" / "0001TP_9.png", np.asarray(label))
    (note,) = read_target(shipped("camvid"), tmp_path, SIZE).notes
    assert "share 1 of 3 groups (0001TP) between train and test" in note


def test_what_colours_and_ids_mean(tmp_path):
    building, car, sidewalk, road, sky, vegetation = range(6)
    by_hand = (building, building, building, car, sidewalk, road, sky, vegetation, IGNORE_LABEL)
    assert tuple(FACADE_IDS.tolist()) == by_hand
    order = "building car sidewalk road sky vegetation"
    assert " ".join(LABELMEFACADE_6.classes) == order
    save(tmp_path / "a.png", FACADE[None])
    np.testing.assert_array_equal(
        LabelReader(shipped("labelmefacade"))(tmp_path / "a.png")[0], by_hand
    )
    for name, values in {
        "gta5": {7: "road", 11: "building", 23: "sky", 33: "bicycle", 34: None, 0: None},
        "kitti": {7: "road", 26: "car", 24: "person", 17: "pole", 4: None, 16: None, 30: None},
        "synthia": {1: "sky", 3: "road", 21: "wall", 10: "person", 11: "bicycle", 20: "train",
                    15: "traffic light", 0: None, 13: None, 22: None},
        "camvid": {0: "sky", 3: "road", 10: "bicyclist", 11: None},
    }.items():  # fmt: skip
        ids = np.array([[*values]])
        (write_packed if name == "synthia" else save)(tmp_path / "b.png", ids)
        expected = [
            255 if value is None else class_table(name).classes.index(value)
            for value in values.values()
        ]
        np.testing.assert_array_equal(LabelReader(shipped(name))(tmp_path / "b.png")[0], expected)


def test_transparency_and_palettes_change_no_label(tmp_path):
    ids, reader = pixels(*SIZE, below=9), LabelReader(shipped("labelmefacade"))
    transparent = Image.fromarray(FACADE[ids]).convert("RGBA")
    transparent.putalpha(7)
    palette = Image.fromarray(ids)
    palette.putpalette(FACADE.ravel().tolist())
    for picture in (transparent, palette):
        picture.save(tmp_path / "a.png")
        np.testing.assert_array_equal(reader(tmp_path / "a.png"), FACADE_IDS[ids])
    # The same palette is read as ids by a target that has them.
    many = target_of("void: [8]", "{low: {ids: [0, 1, 2, 3]}, high: {ids: [4, 5, 6, 7]}}")
    expected = np.where(ids == 8, 255, ids > 3)
    np.testing.assert_array_equal(LabelReader(many)(tmp_path / "a.png"), expected)


def test_ids_of_16_bits(tmp_path):
    target = target_of("void: [65535]", "{road: {ids: [300, 7000]}, sky: {ids: [0]}}")
    values = np.array([[300, 7000], [0, 65535]], np.uint16)
    Image.fromarray(values).save(tmp_path / "a.png")
    np.testing.assert_array_equal(LabelReader(target)(tmp_path / "a.png"), [[0, 0], [1, 255]])
    Image.fromarray(values + np.uint16(1)).save(tmp_path / "a.png")
    message = r"a\.png: .* has the label id 1 \(1 pixel in 1 image\), 301 .*, 7001 .*; add"
    refuses_file(message, LabelReader(target), tmp_path / "a.png")


@given(st.integers(1, 90), st.integers(1, 90), st.sampled_from([4 / 3, 1.0, 2.5, 0.4]))
def test_a_cut_is_the_largest_of_its_aspect_around_the_centre(height, width, aspect):
    rows, columns = np.mgrid[:height, :width]
    part = cut(np.dstack([rows, columns]), aspect)
    high, wide = part.shape[:2]
    assert high == height or wide == width  # no more is lost than must be
    assert abs(wide - high * aspect) <= max(1, aspect) * 0.5 + 1e-9 or 1 in (high, wide)
    for axis, whole in ((0, height), (1, width)):
        before, after = part[0, 0, axis], whole - 1 - part[-1, -1, axis]
        assert 0 <= after - before <= 1


@given(st.integers(1, 60), st.integers(1, 60))
def test_a_fitted_image_keeps_its_aspect_and_all_of_itself(height, width):
    image = np.random.default_rng(height).integers(0, 256, (height, width, 3), np.uint8)
    canvas, (rows, columns) = fitted(image, (24, 32))
    assert rows == 24 or columns == 32
    assert abs(rows * width - columns * height) <= max(height, width)  # to the nearest pixel
    assert (canvas[:rows, :columns] == resize_image(image, (rows, columns))).all()
    assert (canvas[rows:] == canvas[rows - 1]).all()
    assert (canvas[:, columns:] == canvas[:, columns - 1 : columns]).all()


@pytest.mark.parametrize(("shape", "fit", "void"), [
    ((12, 16), "pad", 0), ((12, 16), "cut", 0), ((24, 16), "cut", 0), ((12, 48), "cut", 0),
    ((24, 16), "pad", 1 / 2), ((12, 48), "pad", 2 / 3), ((12, 12), "pad", 1 / 4),
])  # fmt: skip
def test_images_of_other_shapes_are_padded_with_void_or_cut(tmp_path, shape, fit, void):
    # Sky above road, of other brightness, so that image and label must be treated alike.
    rows = np.arange(shape[0])[:, None] >= shape[0] / 2
    label = np.broadcast_to(np.where(rows, 1, 0), shape)
    save(tmp_path / "l" / "a.png", label)
    save(tmp_path / "i" / "a.png", np.repeat(np.where(label, 40, 220)[..., None], 3, axis=2))
    target = target_of(f"fit: {fit}")
    data = load(list_split(target, tmp_path, "train"), target, (6, 8))
    assert data.images.shape == (1, 6, 8, 3)
    assert np.mean(data.labels == 255) == pytest.approx(void, abs=0.01)
    road, sky = 0, 1
    assert {*data.labels.ravel().tolist()} - {255} == {road, sky}
    assert (data.images[data.labels == road] < 90).all() and (
        data.images[data.labels == sky] > 170
    ).all()
    whole = load(
        list_split(target, tmp_path, "train"), target, (6, 8), "pad" if fit == "cut" else "cut"
    )
    assert digest(whole) == digest(data) or shape != (12, 16)


def test_a_smaller_label_has_the_pixels_at_its_centres():
    label = np.arange(36, dtype=np.uint8).reshape(6, 6)
    _, small = _fit(np.zeros((6, 6, 3), np.uint8), label, (2, 2), "cut")
    np.testing.assert_array_equal(small, [[7, 10], [25, 28]])


def test_images_of_three_shapes_come_at_one_size(tmp_path):
    for k, shape in enumerate(((12, 16), (16, 12), (9, 30))):
        save(tmp_path / "i" / f"{k}.png", pixels(*shape, 3, seed=k))
        save(tmp_path / "l" / f"{k}.png", pixels(*shape, seed=k, below=3))
    entries = list_split(target_of(""), tmp_path, "train")
    data = load(entries, target_of(""), (12, 16))
    shown = [np.mean(label != 255) for label in data.labels]
    assert shown == pytest.approx([1, 9 / 16, 5 / 12])
    assert not (load(entries, target_of(""), (12, 16), "cut").labels == 255).any()
    refuses_file(
        r"i/1\.png: 12x16 pixels where .*0\.png has 16x12; pass a size",
        load,
        entries,
        target_of(""),
    )


def test_values_of_no_class_are_told_with_their_count_and_first_file(tmp_path):
    for k in range(3):
        save(tmp_path / "i" / f"{k}.png", pixels(2, 4, 3, seed=k))
        save(
            tmp_path / "l" / f"{k}.png", np.array([[0, 1, 2, 0], [7 * (k > 0), 9 * (k > 1), 1, 1]])
        )
    entries = list_split(target_of(""), tmp_path, "train")
    message = (
        r"^.*l/1\.png: no class of t\.yaml has the label id 7 \(2 pixels in 2 images\), 9 \(1 pixel in "
        r"1 image\); add each to a class or to 'void'$"
    )
    refuses_file(message, load, entries, target_of(""))
    assert len(load(entries, target_of("void: [7, 9]")).names) == 3


@given(
    st.tuples(*[st.integers(0, 255)] * 3).filter(
        lambda c: c not in set(map(tuple, FACADE.tolist()))
    )
)
def test_any_colour_of_no_class_is_named_with_its_file(tmp_path_factory, color):
    path = tmp_path_factory.getbasetemp() / "odd.png"
    label = FACADE[[[0, 1, 2], [3, 4, 5]]]
    label[1, 2] = color
    save(path, label)
    message = r"odd\.png: no class of labelmefacade has the label colour \({}, {}, {}\) \(1 pixel in 1 image"
    refuses_file(message.format(*color), LabelReader(shipped("labelmefacade")), path)


def test_smoothed_labels_and_labels_of_other_kinds_are_refused(tmp_path):
    path = tmp_path / "label.png"
    facade, synthia = (LabelReader(shipped(name)) for name in ("labelmefacade", "synthia"))
    save(path, pixels(9, 9, 3))
    refuses_file(r"colour (\(.*\).*, ){2}\(.*\) and 78 more; add each", facade, path)
    refuses_file("a label in colours \\(mode RGB\\)", LabelReader(shipped("camvid")), path)
    write_packed(path, pixels(3, 4, below=20), np.uint8)
    refuses_file(r"3 channel\(s\) of 8 bits; expected three of 16", synthia, path)
    save(path, np.full((3, 4), 5))
    refuses_file(r"1 channel\(s\) of 8 bits; expected three of 16", synthia, path)


def test_labels_of_another_size_and_what_is_missing(tmp_path):
    write("camvid", tmp_path)
    read = read_split, "camvid", tmp_path, "train"
    label = tmp_path / "trainannot" / "0006R0_2.png"
    save(label, np.zeros((9, 7)))
    refuses_file(r"0006R0_2\.png: 7x9 pixels, but its image .*0006R0_2\.png has 16x12", *read)
    label.write_bytes(label.read_bytes()[:40])
    refuses_file(r"0006R0_2\.png: not a readable image", *read)
    label.unlink()
    refuses(r"0006R0_2\.png: image without label; expected .*0006R0_2\.png", *read, error=UserError)
    refuses("no images to load", load, (), shipped("camvid"))
    entries = list_split(shipped("camvid"), tmp_path, "test")
    refuses(r"size must be a positive \(height, width\)", load, entries, shipped("camvid"), (0, 4))


def test_limit_is_a_seeded_subset_in_order(tmp_path):
    entries = list_split(shipped("camvid"), write("camvid", tmp_path), "train")
    assert subset(entries, 2, seed=1) == subset(entries, 2, seed=1)
    assert len({subset(entries, 2, seed) for seed in range(20)}) == 3
    assert all(list(kept) == sorted(kept) for kept in (subset(entries, 2, s) for s in range(5)))
    assert subset(entries, 99) == subset(entries, None) == entries
    refuses("limit must be at least 1", subset, entries, 0)


def test_an_image_in_two_splits_is_found_by_its_pixels(tmp_path):
    write("camvid", tmp_path)
    data = read_target(shipped("camvid"), tmp_path, SIZE).splits
    refuse_shared(data)
    for part in ("", "annot"):
        save(tmp_path / f"test{part}" / "new_1.png",
             np.asarray(Image.open(tmp_path / f"train{part}" / "0006R0_2.png")))  # fmt: skip
    message = "images in two splits: 1, such as 0006R0_2 in train is new_1 in test"
    refuses(message, read_target, shipped("camvid"), tmp_path, SIZE, error=UserError)
    assert list(read_target(shipped("camvid"), tmp_path, SIZE, splits=["test"]).splits) == ["test"]


def test_a_target_beside_its_images(tmp_path):
    for k in range(4):
        save(tmp_path / "i" / f"d{k // 2}_{k}.png", pixels(6, 8, 3, seed=k))
        save(tmp_path / "l" / f"d{k // 2}_{k}.png", pixels(6, 8, seed=k, below=3))
    (tmp_path / "target.yaml").write_text(
        "images: i/{name}\nlabels: l/{name}\ngroup: '^[^_]+'\nsplits: {test: 0.5}\n"
        "classes:\n  road: {ids: [0], renders: [road]}\n  thing: {ids: [1, 2]}\n"
    )
    data = read_target(find_target(None, tmp_path), tmp_path, (3, 4))
    sides = {split: {*images.sequences} for split, images in data.splits.items()}
    assert sorted(map(len, sides.values())) == [1, 1] and sides["train"] != sides["test"]
    assert data.table.classes == ("road", "thing")
    assert data.table.from_train_id[0] == 0 and set(data.table.from_train_id[1:]) == {255}


POLYGONS = [
    ("road", [[0, 6], [16, 6], [16, 12], [0, 12]]), ("sky", [[0, 0], [15, 0], [15, 4], [0, 4]]),
    ("car", [[2.5, 5.2], [9.7, 5.1], [8.2, 9.9], [3, 10]]), ("cargroup", [[11, 6], [15, 7], [12, 11]]),
    ("static", [[-3, -3], [2, 1], [1, 3]]),
]  # fmt: skip


def test_polygons_of_cityscapes_are_drawn_as_its_own_tool_draws_them(tmp_path):
    objects = [{"label": name, "polygon": points} for name, points in POLYGONS]
    objects.append({"label": "car", "polygon": POLYGONS[0][1], "deleted": 1})
    path = tmp_path / "a_gtFine_polygons.json"
    path.write_text(json.dumps({"imgHeight": 12, "imgWidth": 16, "objects": objects}))
    annotation = Annotation()
    annotation.fromJsonFile(str(path))
    official = tmp_path / "ids.png"
    createLabelImage(annotation, "ids").save(official)
    classes = ", ".join(f"{n}: {{names: [{n}]}}" for n in ("road", "sky", "car"))
    target = target_of("format: cityscapes-json\nvoid: [static]", f"{{{classes}}}")
    label = LabelReader(target)(path)
    expected = LabelReader(shipped("cityscapes"))(official)
    table = [CITYSCAPES_19.classes.index(n) for n in ("road", "sky", "car")]
    lookup = np.full(256, 255)
    lookup[:3] = table
    np.testing.assert_array_equal(lookup[label], expected)
    assert len(np.unique(label)) == 4


def test_polygons_and_rectangles_of_labelme(tmp_path):
    shapes = [
        {"label": "road", "points": [[0, 3], [7, 3], [7, 5], [0, 5]], "shape_type": "polygon"},
        {"label": "car", "points": [[2, 2], [3, 4]], "shape_type": "rectangle"},
        {"label": "sky", "points": [[0, 0], [7, 0], [7, 0]]},
    ]
    path, content = tmp_path / "a.json", {"imageHeight": 6, "imageWidth": 8, "shapes": shapes}
    path.write_text(json.dumps(content))
    target = target_of("", "{road: {names: [road]}, car: {names: [car]}, sky: {names: [sky]}}")
    expected = np.full((6, 8), 255)
    expected[3:], expected[2:5, 2:4], expected[0] = 0, 1, 2
    np.testing.assert_array_equal(LabelReader(target)(path), expected)
    save(tmp_path / "i" / "a.png", pixels(6, 8, 3))
    (tmp_path / "l").mkdir()
    path.rename(tmp_path / "l" / "a.json")
    target = msgspec.structs.replace(target, labels="l/{name}.json")
    np.testing.assert_array_equal(
        load(list_split(target, tmp_path, "train"), target).labels[0], expected
    )
    accents = tmp_path / "accents.json"
    accents.write_text(json.dumps(content | {"shapes": [shapes[0] | {"label": "a\u0308cker"}]}))
    named = target_of("", "{äcker: {names: [äcker]}, sky: {names: [sky]}}")
    alone = np.full((6, 8), 255)
    alone[3:] = 0
    np.testing.assert_array_equal(LabelReader(named)(accents), alone)
    empty = tmp_path / "e.json"
    empty.write_text(json.dumps(content | {"shapes": []}))
    assert (LabelReader(target)(empty) == 255).all()
    dot = {"label": "mark", "points": [[3, 3]]}
    drops = [
        *(dot | {"shape_type": kind} for kind in ("point", "points", "line", "linestrip")),
        dot,
    ]
    empty.write_text(json.dumps(content | {"shapes": [drops[0], shapes[0], *drops[1:]]}))
    np.testing.assert_array_equal(LabelReader(target)(empty), alone)
    for change, message in (
        ({"shapes": [shapes[0] | {"label": "lorry"}]}, r"no class .* name 'lorry' \(24 pixels in 1 image\)"),
        ({"shapes": [shapes[0] | {"shape_type": "circle"}]}, r"shapes\[0\]\.shape_type is 'circle'"),
        ({"shapes": [shapes[0] | {"points": [[1, 2, 3]]}]}, r"shapes\[0\]\.points must be a list of points"),
        ({"shapes": [shapes[0] | {"points": [[1, 1e9]]}]}, r"shapes\[0\]\.points must be a list of points"),
        ({"shapes": [shapes[0] | {"label": 3}]}, r"shapes\[0\]\.label must be text"),
        ({"shapes": [7]}, r"shapes\[0\] must be a JSON object"), ({"shapes": {}}, "shapes must be a list"),
        ({"imageWidth": None}, "imageWidth must be a positive whole number, not None"),
        ({"imageWidth": 10**8, "imageHeight": 10**8}, "100000000x100000000 is more than 50,000,000 pixels"),
    ):  # fmt: skip
        empty.write_text(json.dumps(content | change))
        refuses_file(r"e\.json: " + message, LabelReader(target), empty)
    for text in ("{", "[NaN]", "[" * 100_000):
        empty.write_text(text)
        refuses_file(r"e\.json: not valid JSON", LabelReader(target), empty)


COCO = """
images: i/{name}.png
labels: coco.json
format: coco-json
classes: {road: {names: [road]}, car: {names: [car, van]}, person: {names: [person]}}
"""


def coco_text(annotations, sizes, files):
    """A file of COCO about images, with (image, category, segmentation, crowd) of each annotation."""
    names = ("road", "car", "van", "person", "sky")
    content = {
        "images": [
            {"id": k, "file_name": file, "height": h, "width": w}
            for k, (file, (h, w)) in enumerate(zip(files, sizes, strict=True))
        ],
        "annotations": [
            {"id": k, "image_id": image, "category_id": names.index(name), "iscrowd": crowd,
             "segmentation": mask, "bbox": [0, 0, 1, 1], "area": 1}
            for k, (image, name, mask, crowd) in enumerate(annotations)
        ],
        "categories": [{"id": k, "name": name} for k, name in enumerate(names)],
    }  # fmt: skip
    return json.dumps(content)


def coco(root, annotations, sizes=((12, 16),), files=None):
    """Images 0.png, 1.png, ... with their file of COCO, which may call them by other names."""
    names = files or [f"{k}.png" for k in range(len(sizes))]
    (root / "coco.json").write_text(coco_text(annotations, sizes, names))
    for k, size in enumerate(sizes):
        save(root / "i" / f"{k}.png", pixels(*size, 3, seed=k))
    return root / "coco.json"


def box(left, top, right, bottom):
    return [left, top, right, top, right, bottom, left, bottom]


def runs(mask, text):
    """A mask as COCO's own tool writes it."""
    encoded = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
    if text:
        return encoded | {"counts": encoded["counts"].decode()}
    flat = mask.T.ravel()
    changes = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff([0, *changes, flat.size]).tolist()
    return {"size": list(mask.shape), "counts": [0] * bool(flat[0]) + counts}


def test_regions_of_coco_are_drawn_with_small_ones_above_and_crowds_ignored(tmp_path):
    crowd = np.zeros((12, 16), bool)
    crowd[2:6, :5] = True
    path = coco(tmp_path, [
        (0, "person", [box(4, 5, 6, 9)], 0), (0, "car", [box(3, 4, 8, 10), box(12, 4, 15, 10)], 0),
        (0, "road", [box(0, 0, 16, 12)], 0), (0, "person", runs(crowd, False), 1),
        (1, "van", [box(0, 0, 4, 2)], 0),
    ], sizes=[(12, 16), (6, 8), (6, 8)])  # fmt: skip
    target = parse_target(COCO, "t.yaml")
    expected = np.zeros((12, 16), int)
    expected[4:10, 3:8] = expected[4:10, 12:15] = 1
    expected[crowd] = IGNORE_LABEL
    expected[5:9, 4:6] = 2
    read = LabelReader(target)
    np.testing.assert_array_equal(read(path, tmp_path / "i" / "0.png"), expected)
    path.write_bytes(codecs.BOM_UTF8 + path.read_bytes())
    # An image without regions has a label, too.
    assert (read(path, tmp_path / "i" / "2.png") == IGNORE_LABEL).all()
    data = load(list_split(target, tmp_path, "train"), target, (6, 8))
    assert data.names == ("0", "1", "2") and data.labels[1, :2, :4].max() == 1
    rest = parse_target(f"{COCO}rest: other", "t.yaml")
    assert (LabelReader(rest)(path, tmp_path / "i" / "2.png") == 3).all()
    assert (LabelReader(rest)(path, tmp_path / "i" / "0.png")[crowd & (expected > 2)] == 255).all()


@pytest.mark.parametrize("corners", [[], [5, 5], [5, 5, 5, 5], [0, 0, 9, 9]])
def test_polygons_of_fewer_than_three_points_are_left_out(tmp_path, corners):
    path = coco(tmp_path, [(0, "person", [corners], 0), (0, "car", [corners, box(0, 0, 4, 2)], 0)])
    label = LabelReader(parse_target(COCO, "t.yaml"))(path, tmp_path / "i" / "0.png")
    assert (label[:2, :4] == 1).all() and (label == 1).sum() == 8


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_masks_and_polygons_of_coco_are_those_of_its_own_tool(tmp_path_factory, seed, text):
    rng, root = np.random.default_rng(seed), tmp_path_factory.mktemp("coco")
    mask = np.kron(rng.random((4, 5)) < rng.random(), np.ones((3, 4))).astype(bool)
    mask |= rng.random(mask.shape) < 0.05
    angles = np.sort(rng.random(rng.integers(3, 9))) * 2 * np.pi
    radii = rng.uniform(20, 45, len(angles))
    corners = np.stack([64 + radii * np.cos(angles), 48 + radii * np.sin(angles)], axis=1).ravel()
    path = coco(root, [(0, "car", runs(mask, text), 0), (1, "car", [corners.tolist()], 0)],
                sizes=[mask.shape, (96, 128)])  # fmt: skip
    read = LabelReader(parse_target(f"{COCO}rest: other", "t.yaml"))
    np.testing.assert_array_equal(read(path, root / "i" / "0.png") == 1, mask)
    drawn = read(path, root / "i" / "1.png") == 1
    official = coco_mask.decode(coco_mask.frPyObjects([corners.tolist()], 96, 128))[..., 0]
    assert np.mean(drawn != official) < 0.006  # edges may differ by a pixel here and there


@pytest.mark.parametrize(("files", "expected"), [
    (["0.png", "1.png"], "01"), (["i/0.png", "./i//1.png"], "01"),
    (["/data/upload/0.png", r"C:\photos\1.png"], "01"),
    (["../../media/0.png", "https://x.org/1.png"], "01"), (["train/0.png", "1.png"], "1"),
    (["0.jpg", "1.png"], "1"),
])  # fmt: skip
def test_images_of_coco_are_found_by_their_names(tmp_path, files, expected):
    coco(tmp_path, [], sizes=[(6, 8)] * 2, files=files)
    skip = parse_target(f"{COCO}unlabelled: skip", "t.yaml")
    assert "".join(entry.name for entry in list_split(skip, tmp_path, "train")) == expected
    if expected != "01":
        refuses(r"i/0\.png: image without label; expected its name among the images in .*coco\.json; "
                "'unlabelled: skip'", list_split, parse_target(COCO, "t.yaml"), tmp_path, "train",
                error=UserError)  # fmt: skip


def test_what_is_wrong_in_a_file_of_coco(tmp_path):
    target = parse_target(COCO, "t.yaml")
    path = coco(tmp_path, [(0, "car", [box(0, 0, 4, 4)], 0)])
    right = json.loads(path.read_text())
    (image,), (annotation,) = right["images"], right["annotations"]
    for change, message in (
        ({"segmentation": []}, r"annotations\[0\] has a box at most; expected a segmentation"),
        ({"segmentation": [[1, 2, 3]]}, r"annotations\[0\]\.segmentation: a polygon of 3 numbers"),
        ({"segmentation": [[0, 0, 9, 0, 9, 1e7]]}, "expected points in or near the image"),
        ({"segmentation": [[0, 0, 9, "x"]]}, r"segmentation\[0\]\[3\]: expected number, not text"),
        ({"segmentation": {"size": [12, 16], "counts": [5, 5]}}, "add up to the pixels of the image"),
        ({"segmentation": {"size": [12, 16], "counts": [-8, 200]}}, "must be numbers from 0"),
        ({"segmentation": {"size": [9, 16], "counts": "o"}}, r"a mask of \(9, 16\), but its image has"),
        ({"segmentation": {"size": [12, 16], "counts": "~"}}, "its counts are not COCO's text"),
        ({"segmentation": {"size": [12, 16], "counts": "o" * 99}}, "its counts are not COCO's text"),
        ({"category_id": 9}, r"annotations\[0\]\.category_id 9 is not in categories"),
        ({"category_id": None}, r"annotations\[0\]\.category_id: expected"),
    ):  # fmt: skip
        path.write_text(json.dumps(right | {"annotations": [annotation | change]}))
        with pytest.raises(UserError, match=rf"coco\.json: .*{message}"):
            read_target(target, tmp_path, SIZE)
    for change, message in (
        ({"images": [image, image]}, r"images\[0\] and images\[1\] have the same file_name, 0\.png"),
        ({"images": [image, image | {"file_name": "b"}]}, r"images\[0\] and images\[1\] have the same id, 0"),
        ({"images": [image | {"width": 0}]}, r"images\[0\]\.width: expected whole number >= 1"),
        ({"images": [image | {"width": 10**6, "height": 10**6}]}, "1000000x1000000 is more than 50,000,"),
        ({"images": {}}, "images: expected list, not table"),
        ({"images": [image | {"width": 15}]}, "15x12 pixels, but its image .*0.png has 16x12"),
    ):  # fmt: skip
        path.write_text(json.dumps(right | change))
        with pytest.raises(UserError, match=rf"coco\.json: {message}"):
            read_target(target, tmp_path, SIZE)
    for text, message in (
        ("{", "not valid JSON"), ("[" * 99_999, "no annotations of COCO: expected table, not list"),
        ('{"shapes": []}', "missing field images"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(UserError, match=rf"coco\.json: .*{message}"):
            read_target(target, tmp_path, SIZE)
    named = parse_target(COCO.replace("person: {names: [person]}", "sky: {names: [sky]}"), "t.yaml")
    path = coco(tmp_path, [(0, "person", [box(0, 0, 4, 4)], 0)] * 2)
    refuses_file(r"coco\.json: no class of t\.yaml has the label name 'person' \(16 pixels in 1 image\)",
                 read_target, named, tmp_path, SIZE)  # fmt: skip


def test_real_camvid_has_the_shares_that_its_description_says(camvid_dir):
    entries = list_split(shipped("camvid"), camvid_dir, "train")
    assert {entry.sequence for entry in entries} == {"0001TP", "0006R0", "0016E5"}
    data = load(subset(entries, 40, seed=1), shipped("camvid"), (90, 120))
    share = np.bincount(data.labels.ravel(), minlength=256) / data.labels.size
    # Shares over all 367 images: road .32, building .23, sky .17, void .04.
    for name, expected in (("road", 0.32), ("building", 0.23), ("sky", 0.17)):
        assert share[CAMVID_11.classes.index(name)] == pytest.approx(expected, abs=0.06)
    assert 0 < share[255] < 0.1


def test_real_labelmefacade_has_the_groups_and_shares_that_are_known(labelmefacade_dir):
    train, test = (
        list_split(shipped("labelmefacade"), labelmefacade_dir, s) for s in ("train", "test")
    )
    # The published lists cut through albums: photographs of most training albums are in both.
    albums, reported = ({entry.sequence for entry in side} for side in (train, test))
    assert (len(albums), len(reported), len(albums & reported)) == (43, 81, 32)
    data = load(subset(train, 40, seed=1), shipped("labelmefacade"), (90, 120))
    share = np.bincount(data.labels.ravel(), minlength=256) / data.labels.size
    # Shares over all 100 images; void is .04.
    for name, expected in (("building", 0.54), ("road", 0.14), ("sky", 0.11), ("car", 0.04)):
        measured = share[LABELMEFACADE_6.classes.index(name)]
        assert measured == pytest.approx(expected, abs=0.06)
    assert 0 < share[IGNORE_LABEL] < 0.1


def test_a_class_of_the_rest_takes_every_other_value(tmp_path):
    head = "images: 'a/{name}'\nlabels: 'b/{name}'\nrest: other\nvoid: [9]\n"
    target = parse_target(head + "classes: {road: {ids: [3], renders: [road]}}", "x")
    assert target.class_names == ("road", "other") and target.rendered == (True, True)
    ids = np.array([[3, 0, 1, 9, 200]], np.uint8)
    Image.fromarray(ids).save(tmp_path / "a.png")
    np.testing.assert_array_equal(LabelReader(target)(tmp_path / "a.png"), [[0, 1, 1, 255, 1]])
    deep = Image.fromarray(np.array([[3, 40000]], np.uint16))
    deep.save(tmp_path / "deep.png")
    np.testing.assert_array_equal(LabelReader(target)(tmp_path / "deep.png"), [[0, 1]])
    assert [row.id for row in classes_of(target)] == [3, 0]  # the least id that is free
    # It may have values, and a place, of its own.
    named = parse_target(head + "classes: {other: {ids: [0]}, road: {ids: [1]}}", "x")
    assert named.class_names == ("other", "road")
    np.testing.assert_array_equal(LabelReader(named)(tmp_path / "a.png"), [[0, 0, 1, 255, 0]])
    shapes = [{"label": "tree", "points": [[0, 0], [4, 0], [4, 4], [0, 4]]}]
    text = json.dumps({"shapes": shapes, "imageHeight": 4, "imageWidth": 8})
    (tmp_path / "a.json").write_text(text)
    named = parse_target(head.replace("[9]", "[]") + "classes: {road: {names: [road]}}", "x")
    np.testing.assert_array_equal(LabelReader(named)(tmp_path / "a.json"), np.ones((4, 8)))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA"])
def test_equal_channels_are_ids_and_others_are_colours(tmp_path, mode):
    grey = Image.fromarray(np.array([[0, 7], [200, 255]], np.uint8))
    grey.convert(mode).save(tmp_path / "a.png")
    np.testing.assert_array_equal(label_ids((tmp_path / "a.png").read_bytes()), np.asarray(grey))
    if mode != "LA":
        Image.new(mode, (2, 2), (1, 2, 3)).save(tmp_path / "a.png")
        with pytest.raises(UserError, match=rf"a label in colours \(mode {mode}\)"):
            label_ids((tmp_path / "a.png").read_bytes())


EXAMPLES = {
    name: cell.replace("`", "").split("<br>")
    for name, cell in re.findall(
        r"^\| ([^|]+) \| (`.*`) \|$", (ROOT / "docs/howto/target.md").read_text(), re.MULTILINE
    )
}
"""Rows of the page's table of labels: what to write in `target.yaml`."""


def polygons(sizes, shapes, points):
    """A label file with sky above road: the names of its keys differ between tools."""
    rows = (("sky", [[0, 0], [7, 0], [7, 2], [0, 2]]), ("road", [[0, 3], [7, 3], [7, 5], [0, 5]]))
    places = [{"label": name, points: corners} for name, corners in rows]
    return json.dumps({sizes[0]: 6, sizes[1]: 8, shapes: places})


def labelled_as(name, classes):
    """The label file of a row: sky in the upper half, road in the lower, in the values of its classes."""
    if "LabelMe" in name:
        return polygons(("imageHeight", "imageWidth"), "shapes", "points")
    if "COCO" in name:
        regions = [(0, "road", [box(0, 3, 8, 6)], 0), (0, "sky", [box(0, 0, 8, 3)], 0)]
        return coco_text(regions, [(6, 8)], ["a.png"])
    if "Cityscapes" in name:
        return polygons(("imgHeight", "imgWidth"), "objects", "polygon")
    upper, lower = classes
    values = np.array([upper] * 3 + [lower] * 3, np.uint8)
    return np.repeat(values[:, None], 8, axis=1)


VALUES = {  # of the upper and the lower half, and the classes that are expected there
    "a binary mask, 0 and 255": ((0, 255), ("other", "road")),
    "ids from 0, 255 is ignored": ((255, 0), (None, "road")),
    "ids from 1, 0 is unlabelled (as ADE20K)": ((2, 0), ("sky", None)),
    "RGB colours": (((70, 130, 180), (128, 64, 128)), ("sky", "road")),
    "a PNG with a palette": ((1, 0), ("sky", "road")),
    "two ids that are one class": ((7, 1), ("building", "building")),
    "one class, the rest is background": ((9, 1), ("background", "road")),
    "LabelMe polygons": ((0, 0), ("sky", "road")),
    "Cityscapes polygons": ((0, 0), ("sky", "road")),
    "COCO polygons or masks": ((0, 0), ("sky", "road")),
    'CVAT\'s "Segmentation mask 1.1"': (((51, 221, 255), (250, 50, 83)), ("sky", "road")),
}


def test_the_page_has_the_rows_that_are_tried():
    assert EXAMPLES.keys() == VALUES.keys()


@pytest.mark.parametrize("name", VALUES)
def test_labels_by_example_are_read_as_the_page_says(name, tmp_path):
    fields = {line.partition(":")[0]: line for line in EXAMPLES[name]}
    usual = {"images": 'images: "images/{name}.png"', "labels": 'labels: "labels/{name}.png"'}
    target = parse_target("\n".join({**usual, **fields}.values()), "target.yaml")
    values, expected = VALUES[name]
    save(tmp_path / target.images.format(name="a"), pixels(6, 8, 3))
    label, path = labelled_as(name, values), tmp_path / target.labels.format(name="a")
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(label, str):
        path.write_text(label)
    elif "palette" in name:
        image = Image.fromarray(label).convert("P")
        image.putpalette([0, 0, 0, 70, 130, 180] * 8)
        image.putdata(label.ravel().tolist())
        image.save(path)
    else:
        save(path, label)
    data = read_target(target, tmp_path, size=(6, 8))
    labels = data.splits["train"].labels[0]
    for rows, class_name in ((labels[:3], expected[0]), (labels[3:], expected[1])):
        place = IGNORE_LABEL if class_name is None else data.table.classes.index(class_name)
        assert (rows == place).all(), class_name
