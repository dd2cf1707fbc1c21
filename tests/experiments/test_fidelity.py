"""Fidelity of the rungs: the statistics by hand, the seeds, and that a kill changes nothing."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from experiments.targets import TARGETS
from hypothesis import given
from hypothesis import strategies as st

from experiments import fidelity_job as module
from experiments.config import PRESETS
from experiments.fidelity_job import (
    check,
    fidelity_config,
    levels,
    main,
    proposals,
    run,
)
from experiments.fidelity_stats import (
    bootstrap,
    noise_variance,
    pairing,
    residual_variance,
    signal_to_noise,
    spearman,
)
from experiments.reward import Evaluation
from scene.attributes import NAMES

from .conftest import Killed, lines

FILES = ("fidelity.json", "fidelity.md")


def table_of(worth, seeds, left):
    """a_p + b_s + e_ps."""
    return np.asarray(worth)[:, None] + np.asarray(seeds)[None] + np.asarray(left)


def test_spearman_by_hand():
    assert spearman(np.array([1.0, 2, 3]), np.array([10.0, 40, 50])) == pytest.approx(1)
    assert spearman(np.array([1.0, 2, 3]), np.array([3.0, 1, 2])) == pytest.approx(-0.5)
    # Equal values share their rank: (1.5, 1.5, 3) against (1, 2, 3).
    assert spearman(np.array([5.0, 5, 6]), np.array([1.0, 2, 3])) == pytest.approx(math.sqrt(0.75))
    assert math.isnan(spearman(np.ones(3), np.arange(3.0)))


def test_variances_by_hand():
    # e = +-1: each row and column of it sums to 0. Four residuals of 1, one degree of freedom.
    table = table_of([0, 10], [0, 4], [[1, -1], [-1, 1]])
    assert residual_variance(table) == pytest.approx(4)
    assert noise_variance(table) == pytest.approx((2 + 18) / 2)  # rows 1, 3 and 9, 15
    pairs = pairing(table)
    assert (pairs.common, pairs.independent) == (pytest.approx(8), pytest.approx(20))


@given(st.integers(0, 2**32 - 1))
def test_pairing_is_the_mean_over_all_pairs(seed):
    table = np.random.default_rng(seed).normal(size=(4, 3))
    pairs = [(p, q) for p in range(4) for q in range(p)]
    common = np.mean([(table[p] - table[q]).var(ddof=1) for p, q in pairs])
    apart = np.mean([table[p].var(ddof=1) + table[q].var(ddof=1) for p, q in pairs])
    found = pairing(table)
    assert found.common == pytest.approx(common) and found.independent == pytest.approx(apart)


def test_common_seeds_pay_where_seeds_move_all_alike():
    rng = np.random.default_rng(0)
    alike = table_of(rng.normal(size=8), rng.normal(size=6), 0.1 * rng.normal(size=(8, 6)))
    apart = table_of(rng.normal(size=8), np.zeros(6), rng.normal(size=(8, 6)))
    assert pairing(alike).independent > 10 * pairing(alike).common
    assert pairing(alike).p_value < 0.01 < 0.05 < pairing(apart).p_value


def test_signal_to_noise_finds_what_was_put_in():
    rng = np.random.default_rng(1)
    b = rng.normal(size=40)
    worth = 3 * rng.normal(size=200)
    table = table_of(worth[:40], b, rng.normal(size=(40, 40)))
    first = worth + b[0] + rng.normal(size=200)
    found = signal_to_noise(first, table, 0)
    low, high = found.ci95  # sqrt(9 / (1 + 1)) = 2.1
    assert found.value == pytest.approx(3 / math.sqrt(2), rel=0.2) and low < 3 / math.sqrt(2) < high
    none = signal_to_noise(b[0] + rng.normal(size=200), table - worth[:40, None], 0)
    assert none.value < 0.5
    assert signal_to_noise(first[:1], table, 0) == (None, None)


def test_a_bootstrap_draws_each_set_by_itself():
    found = bootstrap((3, 5), lambda a, b: float(len(a) * 10 + len(b) + (b.max() > 4)), 0)
    assert found.value == 35 and found.ci95 == [35, 35]
    assert bootstrap((3,), lambda k: math.nan, 0) == (None, None)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
def test_presets_are_sound(target, preset):
    config = fidelity_config(target, preset)
    check(config)
    found = levels(config)
    assert [level.kind for level in found] == ["miou"] * 3
    assert found[0].stage == config.reward and found[-1].stage == config.final
    found = levels(replace(config, reward_kind="mmd"))
    assert [level.kind for level in found] == ["mmd"] * 3 + ["miou"]


def test_proposals_have_random_bins_at_the_search_s_relaxation():
    config = fidelity_config("camvid", "quick")
    found = proposals(config)
    assert list(found)[:3] == ["default", "random", "draw-1"] and len(found) == 2 + 24
    assert found["draw-1"].centre.shape == (len(NAMES),)
    np.testing.assert_allclose(found["draw-1"].width, 0.3)
    again = proposals(config)
    np.testing.assert_array_equal(found["draw-9"].centre, again["draw-9"].centre)
    assert not np.array_equal(found["draw-9"].centre, found["draw-8"].centre)


@pytest.fixture
def measure(camvid, tmp_path, monkeypatch):
    """Measures with a formula for the reward, and lists the calls."""
    calls: list[tuple] = []

    def evaluate(stage, table, renderer, pool, units, seed, truth):
        if len(calls) == evaluate.limit:
            raise Killed
        calls.append((stage, seed, truth.images.shape))
        right = int(1e6 * (1 - np.abs(units - 0.5).mean())) + seed % 7
        return Evaluation(np.array([[right, 10**6]] * 2), 0.01, 0.02)

    evaluate.limit = -1
    monkeypatch.setattr(module, "evaluate", evaluate)
    config = replace(
        fidelity_config("camvid", "smoke"), data=camvid, workers=0, proposals=5, repeated=3,
        out=tmp_path / "run",
    )  # fmt: skip
    return config, calls, evaluate


def test_every_proposal_is_scored_on_every_rung(measure):
    config, calls, _ = measure
    report = run(config)
    assert len(calls) == 3 * (7 + 3)
    for rung, level in zip(report["rungs"], levels(config), strict=True):
        own = {seed for stage, seed, _ in calls if stage == level.stage}
        others = {seed for stage, seed, _ in calls if stage != level.stage}
        assert len(own) == 2 and not own & others
        assert [len(r) for r in rung["rewards"].values()] == [2, 2, 2, 1, 1, 1, 1]
        assert rung["core_seconds"] == pytest.approx(0.03)
    assert report["rungs"][-1]["rank_correlation"]["value"] == pytest.approx(1)
    assert json.loads((config.out / "fidelity.json").read_text()) == report
    text = (config.out / "fidelity.md").read_text()
    assert "the reward's signal is at least" in text and "common random numbers" in text


def test_a_killed_measurement_ends_as_an_unbroken_one(measure, tmp_path):
    config, calls, evaluate = measure
    run(config)
    whole = [(config.out / name).read_bytes() for name in FILES]
    calls.clear()
    killed = replace(config, out=tmp_path / "killed")
    evaluate.limit = 13
    with pytest.raises(Killed):
        run(killed)
    evaluate.limit = -1
    run(killed)
    assert len(calls) == 30 and len(lines(killed.out / "store.jsonl")) == 31
    assert [(killed.out / name).read_bytes() for name in FILES] == whole


@pytest.mark.parametrize(("required", "fit"), [("1", True), ("1e9", False), (None, None)])
def test_a_reward_with_too_little_signal_stops_a_script(measure, required, fit, capsys):
    config, calls, _ = measure
    flags = ["--target", "camvid", "--preset", "smoke", "--data", str(config.data)]
    flags += ["--workers", "0", "--out", str(config.out)]
    flags += ["--proposals", "5", "--repeated", "3", "--rungs", "1"]
    code = main("", flags if required is None else [*flags, "--require-signal", required])
    report = json.loads((config.out / "fidelity.json").read_text())
    (rung,) = report["rungs"]
    assert len(calls) == 7 + 3 and rung["signal_to_noise"]["value"] > 1
    assert report["fit"] is fit and code == (fit is False)
    assert ("the signal is NOT 1e+09 times the noise" in capsys.readouterr().out) == (fit is False)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--target", "moon"], "--target 'moon' is unknown"),
        (["--proposals", "1"], "--proposals must be 2 or more"),
        (["--repeated", "9"], "--repeated must be 2 to 5"),
        (["--repeats", "1"], "--repeats must be 2"),
        (["--rungs", "0"], "--rungs must be 1 or more"),
        (["--require-signal", "0"], "--require-signal must be above 0"),
        (["--search.relaxation", "2"], "--search.relaxation must lie in [0, 1]"),
        (["--target", "cityscapes"], "Cityscapes needs its folder"),
        (["--data", "x"], "--target twin takes no --data"),
    ],
)
def test_what_cannot_work_is_one_line_and_exit_code_2(flags, words, tmp_path, error_line):
    out = tmp_path / "run"
    code = main("", ["--preset", "smoke", "--workers", "0", "--out", str(out), *flags])
    assert code == 2 and words in error_line()
    assert not out.exists()


@pytest.mark.slow
def test_the_command_measures_the_reward_without_labels(tmp_path, start_job):
    job = start_job(
        tmp_path / "run", "--preset", "smoke", "--workers", "1", "--reward-kind", "mmd",
        "--reward.train.steps", "4", "--final.train.steps", "6", experiment="fidelity",
    )  # fmt: skip
    code, stdout, stderr = job.finish()
    assert (code, stderr) == (0, "") and "NOT real data" in stdout
    report = json.loads((tmp_path / "run" / "fidelity.json").read_text())
    assert [rung["reward"] for rung in report["rungs"]] == ["-MMD^2"] * 3 + ["mIoU"]
