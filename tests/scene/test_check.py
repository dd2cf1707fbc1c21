"""The self-check: silent on what was exported, and one line for every kind of damage."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from scene import AssetPool, RenderSettings, check, export_dataset
from scene.attributes import BY_NAME
from scene.check import findings, main
from scene.dataset.edges import Overlap, overlap
from scene.dataset.formats import planes, png, rle
from scene.held import hold
from scene.proposal import default_proposal, draw, random_proposal
from tests.scene.conftest import refused

DEPTH, NORMALS, SEGMENTS = "depth/**/*.png", "normals/**/*.png", "*panoptic*/*.png"
LIST, PANOPTIC = "annotations/instances*", "*panoptic*.json"


# Layouts of other tools hold less: test_export_layouts.py.
@pytest.fixture(scope="module", params=["cityscapes", "coco"])
def exported(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param) / "dataset"
    options = {"settings": RenderSettings(160, 96), "pool": AssetPool(0, 3)}
    units = draw(random_proposal(), 1, 2)
    export_dataset(units, 5, folder, shots=2, format=request.param, **options)
    return folder


@pytest.fixture
def dataset(exported, tmp_path):
    return shutil.copytree(exported, tmp_path / "dataset")


def first(dataset, pattern):
    return sorted(dataset.rglob(pattern))[0]


def edit(path, change):
    """Change an image file by a function of its pixels, or a JSON file by a function of its content."""
    if path.suffix == ".png":
        path.write_bytes(png.encode(np.ascontiguousarray(change(png.read_png(path).copy()))))
    else:
        value = json.loads(path.read_text())
        change(value)
        path.write_text(json.dumps(value))


def test_nothing_is_found_in_what_was_exported_with_edges_to_spare(exported, printed):
    (first(exported, DEPTH).parent / ".DS_Store").write_bytes(b"of the system")
    assert list(findings(exported)) == [] and "no faults" in printed(main, exported)
    edges, moved = Overlap(), Overlap()
    for path in exported.glob(DEPTH):
        segments = first(exported, f"*panoptic*/{path.stem.removesuffix('_depth')}*.png")
        ids, depth = planes.ids_of(png.read_png(segments)), png.read_png(path)
        edges, moved = edges.plus(overlap(ids, depth)), moved.plus(overlap(shift(ids), depth))
    assert edges.lift > 1.2 * check.LEAST_LIFT and moved.lift < 0.8 * check.LEAST_LIFT


def test_findings_are_printed_one_a_line_with_exit_code_one(dataset, capsys):
    depth, normals = first(dataset, DEPTH), first(dataset, NORMALS)
    depth.unlink()
    normals.write_bytes(normals.read_bytes()[:-20])
    assert main([str(dataset)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert sorted(lines) == [f"{depth} is missing", f"{normals} is cut short"]


@pytest.mark.parametrize("files", [{}, {"a.png": b""}, {"dataset.json": b"{}"}])
def test_no_dataset_is_refused_and_an_unfinished_one_says_how_to_go_on(files, tmp_path, refusal):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert str(tmp_path) in refusal(main, tmp_path)
    (tmp_path / "b" / ".export").mkdir(parents=True)
    with pytest.raises(
        ValueError, match="unfinished export; run the command that started it to resume"
    ):
        list(findings(tmp_path / "b"))


@pytest.mark.parametrize(
    "change",
    [
        {"images": 0},
        {"images": 10_000_000},
        {"format": "voc"},
        {"render": None},
        {"shots": "two"},
        {"shots_retaken": 10**400, "shots_refused": 0},
    ],
)
def test_garbled_descriptions_are_refused(dataset, change):
    path, message = dataset / "dataset.json", r"dataset\.json does not describe a dataset"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    refused(ValueError, message, list, findings(dataset))
    path.write_text("{")
    refused(ValueError, r"dataset\.json is not a JSON file", list, findings(dataset))
    refused(ValueError, "gone: no such folder; expected one from", list, findings(dataset / "gone"))


@pytest.mark.parametrize("garbage", [None, "x", [[]], {"": None}])
@pytest.mark.parametrize("file", ["dataset.json", "annotations/instances*", "*panoptic*.json"])
def test_no_garbage_in_a_json_file_stops_the_check_with_a_traceback(dataset, file, garbage):
    path = first(dataset, file)
    content = json.loads(path.read_text())
    lists = [key for key, value in content.items() if isinstance(value, list) and value]
    broken = [{**content, key: garbage} for key in content]
    broken += [{**content, key: [garbage, *content[key][1:]]} for key in lists]
    for value in [garbage, *broken]:
        path.write_text(json.dumps(value))
        try:
            lines = list(findings(dataset))
        except ValueError as error:
            lines = [str(error)]
        assert all(isinstance(line, str) and "\n" not in line for line in lines)


def first_of(value, kind):
    return value["annotations"][0][kind]


def shift(plane):
    return np.roll(plane, 1, axis=1)


def flip_sky(plane):
    plane[:4, :4] = np.where(plane[:4, :4] > 0, 0, 77)
    return plane


def paint(plane, value):
    plane[40:44, 40:44] = value & 255, value >> 8, 0
    return plane


@pytest.mark.parametrize(("pattern", "change", "message"), [
    (NORMALS, lambda p: shutil.copy(p, p.with_name("more.png")), "more.png belongs to no image"),
    (DEPTH, lambda p: np.concatenate([p, p[:, :1]], axis=1), "is 161x96, not 160x96"),
    (NORMALS, lambda n: n.astype(np.uint16), "is uint16 with 3 channels, not uint8"),
    (SEGMENTS, lambda s: np.dstack([s, s[..., :1]]), "is uint8 with 4 channels, not uint8 with 3"),
    (DEPTH, flip_sky, "depth: 16 pixels disagree on"),
    (NORMALS, lambda n: np.where(n.any(2, keepdims=True), 255, n), "do not have length 1"),
    (SEGMENTS, shift, "has (class, area, box) ("),
    (SEGMENTS, lambda s: paint(s, 14), "segment 14 belongs to no class"),
    (SEGMENTS, lambda s: paint(s, 26), "segment 26 is not a valid id for the class car"),
    (SEGMENTS, lambda s: paint(s, 12003), "segment 12003 is not a valid id for the class wall"),
    (LIST, Path.unlink, "json is missing"),
    (LIST, lambda v: v.pop("images"), "is not valid for its format"),
    (LIST, lambda v: v["images"].pop(), "instances and dataset.json differ on scenex_000001_000001"),
    (PANOPTIC, lambda v: first_of(v, "segments_info").pop(), "is in the image but not in the list"),
    (PANOPTIC, lambda v: first_of(v, "segments_info").append({"id": 5, "category_id": 7}),
     "segment 5 is in the list but not in the image"),
    (PANOPTIC, lambda v: first_of(v, "segments_info")[0].update(area=1), "but the list has"),
    (LIST, lambda v: v["annotations"][0].update(bbox=[0, 0, 1, 1]), "annotation 1: class, area or box"),
    (LIST, lambda v: first_of(v, "segmentation").update(counts=rle.encode([0, 160 * 96])),
     "annotation 1: its mask is not one object"),
    (LIST, lambda v: first_of(v, "segmentation").update(counts="00"), "annotation 1 cannot be read"),
    (LIST, lambda v: v["annotations"].pop(), "has no annotation"),
    ("dataset.json", lambda v: v["class_frequency"].update(road=0.99), "class_frequency of road is 0.99"),
    ("dataset.json", lambda v: v["images_with_class"].update(sky=0), "images_with_class of sky is 0"),
    ("camera/**/*.json", lambda v: v["extrinsic"].pop("z"), "extrinsic.z must be a number, not None"),
])  # fmt: skip
def test_every_damage_is_found(dataset, pattern, change, message):
    of_the_file = message.endswith(("belongs to no image", "is missing"))
    path = first(dataset, pattern)
    change(path) if of_the_file else edit(path, change)
    assert message in "\n".join(findings(dataset))


def test_shifted_depth_is_found(dataset, monkeypatch):
    monkeypatch.setattr(check, "ENOUGH_JUMPS", 200)  # four small images
    for path in dataset.glob(DEPTH):
        edit(path, shift)
    assert "label and depth edges disagree" in "\n".join(findings(dataset))


@pytest.mark.parametrize("exported", ["cityscapes"], indirect=True)
@pytest.mark.parametrize("kind", ["labelIds", "labelTrainIds", "instanceIds", "color"])
def test_label_pictures_that_disagree_are_found(dataset, kind):
    edit(first(dataset, f"*_{kind}.png"), shift)
    [line] = findings(dataset)
    assert "values differ from the panoptic segments" in line


def test_a_class_that_is_in_no_image_is_no_fault(tmp_path):
    down = {"camera_rotation_x": BY_NAME["camera_rotation_x"].to_unit(20.0)}
    units = draw(hold(default_proposal(), down), 0, 20)
    options = {"settings": RenderSettings(48, 32, samples=1), "pool": AssetPool(0, 1)}
    export_dataset(units, 0, tmp_path, shots=1, format="folders", **options)
    described = json.loads((tmp_path / "dataset.json").read_text())
    assert described["images_with_class"]["sky"] == 0 and list(findings(tmp_path)) == []


@pytest.mark.parametrize(("overlap", "code"), [("avoid", 0), ("allow", 1)])
def test_what_meets_in_streets_is_counted(overlap, code, capsys):
    assert main(["--overlaps", "2", "--overlap", overlap]) == code
    out = capsys.readouterr().out
    assert out.startswith("2 default streets (extended): ") and "\n2 random streets" in out
    assert ("building and building" in out) == (overlap == "allow")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("", "either a dataset or --overlaps"),
        ("streets --overlaps 2", "either a dataset or --overlaps"),
        ("--overlaps 0", "--overlaps must be 1 or more, not 0"),
        ("--overlaps 2 --overlap maybe", "'maybe'"),
        ("streets --space scenex", "--space needs --overlaps"),
    ],
)
def test_a_wish_that_makes_no_sense_is_refused(line, message, capsys):
    with pytest.raises(SystemExit) as refusal:
        main(line.split())
    assert refusal.value.code == 2 and message in capsys.readouterr().err
