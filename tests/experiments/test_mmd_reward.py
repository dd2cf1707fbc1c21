"""The reward without labels: that none are read, what it prefers, and that a run goes on with its net."""

import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from experiments import mmd_reward as module
from experiments.config import camvid_config, check
from experiments.errors import UserError
from experiments.evaluator import Evaluator, Job, about
from experiments.finals import Finals, draw_units, random_proposal
from experiments.folder import RunFolder
from experiments.main import main
from experiments.mmd_reward import FILE, FeatureNet, evaluate_mmd, feature_net
from experiments.progress import Progress
from experiments.reward import Truth, render
from experiments.search import search
from experiments.store import Store
from experiments.targets import Split, Target, camvid_target, cityscapes_target
from scene.attributes import NAMES
from scene.workers import WorkerPool
from seg.data import RealSet
from seg.mmd import mmd2

from .conftest import TINY, lines

VOID = 255


def unlabelled(height: int, width: int, count: int = 6) -> RealSet:
    """Real images of noise, all of whose labels are void."""
    names = tuple(f"{k}" for k in range(count))
    images = np.random.default_rng(0).integers(0, 256, (count, height, width, 3)).astype(np.uint8)
    return RealSet(names, names, images, np.full(images.shape[:3], VOID, np.uint8))


TARGET = Target(
    "camvid", True, "camvid", "", ("a",), ("b",),
    lambda height, width: Split(unlabelled(height, width), unlabelled(height, width)),
)  # fmt: skip


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """One update of two datasets, two images each."""
    config = camvid_config("smoke")
    stage = replace(config.reward, streets=2, shots=1)
    final = replace(stage, train=replace(stage.train, steps=13))
    search = replace(config.search, method="random_search", updates_per_group=1)
    out = tmp_path_factory.mktemp("mmd") / "run"
    return replace(
        config, reward_kind="mmd", reward=stage, final=final, search=search, groups=(NAMES,),
        workers=0, out=out, asset_count=2,
    )  # fmt: skip


@pytest.fixture(scope="module")
def net(config, tmp_path_factory) -> FeatureNet:
    return feature_net(config, "camvid", tmp_path_factory.mktemp("net"), WorkerPool(0))


def test_a_folder_without_labels_gives_the_reward_from_the_command_line(camvid, tmp_path, capsys):
    photographs, out = tmp_path / "photographs", tmp_path / "run"
    photographs.mkdir()
    for k in range(3):
        shutil.copy(camvid / "train" / f"{('A_1', 'A_2', 'B_1')[k]}.png", photographs / f"p{k}.png")
    flags = [
        *TINY, "--data", str(camvid), "--unlabelled", str(photographs), "--out", str(out),
        "--seeds", "1", "--final.train.steps", "6", "--workers", "0",
    ]  # fmt: skip
    assert main("camvid", camvid_config, camvid_target, "", flags) == 2
    assert "--unlabelled needs --reward-kind mmd" in capsys.readouterr().err
    assert main("camvid", camvid_config, camvid_target, "", [*flags, "--reward-kind", "mmd"]) == 0
    assert "3 images without labels for the reward" in capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    assert list(summary["rows"]) == ["random", "default", "learnt"]
    assert summary["reward_images"] == 3
    assert {line["row"] for line in lines(out / "finals.jsonl")} >= {"random", "learnt"}
    assert "real" not in {line["row"] for line in lines(out / "finals.jsonl")}
    assert "the reward images themselves" not in (out / "report.html").read_text()


def test_the_twin_has_labels(tiny_twin, tmp_path):
    config = replace(tiny_twin, unlabelled=tmp_path, reward_kind="mmd")
    with pytest.raises(UserError, match="--unlabelled needs --data"):
        cityscapes_target(config, WorkerPool(0))


def test_an_unlabelled_image_is_not_reported_on(tiny_camvid, camvid):
    config = replace(tiny_camvid, unlabelled=camvid / "test", reward_kind="mmd")
    with pytest.raises(UserError, match="are among the reward images"):
        camvid_target(config, WorkerPool(0))


