"""A user's own class: where its objects stand, its labels in every format, and what is refused."""

import importlib.util
import json
import math
import shutil

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from common.sent import received
from common.workers.pool import WorkerPool
from scene import (
    AssetPool,
    OwnClass,
    RenderSettings,
    colorize,
    render_dataset,
    render_street,
    stream,
)
from scene.assets.library import LibraryError
from scene.assets.own_class import FAMILY
from scene.check import findings
from scene.classes import CLASS_NAMES, COLORS, OWN, VOID
from scene.dataset import export
from scene.dataset.export import ExportError, export_dataset, read_dataset
from scene.dataset.formats import layout, rle, yolo
from scene.dataset.formats.labels import engine_labels
from scene.dataset.formats.planes import panoptic_plane
from scene.dataset.render import street_of
from scene.dataset.verify import verify
from scene.ground.path import heading_at, nearest
from scene.proposal import default_proposal, draw, random_proposal
from scene.render.__main__ import main
from scene.stats import compare, table
from scene.street.clearance import pairs
from scene.street.instances import standing
from tests.scene.conftest import refused

SETTINGS, SEED, NAME = RenderSettings(width=160, height=96), 5, "wheelie bin"
STREETS = random_proposal("extended")
UNITS = draw(STREETS, 1, 3)
FORMATS = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name == "parquet" and importlib.util.find_spec("pyarrow") is None,
            reason="needs pyarrow",
        ),
    )
    for name in layout.FORMATS
]


def box(width=0.6, colour=(230, 160, 10)):
    """A box a metre high, y up."""
    mesh = trimesh.creation.box((width, 1.0, 0.7))
    mesh.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[*colour, 255]))
    return mesh


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("asset") / "bin.glb"
    box().export(path)
    return path


@pytest.fixture(scope="module")
def pool(file):
    return AssetPool(0, 3, own_class=OwnClass(NAME, str(file)))


@pytest.fixture(scope="module")
def frames(pool):
    return [render_street(u, SEED, k, 1, SETTINGS, "embree", pool)[0] for k, u in enumerate(UNITS)]


def exported(folder, pool, format="cityscapes", **options):
    settings = {"settings": SETTINGS, "pool": pool, "streets": STREETS, **options}
    return export_dataset(UNITS, SEED, folder, shots=1, format=format, **settings)


def tree(folder):
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def masks_of(frame):
    """The pixels of each object of the class."""
    instances = np.unique(frame.instance[frame.label == OWN])
    return [frame.instance == instance for instance in instances]


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_holds_the_class_with_the_pixels_of_its_objects(
    format, pool, frames, tmp_path
):
    folder = tmp_path / "dataset"
    record = exported(folder, pool, format)
    assert list(findings(folder)) == []
    assert record["own_class"].items() >= {
        "name": NAME, "train_id": 19, "label_id": 34, "place": "sidewalk", "file": "bin.glb"
    }.items()  # fmt: skip
    shares = [(frame.label == OWN).mean() for frame in frames]
    assert np.count_nonzero(shares) >= 2 and tuple(record["class_frequency"]) == (
        *CLASS_NAMES,
        NAME,
    )
    assert record["class_frequency"][NAME] == pytest.approx(np.mean(shares), abs=1e-9)
    assert record["placed"][NAME] >= 5 and "own_class" not in record["assets"]
    assert f"| {NAME} |" in (folder / "README.md").read_text()
    READERS[format](folder, frames)
    if format != "yolo-seg":
        dataset = read_dataset(folder)
        np.testing.assert_array_equal(dataset.labels, [frame.label for frame in frames])
        classes, figures = compare(folder, None, ())
        assert classes[OWN] == NAME and NAME in table(classes, figures)
        assert figures["dataset"].containing[OWN] == np.count_nonzero(shares)


def read_cityscapes(folder, frames):
    for k, frame in enumerate(frames):
        name = f"gtFine/train/scenex/scenex_{k:06d}_000000_gtFine"
        planes = {
            kind: np.array(Image.open(folder / f"{name}_{kind}.png"))
            for kind in ("labelIds", "labelTrainIds", "instanceIds", "color")
        }
        is_own = frame.label == OWN
        np.testing.assert_array_equal(planes["labelIds"] == 34, is_own)
        np.testing.assert_array_equal(planes["labelTrainIds"], frame.label)
        np.testing.assert_array_equal((planes["color"] == (0, 255, 255)).all(axis=2), is_own)
        np.testing.assert_array_equal(planes["color"], colorize(frame.label))
        for number, mask in enumerate(masks_of(frame)):
            assert (planes["instanceIds"][mask] == 34000 + number).all()
    read_instances(folder / "annotations" / "instances_train.json", frames)


