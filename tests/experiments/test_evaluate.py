"""`sdr-jax evaluate`: counts by hand, groups, classes of the engine, the worst images, what is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.errors import UserError
from common.files import file_digest
from common.labels.target_file import shipped
from experiments.app.evaluate import Labelled, evaluate, labelled, main, mapping, text
from seg.classes import CAMVID_11, LABELMEFACADE_6
from seg.data import DataError, Entry
from seg.model import SEEN, Model, classes_of, label_classes
from seg.settings import TrainSettings
from seg.train import train
from tests.conftest import refused

SETTINGS = TrainSettings(steps=1, batch=2, warmup=0, predict_batch=2)
NAMES = ("road", "sky", "car")


class Red(Model):
    """Takes the red of a pixel for its class."""

    def predict(self, images, among=None):
        return [image[..., 0] for image in images]


@pytest.fixture
def red() -> Red:
    return Red(SETTINGS, {}, (4, 6), label_classes(NAMES))


def entry(name: str, group: str) -> Entry:
    return Entry(name, group, Path(f"{name}.png"), Path(f"{name}.png"))


TRUTH = {
    "a": [[0, 0, 1, 1], [0, 0, 1, 255]],
    "b": [[0, 0, 0], [1, 1, 1]],
}
PREDICTED = {
    "a": [[0, 0, 1, 0], [0, 0, 1, 0]],  # one of the three pixels of sky is taken for road
    "b": [[0, 2, 2], [1, 1, 1]],  # two of the three of road for cars
}


def read(image: Entry) -> tuple[np.ndarray, np.ndarray]:
    pixels = np.array(PREDICTED[image.name], np.uint8)
    return np.stack([pixels, pixels, pixels], axis=-1), np.array(TRUTH[image.name], np.uint8)


DATA = Labelled(
    NAMES, np.array([(9, 9, 9), (50, 60, 70), (0, 0, 1)], np.uint8), np.full(19, 255, np.uint8),
    (entry("a", "one"), entry("b", "two")), read,
)  # fmt: skip


def test_two_images_by_hand(red, tmp_path):
    scores = evaluate(red, DATA, tmp_path / "worst")
    assert scores["confusion"] == {
        "classes": list(NAMES), "pixels": [[5, 0, 2], [1, 5, 0], [0, 0, 0]],
    }  # fmt: skip
    # Road: 5 of 5 + 2 + 1; sky: 5 of 5 + 1. No car is there.
    assert scores["classes"] == {"road": 62.5, "sky": 83.33, "car": None}
    assert scores["miou"] == 72.92 and scores["absent"] == ["car"] and scores["images"] == 2
    first, second = scores["groups"]["one"], scores["groups"]["two"]
    assert first["classes"] == {"road": 80.0, "sky": 66.67, "car": None} and first["images"] == 1
    assert second["classes"] == {"road": 33.33, "sky": 100.0, "car": None}
    # Strips of one pixel are all of images of two rows.
    assert scores["boundary_iou"]["classes"] == scores["classes"]
    assert [image["name"] for image in scores["worst"]] == ["b", "a"]
    assert scores["worst"][0] == {
        "name": "b", "group": "two", "miou": 66.67, "picture": "worst_1.png",
    }  # fmt: skip
    row = np.asarray(Image.open(tmp_path / "worst" / "worst_1.png"))
    image, truth, prediction = np.split(row, 3, axis=1)
    np.testing.assert_array_equal(image, read(DATA.entries[1])[0])
    np.testing.assert_array_equal(truth, DATA.colors[TRUTH["b"]])
    np.testing.assert_array_equal(prediction, DATA.colors[PREDICTED["b"]])
    again = evaluate(red, DATA._replace(entries=DATA.entries[:1]), tmp_path / "worst")
    assert len(again["worst"]) == len(list((tmp_path / "worst").iterdir())) == 1


def test_columns_are_aligned_whatever_the_names(red):
    classes = ("road", "sky of many clouds and birds", "car")
    lines = text(
        evaluate(replace(red, classes=label_classes(classes)), DATA._replace(classes=classes))
    )
    table = lines.splitlines()[:4]
    assert [line.split()[0] for line in table] == ["IoU", "road", "sky", "mean"]
    assert len({*map(len, table)}) == 1


def test_classes_in_another_order_are_brought_to_those_of_the_data(red):
    among, table = mapping(replace(red, classes=label_classes(("sky", "car", "road"))), DATA)
    assert among == [0, 1, 2] and table[:4].tolist() == [1, 2, 0, 255]


@pytest.mark.parametrize(("table", "gone"), [(CAMVID_11, 1), (LABELMEFACADE_6, 8)])
def test_the_engines_classes_are_brought_to_those_of_the_data(table, gone, red):
    data = DATA._replace(classes=table.classes, of_engine=table.from_train_id[:19])
    among, indices = mapping(replace(red, classes=classes_of(shipped("cityscapes"))), data)
    assert len(among) == 19 - gone
    np.testing.assert_array_equal(indices[:19], table.from_train_id[:19])


def test_a_model_of_other_classes_is_refused(red):
    message = "the model has a, b, c; the data have road, sky, car"
    refused(UserError, message, evaluate, replace(red, classes=label_classes("abc")), DATA)


@pytest.mark.parametrize("names", [("sky", "road", "tree"), ("sky", "road")])
def test_a_model_of_some_of_the_classes_is_tested_on_all(names, red):
    data = DATA._replace(of_engine=np.full(19, 255, np.uint8))
    among, table = mapping(replace(red, classes=label_classes(names)), data)
    assert among == [0, 1] and table[:4].tolist() == [1, 0, 255, 255]


@pytest.fixture(scope="module")
def model() -> Model:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (2, 12, 16, 3), np.uint8)
    labels = rng.integers(0, 11, (2, 12, 16), np.uint8)
    return Model(
        SETTINGS, train(0, images, labels, SETTINGS, 11), (12, 16), classes_of(shipped("camvid"))
    )


def test_the_command_writes_what_the_function_returns(model, camvid, tmp_path, capsys):
    model.save(tmp_path / "model")
    file = tmp_path / "scores.json"
    flags = ["--target", "camvid", "--split", "train", "test", "--group", "B", "--json", str(file)]
    assert main([str(tmp_path / "model"), str(camvid), *flags]) == 0
    scores = json.loads(file.read_text())
    data = labelled("camvid", camvid, ("train", "test"), ("B",))
    assert [image.name for image in data.entries] == ["B_1", "B_2", "B_8"]
    expected = evaluate(model, data)
    assert {key: scores[key] for key in expected} == expected
    assert scores["images"] == 3 and list(scores["groups"]) == ["B"]
    assert scores["splits"] == ["train", "test"] and labelled("camvid", camvid).splits == ("test",)
    output = capsys.readouterr().out
    assert re.search(rf"^mean +{scores['miou']:.2f} ", output, re.MULTILINE) and str(file) in output


def test_images_that_the_net_was_trained_on_are_counted_and_told(model, camvid, tmp_path, capsys):
    file, flags = tmp_path / "f", "--target camvid --split train test --group B".split()
    files = [file_digest(camvid / "train" / f"{name}.png") for name in ("B_1", "B_2")]
    for digests, count in ((files, 2), (files[:1], 1), (["0" * 64], 0), (7, 0)):
        replace(model, notes={SEEN: digests}).save(tmp_path / "model")
        assert main([str(tmp_path / "model"), str(camvid), *flags, "--json", str(file)]) == 0
        assert json.loads(file.read_text())["trained_on"] == count
        sentence = f"The model was trained on {count} of these 3 images, so these scores are higher"
        assert (sentence in capsys.readouterr().out) == bool(count)


def test_labels_at_their_own_size_and_predictions_at_the_images(model, camvid):
    for path in (camvid / "test" / "B_8.png", camvid / "testannot" / "B_8.png"):
        Image.open(path).resize((48, 36), Image.Resampling.NEAREST).save(path)
    scores = evaluate(model, labelled("camvid", camvid))
    assert np.sum(scores["confusion"]["pixels"]) == 48 * 36 + 12 * 16


TARGET = """
images: photographs/{name}.png
labels: ids/{name}.png
group: "^[a-z]+"
classes:
  ground: {ids: [3, 4], renders: [road, sidewalk]}
  shop: {ids: [9]}
