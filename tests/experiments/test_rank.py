"""`sdr-jax predict --rank`: the ranking, and files that annotation tools import."""

import csv
import io
import json
import zipfile
from dataclasses import replace
from urllib.parse import parse_qs, urlsplit
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from PIL import Image

from experiments.app.predict import main, predict
from experiments.app.prelabels import cvat, label_studio
from experiments.app.prelabels.files import Ranked, write_files
from seg.data.images import read_image
from seg.model import label_classes
from seg.uncertainty import order as in_order
from seg.uncertainty import uncertainty

from .test_predict import SHAPES, folder, images, model, one_line, video

__all__ = ["folder", "images", "model"]  # fixtures
NAMES = ["b/w road: old", "sky"]
CLASSES = label_classes(NAMES, ids=[7, 40000], colors=[(128, 64, 128), (70, 130, 180)])


def unpacked(rle: list[int]) -> np.ndarray:
    """Decode the bytes of runs, by the description of rle-pack."""
    bits = np.unpackbits(np.array(rle, np.uint8))
    position = 0

    def read(count: int) -> int:
        nonlocal position
        position += count
        return int("".join(map(str, bits[position - count : position])), 2)

    values: list[int] = []
    total, word = read(32), read(5) + 1
    sizes = [read(4) + 1 for _ in range(4)]
    while len(values) < total:
        same = read(1)
        length = read(sizes[read(2)]) + 1
        values += [read(word)] * length if same else [read(word) for _ in range(length)]
    assert len(bits) - position < 8 and len(values) == total
    return np.array(values, np.uint8)


def colors_in(label_map: str) -> dict[tuple[int, ...], str]:
    """Names by colour, as CVAT's documentation describes the file."""
    lines = [line for line in label_map.splitlines() if line and not line.startswith("#")]
    rows = [line.split(":") for line in lines]
    assert all(len(row) == 4 and row[2:] == ["", ""] for row in rows)
    return {tuple(map(int, color.split(","))): name for name, color, *_ in rows}


@pytest.mark.parametrize("mask", [
    np.zeros((3, 5), bool), np.ones((300, 200), bool), np.eye(40, dtype=bool),
    np.random.default_rng(0).random((31, 17)) < 0.5,
])  # fmt: skip
def test_a_brush_mask_is_the_pictures_four_channels(mask):
    channels = unpacked(label_studio.runs(mask)).reshape(*mask.shape, 4)
    np.testing.assert_array_equal(channels, np.repeat(255 * mask[..., None], 4, axis=-1))


def test_names_in_the_ranking_have_no_control_characters(model, tmp_path):
    row = Ranked("x", "a/x\x1b[31m.png", 0.5, tmp_path / "x.png")
    write_files(tmp_path, [row], 0, model)
    (_, cells) = csv.reader(io.StringIO((tmp_path / "ranking.csv").read_text()))
    assert cells == ["1", r"a/x\x1b[31m.png", "0.500000"]