def read_coco(folder, frames):
    read_instances(folder / "annotations" / "instances.json", frames)
    semantic = json.loads((folder / "annotations" / "semantic.json").read_text())
    assert {"id": 34, "name": NAME, "color": [0, 255, 255]}.items() <= semantic["categories"][
        -1
    ].items()
    annotations = {a["image_id"]: a for a in semantic["annotations"] if a["category_id"] == 34}
    for image, frame in enumerate(frames, start=1):
        area = annotations[image]["area"] if image in annotations else 0
        assert area == (frame.label == OWN).sum()


def read_instances(path, frames):
    content = json.loads(path.read_text())
    assert content["categories"][-1] == {
        "id": 34, "name": NAME, "supercategory": "object", "isthing": 1, "color": [0, 255, 255]
    }  # fmt: skip
    of_class = [a for a in content["annotations"] if a["category_id"] == 34]
    for image, frame in enumerate(frames, start=1):
        of_image = [a for a in of_class if a["image_id"] == image]
        for annotation, mask in zip(of_image, masks_of(frame), strict=True):
            counts = rle.decode(annotation["segmentation"]["counts"])
            np.testing.assert_array_equal(rle.mask(counts, *mask.shape), mask)


def read_yolo(folder, frames):
    data = yaml.safe_load((folder / "data.yaml").read_text())
    assert data["nc"] == 9 and data["names"][8] == NAME
    for k, frame in enumerate(frames):
        lines = (folder / f"labels/train/scenex_{k:06d}_000000.txt").read_text().splitlines()
        outlines = [line.split()[1:] for line in lines if line.startswith("8 ")]
        for shares, mask in zip(outlines, masks_of(frame), strict=True):
            corners = np.array(shares, float).reshape(-1, 2) * [160, 96]
            assert abs(yolo.area(corners)) == pytest.approx(mask.sum(), rel=0.02)


def read_folders(folder, frames):
    assert (folder / "classes.txt").read_text().splitlines()[-2:] == [f"19 {NAME}", "255 void"]
    for path, frame in zip(sorted((folder / "masks").iterdir()), frames, strict=True):
        np.testing.assert_array_equal(np.array(Image.open(path)), frame.label)


def read_parquet(folder, frames):
    from pyarrow import parquet

    rows = parquet.read_table(next((folder / "data").iterdir()))
    features = json.loads(rows.schema.metadata[b"huggingface"])["info"]["features"]
    assert features["classes"]["feature"]["names"][OWN] == NAME
    for row, frame in zip(rows.to_pylist(), frames, strict=True):
        assert row["classes"] == np.setdiff1d(frame.label, VOID).tolist()


READERS = {"cityscapes": read_cityscapes, "coco": read_coco, "folders": read_folders,
           "yolo-seg": read_yolo, "parquet": read_parquet}  # fmt: skip


def test_bytes_do_not_depend_on_workers_and_a_stream_gives_the_same(pool, frames, tmp_path):
    exported(tmp_path / "one", pool, "folders", workers=1)
    exported(tmp_path / "two", pool, "folders", workers=2)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")
    samples = stream(STREETS, 1, settings=SETTINGS, images=1, space="extended", pool=pool)
    (sample,) = samples
    expected = render_street(sample.street, 1, 0, 1, SETTINGS, "embree", pool)[0].label
    np.testing.assert_array_equal(sample.label, expected)
    rendered = render_dataset(UNITS, SEED, shots=1, settings=SETTINGS, pool=pool)
    np.testing.assert_array_equal(rendered.labels, [frame.label for frame in frames])


@pytest.mark.parametrize("place", ["sidewalk", "carriageway"])
def test_objects_stand_on_their_place_and_change_nothing_else(place, file):
    own_class = OwnClass(NAME, str(file), place)
    units, count = draw(STREETS, 2, 12), 0
    for seed, unit in enumerate(units):
        without_class = street_of(unit, 3, seed, 1, AssetPool(0, 3))
        street = street_of(unit, 3, seed, 1, AssetPool(0, 3, own_class=own_class))
        base_count = len(without_class.placements)
        first, added = street.placements[:base_count], street.placements[base_count:]
        for before, after in zip(without_class.placements, first, strict=True):
            assert before._replace(pose=None) == after._replace(pose=None)
            np.testing.assert_array_equal(before.pose, after.pose)
        assert {p.family for p in added} <= {FAMILY} and {p.train_id for p in added} <= {OWN}
        count += len(added)
        objects, rectangles = standing(street.placements)
        for pair in pairs(rectangles, 0.0).tolist():
            assert FAMILY not in {objects[k].family for k in pair}
        check_place(street.ground, added, place)
    assert count > 3 * len(units)


