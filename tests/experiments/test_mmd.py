"""The reward without labels: that none are read, what it prefers, and that a run goes on with its net."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from experiments.config import MainConfig, check
from experiments.presets import defaults
from experiments.reward import mmd as module
from experiments.reward.evaluator import Evaluator, Job, Memory, about
from experiments.reward.miou import Recipe, render
from experiments.reward.mmd import FILE, FeatureNet, evaluate_mmd, feature_net
from experiments.reward.shelf import Shelf
from experiments.reward.store import Log
from experiments.reward.truth import Truth
from experiments.target.base import Split, Target
from experiments.target.named import named_target
from scene.attributes import NAMES
from scene.proposal import random_proposal
from scene.workers import WorkerPool
from seg.data import RealSet
from seg.mmd import mmd2
from shell.errors import UserError
from shell.files import read_json

from .conftest import TINY, diverge, lines, main_job

VOID = 255


def unlabelled(height: int, width: int, count: int = 6) -> RealSet:
    """Real images of noise, all of whose labels are void."""
    names = tuple(f"{k}" for k in range(count))
    images = np.random.default_rng(0).integers(0, 256, (count, height, width, 3)).astype(np.uint8)
    return RealSet(names, names, images, np.full(images.shape[:3], VOID, np.uint8))


TARGET = Target(
    "camvid", True, "camvid", "", ("a",), ("s",), ("b",),
    lambda height, width: Split(unlabelled(height, width), unlabelled(height, width)),
)  # fmt: skip


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> MainConfig:
    """One update of two datasets, two images each."""
    config = defaults(MainConfig, "camvid", "smoke")
    reward = replace(config.reward, streets=2, shots=1)
    final = replace(reward, train=replace(reward.train, steps=13))
    search = replace(config.search, method="random_search", updates_per_group=1)
    out = tmp_path_factory.mktemp("mmd") / "run"
    return replace(
        config, reward_kind="mmd", reward=reward, final=final, search=search, groups=(NAMES,),
        workers=0, out=out, asset_count=2,
    )  # fmt: skip


@pytest.fixture(scope="module")
def recipe(config) -> Recipe:
    return Recipe(config.reward, "camvid", config.renderer, config.pool)


@pytest.fixture(scope="module")
def net(recipe, tmp_path_factory) -> FeatureNet:
    return feature_net(recipe, tmp_path_factory.mktemp("net"), WorkerPool(0))


def test_a_folder_without_labels_gives_the_reward_from_the_command_line(camvid, tmp_path, capsys):
    photographs, out = tmp_path / "photographs", tmp_path / "run"
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
    assert "3 images without labels for the reward" in said and "-MMD^2" in said
    assert (out / FILE).exists()
    assert all(line["class_iou"] == [] for line in lines(out / "evaluations.jsonl"))
    summary = read_json(out / "summary.json")
    assert list(summary["rows"]) == ["random", "default", "learnt"]
    assert summary["reward_images"] == 3
    rows = {line["row"] for line in lines(out / "finals.jsonl")}
    assert rows >= {"random", "learnt"} and "real" not in rows
    assert "the reward images themselves" not in (out / "report.html").read_text()


def test_what_cannot_work_is_refused(
    tiny_twin, tiny_camvid, camvid, tmp_path, config, recipe, net, monkeypatch
):
    twin = replace(tiny_twin, unlabelled=tmp_path, reward_kind="mmd")
    with pytest.raises(UserError, match="--unlabelled needs --data"):
        named_target(twin, WorkerPool(0))
    both = replace(tiny_camvid, unlabelled=camvid / "test", reward_kind="mmd")
    with pytest.raises(UserError, match="are among the reward images"):
        named_target(both, WorkerPool(0))
    squared = replace(config, search=replace(config.search, squared_reward=True))
    with pytest.raises(UserError, match="squared-reward needs --reward-kind miou"):
        check(squared)
    single = replace(config, reward=replace(config.reward, streets=1))
    with pytest.raises(UserError, match="at least 2 images"):
        check(single)
    with pytest.raises(UserError, match="at least 2 reward images"):
        net.reference(unlabelled(16, 16, 1).images)
    (tmp_path / FILE).write_bytes(b"no zip")
    with pytest.raises(UserError, match="remove it to train it anew"):
        FeatureNet(tmp_path / FILE, 11).reference(unlabelled(16, 16).images)

    monkeypatch.setattr(module, "train_features", diverge)
    with pytest.raises(UserError, match="--reward-kind mmd: the loss is nan"):
        feature_net(recipe, tmp_path / "new", WorkerPool(0))


def test_a_dataset_is_nearest_to_itself_by_a_net_that_is_trained_once(recipe, net, monkeypatch):
    own = render(recipe, random_proposal(), 0).images
    others = unlabelled(recipe.fidelity.height, recipe.fidelity.width).images
    sides = [net.reference(images) for images in (own, others)]
    rewards = [evaluate_mmd(recipe, random_proposal(), 0, side).reward for side in sides]
    assert rewards[0] > rewards[1]
    # Unbiased, a set against itself is below 0: what pairs leave out is k(x, x).
    x = net.reference(own).features
    assert rewards[0] == pytest.approx(-mmd2(x, x)) and rewards[0] > 0
    monkeypatch.setattr(module, "train_features", None)
    again = feature_net(recipe, net.path.parent, WorkerPool(0))
    images = unlabelled(16, 16).images
    one, other = again.reference(images), net.reference(images)
    assert one.source == other.source and one.features.shape == (6, 120)
    assert net.reference(images[::-1]).source != one.source


def test_kinds_of_rewards_are_kept_apart(recipe, net, tmp_path):
    images = unlabelled(recipe.fidelity.height, recipe.fidelity.width)
    truth, reference = Truth(images.images, images.labels), net.reference(images.images)
    moved = reference._replace(net="elsewhere.npz")  # where the net lies does not matter
    told = [about(recipe, TARGET, "reward", t) for t in (truth, reference, moved)]
    keys = [each["config"] for each in told]
    assert keys[0] != keys[1] == keys[2]
    assert [each["kind"] for each in told] == ["miou", "mmd", "mmd"]  # by which records are chosen
    evaluator = Evaluator(recipe, TARGET, "reward", reference, Shelf(WorkerPool(0)))
    memory = Memory(Log(tmp_path / "log.jsonl"), None, lambda: 0.0)
    jobs = [Job(random_proposal(), 1, {})]
    ((_, first),) = evaluator.map(jobs, memory)
    ((_, again),) = evaluator.map(jobs, memory)
    assert again.stored and not first.stored and again.reward == first.reward
