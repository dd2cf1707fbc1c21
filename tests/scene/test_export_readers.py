"""The official tools of both formats read our exports unchanged: cityscapesscripts and pycocotools."""

import json

import numpy as np
import pytest
from PIL import Image

from scene import AssetPool, RenderSettings, export_dataset, render_street
from scene.attributes import names
from scene.dataset.formats import planes, segments
from scene.proposal import default_proposal, draw

SETTINGS = RenderSettings(width=160, height=96)
POOL = AssetPool(0, 3)
SHOTS, SEED = 2, 11
UNITS = draw(default_proposal(space="extended"), SEED, 2)
UNITS[:, names("extended").index("gradient")] = 0  # level streets
STEMS = [f"scenex_{k:06d}_{shot:06d}" for k in range(2) for shot in range(SHOTS)]


@pytest.fixture(scope="module")
def frames():
    one, two = (render_street(UNITS[k], SEED, k, SHOTS, SETTINGS, "embree", POOL) for k in (0, 1))
    return [*one, *two]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder of the frames in each format."""
    options = {"shots": SHOTS, "settings": SETTINGS, "pool": POOL, "split": "val"}
    folders = {name: tmp_path_factory.mktemp(name) / "dataset" for name in ("cityscapes", "coco")}
    for name, folder in folders.items():
        export_dataset(UNITS, SEED, folder, format=name, **options)
    return folders


@pytest.fixture(scope="module")
def cityscapes(exported):
    return exported["cityscapes"]


def objects(frame):
    """(labelId, mask) of every thing in a frame."""
    thing = (frame.label >= 11) & (frame.label != 255)
    masks = [thing & (frame.instance == k) for k in np.unique(frame.instance[thing])]
    return [(int(segments.LABEL_OF_TRAIN[frame.label[mask][0]]), mask) for mask in masks]


def read(path):
    return np.array(Image.open(path))


def area_and_box(mask):
    rows, columns = np.nonzero(mask)
    x, y = columns.min(), rows.min()
    return len(rows), [x, y, columns.max() - x + 1, rows.max() - y + 1]


def test_labels_and_instances_are_those_of_the_street_by_the_official_table(cityscapes, frames):
    from cityscapesscripts.evaluation.instances2dict import instances2dict
    from cityscapesscripts.helpers.csHelpers import getCsFileInfo
    from cityscapesscripts.helpers.labels import id2label, trainId2label

    for stem, frame in zip(STEMS, frames, strict=True):
        path = f"{cityscapes}/gtFine/val/scenex/{stem}_gtFine_labelIds.png"
        info = getCsFileInfo(path)
        assert (info.city, info.type, info.type2) == ("scenex", "gtFine", "labelIds")
        np.testing.assert_array_equal(read(path.replace("Ids", "TrainIds")), frame.label)
        ids, color = read(path), read(path.replace("labelIds", "color"))
        for train_id in np.unique(frame.label):
            label = trainId2label[train_id]
            assert (ids[frame.label == train_id] == label.id).all()
            assert (color[frame.label == train_id] == label.color).all()
        [instances] = instances2dict([path.replace("label", "instance")]).values()
        stored = []
        for name, entry in [(n, entry) for n in instances for entry in instances[n]]:
            label = id2label[entry["labelID"]]
            assert (label.name, label.hasInstances) == (name, entry["instID"] >= 1000)
            if label.hasInstances:
                stored.append((label.id, entry["pixelCount"]))
        expected = sorted((label, int(mask.sum())) for label, mask in objects(frame))
        assert sorted(stored) == expected and len(expected) >= 3


def test_the_official_script_makes_the_same_panoptic_files(cityscapes, tmp_path, capsys):
    from cityscapesscripts.preparation.createPanopticImgs import convert2panoptic

    convert2panoptic(str(cityscapes / "gtFine"), str(tmp_path), setNames=["val"])
    exported_json = json.loads((cityscapes / "gtFine" / "cityscapes_panoptic_val.json").read_text())
    official = json.loads((tmp_path / "cityscapes_panoptic_val.json").read_text())
    assert exported_json == official
    for entry in official["annotations"]:
        path = f"cityscapes_panoptic_val/{entry['file_name']}"
        np.testing.assert_array_equal(read(cityscapes / "gtFine" / path), read(tmp_path / path))


def test_depth_and_normals_are_those_of_the_frames_and_the_camera_s_road_is_flat(
    cityscapes, frames
):
    for stem, frame in zip(STEMS, frames, strict=True):
        where = f"val/scenex/{stem}"
        depth = read(cityscapes / f"depth/{where}_depth.png")
        np.testing.assert_allclose(depth / 100, np.minimum(frame.depth, 655.35), atol=0.0051)
        camera = json.loads((cityscapes / f"camera/{where}_camera.json").read_text())
        inner, outer = camera["intrinsic"], camera["extrinsic"]
        disparity = read(cityscapes / f"disparity/{where}_disparity.png").astype(float)
        near = (frame.depth > 1) & (frame.depth < 30)
        metres = outer["baseline"] * inner["fx"] / ((disparity[near] - 1) / 256)
        np.testing.assert_allclose(metres, frame.depth[near], rtol=3e-3)
        normals = read(cityscapes / f"normals/{where}_normals.png") / 127.5 - 1
        np.testing.assert_allclose(normals[near], frame.normal[near], atol=0.0041)
        rows, columns = np.nonzero((frame.label == 0) & (frame.depth < 40))
        ahead, pitch = frame.depth[rows, columns], outer["pitch"]
        down = (rows - inner["v0"]) / inner["fy"] * ahead
        height = outer["z"] - down * np.cos(pitch) - ahead * np.sin(pitch)
        assert len(height) > 500
        assert np.abs(np.median(height)) < 0.1 and np.ptp(height) < 0.5  # roads are cambered


@pytest.mark.parametrize(("format", "file", "root"), [
    ("coco", "instances.json", "images"), ("cityscapes", "instances_val.json", ""),
])  # fmt: skip
def test_pycocotools_reads_boxes_and_masks_of_both(format, file, root, frames, exported, capsys):
    from pycocotools.coco import COCO

    coco_file = COCO(str(exported[format] / "annotations" / file))
    for image, frame in zip(coco_file.loadImgs(coco_file.getImgIds()), frames, strict=True):
        picture = read(exported[format] / root / image["file_name"])
        assert picture.shape == (image["height"], image["width"], 3)
        np.testing.assert_array_equal(picture, frame.image)
        left = {mask.tobytes(): (label, mask) for label, mask in objects(frame)}
        for annotation in coco_file.loadAnns(coco_file.getAnnIds(imgIds=image["id"])):
            label, mask = left.pop(coco_file.annToMask(annotation).astype(bool).tobytes())
            assert (annotation["area"], annotation["bbox"]) == area_and_box(mask)
            assert annotation["category_id"] == label and annotation["iscrowd"] == 0
        assert not left


def test_the_panoptic_file_is_as_published(exported, frames):
    coco = exported["coco"]
    panoptic = json.loads((coco / "annotations" / "panoptic.json").read_text())
    categories = {entry["id"]: entry for entry in panoptic["categories"]}
    assert len(categories) == 19 and {c["isthing"] for c in categories.values()} == {0, 1}
    images = {image["id"]: image for image in panoptic["images"]}
    assert [a["image_id"] for a in panoptic["annotations"]] == list(images)
    for annotation, frame in zip(panoptic["annotations"], frames, strict=True):
        image = images[annotation["image_id"]]
        assert (coco / "images" / image["file_name"]).exists()
        ids = planes.ids_of(read(coco / "panoptic" / annotation["file_name"]))
        assert ids.shape == (image["height"], image["width"])
        segment_ids = [segment["id"] for segment in annotation["segments_info"]]
        assert sorted(segment_ids) == np.unique(ids).tolist() and len(set(segment_ids)) == len(
            segment_ids
        )
        for segment in annotation["segments_info"]:
            assert set(segment) == {"id", "category_id", "area", "bbox", "iscrowd"}
            mask = ids == segment["id"]
            assert (segment["area"], segment["bbox"]) == area_and_box(mask)
            assert (segments.LABEL_OF_TRAIN[frame.label[mask]] == segment["category_id"]).all()
            if categories[segment["category_id"]]["isthing"]:
                assert len(np.unique(frame.instance[mask])) == 1