def check_place(ground, placements, place):
    """Check that objects are within the edges of their place and off crosswalks."""
    for p in placements:
        (along,), (away,) = nearest(ground.path, p.pose[None, :2, 3])
        turn = math.atan2(p.pose[1, 0], p.pose[0, 0]) - float(heading_at(ground.path, along))
        reach = abs(math.sin(turn)) * 0.35 + abs(math.cos(turn)) * 0.3
        if place == "carriageway":
            assert abs(away) + reach <= ground.half_width + 0.02
        else:
            assert ground.half_width - 0.02 <= abs(away) - reach
            assert abs(away) + reach <= ground.outer + 0.02
        assert all(abs(along - x) > 4 for x in ground.crosswalks)


def test_objects_too_large_for_their_place_are_left_out_and_render_says_so(tmp_path, capsys):
    box(14.0).export(tmp_path / "hall.glb")
    class_flags = ["--own-asset", str(tmp_path / "hall.glb"), "--own-class", "hall"]
    flags = ["--images", "1", "--size", "64x48", "--workers", "0", "--out", str(tmp_path / "a")]
    assert main([*flags, *class_flags]) == 0
    assert "No street has a hall: there was no room for one" in capsys.readouterr().out
    assert list(findings(tmp_path / "a")) == []


def test_the_command_line_places_objects_and_stats_compare_datasets(file, tmp_path, capsys):
    flags = ["--images", "1", "--size", "96x64", "--workers", "0", "--asset-count", "3", "--out"]
    class_flags = ["--own-asset", str(file), "--own-class", NAME, "--own-place", "carriageway"]
    assert main([*flags, str(tmp_path / "a"), *class_flags]) == 0
    assert main([*flags, str(tmp_path / "b")]) == 0
    record, without_class = (json.loads((tmp_path / k / "dataset.json").read_text()) for k in "ab")
    assert record["own_class"]["place"] == "carriageway" and record["placed"].pop(NAME) > 0
    assert record["placed"] == without_class["placed"] and "own_class" not in without_class
    assert compare(tmp_path / "a", tmp_path / "b", ())[0] == (*CLASS_NAMES, NAME)
    refused(ValueError, "have different classes", compare, tmp_path / "b", tmp_path / "a", ())
    changed = refused(
        ExportError, "an export with other own_class", export_again, tmp_path / "b", file
    )
    assert "\n" not in str(changed)
    capsys.readouterr()


def export_again(folder, file):
    """Export to the folder of an export again, now with an own class."""
    record = json.loads((folder / "dataset.json").read_text())
    export_dataset(
        np.array(record["streets"], np.float32), 0, folder, shots=1, settings=RenderSettings(96, 64),
        pool=AssetPool(size=3, own_class=OwnClass(NAME, str(file))), streets=default_proposal(),
    )  # fmt: skip


def test_the_file_is_identified_by_its_content_not_its_path(
    pool, file, frames, tmp_path, monkeypatch
):
    copy = tmp_path / "sent" / "other.glb"
    copy.parent.mkdir()
    shutil.copy(file, copy)
    received("0123/bin.glb", copy)  # as on a worker of a cluster
    sent = pool.with_paths(lambda name: "0123/bin.glb" if name else name)
    frame = render_street(UNITS[0], SEED, 0, 1, SETTINGS, "embree", sent)[0]
    np.testing.assert_array_equal(frame.image, frames[0].image)
    with WorkerPool(1) as workers:
        options = {"shots": 1, "settings": SETTINGS, "workers": workers}
        copy_pool = AssetPool(0, 3, own_class=OwnClass(NAME, str(copy)))
        yellow = render_dataset(UNITS[:2], SEED, pool=copy_pool, **options)
        box(colour=(10, 200, 40)).export(copy)
        green = render_dataset(UNITS[:2], SEED, pool=copy_pool, **options)
    np.testing.assert_array_equal(yellow.labels, green.labels)
    assert (yellow.images != green.images).any()
    draw_street = export._draw_street

    def replace_and_draw(*task):
        box(0.8).export(copy)
        return draw_street(*task)

    monkeypatch.setattr(export, "_draw_street", replace_and_draw)
    refused(ExportError, r"other\.glb has changed since", exported, tmp_path / "a", copy_pool)


