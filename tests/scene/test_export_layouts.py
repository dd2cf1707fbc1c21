"""Layouts of other tools, read back by the tools or by their documented rules; labels of a target in each."""

import importlib.util
import json
import re
import shutil

import msgspec
import numpy as np
import pytest
import yaml
from PIL import Image

from common.errors import UserError
from common.labels.target_file import SHIPPED, find_target, parse_target
from scene import AssetPool, RenderSettings, export_dataset, render_street
from scene.check import findings
from scene.classes import VOID, colorize
from scene.dataset.export import read_dataset
from scene.dataset.formats import layout, parquet, yolo
from scene.dataset.formats.labels import engine_labels, target_entry, target_labels
from scene.dataset.formats.segments import FIRST_THING
from scene.dataset.read import describe
from scene.preview.dataset import sheet, write_sheet
from scene.preview.layout import depth_image
from scene.proposal import draw, random_proposal
from scene.render.__main__ import main
from scene.stats import compare
from tests.scene.conftest import refused

SETTINGS, POOL, SEED, SHOTS = RenderSettings(width=160, height=96), AssetPool(0, 3), 5, 2
UNITS = draw(random_proposal(), 1, 2)
COLOURS = """
images: "{name}.png"
labels: "{name}_l.png"
format: colours
void: [[1, 2, 3]]
classes:
  ground: {colours: [[9, 0, 0], [8, 0, 0]], renders: [road, sidewalk]}
  rest: {colours: [[0, 9, 0]]}
  vehicle: {colours: [[0, 0, 9]], renders: [car, truck, bus]}
"""
REST = """
images: "{name}.png"
labels: "{name}_l.png"
void: [3]
classes:
  road: {ids: [1, 255], renders: [road]}
rest: background
"""
# Exact labels; those with outlines are exported in test_outline.py.
CAMVID = msgspec.structs.replace(find_target("camvid"), outlines={})
TARGETS = {"": None, "camvid": CAMVID, "colours": parse_target(COLOURS, "own.yaml")}
RESTS = [
    parse_target(REST.replace("rest:", f"{named}rest:"), "rest.yaml")
    for named in ("", "  background: {ids: [0]}\n")
]
PARQUET = pytest.mark.skipif(
    importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow, of the extra parquet"
)


@pytest.fixture(scope="module")
def frames():
    streets = [
        render_street(u, SEED, k, SHOTS, SETTINGS, "embree", POOL) for k, u in enumerate(UNITS)
    ]
    return [frame for street in streets for frame in street]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """``exported(format, target)``: a folder, exported once."""
    folders = {}

    def export(format, target=""):
        if (format, target) not in folders:
            folder = tmp_path_factory.mktemp(format) / "dataset"
            folders[format, target] = folder
            options = {"settings": SETTINGS, "pool": POOL, "streets": random_proposal()}
            export_dataset(
                UNITS, SEED, folder, shots=SHOTS, format=format, target=TARGETS[target], **options
            )
        return folders[format, target]

    return export


def classes(frame, target):
    """Class indices u8[h, w] of a frame, directly from the target file."""
    if TARGETS[target] is None:
        return frame.label
    of_engine = np.full(256, 255, np.uint8)
    of_engine[:19] = TARGETS[target].of_engine
    return of_engine[frame.label]


FORMATS = [pytest.param(f, marks=PARQUET if f == "parquet" else ()) for f in layout.FORMATS]


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("format", FORMATS)
def test_every_layout_is_read_back_checked_and_counted_in_the_classes_of_its_target(
    format, target, exported, frames
):
    folder = exported(format, target)
    assert list(findings(folder)) == []
    expected = np.stack([classes(frame, target) for frame in frames])
    description = json.loads((folder / "dataset.json").read_text())
    names = engine_labels(True).names if target == "" else tuple(TARGETS[target].classes)
    share = [(expected == k).mean() for k in range(len(names))]
    assert tuple(description["class_frequency"]) == names and ("target" in description) == (
        target != ""
    )
    np.testing.assert_allclose([*description["class_frequency"].values()], share, atol=1e-9)
    if format == "yolo-seg":
        refused(ValueError, "yolo-seg does not label every pixel", read_dataset, folder)
        return
    dataset = read_dataset(folder)
    np.testing.assert_array_equal(dataset.labels, expected)
    np.testing.assert_array_equal(dataset.images, np.stack([f.image for f in frames]))
    counted, figures = compare(folder, None, ())
    assert counted == names
    np.testing.assert_allclose(figures["dataset"].void, (expected == 255).mean())


