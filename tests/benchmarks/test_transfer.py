"""The transfer benchmark: which images it reads, what it shows the nets, and its tables."""

import json
import math
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.transfer import tables
from benchmarks.transfer.__main__ import main
from benchmarks.transfer.recipe import BLOCKS, Recipe, held_out, real_images, sides
from common.errors import UserError
from seg.pyramid import check_features
from tests.experiments.conftest import write_pair

CLASSES = ("sky", "road", "car")
TINY = Recipe("", width=32, height=32, samples=2, streets=1, shots=2)


def write_image(root, split, name):
    paths = (root / folder / f"{name}.png" for folder in (split, f"{split}annot"))
    write_pair(*paths, seed=crc32(name.encode()), highest=10)


@pytest.fixture
def camvid(tmp_path):
    """All splits; of the sequence and the split that decide nothing there are only broken files."""
    root = tmp_path / "camvid"
    for name in ("0001TP_1", "0001TP_2", "0016E5_1", "0006R0_1"):
        write_image(root, "train", name)
    write_image(root, "val", "0016E5_0")
    write_image(root, "test", "0001TP_3")
    for name in ("train/0006R0_1", "trainannot/0006R0_1", "test/0001TP_3", "testannot/0001TP_3"):
        (root / f"{name}.png").write_bytes(b"not an image")
    return root


def test_the_drive_that_results_are_reported_on_is_never_read(camvid):
    recipe = TINY._replace(data=str(camvid), target="camvid", holdout="0006R0")
    images = real_images(recipe)
    assert images.names == ("0001TP_1", "0001TP_2", "0016E5_1", "0016E5_0")
    assert images.images.shape == (4, 32, 32, 3)
    with pytest.raises(UserError, match="--holdout 0005VD is not a group of the training images"):
        real_images(recipe._replace(holdout="0005VD"))


@given(st.lists(st.integers(BLOCKS, 30), min_size=1, max_size=3))
def test_every_image_is_held_out_once_and_in_one_piece(lengths):
    sequences = [str(k) for k, length in enumerate(lengths) for _ in range(length)]
    chosen = np.stack([held_out(tuple(sequences), block) for block in range(BLOCKS)])
    assert (chosen.sum(axis=0) == 1).all() and chosen.any(axis=1).all()
    ends = np.abs(np.diff(chosen.astype(int), axis=1, prepend=0, append=0)).sum(axis=1)
    assert (ends <= 2 * len(lengths)).all()
    alone = tuple(map(str, range(len(sequences))))  # groups of one image are cut together
    assert [held_out(alone, block).sum() for block in range(BLOCKS)] == [
        len(part) for part in np.array_split(alone, BLOCKS)
    ]


def test_gains_are_paired_by_seed_and_told_of_each_class():
    one, other = np.diag([8, 8]), np.array([[4, 4], [0, 8]])  # IoU 1 and 1; 4/8 and 8/12
    now, before = {"random": [other, one]}, {"random": [other, other]}
    rows = {row["class"]: row for row in tables.gain_rows(now, before, ("sky", "road"))}
    assert rows["sky"]["random"] == pytest.approx(75)
    assert rows["sky"]["random, gain"] == "+25.00 (-292.66 to +342.66)"  # 25 +- 12.706 * 25
    assert rows["mIoU"]["random, gain"].startswith("+20.83 (")  # 100 * (1 - 7 / 12) / 2


def test_recognition_by_hand():
    real, renders = np.diag([2, 2, 2]), np.array([[4, 0, 0], [1, 3, 0], [0, 9, 1]])
    rows = {r["class"]: r for r in tables.recognition_rows([real], [renders], CLASSES)}
    columns = ("real recall", "render recall", "render IoU", "taken for")
    assert [rows["car"][name] for name in columns] == [100, 10, pytest.approx(10), "road 90"]
    assert rows["mean"]["render recall"] == pytest.approx((100 + 75 + 10) / 3)
    # A class that the images do not show counts in no mean.
    *_, mean = tables.recognition_rows([np.diag([2, 0, 2])], [np.diag([2, 0, 2])], CLASSES)
    assert [mean[name] for name in ("real recall", "render recall", "real IoU")] == [100] * 3