def test_ids_of_a_class_that_a_dataset_does_not_have_are_found():
    ids = np.array([[34001, 34000], [7, 7]], np.int32)
    planes = {"panoptic": panoptic_plane(ids)}
    strange = [f"panoptic: segment {k} belongs to no class" for k in (34000, 34001)]
    assert list(verify(planes, {}, engine_labels(True))) == strange
    assert list(verify(planes, {}, engine_labels(True, NAME))) == []
    assert (0, 255, 255) not in {tuple(colour) for colour in COLORS.tolist()}


@pytest.mark.parametrize(("flags", "message"), [
    ("--own-asset bin.glb", "--own-asset needs --own-class, too"),
    ("--own-class bin", "--own-class needs --own-asset, too"),
    ("--own-place carriageway", "--own-place needs --own-asset, too"),
    ("--own-asset bin.glb --own-class bin --own-place roof", "carriageway, not 'roof'"),
    ("--own-asset bin.glb --own-class traffic_Light", "'traffic_Light': this class already exists"),
    ("--own-asset bin.glb --own-class VOID", "'VOID': this class already exists"),
    ("--own-asset bin.glb --own-class=", "own class '': a name must be words"),
    ("--own-asset bin.glb --own-class=a\nb", "own class 'a\\nb': a name must be words"),
    ("--own-asset bin.glb --own-class " + 41 * "x", "a name has at most 40 characters, not 41"),
    ("--own-asset nowhere.glb --own-class bin", "nowhere.glb does not exist; an own class needs a .glb"),
    ("--own-asset= --own-class bin", "own class needs a .glb file of its asset"),
    ("--own-asset bin.obj --own-class bin", "bin.obj is not a .glb file; an own class needs a .glb"),
    ("--own-asset points.glb --own-class bin", "points.glb: has no faces"),
    ("--own-asset broken.glb --own-class bin", "broken.glb: broken: truncated"),
    ("--own-asset beside.glb --own-class bin", "beside.glb: needs the separate file skin.png; save"),
    ("--own-asset huge.glb --own-class bin", "huge.glb: is 100 m long; an asset of an own class is 0.05"),
    ("--own-asset bin.glb --own-class bin --target camvid", "cannot be combined with target camvid"),
])  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(
    flags, message, tmp_path, refusal, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    box().export("bin.glb")
    (tmp_path / "bin.obj").write_text("v 0 0 0\n")
    trimesh.Scene([trimesh.PointCloud(np.eye(3))]).export("points.glb")
    (tmp_path / "broken.glb").write_bytes(b"glTF")
    box(100.0).export("huge.glb")
    write_with_separate_texture(tmp_path / "beside.glb")
    files = tree(tmp_path)
    class_flags = [text.replace("\\n", "\n") for text in flags.split(" ")]
    assert message in refusal(main, "--images", "1", "--size", "64x48", "--out", "a", *class_flags)
    assert tree(tmp_path) == files and not (tmp_path / "a").exists()


def write_with_separate_texture(path):
    """Write a GLB with a separate texture file."""
    mesh = box()
    texture = Image.new("RGB", (2, 2), (9, 9, 9))
    texture.save(path.parent / "skin.png")
    material = PBRMaterial(baseColorTexture=texture)
    mesh.visual = TextureVisuals(uv=np.full((8, 2), 0.3), material=material)
    data = mesh.export(file_type="glb")
    size = int.from_bytes(data[12:16], "little")
    content = json.loads(data[20 : 20 + size])
    content["images"] = [{"uri": "skin.png"}]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = [b"glTF", (2).to_bytes(4, "little"), (20 + len(text) + len(rest)).to_bytes(4, "little")]
    path.write_bytes(b"".join([*head, len(text).to_bytes(4, "little"), b"JSON", text, rest]))


def test_a_stream_and_a_pool_refuse_the_same(pool, file):
    refused(ValueError, "cannot be combined with target camvid", stream, pool=pool, target="camvid")
    roof = AssetPool(own_class=OwnClass("bin", str(file), "roof"))
    refused(ValueError, "place 'roof' is unknown; known: sidewalk, carriageway", stream, pool=roof)
    car = AssetPool(own_class=OwnClass("car", str(file)))
    refused(ValueError, "this class already exists", stream, pool=car)
    gone = AssetPool(own_class=OwnClass("bin", "gone.glb"))
    refused(LibraryError, "gone.glb does not exist", stream, pool=gone)