def test_masks_of_folders_hold_what_classes_txt_says(exported, frames):
    for target in TARGETS:
        folder = exported("folders", target)
        lines = [line.split(" ") for line in (folder / "classes.txt").read_text().splitlines()]
        size = 3 if target == "colours" else 1
        table = {" ".join(words[size:]): [int(v) for v in words[:size]] for words in lines}
        assert list(table)[-1] == "void" and len(table) == 1 + len(set(table) - {"void"})
        if target == "camvid":
            assert table["sky"] == [0] and table["bicyclist"] == [10] and table["void"] == [11]
        if target == "colours":
            assert table == {
                "ground": [9, 0, 0], "rest": [0, 9, 0], "vehicle": [0, 0, 9], "void": [1, 2, 3]
            }  # fmt: skip
        values = np.zeros((256, size), int)
        values[[*range(len(table) - 1), 255]] = [*table.values()]
        for path, frame in zip(sorted((folder / "masks").iterdir()), frames, strict=True):
            assert (folder / "images" / path.name).exists()
            mask = np.array(Image.open(path))
            np.testing.assert_array_equal(
                mask.reshape(*mask.shape[:2], -1), values[classes(frame, target)]
            )
    assert {path.name for path in folder.iterdir()} == {
        "images", "masks", "classes.txt", "README.md", "dataset.json"
    }  # fmt: skip


def test_cityscapes_labels_are_the_targets_and_its_panoptic_files_stay(exported, frames):
    default, camvid = exported("cityscapes"), exported("cityscapes", "camvid")
    for path in sorted(default.rglob("*.*")):
        other = camvid / path.relative_to(default)
        same = not path.name.endswith(
            ("labelIds.png", "TrainIds.png", "color.png", "dataset.json", "README.md")
        )
        assert (path.read_bytes() == other.read_bytes()) == same, path
    ids = sorted(camvid.rglob("*_labelIds.png"))
    for path, frame in zip(ids, frames, strict=True):
        expected = classes(frame, "camvid")
        stored = np.array(Image.open(path))
        np.testing.assert_array_equal(stored, np.where(expected == 255, 11, expected))
        numbers = np.array(Image.open(str(path).replace("labelIds", "labelTrainIds")))
        np.testing.assert_array_equal(numbers, expected)
        colour = np.array(Image.open(str(path).replace("labelIds", "color")))
        assert (colour[expected == 3] == (128, 64, 128)).all()


@pytest.mark.parametrize("target", TARGETS)
def test_pycocotools_reads_masks_of_all_classes(target, exported, frames, capsys):
    from pycocotools.coco import COCO

    folder = exported("coco", target)
    coco = COCO(str(folder / "annotations" / "semantic.json"))
    names = [entry["name"] for entry in coco.loadCats(coco.getCatIds())]
    number = {entry["id"]: names.index(entry["name"]) for entry in coco.loadCats(coco.getCatIds())}
    if target == "camvid":
        assert sorted(number) == list(range(11))  # the target's own ids
    for image, frame in zip(coco.loadImgs(coco.getImgIds()), frames, strict=True):
        painted_classes = np.full(frame.label.shape, 255, np.uint8)
        for annotation in coco.loadAnns(coco.getAnnIds(imgIds=image["id"])):
            mask = coco.annToMask(annotation).astype(bool)
            assert mask.sum() == annotation["area"]
            painted_classes[mask] = number[annotation["category_id"]]
        np.testing.assert_array_equal(painted_classes, classes(frame, target))


