"""Exports: the same bytes in all ways to make them, and nothing lost or overwritten."""

import errno
import io
import json
import os
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from common import files
from scene import AssetPool, RenderSettings
from scene.attributes import BY_NAME, NAMES, names
from scene.dataset import description, export
from scene.dataset.description import versions
from scene.dataset.export import ExportError, export_dataset, read_dataset
from scene.dataset.formats.layout import FORMATS
from scene.proposal import Histogram, describe, draw, random_proposal
from scene.render.__main__ import main
from scene.version import ENGINE, MAKERS
from tests.scene.conftest import refused

TINY = RenderSettings(width=64, height=48)
UNITS = draw(random_proposal(), 5, 3)
OPTIONS = {"units": UNITS, "shots": 2, "images": 5, "settings": TINY, "pool": AssetPool(0, 3),
           "streets": random_proposal()}  # fmt: skip
PARQUET = pytest.mark.skipif(find_spec("pyarrow") is None, reason="needs pyarrow")
FLAGS = ["--images", "2", "--size", "64x48", "--workers", "0", "--out"]


def run(folder, **changes):
    options = {**OPTIONS, **changes}
    return export_dataset(options.pop("units"), options.pop("seed", 7), folder, **options)


def tree(folder):
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture(scope="module", params=[
    pytest.param(name, marks=PARQUET if name == "parquet" else ()) for name in FORMATS
])  # fmt: skip
def unbroken(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken") / "dataset"
    run(folder, format=request.param)
    return folder


def described(folder):
    return json.loads((folder / "dataset.json").read_text())


@pytest.fixture
def format(unbroken):
    return described(unbroken)["format"]


def test_the_description_says_what_was_asked_and_what_came_out(unbroken):
    description = described(unbroken)
    if description["format"] == "yolo-seg":
        pytest.skip("does not label every pixel")
    dataset = read_dataset(unbroken)
    requested = {"images": 5, "shots": 2, "seed": 7, "renderer": "embree", "split": "train"}
    assert (
        description.items() >= {**requested, "engine": ENGINE}.items()
        and description["own_assets"] == []
    )
    assert description["render"]["width"] == 64 and description["render"]["response"]
    assert description["assets"]["size"] == 3 and list(description["attributes"]) == list(NAMES)
    np.testing.assert_array_equal(np.array(description["streets"], np.float32), UNITS)
    assert description["attributes"]["car_position"] == {"centre": 0.5, "width": 1.0}
    assert description["versions"]["numpy"] == np.__version__
    assert description["versions"].keys() > {*MAKERS, "processor"}
    share = np.bincount(dataset.labels.ravel(), minlength=19) / dataset.labels.size
    np.testing.assert_allclose(list(description["class_frequency"].values()), share, atol=1e-9)
    containing = [int((dataset.labels == k).any(axis=(1, 2)).sum()) for k in range(19)]
    assert list(description["images_with_class"].values()) == containing
    np.testing.assert_allclose(
        description["mean_rgb"], dataset.images.mean(axis=(0, 1, 2)), atol=1e-3
    )
    assert description["placed"]["building"] > 0 and not (unbroken / ".export").exists()


@pytest.mark.parametrize(
    "writes", [0, 4, 22, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 13, 30))]
)
def test_cut_short_anywhere_it_ends_alike(unbroken, format, writes, tmp_path, monkeypatch):
    left = iter(range(writes if format in ("cityscapes", "coco") else writes // 2))  # fewer files
    folder, written_files, real = tmp_path / "a", [], os.replace

    def cut(source, target):
        if next(left, None) is None:
            os.link(source, f"{source}.left")  # a kill would not have tidied up
            raise KeyboardInterrupt
        real(source, target)

    monkeypatch.setattr(files.os, "replace", cut)
    refused(KeyboardInterrupt, "", run, folder, format=format)
    monkeypatch.undo()
    for part in folder.rglob("*.left"):
        part.rename(part.with_suffix(""))
    assert not (folder / "dataset.json").exists()
    workers = 2 if writes == 0 else 0  # files do not depend on their number
    run(folder, format=format, workers=workers, progress=lambda *s: written_files.append(s[:2]))
    assert tree(folder) == tree(unbroken)
    assert (
        written_files == sorted(written_files)
        and written_files[-1] == (5, 5)
        and {images for _, images in written_files} == {5}
    )


def test_finished_streets_are_not_rendered_again(tmp_path, monkeypatch):
    real, rendered = export._draw_street, []

    def street(plan, index, unit):
        rendered.append(index)
        if rendered == [0, 1, 2]:
            raise KeyboardInterrupt
        return real(plan, index, unit)

    monkeypatch.setattr(export, "_draw_street", street)
    refused(KeyboardInterrupt, "", run, tmp_path / "a")
    # A file that lost its end, as when the power goes, is made again.
    victim = next((tmp_path / "a" / "depth").rglob("scenex_000001_000000*"))
    victim.write_bytes(victim.read_bytes()[:50])
    run(tmp_path / "a")
    assert rendered == [0, 1, 2, 1, 2]


def test_a_complete_export_is_left_alone(unbroken, format):
    def times():
        return {path: path.stat().st_mtime_ns for path in unbroken.rglob("*") if path.is_file()}

    before = times()
    (unbroken / ".export" / "parts").mkdir(parents=True)  # a kill came before it was removed
    assert run(unbroken, format=format)["images"] == 5
    assert times() == before and not (unbroken / ".export").exists()


OTHERS = [
    ({"settings": TINY._replace(width=72)}, "render.width = 64, not 72"),
    ({"shots": 3, "images": 7}, "images = 5, not 7"),
    ({"format": "coco"}, "format = cityscapes, not coco"),
    ({"split": "val"}, "split = train, not val"),
    ({"pool": AssetPool(0, 3, 0.5)}, "assets.fraction = 1.0, not 0.5"),
    ({"units": UNITS[::-1]}, "other streets"),
    ({"streets": None}, "other attributes|attributes = "),
]


@pytest.mark.parametrize("finished", [True, False])
def test_an_export_of_other_settings_or_another_engine_is_kept(finished, tmp_path, monkeypatch):
    folder = tmp_path / "a"
    if finished:
        run(folder)
    else:
        with monkeypatch.context() as broken:
            broken.setattr(export, "_summarize", lambda *_: None)
            refused(FileNotFoundError, "", run, folder)
    before = tree(folder)
    for changes, message in OTHERS:
        refused(ExportError, f"{folder} holds an export with .*({message})", run, folder, **changes)
    with monkeypatch.context() as other:
        for name, version in (("numba", "0.1"), ("numpy", "0.2")):
            other.setattr(
                description, "versions", lambda *_, n=name, v=version: {**versions(), n: v}
            )
            refused(ExportError, f"versions.{name} = [0-9.]+, not {version}; use the", run, folder)
    monkeypatch.setattr(description, "ENGINE", ENGINE + 1)
    refused(ExportError, f"version {ENGINE}, but this is version {ENGINE + 1}; resume", run, folder)
    assert tree(folder) == before


def test_what_makes_no_picture_may_have_another_version(tmp_path, monkeypatch):
    first = run(tmp_path)
    libraries = {**versions(), "python": "3.99.0", "trimesh": "99"}
    monkeypatch.setattr(description, "versions", lambda *_: libraries)
    assert run(tmp_path) == first


def test_numbers_of_numpy_and_hidden_files_change_nothing(tmp_path):
    (tmp_path / ".DS_Store").write_bytes(b"of the system")
    numbers = {k: np.int64(OPTIONS[k]) for k in ("shots", "images")}
    size = TINY._replace(width=np.int64(64), height=np.int32(48), samples=np.int8(1))
    first = run(tmp_path, seed=np.int64(7), settings=size, **numbers)
    assert run(tmp_path) == first == described(tmp_path)
    assert len(read_dataset(str(tmp_path)).images) == 5


def test_other_folders_are_kept_and_a_second_process_is_kept_out(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    refused(ExportError, "holds other files, not an export", run, tmp_path)
    refused(ExportError, "is a file", run, tmp_path / "notes.txt")
    assert tree(tmp_path) == {"notes.txt": b"mine"}

    def second(*_):
        refused(ExportError, "in use by another export", run, tmp_path / "a")

    run(tmp_path / "a", progress=second)


def test_a_full_disk_is_named_and_the_same_call_continues(tmp_path, monkeypatch):
    room = iter(range(27))  # it ends in the second street

    class Full(io.FileIO):
        def write(self, data):
            if next(room, None) is None:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return super().write(data)

    monkeypatch.setattr(files, "open", Full, raising=False)
    caught = refused(OSError, "", run, tmp_path / "a")
    victim, work = Path(caught.filename), tmp_path / "a" / ".export"
    assert caught.errno == errno.ENOSPC
    assert victim.is_relative_to(tmp_path / "a") and not victim.exists()
    assert [len(list((work / name).iterdir())) for name in ("parts", "streets")] == [0, 1]
    monkeypatch.undo()
    for name in "ab":
        run(tmp_path / name)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_too_small_a_disk_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    def leave(free):
        usage = shutil._ntuple_diskusage(10**9, 10**9, free)
        monkeypatch.setattr(export.shutil, "disk_usage", lambda path: usage)

    leave(100_000)
    deep = tmp_path / "deep" / "a"
    refused(ExportError, r"needs about \d+ kB, but \d+ kB are free", run, deep)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    run(tmp_path / "a")
    leave(2 * sum(-(-len(data) // 4096) * 4096 for data in tree(tmp_path / "a").values()))
    run(tmp_path / "b")  # the estimate is not twice what it takes


@pytest.mark.parametrize(("changes", "message"), [
    ({"units": np.zeros((2, 22))}, "must have 23"),
    ({"images": 7}, "7 images do not fit 3 streets with 2 shots"),
    ({"images": 4}, "4 images do not fit 3 streets"),
    ({"split": "test"}, "unknown split 'test'; known: train, val"),
    ({"format": "voc"}, "unknown format 'voc'"),
    ({"pool": AssetPool(use="own")}, "needs a folder of own assets"),
])  # fmt: skip
def test_bad_arguments_are_refused_by_name(changes, message, tmp_path):
    refused(ValueError, message, run, tmp_path / "a", **changes)
    assert list(tmp_path.iterdir()) == []


def test_own_assets_travel_with_their_licences(shelf, tmp_path):
    folder = Path(shelf("car/box.obj", trimesh.creation.box((4, 1.8, 1.5)), author="Ada", up="z"))
    mesh, pool = folder / "car/box.obj", AssetPool(0, 3, own=str(folder))
    description = run(tmp_path / "a", pool=pool)
    [entry] = description["own_assets"]
    recorded = entry["author"], entry["licence"], description["assets"]["own"]
    assert recorded == ("Ada", "CC0-1.0", "own")
    assert (tmp_path / "a" / "assets.csv").read_bytes() == (folder / "assets.csv").read_bytes()
    mesh.write_text("# another\n" + mesh.read_text())
    refused(ExportError, "other own_assets", run, tmp_path / "a", pool=pool)


def test_the_command_line_exports_and_reports(tmp_path, printed):
    first, second, file = (tmp_path / name for name in ("a", "b", "attributes.json"))
    lines = printed(main, *FLAGS, first, "--attributes", "random", "--shots", 1).splitlines()
    assert lines[0].startswith("[  0 %] 0 of 2 images | 0.0 MB")
    assert lines[1].startswith("[ 50 %] 1 of 2 images | ") and lines[1].endswith(" left")
    assert "2 images of 2 streets, one per street, in " in lines[-2] and "dataset.json" in lines[-2]
    assert lines[-1] == f"Contact sheet: {first / 'index.jpg'}" and (first / "index.jpg").exists()
    file.write_text(json.dumps(described(first)["attributes"]))
    printed(main, *FLAGS, second, "--attributes", file, "--shots", 1)
    assert tree(first) == tree(second)


def test_the_command_line_draws_from_probabilities(tmp_path, printed):
    rows = np.random.default_rng(0).dirichlet(np.ones(5), len(NAMES)).astype(np.float32)
    streets, file = Histogram(rows), tmp_path / "attributes.json"
    file.write_text(json.dumps(describe(streets)))
    folders = [tmp_path / "a", tmp_path / "b"]
    printed(main, *FLAGS, folders[0], "--attributes", file, "--shots", 1, "--seed", 3)
    description = described(folders[0])
    np.testing.assert_array_equal(np.array(description["streets"], np.float32), draw(streets, 3, 2))
    probabilities = [description["attributes"][name]["probabilities"] for name in NAMES]
    assert np.array(probabilities, np.float32).tobytes() == rows.tobytes()
    file.write_text(json.dumps(description["attributes"]))
    printed(main, *FLAGS, folders[1], "--attributes", file, "--shots", 1, "--seed", 3)
    assert tree(folders[0]) == tree(folders[1])


def test_the_command_line_holds_what_is_known(tmp_path, printed):
    fix = ["--space", "extended", "--fix", "field_of_view=90", "--fix", "camera_position_y=1.4"]
    output = printed(main, *FLAGS, tmp_path / "a", "--attributes", "mixed", "--shots", 1, *fix)
    assert "Fixed: camera_position_y 1.4 m, field_of_view 90 deg" in output
    description = described(tmp_path / "a")
    for name, value in (("field_of_view", 90), ("camera_position_y", 1.4)):
        units = [street[names("extended").index(name)] for street in description["streets"]]
        assert [BY_NAME[name].physical(unit) for unit in units] == pytest.approx([value] * 2)
        assert [
            c["attributes"][name]["width"] for c in description["attributes"]["components"]
        ] == [0, 0]


@pytest.mark.parametrize(("flags", "message"), [
    ("--fix field_of_view=90", "space scenex has no attribute field_of_view; space extended does"),
    ("--images 0", "--images must lie in 1..10,000,000, not 0"),
    ("--size 0x48", "image size 0x48 is too small"),
    ("--size 64", "argument --size: must look like 640x320, not '64'"),
    ("--seed -1", "--seed must lie in 0..4294967295, not -1"),
    ("--shots 0", "--shots must be 1 or more, not 0"),
    ("--images 9000000 --shots 1000000000", "--shots 1000000000 would take 67.6 TB of memory for the"),
    ("--workers 1000000", "--workers 1000000 would take 100 TB of memory for processes"),
    ("--workers -1", "--workers must be 0 or more"),
    ("--samples 99", "samples must lie in 1..8"), ("--format voc", "parquet, not 'voc'"),
    ("--split test", "train, val, not 'test'"),
    ("--asset-fraction 0", "asset fraction must lie in (0, 1], not 0.0"),
    ("--assets nowhere", "nowhere does not exist; expected the folder of your own assets"),
    ("--attributes defualt", "defualt: no such file; expected default, random, mixed, or a JSON file such as "
     "a run's attributes.json; did you mean default?"),
    ("--attributes .", ".: not a file; expected default, random, mixed, or a JSON file"),
    ("--attributes garbled.json", "garbled.json is not a JSON file"),
    ("--attributes list.json", "list.json: expected a JSON object"),
    ("--attributes unknown.json", "unknown.json: unknown attribute 'car_speed'"),
    ("--attributes outside.json", "outside.json: attribute car_position is 1.01"),
    ("--attributes nan.json", "nan.json is not a JSON file: NaN"),
])  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_two(flags, message, tmp_path, refusal, monkeypatch):
    start = json.dumps(dict.fromkeys(NAMES, 0.5))[:-1]
    ends = {"unknown": '"car_speed": 0.5}', "outside": '"car_position": 1.01}',
            "nan": '"car_position": NaN}', "garbled": '"car_position": '}  # fmt: skip
    texts = {name: f"{start}, {end}" for name, end in ends.items()}
    for name, text in {**texts, "list": "[]"}.items():
        (tmp_path / f"{name}.json").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert message in refusal(main, *FLAGS, "a", *flags.split())
    assert len(list(tmp_path.iterdir())) == 5
