"""Sensitivity: what was put into rewards is found, what is missing is recorded."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.files import read_json, write
from experiments.config.jobs import defaults_of
from experiments.evaluation.store import HEADER, Store
from experiments.studies import sensitivity as job
from experiments.studies.sensitivity import summarize, text
from experiments.tables import sobol as model
from experiments.tables.recorded import Records, read
from scene.attributes import NAMES

from .conftest import lines, never, study

MATTER = ("car_position", "tree_interval", "camera_position_x", "camera_rotation_y")
HUMP, SLOPE, LEFT, RIGHT, NOTHING = map(NAMES.index, (*MATTER, "fence_position"))
CAMVID = ("--target", "camvid")


def synthetic(n: int, noise: float = 0.5, seed: int = 0) -> Records:
    """20 + a hump (variance 2) + a slope (1) + a product of two without effects alone (1) + noise."""
    rng = np.random.default_rng(seed)
    centre = rng.random((n, len(NAMES)))
    wave = np.sqrt(2) * np.cos(np.pi * centre)
    hump = -2 * np.cos(2 * np.pi * centre[:, HUMP])
    rewards = 20 + hump + wave[:, SLOPE] + wave[:, LEFT] * wave[:, RIGHT]
    rewards += noise * rng.normal(size=n)
    return Records(centre, np.zeros_like(centre), rewards, "c", "synthetic", 0, ())


@pytest.fixture(scope="module")
def analysis() -> dict:
    return summarize(synthetic(300))


def test_what_was_put_in_comes_first_and_best_values_are_physical(analysis):
    rows = {row["name"]: row for row in analysis["attributes"]}
    ranked = list(rows)
    assert ranked[0] == NAMES[HUMP] and set(ranked[:4]) == set(MATTER)
    assert set(analysis["pairs"][0]["names"]) == {NAMES[LEFT], NAMES[RIGHT]}
    assert analysis["pairs"][0]["share"]["value"] > 5 * analysis["pairs"][1]["share"]["value"]
    shares = [rows[NAMES[k]]["share"] for k in (HUMP, SLOPE, NOTHING, LEFT, RIGHT)]
    assert [share["value"] for share in shares[:2]] == pytest.approx([50, 25], abs=8)
    assert all(low == 0 and high < 3 for low, high in (share["ci95"] for share in shares[2:]))
    assert rows[NAMES[LEFT]]["total"]["ci95"][0] > 10
    assert analysis["r2"]["value"] > 0.7 and analysis["r2"]["ci95"][0] > 0.5
    assert analysis["noise"]["model"] == pytest.approx(0.5, abs=0.2)
    row = rows[NAMES[HUMP]]
    assert row["best"] == pytest.approx(7.5, abs=0.8) and row["unit"] == "m"  # 1 to 14 m
    assert row["range90"][0] > 5.5 and row["range90"][1] < 9.5
    assert row["worth"] == pytest.approx(4, abs=0.8)
    curve = analysis["curves"][NAMES[HUMP]]
    assert curve["physical"][0] == 1 and curve["physical"][-1] == 14
    assert (np.diff([curve[name] for name in ("low", "mean", "high")], axis=0) >= 0).all()


def test_pure_noise_is_said_to_be_nothing():
    analysis = summarize(
        synthetic(60)._replace(rewards=20 + np.random.default_rng(3).normal(size=60))
    )
    assert analysis["r2"]["value"] < 0.05 and "say nothing about any attribute" in text(
        {"note": "noise", **analysis}
    )


def test_shares_by_hand_and_draws_of_what_is_not_there_lie_around_zero():
    layout = model.lay_out(3)
    single, paired = 3 * model.DEGREE, len(model.PAIR_ORDERS)
    assert layout.effects == 6 and len(layout.effect) == single + 3 * paired
    assert np.bincount(layout.effect, layout.relative) == pytest.approx(np.ones(6))
    weights = np.zeros((1, single + 3 * paired))
    weights[0, [0, 1, model.DEGREE]] = 1, 2, 1  # 1 + 4 of the first attribute, 1 of the second
    weights[0, single + paired] = 2  # 4 of the pair (0, 2)
    shares = model.shares(layout, weights[0], weights)
    np.testing.assert_allclose(shares.effects, [0.5, 0.1, 0, 0, 0.4, 0])
    np.testing.assert_allclose(shares.drawn, [shares.effects])  # one draw does not vary
    np.testing.assert_allclose(model.totals(layout, shares.effects), [0.9, 0.1, 0.4])
    assert shares.signal == pytest.approx(10)
    expected = np.zeros(len(layout.effect))
    expected[0] = 1
    samples = expected + 0.1 * np.random.default_rng(0).normal(size=(5000, len(expected)))
    shares = model.shares(layout, expected, samples)
    np.testing.assert_allclose(shares.drawn.mean(axis=0), shares.effects, atol=0.01)
    assert (np.quantile(shares.drawn, 0.025, axis=0)[1:] < 0).all()
    # Shares are of the same draw's signal, so that what is sure to be all of it is all of it.
    np.testing.assert_allclose(shares.drawn.sum(axis=1), 1)
    assert np.std(shares.drawn_signal) > 0.1


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_shares_are_variances_on_the_unit_cube(seed):
    rng = np.random.default_rng(seed)
    layout = model.lay_out(3)
    weights = rng.normal(size=len(layout.effect))
    unit = rng.random((40_000, 3))
    values = model.features(layout, unit, np.zeros_like(unit)) @ weights
    shares = model.shares(layout, weights, weights[None])
    assert shares.effects.sum() == pytest.approx(1)
    assert values.var() == pytest.approx(shares.signal, rel=0.1)


@given(st.floats(0, 1), st.floats(0, 1))
def test_waves_are_means_over_intervals(centre, width):
    points = centre + width * (np.arange(2000) + 0.5) / 2000 - width / 2
    expected = model.waves(points).mean(axis=0)
    np.testing.assert_allclose(model.waves(centre, width), expected, atol=1e-4)
    np.testing.assert_allclose(model.waves(0.5, 1.0), 0, atol=1e-12)


def test_draws_are_those_of_the_posterior():
    records = synthetic(40)
    layout = model.lay_out(3)
    x = model.features(layout, records.centre[:, :3], records.width[:, :3])
    fitted = model.fit(layout, x, records.rewards)
    samples = model.draw_weights(fitted, 20_000, 0)
    precision = fitted.x.T @ fitted.x / fitted.noise**2 + np.diag(1 / fitted.variance)
    scale = np.sqrt(np.diag(np.linalg.inv(precision)))
    assert np.abs((samples.mean(axis=0) - fitted.weights) / scale).max() < 0.05
    np.testing.assert_allclose(samples.std(axis=0), scale, rtol=0.05)


def evaluation(k: int, config: str = "aaaa", **other) -> dict:
    """A line of a store."""
    centre = np.random.default_rng(k).random(23).round(6).tolist()
    return {
        "key": f"{config}-{k}", "config": config, "target": "camvid", "side": "reward", "kind": "miou",
        "size": "64x48", "images": 96, "steps": 200, "engine": 1, "centre": centre, "width": [0.3] * 23,
        "seed": k, "reward": 0.2 + 0.001 * k, "class_iou": [], "render_seconds": 0.1,
        "train_seconds": 0.1, "failed": None, **other,
    }  # fmt: skip


def write_lines(path, records):
    write(path, "".join(json.dumps(line) + "\n" for line in records))
    return path


def test_one_configuration_is_taken_and_the_others_told(tmp_path):
    config = defaults_of("sensitivity", "camvid", "quick")
    a = [evaluation(k) for k in range(9)]
    a[0] |= {"reward": None, "failed": "the loss is nan"}
    real = [evaluation(k, centre=None, width=None) for k in range(20, 30)]
    aside = {"bb": {}, "cc": {"side": "test"}, "ee": {"target": "twin"}}
    others = [evaluation(k, name, **fields) for k in range(8) for name, fields in aside.items()]
    (tmp_path / "run").mkdir()
    write_lines(tmp_path / "run" / "evaluations.jsonl", a[:3])
    write_lines(tmp_path / "run" / "finals.jsonl", [*a[2:6], *real])
    paths = [tmp_path / "run", write_lines(tmp_path / "store.jsonl", [HEADER, *a[4:], *others])]
    records = read(paths, config, "camvid")
    assert (records.config, len(records.rewards), records.failed) == ("aaaa", 8, 1)
    assert [words[:4] for words in records.aside] == [f"{name} (" for name in aside]
    assert "bb (8 of camvid, reward images, 64x48, 96 rendered" in " ".join(records.aside)
    assert read(paths, config, "camvid", "bb").config == "bb"


@pytest.fixture
def recorded(tmp_path):
    """A store whose rewards depend on one attribute."""
    records = [evaluation(k) for k in range(40)]
    records = [r | {"reward": 0.1 + 0.1 * r["centre"][SLOPE]} for r in records]
    return write_lines(tmp_path / "store.jsonl", [HEADER, *records])


def test_the_order_of_the_lines_does_not_matter(recorded, tmp_path):
    config = defaults_of("sensitivity", "camvid", "quick")
    turned = write_lines(tmp_path / "turned.jsonl", [HEADER, *lines(recorded)[:0:-1]])
    one, two = (np.column_stack(read([p], config, "camvid")[:3]) for p in (recorded, turned))
    np.testing.assert_array_equal(one, two)


def test_records_need_no_data_and_give_the_same_again(recorded, out, monkeypatch, capsys):
    monkeypatch.delenv("CAMVID_DIR", raising=False)
    files = []
    for _ in range(2):
        assert study("sensitivity", "--records", str(recorded), *CAMVID, "--out", str(out)) == 0
        assert "tree interval" in capsys.readouterr().out
        files.append([path.read_bytes() for path in sorted(out.glob("sensitivity.*"))])
    assert files[0] == files[1] and len(files[0]) == 3
    report = read_json(out / "sensitivity.json")
    assert report["attributes"][0]["name"] == NAMES[SLOPE] and report["study"] == "sensitivity"
    assert len(report["attributes"]) == 23 and len(report["pairs"]) == 253


@pytest.fixture
def config(tiny, monkeypatch):
    """An analysis of tiny CamVid, without its figure."""
    monkeypatch.setattr(job, "STUDY", replace(job.STUDY, form=job.STUDY.form._replace(figures={})))
    return tiny(partial(defaults_of, "sensitivity"))


def test_what_is_missing_is_recorded_once(config, counted, tmp_path, scored_by):
    complete = job.analyse(config)
    assert len(counted.calls) == 12 and complete["records"]["rewards"] == 12
    assert len({seed for _, _, seed, _ in counted.calls}) == 12
    assert all(recipe.fidelity == config.reward for recipe, *_ in counted.calls)
    scored_by(never)
    recorded = replace(config, records=(config.out,), out=tmp_path / "recorded")
    assert job.analyse(recorded)["attributes"] == complete["attributes"]


def test_rewards_that_others_have_made_count(config, counted, tmp_path):
    shared = replace(config, store=tmp_path / "shared.jsonl")
    job.analyse(replace(shared, evaluations=8, seed=5))
    counted.calls.clear()
    more = replace(shared, out=tmp_path / "more")
    report = job.analyse(more)
    assert len(counted.calls) == 4 and report["records"]["rewards"] == 12
    assert len(Store(tmp_path / "shared.jsonl", shared=True)) == 12
    assert job.analyse(more) == report and len(counted.calls) == 4
    # Rewards of other attributes do not.
    counted.calls.clear()
    job.analyse(replace(shared, space="extended", out=tmp_path / "extended"))
    assert len(counted.calls) == 12


@pytest.mark.parametrize(("flags", "words"), [
    (["--records", "none.jsonl"], "none.jsonl does not exist; pass a store"),
    (["--records", "."], "is not a run folder"),
    (["--records", "few.jsonl"], "holds rewards of 2 proposals; a model needs 8 or more"),
    (["--records", "same.jsonl"], "all 10 rewards are equal"),
    (["--records", "text.jsonl"], "text.jsonl is no store of evaluations"),
    (["--records", "deep.jsonl"], "deep.jsonl"),
    (["--records", "store.jsonl", "other.jsonl"], "hold the same evaluation with different values"),
    (["--records", "store.jsonl", "--target", "twin"], "no rewards of target twin in --space scenex, but"),
    (["--records", "store.jsonl", "--records-config", "x"], "--records-config 'x'"),
    (["--records-config", "x"], "--records-config needs --records"),
    (["--evaluations", "7"], "--evaluations must be 8 or more"),
    (["--search.bins", "1"], "--search.bins must be 2 or more"),
    (["--data", "/nowhere"], "/nowhere"),
])  # fmt: skip
def test_what_cannot_work_is_refused(flags, words, tmp_path, monkeypatch, error_line):
    monkeypatch.chdir(tmp_path)
    same = [evaluation(k, reward=0.05) for k in range(10)]
    write_lines(tmp_path / "few.jsonl", [HEADER, *same[:2]])
    write_lines(tmp_path / "same.jsonl", [HEADER, *same])
    (tmp_path / "text.jsonl").write_text("some text\n")
    (tmp_path / "deep.jsonl").write_text("[" * 100_000 + "\n")
    write_lines(tmp_path / "store.jsonl", [HEADER, *(evaluation(k) for k in range(9))])
    write_lines(tmp_path / "other.jsonl", [HEADER, evaluation(3, reward=0.9)])
    assert study("sensitivity", *CAMVID, "--workers", "0", "--out", "run", *flags) == 2
    assert words in error_line() and not (tmp_path / "run").exists()