def test_features_of_both_sides_are_those_that_a_recipe_needs(camvid):
    recipe = TINY._replace(
        data=str(camvid), target="camvid", holdout="0006R0", training="lite0-heads"
    )
    settings = recipe.train
    assert settings.average_mirror
    labelled, tested = sides(recipe, 0)
    check_features(labelled.features, labelled.images, settings, settings.views)
    check_features(tested.features, tested.images, settings, 2)


def test_tones_are_medians_beside_the_road_s_and_few_pixels_do_not_count():
    labels = np.zeros((2, 10, 10), np.uint8)
    labels[:, :5] = 1  # half of each image is road
    labels[1, 0, 0] = 2  # a speck
    images = np.zeros((2, 10, 10, 3), np.uint8)
    images[0], images[1] = 30, 90
    images[:, :5] *= 2
    images[1, 9, 9] = 255  # an outlier
    rows = tables.tone_rows({"renders": (images, labels)}, CLASSES)
    assert [row["class"] for row in rows] == [*CLASSES]
    assert [row["renders"] for row in rows[:2]] == pytest.approx([60, 120])
    assert rows[0]["renders / road"] == pytest.approx(0.5) and math.isnan(rows[2]["renders"])


FLAGS = (
    "--only transfer --seeds 1 --streets 1 --steps 2 --training compact --workers 0 --width 32 "
    "--height 32 --target camvid --holdout 0006R0 --data"
)


def test_only_another_engine_trains_again_and_gains_over_the_one_before_are_told(
    camvid, tmp_path, capsys, monkeypatch
):
    command = [*FLAGS.split(), str(camvid), "--json", str(tmp_path / "t.json"), "--out"]
    log, outputs = tmp_path / "out" / "nets.jsonl", []
    # The same engine twice, and another: two nets each, printed alike.
    for engine, count in (("one", 2), ("one", 2), ("another", 4)):
        monkeypatch.setattr("benchmarks.transfer.__main__.engine", lambda engine=engine: engine)
        assert main([*command, str(tmp_path / "out")]) == 0
        outputs.append(capsys.readouterr().out.splitlines()[-3:])
        assert len(log.read_bytes().splitlines()) == count
    assert outputs[0] == outputs[1]
    rows = json.loads((tmp_path / "t.json").read_text())["transfer"]
    assert [row["attributes"] for row in rows] == ["random", "default"]
    monkeypatch.setattr("benchmarks.transfer.__main__.engine", lambda: "a third")
    again = [*command, str(tmp_path / "again"), "--against", str(log)]
    assert main(again) == 0
    gains = json.loads((tmp_path / "t.json").read_text())["gains"]
    # The same sources under another name: the same nets.
    assert {row["default, gain"] for row in gains} == {"+0.00"} and gains[-1]["class"] == "mIoU"
    capsys.readouterr()
    assert main([*again, "--seeds", "2"]) == 2
    assert "it lacks the net" in capsys.readouterr().err


@pytest.mark.parametrize(("change", "complaint"), [
    (["--data", "nowhere"], "nowhere: no such folder"),
    (["--seeds", "0"], "at least 1, not '0'"), (["--steps", "many"], "at least 1, not 'many'"),
    (["--only", "looks"], "invalid choice"), (["--target", "moon"], "--target moon: no such file"),
    (["--json", "nowhere/t.json"], "must be a file in an existing folder"),
    (["--against", "nowhere"], "--against nowhere: no such file"),
    (["--against", "nowhere", "--only", "tones"], "--against needs the table transfer"),
    (["--out", "{data}/train.txt"], "train.txt"),
])  # fmt: skip
def test_bad_input_is_one_error_and_exit_code_2(camvid, refused, change, complaint):
    (camvid / "train.txt").write_text("train/0001TP_1.png trainannot/0001TP_1.png\n")
    (camvid / "val.txt").write_text("val/0016E5_0.png valannot/0016E5_0.png\n")
    command = ["--data", str(camvid), "--target", "camvid", "--workers", "0"]
    command += [word.format(data=camvid) for word in change]
    refused(main, command, complaint)