def test_yolo_polygons_enclose_each_object_as_ultralytics_reads_them(exported, frames):
    """Rules: docs.ultralytics.com/datasets/segment; masks as in ``ultralytics.data.utils.polygon2mask``."""
    import cv2

    folder, objects, overlaps = exported("yolo-seg"), 0, []
    data = yaml.safe_load((folder / "data.yaml").read_text())
    assert data["names"] == dict(enumerate(layout_names()[FIRST_THING:])) and data["nc"] == 8
    paths = sorted((folder / data["train"]).iterdir())
    for path, frame in zip(paths, frames, strict=True):
        lines = (folder / "labels" / "train" / f"{path.stem}.txt").read_text().splitlines()
        left = {}
        thing = (frame.label >= FIRST_THING) & (frame.label != VOID)
        for instance in np.unique(frame.instance[thing]):
            mask = thing & (frame.instance == instance)
            left.setdefault(int(frame.label[mask][0]) - FIRST_THING, []).append(mask)
        for line in lines:
            class_text, *shares = line.split()
            corners = np.array(shares, np.float32).reshape(-1, 2) * [160, 96]
            assert len(corners) >= 3 and 0 <= corners.min()
            filled = np.zeros(frame.label.shape, np.uint8)
            cv2.fillPoly(filled, [corners.astype(np.int32)], 1)
            overlap = [(filled & m).sum() / (filled | m).sum() for m in left[int(class_text)]]
            mask = left[int(class_text)].pop(int(np.argmax(overlap)))
            assert abs(abs(yolo.area(corners.astype(float))) - mask.sum()) <= 0.02 * mask.sum()
            overlaps.append(max(overlap))
            objects += 1
        assert not any(left.values())
    assert objects >= 8 and np.mean(overlaps) > 0.95
    camvid = yaml.safe_load((exported("yolo-seg", "camvid") / "data.yaml").read_text())
    assert camvid["names"] == {0: "car", 1: "pedestrian", 2: "bicyclist"}


def test_an_object_of_many_parts_has_one_outline_around_all_of_them():
    """A car behind leaves: each step looks at new corners only, so hundreds of parts take no minutes."""
    mask = np.kron(np.indices((40, 40)).sum(axis=0) % 2, np.ones((2, 2), int)).astype(bool)
    mask[:, ::7] = False
    polygon = yolo.outline(mask)
    assert abs(abs(yolo.area(polygon)) - mask.sum()) < 0.02 * mask.sum()


def layout_names():
    return engine_labels(True).names


def test_outlines_by_hand_and_of_any_mask():
    square = np.pad(np.ones((4, 5), bool), 2)
    assert yolo.outline(square).round().tolist() == [[2, 2], [2, 6], [7, 6], [7, 2]]
    square[3, 4] = False  # a hole
    square[0, 0] = True  # and a second piece
    rng = np.random.default_rng(0)
    for mask in (square, *(rng.random((9, 14)) < share for share in (0.1, 0.5, 0.9))):
        enclosed = abs(yolo.area(yolo.outline(mask)))
        assert abs(enclosed - mask.sum()) <= 0.02 * mask.sum()


@PARQUET
@pytest.mark.parametrize("target", TARGETS)
def test_datasets_loads_parquet_with_pictures_and_names_of_classes(
    target, exported, frames, tmp_path, monkeypatch
):
    datasets = pytest.importorskip("datasets", reason="needs the package datasets")
    folder = exported("parquet", target)
    files = {"train": str(folder / "data" / "*.parquet")}
    rows = datasets.load_dataset(
        "parquet", data_files=files, split="train", cache_dir=str(tmp_path)
    )
    assert isinstance(rows.features["image"], datasets.Image) and len(rows) == len(frames)
    names = rows.features["classes"].feature.names
    assert names == list(json.loads((folder / "dataset.json").read_text())["class_frequency"])
    values = target_labels(target_entry(TARGETS[target])).values if target else None
    for row, frame in zip(rows, frames, strict=True):
        np.testing.assert_array_equal(np.array(row["image"]), frame.image)
        expected = classes(frame, target)
        label = np.array(row["label"])
        np.testing.assert_array_equal(label, expected if values is None else values[expected])
        assert row["classes"] == [k for k in np.unique(expected).tolist() if k != 255]


