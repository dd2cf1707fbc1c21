"""Sensitivity: what was put into rewards is found, files in both formats, what is missing is recorded."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.targets import TARGETS
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from experiments import sensitivity_job, sensitivity_model, sensitivity_report, study_nets
from experiments.config import PRESETS
from experiments.sensitivity_job import check, main, proposals, run, sensitivity_config
from experiments.sensitivity_model import DEGREE, PAIR_ORDERS
from experiments.sensitivity_records import BINS, Records, read
from experiments.store import HEADER, Store
from scene.attributes import NAMES

from .conftest import Killed, formula, lines, never

HUMP, SLOPE, LEFT, RIGHT = (
    NAMES.index(name)
    for name in ("car_position", "tree_interval", "camera_position_x", "camera_rotation_y")
)
NOTHING = NAMES.index("fence_position")


def synthetic(n: int, noise: float = 0.5, seed: int = 0) -> Records:
    """20 + a hump (variance 2) + a slope (1) + a product of two without effects alone (1) + noise."""
    rng = np.random.default_rng(seed)
    centre = rng.random((n, len(NAMES)))
    wave = np.sqrt(2) * np.cos(np.pi * centre)
    rewards = (
        20
        - 2 * np.cos(2 * np.pi * centre[:, HUMP])
        + wave[:, SLOPE]
        + wave[:, LEFT] * wave[:, RIGHT]
        + noise * rng.normal(size=n)
    )
    return Records(centre, np.zeros_like(centre), rewards, "c", "synthetic", 0, ())


@pytest.fixture(scope="module")
def found() -> dict:
    """The report of 300 synthetic records."""
    return sensitivity_report.summarize(synthetic(300))


def test_what_was_put_in_comes_first(found):
    rows = {row["name"]: row for row in found["attributes"]}
    ranked = list(rows)
    assert ranked[0] == NAMES[HUMP]
    assert set(ranked[1:4]) == {NAMES[SLOPE], NAMES[LEFT], NAMES[RIGHT]}
    assert set(found["pairs"][0]["names"]) == {NAMES[LEFT], NAMES[RIGHT]}
    assert found["pairs"][0]["share"]["value"] > 5 * found["pairs"][1]["share"]["value"]
    for k, share in ((HUMP, 50), (SLOPE, 25)):
        assert rows[NAMES[k]]["share"]["value"] == pytest.approx(share, abs=8)
    for k in (NOTHING, LEFT, RIGHT):  # no effect alone
        low, high = rows[NAMES[k]]["share"]["ci95"]
        assert low == 0 and high < 3
    assert rows[NAMES[LEFT]]["total"]["ci95"][0] > 10
    assert found["r2"]["value"] > 0.7 and found["r2"]["ci95"][0] > 0.5
    assert found["noise"]["model"] == pytest.approx(0.5, abs=0.2)


def test_best_values_are_physical(found):
    row = next(row for row in found["attributes"] if row["name"] == NAMES[HUMP])
    assert row["best"] == pytest.approx(7.5, abs=0.8) and row["unit"] == "m"  # 1 to 14 m
    assert row["range90"][0] > 5.5 and row["range90"][1] < 9.5
    assert row["worth"] == pytest.approx(4, abs=0.8)
    curve = found["curves"][NAMES[HUMP]]
    assert curve["physical"][0] == 1 and curve["physical"][-1] == 14
    assert all(
        a <= b <= c for a, b, c in zip(curve["low"], curve["mean"], curve["high"], strict=True)
    )


def test_the_order_of_the_records_changes_nothing(tmp_path):
    config = sensitivity_config("camvid", "quick")
    rng = np.random.default_rng(1)
    texts = [
        json.dumps({"bins": rng.integers(0, 10, len(NAMES)).tolist(), "reward": float(k % 7)})
        for k in range(30)
    ]
    paths = [tmp_path / "one.jsonl", tmp_path / "two.jsonl"]
    paths[0].write_text("\n".join(texts))
    paths[1].write_text("\n".join(rng.permutation(texts)))
    one, two = (read([path], config, "camvid") for path in paths)
    for ours, theirs in zip(one[:3], two[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_pure_noise_is_said_to_be_nothing():
    rng = np.random.default_rng(3)
    records = synthetic(60)._replace(rewards=20 + rng.normal(size=60))
    found = sensitivity_report.summarize(records)
    assert found["r2"]["value"] < 0.05
    report = {"target": "camvid", "real": True, "note": "noise", **found}
    assert "nothing is known" in sensitivity_report.text(report)


def test_shares_by_hand():
    layout = sensitivity_model.lay_out(3)
    own, both = 3 * DEGREE, len(PAIR_ORDERS)
    assert layout.effects == 6 and len(layout.effect) == own + 3 * both
    assert np.bincount(layout.effect, layout.relative) == pytest.approx(np.ones(6))
    weights = np.zeros((1, own + 3 * both))
    weights[0, [0, 1, DEGREE]] = 1, 2, 1  # 1 + 4 of the first attribute, 1 of the second
    weights[0, own + both] = 2  # 4 of the pair (0, 2)
    found = sensitivity_model.shares(layout, weights[0], weights)
    np.testing.assert_allclose(found.effects, [0.5, 0.1, 0, 0, 0.4, 0])
    np.testing.assert_allclose(found.drawn, [found.effects])  # one draw does not vary
    np.testing.assert_allclose(sensitivity_model.totals(layout, found.effects), [0.9, 0.1, 0.4])
    assert found.signal == pytest.approx(10)


def test_draws_of_what_is_not_there_lie_around_zero():
    layout = sensitivity_model.lay_out(3)
    expected = np.zeros(len(layout.effect))
    expected[0] = 1
    drawn = expected + 0.1 * np.random.default_rng(0).normal(size=(5000, len(expected)))
    found = sensitivity_model.shares(layout, expected, drawn)
    np.testing.assert_allclose(found.drawn.mean(axis=0), found.effects, atol=0.01)
    assert (np.quantile(found.drawn, 0.025, axis=0)[1:] < 0).all()


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_shares_are_variances_on_the_unit_cube(seed):
    rng = np.random.default_rng(seed)
    layout = sensitivity_model.lay_out(3)
    weights = rng.normal(size=len(layout.effect))
    unit = rng.random((40_000, 3))
    values = sensitivity_model.features(layout, unit, np.zeros_like(unit)) @ weights
    found = sensitivity_model.shares(layout, weights, weights[None])
    assert found.effects.sum() == pytest.approx(1)
    assert values.var() == pytest.approx(found.signal, rel=0.1)


@given(st.floats(0, 1), st.floats(0, 1))
def test_waves_are_means_over_intervals(centre, width):
    points = centre + width * (np.arange(2000) + 0.5) / 2000 - width / 2
    wanted = sensitivity_model.waves(points).mean(axis=0)
    np.testing.assert_allclose(sensitivity_model.waves(centre, width), wanted, atol=1e-4)
    np.testing.assert_allclose(sensitivity_model.waves(0.5, 1.0), 0, atol=1e-12)


def test_draws_are_those_of_the_posterior():
    records = synthetic(40)
    layout = sensitivity_model.lay_out(3)
    x = sensitivity_model.features(layout, records.centre[:, :3], records.width[:, :3])
    fitted = sensitivity_model.fit(layout, x, records.rewards)
    drawn = sensitivity_model.draw(fitted, 20_000, 0)
    precision = fitted.x.T @ fitted.x / fitted.noise**2 + np.diag(1 / fitted.variance)
    scale = np.sqrt(np.diag(np.linalg.inv(precision)))
    assert np.abs((drawn.mean(axis=0) - fitted.weights) / scale).max() < 0.05
    np.testing.assert_allclose(drawn.std(axis=0), scale, rtol=0.05)


def evaluation(k: int, config: str = "aaaa", **other) -> dict:
    """A line of a store."""
    rng = np.random.default_rng(k)
    return {
        "key": f"{config}-{k}", "config": config, "target": "camvid", "side": "reward",
        "size": "64x48", "images": 96, "steps": 200, "engine": "e",
        "centre": rng.random(23).round(6).tolist(), "width": [0.3] * 23, "seed": k,
        "reward": 0.2 + 0.001 * k, "class_iou": [], "render_seconds": 0.1, "train_seconds": 0.1,
        "failed": None, **other,
    }  # fmt: skip


def write_store(path, records):
    path.write_text("".join(json.dumps(line) + "\n" for line in [HEADER, *records]))
    return path


def test_one_configuration_is_taken_and_the_others_told(tmp_path):
    config = sensitivity_config("camvid", "quick")
    a = [evaluation(k) for k in range(9)]
    a[0] |= {"reward": None, "failed": "the loss is nan"}
    b = [evaluation(k, "bbbb") for k in range(8)]
    tests = [evaluation(k, "cccc", side="test") for k in range(20)]
    one = write_store(tmp_path / "one.jsonl", [*a[:6], *tests])
    two = write_store(tmp_path / "two.jsonl", [*a[4:], *b])
    found = read([one, two], config, "camvid")
    assert (found.config, len(found.rewards), found.failed) == ("aaaa", 8, 1)
    assert len(found.aside) == 2 and "bbbb (8 of camvid" in " ".join(found.aside)
    assert read([one, two], config, "camvid", "bbbb").config == "bbbb"


def test_lines_of_bins_mean_relaxed_bins(tmp_path):
    path = tmp_path / "bins.jsonl"
    path.write_text('{"bins": ' + json.dumps([0] * 22 + [5]) + ', "reward": 21.5}\n')
    found = read([path], sensitivity_config("camvid", "quick"), "camvid")
    assert found.config == BINS and found.rewards == pytest.approx([21.5])
    assert found.centre[0, 0] == pytest.approx(0.15)  # slid inside
    assert found.centre[0, 22] == pytest.approx(0.55)
    assert found.width[0] == pytest.approx([0.3] * 23)


@pytest.fixture
def recorded(tmp_path):
    """A file of bins whose rewards depend on one attribute."""
    rng = np.random.default_rng(0)
    bins = rng.integers(0, 10, (40, len(NAMES)))
    path = tmp_path / "bins.jsonl"
    path.write_text(
        "".join(
            json.dumps({"bins": row.tolist(), "reward": 10 + float(row[SLOPE])}) + "\n"
            for row in bins
        )
    )
    return path


def test_records_need_no_data_and_give_the_same_again(recorded, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("CAMVID_DIR", raising=False)
    out = tmp_path / "run"
    flags = ["--target", "camvid", "--records", str(recorded), "--out", str(out)]
    assert main("", flags) == 0
    assert "tree interval" in capsys.readouterr().out
    names = ("sensitivity.json", "sensitivity.md", "sensitivity.png")
    first = [(out / name).read_bytes() for name in names]
    assert min(Image.open(out / names[2]).size) > 200
    report = json.loads(first[0])
    assert report["attributes"][0]["name"] == NAMES[SLOPE] and report["study"] == "sensitivity"
    assert len(report["attributes"]) == 23 and len(report["pairs"]) == 253
    assert main("", flags) == 0
    assert [(out / name).read_bytes() for name in names] == first


@pytest.fixture
def measure(camvid, tmp_path, monkeypatch):
    """Records on tiny CamVid with rewards by formula."""
    calls: list[tuple] = []

    def counted(*task):
        if len(calls) == counted.limit:
            raise Killed
        calls.append(task)
        return formula(*task)

    counted.limit = -1
    monkeypatch.setattr(sensitivity_job, "evaluate", counted)
    undrawn = sensitivity_report.FORM._replace(picture=lambda report: b"")
    monkeypatch.setattr(sensitivity_job, "FORM", undrawn)
    config = replace(
        sensitivity_config("camvid", "smoke"), data=camvid, workers=0, out=tmp_path / "run"
    )
    return config, calls, counted


def test_what_is_missing_is_recorded_once(measure, monkeypatch):
    config, calls, _ = measure
    report = run(config)
    assert len(calls) == 12 and report["records"]["rewards"] == 12
    assert len({task[5] for task in calls}) == 12  # seeds
    assert all(task[0] == config.reward for task in calls)
    monkeypatch.setattr(sensitivity_job, "evaluate", never)
    assert run(config) == report


def test_a_killed_one_goes_on_and_ends_the_same(measure, tmp_path):
    config, calls, counted = measure
    whole = run(config)
    calls.clear()
    counted.limit = 5
    broken = replace(config, out=tmp_path / "broken")
    with pytest.raises(Killed):
        run(broken)
    counted.limit = -1
    found = run(broken)
    assert len(calls) == 12 and len(lines(broken.out / "store.jsonl")) == 13
    assert found == whole | {"note": found["note"]}


def test_rewards_that_others_have_made_count(measure, tmp_path):
    config, calls, _ = measure
    shared = replace(config, store=tmp_path / "shared.jsonl")
    run(replace(shared, evaluations=8, seed=5))
    calls.clear()
    report = run(replace(shared, out=tmp_path / "more"))
    assert len(calls) == 4 and report["records"]["rewards"] == 12
    assert len(Store(tmp_path / "shared.jsonl")) == 12


def test_more_evaluations_only_add_some():
    config = sensitivity_config("twin", "quick")
    few, many = proposals(replace(config, evaluations=8)), proposals(config)
    np.testing.assert_array_equal(np.stack(few), np.stack(many[:8]))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
def test_presets_are_sound(target, preset):
    check(sensitivity_config(target, preset))


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--records", "{tmp}/none.jsonl"], "none.jsonl: no such store"),
        (["--records", "{tmp}/short.jsonl"], "line 2 must hold a reward and 23 bins from 0 to 9"),
        (["--records", "{tmp}/few.jsonl"], "holds rewards of 2 proposals; 8 are the least"),
        (["--records", "{tmp}/same.jsonl"], "all 10 rewards are equal"),
        (["--records", "{tmp}/text.jsonl"], "text.jsonl: line 1 is not JSON"),
        (["--records", "{tmp}/store.jsonl", "--target", "twin"], "no rewards of target twin, but"),
        (["--records", "{tmp}/store.jsonl", "--records-config", "x"], "--records-config 'x'"),
        (["--records-config", "x"], "--records-config needs --records"),
        (["--evaluations", "7"], "--evaluations must be 8 or more"),
        (["--reward-kind", "mmd"], "sensitivity knows miou only"),
        (["--target", "moon"], "--target 'moon' is unknown"),
        (["--data", "/nowhere"], "/nowhere"),
    ],
)
def test_what_cannot_work_is_one_line_and_exit_code_2(flags, words, tmp_path, error_line):
    good = json.dumps({"bins": [1] * 23, "reward": 5}) + "\n"
    others = "".join(
        json.dumps({"bins": [k % 10] + [1] * 22, "reward": 5}) + "\n" for k in range(10)
    )
    (tmp_path / "short.jsonl").write_text(good + '{"bins": [1], "reward": 5}\n')
    (tmp_path / "few.jsonl").write_text(
        "".join(others.splitlines(keepends=True)[:3])
    )  # 0, 1 slide together
    (tmp_path / "same.jsonl").write_text(others)
    (tmp_path / "text.jsonl").write_text("some text\n")
    write_store(tmp_path / "store.jsonl", [evaluation(k) for k in range(9)])
    out = tmp_path / "run"
    given_ = [flag.format(tmp=tmp_path) for flag in flags]
    target = [] if "--target" in flags else ["--target", "camvid"]
    assert main("", ["--workers", "0", "--out", str(out), *target, *given_]) == 2
    assert words in error_line()
    assert not out.exists()


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert main("", ["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real" in capsys.readouterr().out
    assert json.loads((out / "sensitivity.json").read_text())["records"]["rewards"] == 12
    assert study_nets.score_proposals is sensitivity_job.score_proposals
