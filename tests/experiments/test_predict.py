"""`sdr-jax predict`: label pictures of images and videos, killed and continued, refused in one line."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from common.errors import UserError
from experiments.app.predict import main, predict
from seg.data import DataError
from seg.data.frames import frames, list_sources
from seg.data.images import read_image
from seg.model import Model, label_classes
from seg.settings import TrainSettings
from seg.train import train
from tests.conftest import refused

from .conftest import ROOT

CLASSES = label_classes(["road", "sky"], ids=[7, 23], colors=[(128, 64, 128), (70, 130, 180)])
SETTINGS = TrainSettings(steps=2, batch=2, warmup=1, predict_batch=2)
SHAPES = {"b": (20, 30), "a/x": (31, 9), "a/y": (16, 24), "c": (5, 5)}


@pytest.fixture(scope="module")
def model() -> Model:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (2, 16, 24, 3), np.uint8)
    labels = (images[..., 0] > 127).astype(np.uint8)
    return Model(SETTINGS, train(0, images, labels, SETTINGS, 2), (16, 24), CLASSES)


@pytest.fixture
def folder(model, tmp_path) -> str:
    model.save(tmp_path / "model")
    return str(tmp_path / "model")


@pytest.fixture
def images(tmp_path) -> Path:
    rng = np.random.default_rng(1)
    for name, shape in SHAPES.items():
        path = tmp_path / "images" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(rng.integers(0, 256, (*shape, 3), np.uint8)).save(path)
    (tmp_path / "images" / "list.txt").write_text("not an image")
    return tmp_path / "images"


def video(path: Path, count: int = 5) -> None:
    kind = cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), kind, 10, (48, 32))
    for k in range(count):
        writer.write(np.full((32, 48, 3), 50 * k, np.uint8))
    writer.release()


def pictures(out: Path) -> dict[str, np.ndarray]:
    paths = sorted(out.rglob("*.png"))
    return {
        str(path.relative_to(out).with_suffix("")): np.asarray(Image.open(path)) for path in paths
    }


def one_line(capsys) -> str:
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    return line


def test_each_image_gets_labels_of_its_size(model, folder, images, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([folder, str(images), "--out", str(out)]) == 0
    output = capsys.readouterr().out.splitlines()
    assert (
        output[-1] == f"{out}: labels of 4 images as ids; classes: road, sky"
        and "left" in output[0]
    )
    labels_by_name = pictures(out)
    assert labels_by_name.keys() == SHAPES.keys()
    for name, shape in SHAPES.items():
        (labels,) = model.predict([read_image(images / f"{name}.png")])
        np.testing.assert_array_equal(labels_by_name[name], np.where(labels == 0, 7, 23))
        assert labels_by_name[name].shape == shape


def test_photographs_that_are_not_read_are_counted(folder, images, tmp_path, capsys):
    for name in ("x.HEIC", "y.heic", "z.avif", "w.jp2"):
        (images / name).touch()
    assert main([folder, str(images), "--out", str(tmp_path / "out")]) == 0
    output = capsys.readouterr().out
    assert "cannot read 2 .heic, 1 .avif, 1 .jp2: convert them to JPEG or PNG" in output
    (tmp_path / "phone").mkdir()
    (tmp_path / "phone" / "x.heic").touch()
    assert main([folder, str(tmp_path / "phone"), "--out", str(tmp_path / "none")]) == 2
    assert "expected .png, .jpg" in (error := capsys.readouterr().err)
    assert "cannot read 1 .heic" in error


def test_colours_overlays_and_probabilities(model, images, tmp_path, monkeypatch):
    image = read_image(images / "b.png")
    (labels,) = model.predict([image])
    colours = np.array([label.color for label in CLASSES])[labels]
    assert predict(model, images / "b.png", tmp_path / "c", "colours", probabilities=True) == 1
    np.testing.assert_array_equal(pictures(tmp_path / "c")["b"], colours)
    likely = np.load(tmp_path / "c" / "b.npy")
    assert likely.shape == (20, 30, 2) and likely.dtype == np.float16
    (expected,) = model.probabilities([image])
    np.testing.assert_allclose(likely, expected, atol=1e-3)
    counts, all_at_once = [], Model.probabilities
    monkeypatch.setattr(
        Model,
        "probabilities",
        lambda self, some: counts.append(len(some)) or all_at_once(self, some),
    )
    predict(model, images, tmp_path / "p", probabilities=True)
    assert set(counts) == {1} and len(counts) > 1  # those of a batch may not fit into memory
    predict(model, images / "b.png", tmp_path / "o", "overlay")
    middle = (image.astype(float) + colours) / 2
    assert np.abs(pictures(tmp_path / "o")["b"] - middle).max() <= 0.5
    as_colours = replace(model, written="colours")
    predict(as_colours, images / "b.png", tmp_path / "d")
    np.testing.assert_array_equal(pictures(tmp_path / "d")["b"], colours)


def test_what_is_there_is_kept_and_only_the_rest_is_made(model, folder, images, tmp_path):
    whole, out = tmp_path / "whole", tmp_path / "out"
    predict(model, images, whole)
    predict(model, images, out)
    unchanged, removed = out / "a" / "x.png", out / "b.png"
    unchanged.write_bytes(b"as it was")
    removed.unlink()
    (out / "b.png.part").write_bytes(b"half")  # as a kill leaves it
    assert predict(folder, images, out) == 4
    assert unchanged.read_bytes() == b"as it was"
    assert removed.read_bytes() == (whole / "b.png").read_bytes()
    assert not list(out.rglob("*.part"))


def test_killed_at_any_time_it_goes_on(model, folder, tmp_path):
    images, out = tmp_path / "many", tmp_path / "out"
    images.mkdir()
    for k in range(40):
        Image.fromarray(np.full((200, 200, 3), 6 * k, np.uint8)).save(images / f"{k:02d}.png")
    words = [
        sys.executable,
        "-m",
        "experiments",
        "predict",
        folder,
        str(images),
        "--out",
        str(out),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    process = subprocess.Popen(words, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
    while len(finished := list(out.rglob("*.png"))) < 5:
        assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(finished) < 40
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.png")}
    assert predict(folder, images, out) == 40
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())
    predict(model, images, tmp_path / "whole")
    resumed, whole = pictures(out), pictures(tmp_path / "whole")
    assert resumed.keys() == whole.keys()
    assert all(np.array_equal(resumed[name], whole[name]) for name in resumed)


def test_a_video_gives_a_picture_of_each_frame(model, tmp_path):
    video(tmp_path / "drive.avi")
    (source,) = list_sources(tmp_path / "drive.avi")
    read = [frame.image for frame in frames(source, lambda name: False)]
    assert source.frames == 5 and [round(i.mean() / 50) for i in read] == [0, 1, 2, 3, 4]
    out = tmp_path / "out"
    assert predict(model, tmp_path / "drive.avi", out) == 5
    assert list(pictures(out)) == [f"drive/{k:06d}" for k in range(5)]
    before = pictures(out)["drive/000003"]
    np.testing.assert_array_equal(before, model.painted(model.predict([read[3]])[0]))
    (out / "drive" / "000003.png").unlink()
    assert predict(model, tmp_path / "drive.avi", out) == 5
    np.testing.assert_array_equal(pictures(out)["drive/000003"], before)


def test_a_video_without_frames_and_files_that_are_no_images(folder, tmp_path, capsys):
    (tmp_path / "drive.mp4").write_bytes(b"nothing")
    assert main([folder, str(tmp_path / "drive.mp4"), "--out", str(tmp_path / "out")]) == 2
    assert "drive.mp4: OpenCV cannot read this video, or it has no frames" in one_line(capsys)
    (tmp_path / "photo.jpg").write_bytes(b"nothing")
    assert main([folder, str(tmp_path / "photo.jpg"), "--out", str(tmp_path / "other")]) == 2
    assert "photo.jpg: not a readable image" in one_line(capsys)
    (tmp_path / "notes.txt").write_bytes(b"nothing")
    assert main([folder, str(tmp_path / "notes.txt"), "--out", str(tmp_path / "none")]) == 2
    assert "notes.txt: not an image or video; expected .png, " in one_line(capsys)
    with pytest.raises(SystemExit, match="2"):
        main([folder, str(tmp_path), "--out", str(tmp_path / "none"), "--as", "x"])
    assert "--as: must be one of ids, colours, overlay, not 'x'" in capsys.readouterr().err
    assert not any((tmp_path / name).exists() for name in ("out", "other", "none"))


def test_a_broken_video_is_one_line_of_the_whole_process(tmp_path):
    """FFmpeg writes its lines past Python, once a process has opened a video."""
    (tmp_path / "drive.mp4").write_bytes(b"nothing")
    words = f"from seg.data.frames import list_sources; list_sources({str(tmp_path)!r})"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""


@pytest.mark.parametrize("rank", [[], ["--rank"]])
def test_broken_files_are_named_once_all_others_have_labels(rank, folder, images, tmp_path, capsys):
    files = ["a/w.jpg", "a/z.jpg"] if rank else ["a/w.mp4", "a/z.jpg"]
    out, names = tmp_path / "out", [images / file for file in files]
    for name in names:
        name.write_bytes(b"junk")
    for _ in range(2):  # the same command finds the same
        assert main([folder, str(images), "--out", str(out), *rank]) == 1
        expected = f"error: {out}: labels of 4 images; 2 broken files: {names[0]}, {names[1]}"
        assert one_line(capsys) == expected and pictures(out).keys() == SHAPES.keys()
    if rank:
        assert len((out / "ranking.csv").read_text().splitlines()) == 1 + 4


def test_folders_that_cannot_be_read_or_written(model, folder, images, tmp_path, capsys):
    refused(DataError, "no such file or folder", list_sources, tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    refused(
        DataError,
        "no images or videos; expected .png",
        list_sources,
        tmp_path / "empty",
    )
    refused(UserError, "is inside", predict, model, images, images / "out")
    (images / "b.jpg").write_bytes(b"")
    refused(DataError, "b.png and .*b.jpg have the same name; rename one", list_sources, images)
    (images / "b.jpg").unlink()
    video(images / "drive.avi", 1)
    (images / "drive").mkdir()
    (images / "b.png").rename(images / "drive" / "000000.png")
    refused(
        DataError,
        "000000.png: its folder is named like the video .*drive.avi",
        list_sources,
        images,
    )
    (images / "drive" / "000000.png").rename(images / "b.png")
    (images / "drive.avi").unlink()
    (images / "drive").rmdir()
    out = tmp_path / "out"
    predict(model, images, out)
    assert main([folder, str(images), "--out", str(out), "--as", "overlay"]) == 2
    assert 'holds a run with as = "ids", not "overlay"' in one_line(capsys)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letter.txt").write_text("dear")
    assert main([folder, str(images), "--out", str(tmp_path / "other")]) == 2
    assert "contains other files" in one_line(capsys)
    assert main([str(tmp_path / "other"), str(images), "--out", str(tmp_path / "new")]) == 2
    assert "other is not a model: pass a folder with config.json" in one_line(capsys)
    assert main(["rendres19", str(images), "--out", str(tmp_path / "new")]) == 2
    assert one_line(capsys).endswith("or renders19; did you mean renders19?")
    assert not (tmp_path / "new").exists()