@PARQUET
def test_parquet_has_as_many_shards_as_it_takes_and_no_other_files(exported, tmp_path, monkeypatch):
    one = exported("parquet")
    assert {path.name for path in one.iterdir()} == {"data", "README.md", "dataset.json"}
    monkeypatch.setattr(parquet, "SHARD", 20_000)
    options = {"settings": SETTINGS, "pool": POOL, "streets": random_proposal()}
    export_dataset(UNITS, SEED, tmp_path / "a", shots=SHOTS, format="parquet", **options)
    names = [path.name for path in parquet.shards(tmp_path / "a", "train")]
    assert names == [f"train-{k:05d}-of-{len(names):05d}.parquet" for k in range(len(names))]
    assert len(names) > 1 and list(findings(tmp_path / "a")) == []
    np.testing.assert_array_equal(read_dataset(tmp_path / "a").images, read_dataset(one).images)


@pytest.mark.parametrize("format", [
    "cityscapes", "coco", "yolo-seg", "folders", pytest.param("parquet", marks=PARQUET),
])  # fmt: skip
def test_a_card_begins_with_yaml_as_hugging_face_reads_it(format, exported):
    begin, front, text = (exported(format, "camvid") / "README.md").read_text().split("---\n", 2)
    metadata = yaml.safe_load(front)
    assert begin == "" and metadata["task_categories"] == ["image-segmentation"]
    assert metadata["size_categories"] == ["n<1K"] and text.startswith(
        "# Rendered streets\n4 images of"
    )
    assert "the target camvid" in text
    folders = {line for line in re.findall(r'[`"](\w+)/', text)}
    assert folders and all((exported(format, "camvid") / name).is_dir() for name in folders)
    if format == "yolo-seg":  # the classes of its files are those of data.yaml
        shown = (exported(format, "") / "README.md").read_text()
        assert "| 0 | person |" in shown and "| 7 | bicycle |" in shown and "road" not in shown
        assert "with outlines of things" in shown and "| 0 | car |" in text
        return
    assert "| 10 | bicyclist |" in text and "with the class of every pixel" in text
    if format == "parquet":
        [config] = metadata["configs"]
        assert config["data_files"] == [{"split": "train", "path": "data/train-*"}]


@PARQUET
def test_damage_to_parquet_files_is_found(exported, tmp_path):
    folder = shutil.copytree(exported("parquet"), tmp_path / "a")
    [shard] = parquet.shards(folder, "train")
    content = shard.read_bytes()
    place = content.index(b"IDAT") + 20
    shard.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
    assert any("is damaged" in line for line in findings(folder))
    shard.write_bytes(content[:-9])
    refused(ValueError, f"{shard} cannot be read: ", list, findings(folder))
    shard.unlink()
    assert f"{folder}: no row of image scenex_000000_000000 in data/" in list(findings(folder))


def test_damage_to_masks_and_polygons_is_found(exported, tmp_path):
    masks = shutil.copytree(exported("folders", "camvid"), tmp_path / "masks")
    path = sorted((masks / "masks").iterdir())[0]
    mask = np.array(Image.open(path))
    Image.fromarray(np.where(mask == 3, 77, mask).astype(np.uint8)).save(path)
    output = "\n".join(findings(masks))
    assert "pixels have a value of no class" in output
    assert "class_frequency of road is" in output
    (masks / "classes.txt").write_text("0 sky\n")
    assert f"{masks / 'classes.txt'} and dataset.json disagree on the classes" in list(
        findings(masks)
    )
    polygons = shutil.copytree(exported("yolo-seg"), tmp_path / "polygons")
    path = next(p for p in sorted(polygons.rglob("labels/train/*.txt")) if p.stat().st_size)
    text = path.read_text()
    path.write_text(text.partition("\n")[2])
    assert "but the outlines enclose" in "\n".join(findings(polygons))
    for line in (
        "8 0 0 0 1 1 1",
        "0 0 0 1 1",
        "0 0 0 0 1 1 1.5",
        "0 0 0 0 1 1",
        "0 0 0 0 nan 1 1",
        "é",
    ):
        path.write_text(f"{text}{line}\n")
        number = text.count("\n") + 1
        assert f"{path}, line {number}: expected a class below 8" in "\n".join(findings(polygons))


