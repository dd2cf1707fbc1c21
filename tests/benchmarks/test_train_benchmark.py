"""The benchmark of nets: rows that scripts rely on, at tiny sizes."""

import json

import numpy as np
import pytest

from benchmarks import train as benchmark
from seg import TrainSettings, mean_iou, score
from seg.data import LabelledImages
from seg.train import train


def test_rows_are_those_that_scripts_rely_on(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(benchmark, "find_spec", lambda name: None)
    path = tmp_path / "train.json"
    arguments = ["--nets", "compact", "--sizes", "16x8", "--repeats", "1", "--batch", "2"]
    assert benchmark.main([*arguments, "--no-reward", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())["rows"]
    assert [row["pass"] for row in rows] == ["forward", "step"]
    for row in rows:
        assert (row["net"], row["size"], row["batch"]) == ("compact", "16x8", 2)
        assert row["images_per_s"] == pytest.approx(2000 / row["ms"]) and row["ms"] > 0
        assert row["torch_ms"] is None and row["ratio_to_torch"] is None
    assert "| compact | 16x8 |" in " ".join(capsys.readouterr().out.split())


def test_ratio_is_pytorchs_time_over_ours(monkeypatch):
    times = {"jax": (10.0, 20.0), False: (30.0, 30.0), True: (20.0, 40.0)}
    named = {key: dict(zip(("forward", "step"), pair, strict=True)) for key, pair in times.items()}
    monkeypatch.setattr(benchmark, "jax_runs", lambda job: "jax")
    monkeypatch.setattr(benchmark, "torch_runs", lambda job, last, threads: last)
    monkeypatch.setattr(benchmark, "medians", lambda runs, repeats: named[runs])
    rows = benchmark.net_rows(benchmark.Job("compact", 16, 8, 2), 1, 2, True)
    assert [row["ratio_to_torch"] for row in rows] == [2.0, 1.5]
    assert [row["torch_layout"] for row in rows] == ["channels_last", "contiguous"]


def test_what_a_net_learns_is_a_row_with_its_cost():
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (4, 16, 24, 3), np.uint8)
    labels = rng.integers(0, 2, images.shape[:3], np.uint8)
    sides = {
        "labelled": LabelledImages(images, labels),
        "test": LabelledImages(images[:3], labels[:3]),
    }
    settings = TrainSettings(steps=2, warmup=1, batch=2, predict_batch=3)
    row = benchmark.learning_row(sides, settings, 2, range(2))
    assert (row["net"], row["steps"], row["images"], row["tested"]) == ("compact", 2, 4, 3)
    mious = [float(miou) for miou in row["mious"].split()]
    assert len(mious) == 2 and row["miou"] == pytest.approx(np.mean(mious), abs=0.06)
    expected = [
        100
        * mean_iou(
            score(train(seed, images, labels, settings, 2), images[:3], labels[:3], settings, 2)
        )
        for seed in range(2)
    ]
    assert mious == pytest.approx(expected, abs=0.01)
    assert row["features_s"] == 0 and row["core_s"] == row["train_s"] > 0


def test_a_target_to_learn_needs_its_images(monkeypatch, capsys):
    monkeypatch.delenv("CAMVID_DIR", raising=False)
    with pytest.raises(SystemExit) as ended:
        benchmark.main(["--learn", "camvid", "--nets", "compact"])
    assert ended.value.code == 2
    assert "--learn camvid needs --data" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.slow
def test_lite0_has_four_passes():
    runs = dict(benchmark.jax_runs(benchmark.Job("lite0", 40, 32, 2)))
    assert list(runs) == ["forward", "features", "head", "step"]
    for name in ("features", "head"):
        assert benchmark.medians(iter([(name, runs[name])]), 1)[name] > 0


@pytest.mark.parametrize(("job", "passes"), [
    (benchmark.Job("compact", 16, 8, 2), "forward step"),
    (benchmark.Job("lite0", 40, 32, 2), "forward features head step"),
])  # fmt: skip
@pytest.mark.parametrize("channels_last", [False, True])
def test_pytorch_does_the_same_work(job, passes, channels_last):
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install torch")
    ms = benchmark.medians(benchmark.torch_runs(job, channels_last, 1), 1)
    assert list(ms) == passes.split() and min(ms.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize(("requested", "images"), [(None, 96), (14, 12)])
def test_a_reward_is_split(requested, images):
    row = benchmark.reward_row(4, steps=3, images=requested)  # whole streets, of 4 images each
    assert (row["size"], row["images"], row["scored"], row["steps"]) == ("240x176", images, 4, 3)
    parts = [row[f"{part}_s"] for part in ("render", "train", "score")]
    assert min(parts) > 0 and row["reward_s"] == pytest.approx(sum(parts))


@pytest.mark.parametrize(("arguments", "message"), [
    (["--sizes", "big"], "must look like 640x320, not 'big'"),
    (["--repeats", "0"], "at least 1, not '0'"),
    (["--nets", "unet"], "invalid choice: 'unet'"),
])  # fmt: skip
def test_arguments_that_make_no_sense(arguments, message, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        benchmark.main(arguments)
    assert message in capsys.readouterr().err