"""


def test_a_folder_with_a_target_file_and_a_net_of_the_engines_classes(tmp_path):
    (tmp_path / "target.yaml").write_text(TARGET)
    red = Red(SETTINGS, {}, (4, 6), classes_of(shipped("cityscapes")))
    for name in ("up1", "up2", "down1"):
        image, ids = np.zeros((2, 3, 3), np.uint8), np.array([[3, 4, 9], [4, 4, 9]], np.uint8)
        image[..., 0] = [[0, 1, 1], [0, 0, 0]]  # road and sidewalk
        for folder, pixels in (("photographs", image), ("ids", ids)):
            (tmp_path / folder).mkdir(exist_ok=True)
            Image.fromarray(pixels).save(tmp_path / folder / f"{name}.png")
    data = labelled(str(tmp_path / "target.yaml"), tmp_path)
    assert data.splits == ("train",)
    text = TARGET + "splits: {train: train.txt, val: val.txt}\n"
    (tmp_path / "splits.yaml").write_text(text)
    (tmp_path / "train.txt").write_text("up1\nup2\n")
    (tmp_path / "val.txt").write_text("down1\n")
    assert labelled(str(tmp_path / "splits.yaml"), tmp_path).splits == ("val",)
    assert mapping(red, data)[0] == [0, 1]
    scores = evaluate(red, data)
    # All is taken for ground: 4 of 6 pixels of each image are; no net of renders knows a shop.
    assert scores["classes"] == {"ground": 66.67, "shop": 0.0} and scores["miou"] == 33.33
    assert {k: group["images"] for k, group in scores["groups"].items()} == {"down": 1, "up": 2}


def test_what_cannot_be_scored_is_refused(model, red, camvid, tmp_path, capsys):
    refused(
        UserError,
        "--target mars: no such file; expected a file, or one of camvid",
        labelled,
        "mars",
        camvid,
    )
    message = "--group Z: split .* has no such group; it has B, C"
    refused(UserError, message, labelled, "camvid", camvid, (), ("Z",))
    refused(UserError, "no split 'x'", labelled, "camvid", camvid, ("x",))
    unlabelled = DATA._replace(read=lambda image: (read(image)[0], np.full((2, 4), 255, np.uint8)))
    unlabelled = unlabelled._replace(entries=unlabelled.entries[:1])
    refused(UserError, "all labels are ignored pixels", evaluate, red, unlabelled)
    Image.open(camvid / "testannot" / "B_8.png").resize((9, 9)).save(
        camvid / "testannot" / "B_8.png"
    )
    refused(
        DataError,
        "B_8.png: 9x9 pixels, but its image",
        evaluate,
        model,
        labelled("camvid", camvid),
    )
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("dear")
    refused(
        UserError, "has other files, such as letter.txt", evaluate, red, DATA, tmp_path / "full"
    )
    message = "--split train train has a value twice"
    refused(UserError, message, labelled, "camvid", camvid, ("train", "train"))
    model.save(tmp_path / "model")
    words = [str(tmp_path / "model"), str(camvid), "--json"]
    assert main([*words, str(tmp_path)]) == 2
    assert main([*words, str(tmp_path / "no" / "s.json")]) == 2
    assert main([*words, str(tmp_path / "s.json"), "--target", "mars"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and "is a folder; name a file" in lines[0] and "mars" in lines[2]
    assert f"no folder {tmp_path / 'no'}; create it" in lines[1]
    assert not (tmp_path / "s.json").exists()
