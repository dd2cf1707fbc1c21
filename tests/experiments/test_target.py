"""Real data as targets: the split, the overlap, and everything that can be wrong on disk."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from experiments.config import MainConfig
from experiments.presets import defaults
from experiments.target.base import refuse_overlap
from experiments.target.named import named_target
from seg.classes import CAMVID_11
from shell.errors import UserError

from .conftest import POOL, main_job

names = st.lists(st.sampled_from([f"n{i}" for i in range(12)]), unique=True)


@pytest.fixture
def fails(camvid, tmp_path, error_line):
    """Runs the CamVid job; it must end with one line that has all words, and leave nothing."""

    def run(*words: str, flags: tuple[str, ...] = ()) -> None:
        out = tmp_path / "new" / "run"
        assert main_job("camvid", "--data", str(camvid), "--out", str(out), *flags) == 2
        line = error_line(begun=not flags)  # pixels are read after the target is told
        assert all(word in line for word in words), line
        assert not out.parent.exists()

    return run


def test_the_public_protocol_and_a_sequence_held_out(tiny_camvid, camvid):
    target = named_target(tiny_camvid, POOL)
    assert target.real and target.name == target.table == "camvid" and target.twin is None
    assert target.reward_names == ("A_1", "A_2", "B_1", "B_2")
    assert target.test_names == ("B_8", "C_1")
    assert "4 images" in target.title and "split test" in target.title
    assert "sequences B are on both sides" in target.title
    split = target.at(24, 32)
    assert split.reward.images.shape == (4, 24, 32, 3) and split.test.labels.shape == (2, 24, 32)
    reward = target.at(12, 16).reward
    for name, labels in zip(reward.names, reward.labels, strict=True):
        values = np.asarray(Image.open(camvid / "trainannot" / f"{name}.png"))
        np.testing.assert_array_equal(labels, CAMVID_11.from_file[values])
    target = named_target(replace(tiny_camvid, holdout="B"), POOL)
    assert (target.reward_names, target.test_names) == (("A_1", "A_2"), ("B_1", "B_2"))
    assert "sequence B" in target.title and "both sides" not in target.title


def test_a_city_held_out(cityscapes):
    config = replace(defaults(MainConfig, "cityscapes", "smoke"), data=cityscapes)
    target = named_target(config, POOL)
    assert target.real and target.name == "cityscapes"
    assert len(target.reward_names) == len(target.test_names) == 2
    with pytest.raises(UserError, match=r"both sides.*aachen"):
        named_target(replace(config, holdout="aachen"), POOL)


def test_limits_choose_a_subset_that_runs_of_all_seeds_share(tiny_camvid):
    config = replace(tiny_camvid, reward_images=2, test_images=1)
    found = [named_target(replace(config, seed=s), POOL) for s in range(12)]
    ((reward, test),) = {(own.reward_names, own.test_names) for own in found}
    assert (len(reward), len(test)) == (2, 1) and reward == found[0].at(16, 16).reward.names


@pytest.mark.parametrize(("flags", "words"), [
    (("--data", "/nowhere"), ("/nowhere", "no such folder", "CamVid")),
    (("--holdout", "Z"), ("--holdout 'Z'", "sequences A, B")),
    (("--holdout", "A", "--test-split", "test"), ("--holdout", "--test-split")),
    (("--test-split", "train"), ("4 images", "A_1", "--test-split", "--holdout")),
    (("--test-split", "val"), ("no split 'val'", "Splits there: test, train")),
])  # fmt: skip
def test_what_is_not_there_or_at_odds(fails, flags, words):
    fails(*words, flags=flags)


def test_a_missing_split_and_an_image_on_both_sides(fails, camvid):
    for kind in ("", "annot"):  # one image copied from one side to the other
        image = (camvid / f"train{kind}" / "A_2.png").read_bytes()
        (camvid / f"test{kind}" / "A_2.png").write_bytes(image)
    fails("1 images", "A_2")
    for name in ("test", "testannot"):
        (camvid / name).rename(camvid.parent / name)
    fails("no split 'test'", "Splits there: train", "--holdout", "--test-split")


@given(names, names)
def test_overlap_is_refused_exactly_where_there_is_one(reward, test):
    said = pytest.raises(UserError, match="among the reward images and the test")
    with said if set(reward) & set(test) else nullcontext():
        refuse_overlap(reward, test)


def short(bytes_left: int):
    """Cuts a file short."""
    return lambda path: path.write_bytes(path.read_bytes()[:bytes_left])


def flat(value: int, size=(12, 16)):
    """Puts one label everywhere."""
    return lambda path: Image.fromarray(np.full(size, value, np.uint8)).save(path)


@pytest.mark.parametrize(("change", "files", "words"), [
    (Path.unlink, "trainannot/A_1.png", ("train/A_1.png", "image without label", "FILE")),
    (Path.unlink, "testannot/B_8.png", ("test/B_8.png", "image without label", "FILE")),
    (short(200), "train/A_1.png", ("FILE", "broken or truncated")),
    (short(200), "test/B_8.png", ("FILE", "broken or truncated")),
    (short(40), "trainannot/B_1.png", ("FILE", "broken or truncated")),
    (short(0), "test/C_1.png", ("C_1.png", "empty")),
    (flat(0, (8, 8)), "trainannot/A_2.png", ("FILE", "8x8", "16x12")),
    (flat(77), "testannot/C_1.png", ("FILE", "label value 77", "camvid", "0..11")),
    (flat(11), "testannot/*.png", ("camvid", "all labels of the test images are void")),
    (Path.unlink, "train*/*.png", ("zero images", "train")),
])  # fmt: skip
def test_what_is_wrong_on_disk(fails, camvid, change, files, words):
    found = sorted(camvid.glob(files))
    for path in found:
        change(path)
    fails(*(word.replace("FILE", str(found[0])) for word in words))