@pytest.mark.parametrize(("flags", "message"), [
    ("--target nowhere", "--target nowhere: no such file; expected a file, or one of camvid"),
    ("--target camvd", "synthia; did you mean camvid?"),
    ("--target own.yaml", "target own: none of its classes is rendered"),
    ("--target flat.yaml --format yolo-seg", "format yolo-seg stores things only, but target flat has none"),
])  # fmt: skip
def test_bad_targets_are_one_line(flags, message, tmp_path, refusal, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = 'images: "{name}.png"\nlabels: "{name}_l.png"\nclasses:\n  b: {ids: [1]}\n'
    text += "  ground: {ids: [0]RENDERS}\n"
    (tmp_path / "own.yaml").write_text(text.replace("RENDERS", ""))
    (tmp_path / "flat.yaml").write_text(text.replace("RENDERS", ", renders: [road]"))
    assert message in refusal(main, "--images", "1", "--out", "a", *flags.split())
    assert not (tmp_path / "a").exists()


def test_a_missing_package_is_named_with_its_extra(tmp_path, refusal, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    error = refusal(main, "--images", "1", "--format", "parquet", "--out", tmp_path / "a")
    assert "format parquet needs pyarrow: pip install 'sdr-jax[parquet]'" in error
    assert not (tmp_path / "a").exists()


def test_an_export_of_other_classes_is_not_continued(exported):
    folder = exported("folders", "camvid")
    options = {"shots": SHOTS, "settings": SETTINGS, "pool": POOL, "format": "folders"}
    for target in (None, TARGETS["colours"]):
        refused(
            UserError, "holds an export with other target", export_dataset, UNITS, SEED, folder,
            target=target, streets=random_proposal(), **options,
        )  # fmt: skip


@pytest.mark.parametrize("name", [*SHIPPED, *RESTS])
def test_every_target_has_a_value_of_its_own_for_each_class_and_void(name):
    target = find_target(name) if isinstance(name, str) else name
    labels = target_labels(json.loads(json.dumps(target_entry(target))))
    values = [json.dumps(value) for value, _ in labels.all_values]
    assert len(set(values)) == len(values) == len(target.classes) + 1
    assert labels.of_engine[:19].tolist() == list(target.of_engine)
    train_ids = np.arange(19, dtype=np.uint8)[None]
    picture = labels.values.take(labels.of_engine.take(train_ids), axis=0)
    np.testing.assert_array_equal(labels.classes_of(picture), labels.of_engine[train_ids])


@pytest.mark.parametrize("change", [
    {"classes": []}, {"void": "x"}, {"void": 70000}, {"classes": [{"name": "a"}]}, {"void": None},
    {"classes": [{"name": "a", "value": 1, "colour": [0, 0, 0], "renders": ["moon"]}]},
])  # fmt: skip
def test_a_garbled_target_in_a_description_is_refused(change):
    entry = {**target_entry(TARGETS["camvid"]), **change}
    refused(ValueError, "the entry of the target is damaged", target_labels, entry)


@pytest.mark.parametrize(("format", "rows"), [("cityscapes", 3), ("folders", 2), ("yolo-seg", 1)])
def test_a_contact_sheet_shows_what_the_format_has(format, rows, exported, frames):
    dataset = describe(exported(format))
    height, width = SETTINGS.height, SETTINGS.width
    page = sheet(dataset)
    assert page.shape == (rows * height, len(frames) * width, 3)
    for k, frame in enumerate(frames):
        column = page[:, k * width : (k + 1) * width].reshape(rows, height, width, 3)
        expected = (frame.image, colorize(frame.label), depth_image(frame.depth))[:rows]
        for tile, image in zip(column, expected, strict=True):
            assert np.abs(tile.astype(int) - image).max() <= 1  # depth has steps of a centimetre
    assert sheet(dataset, images=1).shape == (rows * height, width, 3)
    assert write_sheet(dataset.folder).name == "index.jpg"