def test_images_are_in_order_and_their_labels_in_the_files_of_both_tools(
    model, images, tmp_path, capsys
):
    model = replace(model, classes=CLASSES)
    model.save(tmp_path / "model")
    arguments = [str(tmp_path / "model"), str(images), "--rank", "--first", "3", "--out"]
    out = tmp_path / "out"
    assert main([*arguments, str(out)]) == 0
    assert "cvat.zip and label_studio.json: pre-labels of the first 3" in capsys.readouterr().out
    head, *rows = csv.reader(io.StringIO((out / "ranking.csv").read_text()))
    assert head == ["rank", "image", "uncertainty"] and len(rows) == len(SHAPES)
    files = sorted(SHAPES)
    uncertainties = [
        uncertainty(scores)
        for name in files
        for scores, _ in model._scores([read_image(images / f"{name}.png")])
    ]
    values = dict(zip(files, (score.margin for score in uncertainties), strict=True))
    order = [files[k] for k in in_order(uncertainties, 3)]
    assert values[order[0]] == max(values.values())
    assert [row[1] for row in rows] == [f"images/{name}.png" for name in order]
    assert [float(row[2]) for row in rows] == pytest.approx([values[n] for n in order], abs=1e-6)
    expected = {n: model.predict([read_image(images / f"{n}.png")])[0] for n in order[:3]}

    with zipfile.ZipFile(out / "cvat.zip") as file:
        assert file.read("ImageSets/Segmentation/default.txt").decode().split() == order[:3]
        name_of = colors_in(file.read("labelmap.txt").decode())
        assert name_of.pop((0, 0, 0)) == "background" and len(name_of) == 2
        for name, labels in expected.items():
            classes = np.asarray(Image.open(file.open(f"SegmentationClass/{name}.png")))
            for index, class_name in enumerate(("b/w road old", "sky")):
                (color,) = (c for c, listed in name_of.items() if listed == class_name)
                np.testing.assert_array_equal((classes == color).all(axis=-1), labels == index)
            objects = np.asarray(Image.open(file.open(f"SegmentationObject/{name}.png")))
            counts = [len(np.unique(p.reshape(-1, 3), axis=0)) for p in (classes, objects)]
            assert counts[0] == counts[1]
    raw = json.loads((out / "cvat_labels.json").read_text())
    assert [entry["name"] for entry in raw] == ["b/w road old", "sky"]
    assert {tuple(bytes.fromhex(entry["color"][1:])) for entry in raw} == set(name_of)

    tasks = json.loads((out / "label_studio.json").read_text())
    view = ElementTree.parse(out / "label_studio.xml").getroot()
    brush, image = view.find("BrushLabels"), view.find("Image")
    assert [label.get("value") for label in brush] == NAMES
    scores = [task["predictions"][0]["score"] for task in tasks]
    assert scores == pytest.approx([1 - values[name] for name in order[:3]], abs=1e-5)
    for name, task in zip(order, tasks, strict=False):
        where = parse_qs(urlsplit(task["data"][image.get("value")[1:]]).query)["d"]
        assert where == [f"images/{name}.png"]
        labels = np.full(SHAPES[name], 255)
        for region in task["predictions"][0]["result"]:
            assert (region["from_name"], region["to_name"]) == (
                brush.get("name"),
                image.get("name"),
            )
            assert brush.get("toName") == image.get("name") and region["type"] == "brushlabels"
            size = region["original_height"], region["original_width"]
            on = unpacked(region["value"]["rle"]).reshape(*size, 4)[..., 3] == 255
            labels[on] = NAMES.index(region["value"]["brushlabels"][0])
        np.testing.assert_array_equal(labels, expected[name])
    assert len(tasks) == 3


def test_a_stopped_ranking_resumes_and_ends_the_same(model, images, tmp_path):
    whole, out = tmp_path / "whole", tmp_path / "out"
    predict(model, images, whole, rank=2)
    predict(model, images, out, rank=2)
    lines = (out / "scores.jsonl").read_text().splitlines(keepends=True)
    (out / "scores.jsonl").write_text("".join(lines[:2]) + lines[2][:20])  # as a kill leaves it
    (out / "ranking.csv").unlink()
    (out / f"{json.loads(lines[0])['name']}.png").unlink()
    assert predict(model, images, out, rank=2) == 4
    for name in ("ranking.csv", "cvat.zip", "label_studio.json", "a/x.png"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    predict(model, images, out, rank=4)  # only adds pre-labels
    assert len(json.loads((out / "label_studio.json").read_text())) == 4


def test_colours_that_a_mask_could_not_tell_apart_are_replaced():
    same = label_classes(["a", "background"], colors=[(0, 0, 0), (9, 9, 9)])
    names = colors_in(cvat.label_map(same))
    assert len(names) == 2 and (0, 0, 0) not in names and set(names.values()) == {"a", "background"}
    assert cvat.colors_of(CLASSES) == [row.color for row in CLASSES]


def test_what_cannot_be_ranked_is_one_line(folder, images, tmp_path, capsys):
    out = tmp_path / "out"
    words = [folder, str(images), "--rank", "--out", str(out)]
    for flags, message in (
        (
            ["--as", "overlay"],
            "--rank writes label images of ids; leave out --as overlay",
        ),
        (["--probabilities"], "leave out --probabilities"),
        (["--first", "0"], "--first must be at least 1, not 0"),
    ):
        assert main([*words, *flags]) == 2
        assert message in one_line(capsys)
    for first in ("0", "5"):  # without --rank it would do nothing
        with pytest.raises(SystemExit, match=r"^2$"):
            main([folder, str(images), "--out", str(out), f"--first={first}"])
        assert capsys.readouterr().err.endswith("error: --first needs --rank\n")
    video(tmp_path / "drive.avi")
    assert main([folder, str(tmp_path / "drive.avi"), "--rank", "--out", str(out)]) == 2
    assert "drive.avi is a video; extract its frames" in one_line(capsys)
    assert not out.exists()
    assert main(words) == 0
    (out / "b.png").write_bytes(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes())
    capsys.readouterr()
    assert main(words) == 2
    assert "b.png is damaged; remove it, and run the same command again" in one_line(capsys)
    (out / "scores.jsonl").write_text("{}\n")
    assert main(words) == 2
    assert "scores.jsonl: line 1 is not a score" in one_line(capsys)
