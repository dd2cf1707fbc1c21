"""The reward without labels: that none are read, what it prefers, and that a run goes on with its net."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from common.errors import UserError
from common.files import read_json
from experiments.config import MainConfig, check
from experiments.config.presets import defaults
from experiments.evaluation.in_worker import render
from experiments.evaluation.job import Job, Recipe
from experiments.evaluation.mmd import FILE, FeatureNet, evaluate_mmd, feature_net
from experiments.evaluation.runner import about
from experiments.targets.named import named_target
from scene.attributes import NAMES
from scene.proposal import random_proposal
from seg.data import LabelledImages
from seg.mmd import mmd2

from .conftest import POOL, TINY, diverge, lines, main_job, runner_of, searching, target_of


def unlabelled(height: int, width: int, count: int = 6) -> LabelledImages:
    """Real images of noise, all of whose labels are void."""
    names = tuple(f"{k}" for k in range(count))
    images = np.random.default_rng(0).integers(0, 256, (count, height, width, 3)).astype(np.uint8)
    return LabelledImages(images, np.full(images.shape[:3], 255, np.uint8), names, names)


TARGET = target_of(unlabelled(48, 64), unlabelled(48, 64))


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> MainConfig:
    """One update of two datasets, two images each."""
    config = defaults(MainConfig, "camvid", "smoke", reward_kind="mmd", groups=(NAMES,))
    config = searching(config, method="random_search", updates_per_group=1)
    reward = replace(config.reward, streets=2, shots=1)
    final = replace(reward, train=replace(reward.train, steps=13))
    own = {"workers": 0, "out": tmp_path_factory.mktemp("mmd") / "run", "asset_count": 2}
    return replace(config, reward=reward, final=final, **own)


@pytest.fixture(scope="module")
def recipe(config) -> Recipe:
    return Recipe(config.reward, "camvid", config.renderer, config.pool)


@pytest.fixture(scope="module")
def net(recipe, tmp_path_factory) -> FeatureNet:
    return feature_net(recipe, tmp_path_factory.mktemp("net"), POOL)


def test_a_folder_without_labels_gives_the_reward_from_the_command_line(camvid, out, capsys):
    photographs = out.with_name("photographs")
    photographs.mkdir()
    for name in ("A_1", "A_2", "B_1"):
        shutil.copy(camvid / "train" / f"{name}.png", photographs / f"p{name}.png")
    flags = [
        *TINY, "--data", str(camvid), "--unlabelled", str(photographs), "--out", str(out),
        "--workers", "0", "--seeds", "1", "--final.train.steps", "6",
    ]  # fmt: skip
    assert main_job("camvid", *flags) == 2
    assert "--unlabelled needs --reward-kind mmd" in capsys.readouterr().err
    assert main_job("camvid", *flags, "--reward-kind", "mmd") == 0
    said = capsys.readouterr().out
    assert "3 images without labels for the search" in said and "-MMD^2" in said
    assert (out / FILE).exists()
    assert all(line["class_iou"] == [] for line in lines(out / "evaluations.jsonl"))
    summary = read_json(out / "summary.json")
    assert list(summary["rows"]) == ["random", "default", "learnt"]
    assert summary["reward_images"] == 3
    rows = {line["row"] for line in lines(out / "finals.jsonl")}
    assert rows >= {"random", "learnt"} and "real" not in rows
    assert "labelled target images" not in (out / "report.html").read_text()


def test_what_cannot_work_is_refused(tiny_camvid, tmp_path, config, recipe, net, monkeypatch):
    mmd = {"unlabelled": tiny_camvid.data / "test", "reward_kind": "mmd"}
    twin, both = defaults(MainConfig, "twin", "smoke", **mmd), replace(tiny_camvid, **mmd)
    single = replace(config, reward=replace(config.reward, streets=1))
    broken = FeatureNet(tmp_path / FILE, 11)
    broken.path.write_bytes(b"no zip")
    monkeypatch.setattr("experiments.evaluation.mmd.train_features", diverge)
    for complaint, work, *task in (
        ("--unlabelled needs --data", named_target, twin, POOL),
        ("are both training and test images", named_target, both, POOL),
        ("squared-reward needs --reward-kind miou", check, searching(config, squared_reward=True)),
        ("checkpoints needs --reward-kind miou", check, searching(config, checkpoints=2)),
        ("at least 2 images", check, single),
        ("at least 2 reward images", net.reference, unlabelled(16, 16, 1).images),
        ("remove it, and run the same command again", broken.reference, unlabelled(16, 16).images),
        ("--reward-kind mmd: the loss is nan", feature_net, recipe, tmp_path / "new", POOL),
    ):
        with pytest.raises(UserError, match=complaint):
            work(*task)


def test_a_dataset_is_nearest_to_itself_by_a_net_that_is_trained_once(recipe, net, monkeypatch):
    own = render(recipe, random_proposal(), 0).images
    others = unlabelled(recipe.fidelity.height, recipe.fidelity.width).images
    sides = [net.reference(images) for images in (own, others)]
    rewards = [evaluate_mmd(recipe, random_proposal(), 0, side).reward for side in sides]
    assert rewards[0] > rewards[1]
    # Unbiased, a set against itself is below 0: what pairs leave out is k(x, x).
    x = net.reference(own).features
    assert rewards[0] == pytest.approx(-mmd2(x, x)) and rewards[0] > 0
    monkeypatch.setattr("experiments.evaluation.mmd.train_features", None)
    again = feature_net(recipe, net.path.parent, POOL)
    images = unlabelled(16, 16).images
    one, other = again.reference(images), net.reference(images)
    assert one.source == other.source and one.features.shape == (6, 120)
    assert net.reference(images[::-1]).source != one.source


def test_kinds_of_rewards_are_kept_apart(recipe, net, tmp_path):
    images = unlabelled(recipe.fidelity.height, recipe.fidelity.width)
    truth, reference = images, net.reference(images.images)
    moved = reference._replace(net="elsewhere.npz")  # where the net lies does not matter
    fields = [about(recipe, TARGET, "reward", t) for t in (truth, reference, moved)]
    keys = [kind_fields["config"] for kind_fields in fields]
    assert keys[0] != keys[1] == keys[2]
    assert [kind_fields["kind"] for kind_fields in fields] == [
        "miou",
        "mmd",
        "mmd",
    ]  # by which records are chosen
    shutil.copy(net.path, tmp_path)
    runner = runner_of(TARGET, tmp_path)
    job = Job(recipe, random_proposal(), 1, {}, "reward", "mmd")
    (first,), (again,) = (runner.run([job]) for _ in range(2))
    assert runner.about(job) == fields[1]
    assert again.stored and not first.stored and again.reward == first.reward
