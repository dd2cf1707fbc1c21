"""Real data as targets: the split, the overlap, and everything that can be wrong on disk."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from experiments.cli import main
from experiments.config import MainConfig
from experiments.main.job import MAIN
from experiments.presets import defaults
from experiments.study.skeleton import do
from experiments.target.base import refuse_overlap
from experiments.target.named import named_target
from scene.workers import WorkerPool
from seg.classes import CAMVID_11
from shell.errors import UserError

POOL = WorkerPool(0)


@pytest.fixture
def fails(camvid, tmp_path, error_line):
    """Runs the CamVid job; it must end with one line that has all words, and leave nothing."""

    def run(*words: str, flags: tuple[str, ...] = ()) -> None:
        out = tmp_path / "new" / "run"
        arguments = ["--preset", "smoke", "--workers", "0", "--data", str(camvid)]
        arguments += ["--out", str(out), *flags]
        own, work = partial(defaults, MainConfig), partial(do, MAIN)
        assert main("camvid", own, work, "", arguments, target="camvid") == 2
        line = error_line()
        for word in words:
            assert word in line
        assert not out.parent.exists()

    return run


def test_the_public_protocol(tiny_camvid):
    target = named_target(tiny_camvid, POOL)
    assert target.real and target.name == target.table == "camvid" and target.twin is None
    assert target.reward_names == ("A_1", "A_2", "B_1", "B_2")
    assert target.test_names == ("B_8", "C_1")
    assert "4 images" in target.title and "split test" in target.title
    assert "sequences B are on both sides" in target.title
    split = target.at(24, 32)
    assert split.reward.images.shape == (4, 24, 32, 3) and split.test.labels.shape == (2, 24, 32)
    assert split.reward.labels.max() < 11 or (split.reward.labels == 255).any()


def test_a_sequence_held_out_leaves_the_reward(tiny_camvid):
    target = named_target(replace(tiny_camvid, holdout="B"), POOL)
    assert target.reward_names == ("A_1", "A_2")
    assert target.test_names == ("B_1", "B_2")
    assert "sequence B" in target.title and "both sides" not in target.title


def test_a_city_held_out(cityscapes):
    config = replace(defaults(MainConfig, "cityscapes", "smoke"), data=cityscapes)
    target = named_target(config, POOL)
    assert target.real and target.name == "cityscapes"
    assert len(target.reward_names) == len(target.test_names) == 2
    with pytest.raises(UserError, match=r"both sides.*aachen"):
        named_target(replace(config, holdout="aachen"), POOL)


def test_limits_choose_a_seeded_subset(tiny_camvid):
    config = replace(tiny_camvid, reward_images=2, test_images=1)
    names = {named_target(replace(config, seed=s), POOL).reward_names for s in range(12)}
    assert len(names) > 1 and all(len(chosen) == 2 for chosen in names)
    again = named_target(config, POOL)
    assert again.reward_names == named_target(config, POOL).reward_names
    assert again.at(16, 16).reward.names == again.reward_names


def test_missing_folder(fails, tmp_path):
    fails("/nowhere", "no such folder", "CamVid", flags=("--data", str(tmp_path / "nowhere")))


def test_missing_split(fails, camvid):
    for name in ("test", "testannot"):
        (camvid / name).rename(camvid.parent / name)
    fails("no split 'test'", "Splits there: train", "--holdout", "--test-split")
    fails("no split 'val'", "Splits there: train", flags=("--test-split", "val"))


def test_unknown_sequence(fails):
    fails("--holdout 'Z'", "sequences A, B", flags=("--holdout", "Z"))


def test_holdout_and_split_at_once(fails):
    fails("--holdout", "--test-split", flags=("--holdout", "A", "--test-split", "test"))


def test_overlap_of_reward_and_test_images(fails, camvid):
    fails("4 images", "A_1", "--test-split", "--holdout", flags=("--test-split", "train"))
    for kind in ("", "annot"):  # one image copied from one side to the other
        (camvid / f"train{kind}" / "A_2.png").rename(camvid / f"test{kind}" / "A_2.png")
        (camvid / f"train{kind}" / "A_2.png").write_bytes(
            (camvid / f"test{kind}" / "A_2.png").read_bytes()
        )
    fails("1 images", "A_2")


names = st.lists(st.sampled_from([f"n{i}" for i in range(12)]), unique=True)


@given(names, names)
def test_overlap_is_refused_exactly_where_there_is_one(reward, test):
    if set(reward) & set(test):
        with pytest.raises(UserError, match="among the reward images and the test"):
            refuse_overlap(reward, test)
    else:
        refuse_overlap(reward, test)


@pytest.mark.parametrize("split", ["train", "test"])
def test_image_without_label(fails, camvid, split):
    label = sorted((camvid / f"{split}annot").iterdir())[0]
    label.unlink()
    fails(f"{split}/{label.name}", "image without label", str(label))


@pytest.mark.parametrize("split", ["train", "test"])
def test_truncated_image(fails, camvid, split):
    path = sorted((camvid / split).iterdir())[0]
    path.write_bytes(path.read_bytes()[:200])
    fails(str(path), "broken or truncated")


def test_truncated_label(fails, camvid):
    path = camvid / "trainannot" / "B_1.png"
    path.write_bytes(path.read_bytes()[:40])
    fails(str(path), "broken or truncated")


def test_empty_image(fails, camvid):
    (camvid / "test" / "C_1.png").write_bytes(b"")
    fails("C_1.png", "empty")


def test_sizes_that_differ(fails, camvid):
    path = camvid / "trainannot" / "A_2.png"
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(path)
    fails(str(path), "8x8", "16x12")


def test_label_outside_the_table(fails, camvid):
    path = camvid / "testannot" / "C_1.png"
    Image.fromarray(np.full((12, 16), 77, np.uint8)).save(path)
    fails(str(path), "label value 77", "camvid", "0..11")


def test_zero_images(fails, camvid):
    for kind in ("train", "trainannot"):
        for path in (camvid / kind).iterdir():
            path.unlink()
    fails("zero images", "train")


def test_nothing_but_void(fails, camvid):
    for path in (camvid / "testannot").iterdir():
        Image.fromarray(np.full((12, 16), 11, np.uint8)).save(path)
    fails(str(camvid), "all labels of the test images are void")


def test_cityscapes_without_labels(cityscapes, tmp_path, error_line):
    (cityscapes / "gtFine").rename(cityscapes / "gtCoarse")
    arguments = ["--preset", "smoke", "--data", str(cityscapes), "--out", str(tmp_path / "run")]
    own, work = partial(defaults, MainConfig), partial(do, MAIN)
    assert main("cityscapes", own, work, "", arguments, target="cityscapes") == 2
    assert "gtFine: no such folder" in error_line()
    assert not (tmp_path / "run").exists()


def test_labels_are_those_on_disk(tiny_camvid, camvid):
    target = named_target(tiny_camvid, POOL)
    reward = target.at(12, 16).reward
    for name, labels in zip(reward.names, reward.labels, strict=True):
        values = np.asarray(Image.open(camvid / "trainannot" / f"{name}.png"))
        np.testing.assert_array_equal(labels, CAMVID_11.from_file[values])
