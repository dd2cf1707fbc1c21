"""The search loop with a reward that is a formula: replay, errors, and what ends it."""

import json
import signal
from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import sdr_jax
from experiments import search as module
from experiments.config import camvid_config
from experiments.errors import UserError
from experiments.folder import RunFolder
from experiments.main import main
from experiments.progress import Progress
from experiments.reward import Evaluation, Truth
from experiments.search import make_space, search
from experiments.targets import Target, camvid_target
from scene.workers import WorkerPool
from seg.train import TrainingError

TRUTH = Truth(np.zeros((1, 8, 8, 3), np.uint8), np.zeros((1, 8, 8), np.uint8))


def formula(stage, table, renderer, pool, units, seed, truth) -> Evaluation:
    """Worth more the nearer the middle; a little noise by seed."""
    right = int(1000 * (1 - np.abs(units - 0.5).mean())) + seed % 50
    return Evaluation(np.array([[right, 1000]] * 2), 0.01, 0.02)


def nan(*task) -> SimpleNamespace:
    return SimpleNamespace(reward=float("nan"))


def diverge(*task) -> None:
    raise TrainingError("the loss is nan after 50 of 200 steps")


def die(*task) -> None:
    import os

    os.kill(os.getpid(), signal.SIGKILL)


class Killed(BaseException):
    """Stands for the end of the process."""


TARGET = Target("camvid", True, "camvid", "", (), (), lambda height, width: None)


def run(config, monkeypatch, evaluate=formula):
    monkeypatch.setattr(module, "evaluate", evaluate)
    folder = RunFolder(config, TARGET.name)
    try:
        with open("/dev/null", "w") as stream:
            progress = Progress(1, stream=stream)
            return search(config, TARGET, TRUTH, folder, WorkerPool(0), progress, 1.0)
    finally:
        folder.close()


def without_times(path):
    records = [json.loads(line) for line in path.read_text().splitlines()]
    return [{k: v for k, v in r.items() if "seconds" not in k and k != "elapsed"} for r in records]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An unbroken search by SDR, 12 updates of 2 datasets: its configuration and its result."""
    config = camvid_config("smoke")
    search = replace(config.search, method="sdr", updates_per_group=2)
    config = replace(
        config, workers=0, search=search, out=tmp_path_factory.mktemp("search") / "whole"
    )
    with pytest.MonkeyPatch.context() as patch:
        return config, run(config, patch)


def test_every_reward_is_logged_with_its_actions(whole):
    config, result = whole
    logged = without_times(config.out / "evaluations.jsonl")
    wanted = [(update, dataset) for update in range(12) for dataset in range(2)]
    assert [(r["update"], r["dataset"]) for r in logged] == wanted
    np.testing.assert_array_equal(
        result.rewards, np.float32([r["reward"] for r in logged]).reshape(12, 2)
    )
    np.testing.assert_array_equal(result.groups, np.repeat(np.arange(6), 2))
    assert result.probabilities.shape == (12, 23, 5)
    np.testing.assert_allclose(result.probabilities.sum(-1), 1, atol=1e-5)
    # An attribute has an action from its group's turn on, and keeps it once learnt.
    space = make_space(config)
    for record in logged:
        decided = {a for g in space.groups[: record["update"] // 2 + 1] for a in g}
        assert {a for a, action in enumerate(record["actions"]) if action >= 0} == decided


def test_kill_and_continue_gives_the_same_answer(whole, tmp_path, monkeypatch):
    config, result = whole
    for count in (7, 15):  # before an update's second reward, and before an update's first
        left = [count]

        def dying(*task, left=left):
            if left[0] == 0:
                raise Killed
            left[0] -= 1
            return formula(*task)

        with pytest.raises(Killed):
            run(replace(config, out=tmp_path / "killed"), monkeypatch, dying)
    assert len(without_times(tmp_path / "killed" / "evaluations.jsonl")) == 7 + 15
    again = run(replace(config, out=tmp_path / "killed"), monkeypatch)
    for name, value in result._asdict().items():
        for one, other in zip(
            jax.tree.leaves(getattr(again, name)), jax.tree.leaves(value), strict=True
        ):
            np.testing.assert_array_equal(one, other, err_msg=name)
    logs = [without_times(p / "evaluations.jsonl") for p in (config.out, tmp_path / "killed")]
    assert logs[0] == logs[1]


def test_continuous_actions_are_replayed_to_the_bit(tmp_path, monkeypatch):
    """A method's actions may be floats: the log keeps them, and a finished run scores nothing."""
    monkeypatch.setattr(module, "make_method", lambda _, space: sdr_jax.gaussian(space))
    config = camvid_config("smoke")
    config = replace(
        config,
        workers=0,
        search=replace(config.search, updates_per_group=1, datasets_per_update=2),
        out=tmp_path / "run",
    )
    first = run(config, monkeypatch)
    logged = [r["actions"] for r in without_times(tmp_path / "run" / "evaluations.jsonl")]
    assert all(isinstance(value, float) for actions in logged for value in actions)
    again = run(config, monkeypatch, die)
    jax.tree.map(np.testing.assert_array_equal, again, first)


