"""Real data as targets: the split, the overlap, and everything that can be wrong on disk."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from common.errors import UserError
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.targets.base import refuse_overlap
from experiments.targets.named import named_target
from experiments.targets.real import reported_split
from tests.layouts import FACADE, FACADE_IDS

from .conftest import POOL, main_job

names = st.lists(st.sampled_from([f"n{i}" for i in range(12)]), unique=True)


@pytest.mark.parametrize(("splits", "reported"), [
    (("train", "val", "test"), "test"), (("training", "validation", "testing"), "testing"),
    (("train", "valid"), "valid"), (("training", "validation"), "validation"), (("a", "b"), "test"),
    (("Train", "Test"), "Test"),
])  # fmt: skip
def test_the_held_out_split_is_known_by_its_usual_names(splits, reported):
    assert reported_split("mine", splits) == reported
    # The target's own split comes first, where the folder has it: its name may be a user's folder.
    assert reported_split("cityscapes", splits) == ("val" if "val" in splits else reported)
    assert reported_split("camvid", ("train", "val")) == "val"


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
    assert split["reward"].images.shape == (4, 24, 32, 3) and split["test"].labels.shape == (
        2,
        24,
        32,
    )
    reward = target.at(12, 16)["reward"]
    for name, labels in zip(reward.names, reward.labels, strict=True):
        values = np.asarray(Image.open(camvid / "trainannot" / f"{name}.png"))
        np.testing.assert_array_equal(labels, np.where(values == 11, 255, values))
    target = named_target(replace(tiny_camvid, holdout="B"), POOL)
    assert (target.reward_names, target.test_names) == (("A_1", "A_2"), ("B_1", "B_2"))
    assert "sequence B" in target.title and "both sides" not in target.title


def test_a_city_held_out(cityscapes):
    config = replace(defaults(MainConfig, "cityscapes", "smoke"), data=cityscapes)
    target = named_target(config, POOL)
    assert target.real and target.name == "cityscapes"
    assert len(target.reward_names) == len(target.test_names) == 2
    with pytest.raises(UserError, match=r"to test on.*aachen"):
        named_target(replace(config, holdout="aachen"), POOL)


def test_photographs_are_cut_to_four_by_three_and_albums_held_out(labelmefacade):
    config = replace(defaults(MainConfig, "labelmefacade", "smoke"), data=labelmefacade)
    target = named_target(config, POOL)
    assert target.real and target.name == target.table == "labelmefacade"
    # By album.
    assert target.reward_names == ("a_p1", "a_p2", "b__1", "b__2")
    assert target.reward_sequences == ("a_p", "a_p", "b", "b")
    assert "split test, 2 images (sequences b are on both sides)" in target.title
    split = target.at(9, 12)
    for name, label in zip(target.reward_names, split["reward"].labels, strict=True):
        # 16x12 as it is, 12x12 without a row and a half at either end.
        colors = np.asarray(Image.open(labelmefacade / "labels" / f"{name}.png"))
        assert colors.shape[1] in (16, 12)
        if colors.shape[1] == 12:
            codes = (colors[1:10, :, None] == FACADE).all(axis=-1).argmax(axis=-1)
            np.testing.assert_array_equal(label, FACADE_IDS[codes])
    assert split["test"].images.shape == (2, 9, 12, 3)
    target = named_target(replace(config, holdout="a_p"), POOL)
    assert target.reward_names == ("b__1", "b__2") and target.test_names == ("a_p1", "a_p2")
    assert "both sides" not in target.title
    with pytest.raises(UserError, match=r"--holdout 'c' .* the sequences a_p, b"):
        named_target(replace(config, holdout="c"), POOL)


def test_many_sequences_on_both_sides_are_counted(labelmefacade):
    for split in ("train", "test"):
        names = [f"{album}_{len(split)}" for album in "abcdefghi"]
        for name, part in product(names, ("images/{}.jpg", "labels/{}.png")):
            (labelmefacade / part.format(name)).write_bytes(b"never read")
        (labelmefacade / f"{split}.txt").write_text("\n".join(names))
    config = replace(defaults(MainConfig, "labelmefacade", "smoke"), data=labelmefacade)
    title = named_target(replace(config, reward_images=None, test_images=None), POOL).title
    assert title.endswith("9 images (9 sequences are on both sides)")
    assert " (sequences " in named_target(replace(config, reward_images=3), POOL).title


def test_the_real_photographs_come_by_album(labelmefacade_dir):
    config = replace(defaults(MainConfig, "labelmefacade", "quick"), data=labelmefacade_dir)
    target = named_target(config, POOL)
    assert (len(target.reward_names), len(target.test_names)) == (100, 300)
    albums = target.reward_sequences
    assert 1 + sum(map(str.__ne__, albums[1:], albums)) == len(set(albums)) == 43


def test_limits_choose_a_subset_that_runs_of_all_seeds_share(tiny_camvid):
    config = replace(tiny_camvid, reward_images=2, test_images=1)
    targets = [named_target(replace(config, seed=s), POOL) for s in range(12)]
    ((reward, test),) = {(target.reward_names, target.test_names) for target in targets}
    assert (len(reward), len(test)) == (2, 1) and reward == targets[0].at(16, 16)["reward"].names


@pytest.mark.parametrize(("flags", "words"), [
    (("--data", "/nowhere"), ("/nowhere", "no such folder", "camvid", "{split}.txt or {split}/{name}")),
    (("--holdout", "Z"), ("--holdout 'Z'", "sequences A, B")),
    (("--holdout", "A", "--test-split", "test"), ("--holdout", "--test-split")),
    (("--test-split", "train"), ("4 images", "A_1", "--test-split", "--holdout")),
    (("--test-split", "val"), ("no split 'val'", "val.txt", "Its splits: train, test")),
])  # fmt: skip
def test_what_is_not_there_or_at_odds(fails, flags, words):
    fails(*words, flags=flags)


def test_an_image_on_both_sides_is_found_under_another_name(fails, camvid):
    for kind in ("", "annot"):
        image = (camvid / f"train{kind}" / "A_2.png").read_bytes()
        (camvid / f"test{kind}" / "Z_9.png").write_bytes(image)
    fails("images in two splits: 1", "A_2 in the training images is Z_9 in the test images")


def test_a_missing_split_and_an_image_on_both_sides(fails, camvid):
    for kind in ("", "annot"):  # one image copied from one side to the other
        image = (camvid / f"train{kind}" / "A_2.png").read_bytes()
        (camvid / f"test{kind}" / "A_2.png").write_bytes(image)
    fails("1 images", "A_2")
    for name in ("test", "testannot"):
        (camvid / name).rename(camvid.parent / name)
    fails("no split 'test'", "Its splits: train", "--holdout", "--test-split")


@given(names, names)
def test_overlap_is_refused_exactly_where_there_is_one(reward, test):
    refused = pytest.raises(UserError, match="are both training and test images")
    with refused if set(reward) & set(test) else nullcontext():
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
    (flat(77), "testannot/C_1.png", ("FILE", "label id 77 (192 pixels in 1 image)", "no class of camvid")),
    (flat(11), "testannot/*.png", ("camvid", "no pixel of the test images has a class", "); label a pixel")),
    (Path.unlink, "train*/*.png", ("no images in split 'train'",)),
])  # fmt: skip
def test_what_is_wrong_on_disk(fails, camvid, change, files, words):
    changed = sorted(camvid.glob(files))
    for path in changed:
        change(path)
    fails(*(word.replace("FILE", str(changed[0])) for word in words))