@pytest.mark.slow
def test_search_and_candidates_need_no_label(config):
    check(config)
    folder, workers = RunFolder(config, "camvid"), WorkerPool(0)
    stream = io.StringIO()
    progress = Progress(4, stream=stream)
    net = feature_net(config, "camvid", folder.path, workers)
    split = TARGET.at(config.final.height, config.final.width)
    reference = net.reference(split.reward.images)
    result = search(config, TARGET, reference, folder, workers, progress, 1.0)
    assert result.rewards.shape == (1, 2) and np.isfinite(result.rewards).all()
    finals = Finals(config, TARGET, split, folder, workers, progress, 1.0, None, net)
    chosen, scores = finals.candidates(result)
    folder.close()
    assert chosen in config.candidates and set(scores) == set(config.candidates)
    assert (config.out / FILE).exists()
    assert all(line["class_iou"] == [] for line in lines(config.out / "evaluations.jsonl"))
    assert "-MMD^2" in stream.getvalue() and "mIoU" not in stream.getvalue()


def test_the_net_is_trained_once(config, net, monkeypatch):
    monkeypatch.setattr(module, "train_features", None)
    again = feature_net(config, "camvid", net.path.parent, WorkerPool(0))
    images = unlabelled(16, 16).images
    one, other = again.reference(images), net.reference(images)
    assert one.source == other.source and one.features.shape == (6, 120)
    assert net.reference(images[::-1]).source != one.source


def test_a_dataset_is_nearest_to_itself(config, net):
    stage, pool = config.reward, config.pool
    units = draw_units(random_proposal(), 0, stage.streets)
    own = render(stage, config.renderer, pool, units, 0).images
    rewards = [
        evaluate_mmd(stage, "camvid", config.renderer, pool, units, 0, net.reference(images)).reward
        for images in (own, unlabelled(stage.height, stage.width).images)
    ]
    assert rewards[0] > rewards[1]
    # Unbiased, a set against itself is below 0: what pairs leave out is k(x, x).
    x = net.reference(own).features
    assert rewards[0] == pytest.approx(-mmd2(x, x)) and rewards[0] > 0


def test_the_store_keeps_kinds_of_rewards_apart(config, net, tmp_path):
    images = unlabelled(config.reward.height, config.reward.width)
    truth, reference = Truth(images.images, images.labels), net.reference(images.images)
    moved = reference._replace(net="elsewhere.npz")  # where the net lies does not matter
    keys = [
        about(config, config.reward, TARGET, "reward", t)["config"]
        for t in (truth, reference, moved)
    ]
    assert keys[0] != keys[1] == keys[2]
    store = Store(tmp_path / "store.jsonl")
    evaluator = Evaluator(config, config.reward, TARGET, "reward", reference, WorkerPool(0), store)
    jobs = [Job(random_proposal(), draw_units(random_proposal(), 1, 2), 1)]
    ((_, first),) = evaluator.map(evaluate_mmd, jobs)
    ((_, again),) = evaluator.map(evaluate_mmd, jobs)
    assert again.stored and not first.stored and again.reward == first.reward


def test_what_cannot_work_is_refused(config, net, tmp_path):
    squared = replace(config, search=replace(config.search, squared_reward=True))
    with pytest.raises(UserError, match="squared-reward needs --reward-kind miou"):
        check(squared)
    single = replace(config, reward=replace(config.reward, streets=1))
    with pytest.raises(UserError, match="at least 2 images"):
        check(single)
    with pytest.raises(UserError, match="at least 2 reward images"):
        net.reference(unlabelled(16, 16, 1).images)
    images = unlabelled(16, 16)
    with pytest.raises(UserError, match="this command knows miou only"):
        truth = Truth(images.images, images.labels)
        Evaluator(config, config.reward, TARGET, "reward", truth, WorkerPool(0))
    (tmp_path / FILE).write_bytes(b"no zip")
    with pytest.raises(UserError, match="remove it to train it anew"):
        FeatureNet(tmp_path / FILE, 11).reference(images.images)