def test_a_log_of_another_run_is_refused(whole, tmp_path, monkeypatch):
    config = replace(whole[0], out=tmp_path / "run")
    RunFolder(config, TARGET.name).close()
    first = json.loads((whole[0].out / "evaluations.jsonl").read_text().splitlines()[0])
    path = config.out / "evaluations.jsonl"
    path.write_text(json.dumps({**first, "seed": first["seed"] ^ 1}) + "\n")
    with pytest.raises(UserError, match=r"evaluations\.jsonl: update 0, dataset 0 was not made"):
        run(config, monkeypatch)


def end(camvid, out, monkeypatch, capsys, evaluate, *flags) -> tuple[int, str]:
    """Exit code and the one line on standard error of a CamVid job with another reward."""
    monkeypatch.setattr(module, "evaluate", evaluate)
    arguments = ["--preset", "smoke", "--data", str(camvid), "--out", str(out), *flags]
    code = main("camvid", camvid_config, camvid_target, "", arguments)
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err and len(captured.err.strip().splitlines()) == 1
    return code, captured.err.strip()


def test_a_nan_reward_is_an_error_and_no_line(camvid, tmp_path, monkeypatch, capsys):
    out = tmp_path / "run"
    code, text = end(camvid, out, monkeypatch, capsys, nan, "--workers", "0")
    assert code == 2 and "update 0, dataset 0: the reward is nan" in text
    assert not (out / "evaluations.jsonl").exists()


def test_training_that_diverges_is_one_line_and_exit_code_2(camvid, tmp_path, monkeypatch, capsys):
    code, text = end(camvid, tmp_path / "run", monkeypatch, capsys, diverge, "--workers", "0")
    assert code == 2 and text == "error: the loss is nan after 50 of 200 steps"


def test_ctrl_c_is_one_line_and_exit_code_130(camvid, tmp_path, monkeypatch, capsys):
    def interrupted(*task):
        raise KeyboardInterrupt

    code, text = end(camvid, tmp_path / "run", monkeypatch, capsys, interrupted, "--workers", "0")
    assert code == 130 and text == "stopped; the same command goes on where it was"


def test_a_worker_that_dies_twice_is_one_line_and_exit_code_1(
    camvid, tmp_path, monkeypatch, capsys
):
    code, text = end(camvid, tmp_path / "run", monkeypatch, capsys, die, "--workers", "1")
    assert code == 1 and "a worker process died twice" in text and "--workers" in text


def test_a_disk_that_fills_up_is_named_and_the_run_goes_on_later(
    camvid, tmp_path, monkeypatch, capsys
):
    from experiments import folder

    calls = []
    fsync = folder.os.fsync

    def filling(descriptor):
        calls.append(descriptor)
        if len(calls) > 5:
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    out = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(folder.os, "fsync", filling)
        code, text = end(camvid, out, patch, capsys, formula, "--workers", "0")
    assert code == 2 and f"{out / 'evaluations.jsonl'}: No space left on device" in text
    assert len(without_times(out / "evaluations.jsonl")) == 4
    code, text = end(camvid, out, monkeypatch, capsys, nan, "--workers", "0")
    assert code == 2 and "update 2, dataset 0" in text  # the first four were taken from the log
