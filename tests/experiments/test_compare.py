"""The comparison: equal budgets, subsets in the whole space, kills, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.errors import UserError
from experiments.outcome import Outcome
from experiments.stats import mean_ci95, paired_gain
from experiments.targets import TARGETS, Target
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import sdr_jax
from experiments import compare_report, compare_search
from experiments.compare_config import (
    METHODS,
    RANDOM,
    SUBSETS,
    check,
    compare_config,
    plan,
    plans,
    schedule,
)
from experiments.compare_main import main
from experiments.compare_search import Found, embed, learnable
from experiments.config import PRESETS
from experiments.reward import Evaluation
from experiments.store import Store
from scene.attributes import NAMES
from seg.train import TrainingError

from .conftest import Killed, lines, never

QUICKLY = ("random_attributes", "random_search")
TARGET = Target("camvid", True, "camvid", "some streets", (), (), lambda height, width: None)


def formula(stage, table, renderer, pool, units, seed, truth) -> Evaluation:
    """Worth more with buildings far off; a little noise by seed."""
    right = 500 + int(400 * units[:, NAMES.index("building_position")].mean()) + seed % 50
    return Evaluation(np.array([[right, 1000]] * 2), 0.5, 1.5)


@pytest.fixture
def compare(camvid, monkeypatch):
    """Runs a comparison on tiny CamVid with rewards by formula; returns the exit code."""

    def start(out, *flags, evaluate=formula, methods=QUICKLY):
        monkeypatch.setattr(compare_search, "evaluate", evaluate)
        fixed = ("--target", "camvid", "--preset", "smoke", "--data", str(camvid), "--workers", "0")
        chosen = ("--methods", *methods) if methods else ()
        return main("", [*fixed, "--out", str(out), *chosen, *flags])

    return start


def report_of(out) -> dict:
    """What is in ``compare.json``, without the seconds of the method itself."""
    report = json.loads((out / "compare.json").read_text())
    for row in report["rows"]:
        if row["search"] is not None:
            assert row["search"].pop("method_seconds")["cpu"] >= 0
    return report


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
def test_presets_give_sdr_the_whole_budget(target, preset):
    config = check(replace(compare_config(target, preset), methods=("sdr", "random_search")))
    for made in plans(config):
        assert made.datasets * made.updates == config.evaluations
        if made.method == "sdr":
            assert made.search.updates == made.updates
    assert config.seeds >= 2


def test_defaults_are_the_papers():
    config = compare_config("camvid", "quick")
    assert config.methods == METHODS and config.subsets == SUBSETS
    assert SUBSETS[0] == ("building_position", "fence_position", "tree_position")
    assert [len(subset) for subset in SUBSETS] == [3, 5, 7]
    assert (config.evaluations, config.search.datasets_per_update, config.seeds) == (48, 8, 3)


def test_schedules_by_hand():
    assert schedule(48, 2, 8) == (8, 3)
    assert schedule(48, 3, 8) == (8, 2)
    assert schedule(48, 4, 8) == (6, 2)  # with 8, two of six updates would be left over
    assert schedule(300, 4, 1) == (1, 75)
    assert schedule(50, 3, 10) == (10, 1)  # no number does; two updates try the answer
    assert schedule(8, 2, 8) == (4, 1)


@given(st.integers(1, 400), st.integers(1, 6), st.integers(1, 10))
def test_schedules_never_go_over_the_budget(evaluations, groups, datasets):
    n, each = schedule(evaluations, groups, datasets)
    assert min(datasets, 2) <= n <= datasets and n * each * groups <= evaluations


def test_a_plan_keeps_the_order_of_the_groups():
    config = compare_config("camvid", "quick")
    made = plan(config, "sdr", ("car_position", "tree_position", "building_position"))
    assert (made.datasets, made.updates) == (8, 6) and made.search.updates == 6
    assert plan(config, "random_search", SUBSETS[2]).search.updates is None


def test_all_is_the_whole_space():
    config = replace(compare_config("twin", "quick"), methods=(RANDOM, "sdr"), subsets=(("all",),))
    checked = check(config)
    assert checked.subsets == (NAMES,)
    (made,) = plans(checked)
    assert (made.datasets, made.updates) == (8, 6)


@given(st.permutations(range(23)), st.integers(1, 5))
def test_attributes_outside_a_subset_are_random(order, count):
    subset = [NAMES[k] for k in order[:count]]
    rng = np.random.default_rng(count)
    inner = sdr_jax.Proposal(rng.random((4, count)), rng.random((4, count)))
    whole = embed(subset, inner)
    for values, given_, random in zip(whole, inner, (0.5, 1.0), strict=True):
        assert values.shape == (4, 23)
        np.testing.assert_allclose(values[:, order[:count]], given_, rtol=1e-6)
        assert (values[:, order[count:]] == random).all()


def test_a_failed_reward_becomes_the_lowest_and_never_zero():
    np.testing.assert_allclose(learnable([0.3, np.nan, 0.2]), [0.3, 0.2, 0.2])
    assert learnable([np.nan, np.nan]) is None


def test_a_comparison_leaves_its_figures(compare, tmp_path, capsys):
    out = tmp_path / "run"
    assert compare(out) == 0
    printed = capsys.readouterr().out
    assert "images: 3 attributes, random_search, seed 1" in printed and " left" in printed
    assert {p.name for p in out.iterdir()} == {
        "compare.json", "compare.md", "compare.png", "config.json", "lock", "store.jsonl",
    }  # fmt: skip
    report = report_of(out)
    assert [(r["attributes"], r["method"]) for r in report["rows"]] == [
        (2, RANDOM), (2, "random_search"), (3, RANDOM), (3, "random_search"),
    ]  # fmt: skip
    random, ours = report["rows"][:2]
    # Random attributes are the same streets and nets whatever is optimised elsewhere.
    assert random["search"] is None and random["final"] == report["rows"][2]["final"]
    mean, ci95 = mean_ci95(ours["final"]["miou"])
    assert (ours["final"]["mean"], ours["final"]["ci95"]) == (mean, ci95)
    gain, interval = paired_gain(ours["final"]["miou"], random["final"]["miou"])
    assert ours["final"]["gain"] == {"mean": gain, "ci95": interval}
    search = ours["search"]
    assert search["evaluations"] == len(search["rewards"]) == 4 and search["failed"] == 0
    assert search["first_third"] == search["rewards"][0]
    assert search["reward_seconds"] == {"core": 8.0, "wall": 8.0}
    assert set(search["solution"]) == {"building_position", "fence_position"}
    assert len(report["budgets"]) == 3 and report["budgets"][-1] == "64x48, 6 images, 20 steps"
    assert [row["budgets"][-1] for row in report["rows"]] == [r["final"] for r in report["rows"]]
    # 2 x 4 rewards; random attributes twice, two answers twice, at each of three budgets.
    assert len(Store(out / "store.jsonl")) == 8 + 3 * (2 + 4)
    table = (out / "compare.md").read_text().splitlines()
    assert len([line for line in table if line.startswith("| ")]) == (2 + 4) + (2 + 2)
    assert min(Image.open(out / "compare.png").size) > 200


def test_killed_it_goes_on_and_ends_the_same(compare, tmp_path, capsys):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert compare(whole) == 0
    for count in (3, 8, 10):  # within a search, and within the nets of the first and last budgets
        left = [count]

        def dying(*task, left=left):
            if left[0] == 0:
                raise Killed
            left[0] -= 1
            return formula(*task)

        with pytest.raises(Killed):
            compare(broken, evaluate=dying)
    with open(broken / "store.jsonl", "a") as file:
        file.write('{"key": "12')  # as a kill within a write leaves it
    assert len(lines(broken / "store.jsonl")) == 1 + 3 + 8 + 10
    assert compare(broken) == 0
    assert report_of(broken) == report_of(whole)
    found, wanted = (lines(p / "store.jsonl") for p in (broken, whole))
    assert sorted(map(str, found)) == sorted(map(str, wanted))
    assert compare(broken, evaluate=never) == 0  # what is finished is not redone


def test_a_shared_store_serves_other_folders_and_more_methods(compare, tmp_path):
    store = tmp_path / "shared.jsonl"
    flags = ("--store", str(store), "--subsets", "building_position")
    assert compare(tmp_path / "one", *flags) == 0
    known = len(Store(store))
    again = compare(tmp_path / "two", *flags, "--no-finals", evaluate=never)
    assert again == 0 and len(Store(store)) == known
    assert not (tmp_path / "one" / "store.jsonl").exists()
    (_, row) = report_of(tmp_path / "two")["rows"]
    assert row["final"] is None and row["search"]["evaluations"] == 4


def test_all_attributes_without_finals_record_proposals_and_rewards(compare, tmp_path):
    out = tmp_path / "run"
    assert compare(out, "--subsets", "all", "--no-finals", methods=("random_search",)) == 0
    (row,) = report_of(out)["rows"]
    assert (row["attributes"], row["subset"]) == (23, "all")
    records = Store(out / "store.jsonl").records
    assert [100 * r["reward"] for r in records] == row["search"]["rewards"]
    assert all(r["side"] == "reward" and r["width"] == [0.2] * 23 for r in records)
    assert len({tuple(r["centre"]) for r in records}) > 1


def test_a_failed_evaluation_is_told_and_left_out(compare, tmp_path, capsys):
    calls = []

    def sometimes(*task):
        calls.append(task)
        if len(calls) in (1, 3, 4, 7):  # one of an update, all of one, and random's second net
            raise TrainingError("the loss is nan")
        return formula(*task)

    out = tmp_path / "run"
    flags = ("--subsets", "building_position,car_position", "--no-cheap-finals")
    assert compare(out, *flags, evaluate=sometimes) == 0
    random, ours = report_of(out)["rows"]
    assert ours["search"]["failed"] == 3 and ours["search"]["rewards"].count(None) == 3
    assert ours["search"]["first_third"] is None
    assert random["final"]["miou"][1] is None and random["final"]["ci95"] is None
    assert ours["final"]["ci95"] is not None and ours["final"]["gain"]["ci95"] is None
    kept = Store(out / "store.jsonl").records
    assert [k + 1 for k, r in enumerate(kept) if r["failed"]] == [1, 3, 4, 7]
    assert not any(r["reward"] == 0 for r in kept)
    assert "3 evaluations failed" in (out / "compare.md").read_text()


def test_the_table_and_the_picture_bear_what_is_missing():
    outcomes = [Outcome(0.2, [0.2], 1.0, 2.0), Outcome(np.nan, [], 0.0, 1.0, "the loss is nan")]
    proposal = sdr_jax.Proposal(np.full(23, 0.5), np.ones(23))
    rows = [(RANDOM, SUBSETS[0]), ("sdr", SUBSETS[0]), ("sdr", SUBSETS[1])]
    found = {name: Found(proposal, outcomes, 0.1, 0.2) for name in rows[1:]}
    config = replace(compare_config("camvid", "smoke"), subsets=SUBSETS[:2])
    report = compare_report.summarize(config, TARGET, rows, found, [])
    text = compare_report.text(report)
    assert "| 3 | random attributes |" in text and "2 evaluations failed" in text
    assert compare_report.picture(report).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--methods", "sdr", "descent"), "--methods 'descent' is unknown; known: random_attr"),
        (("--methods", "sdr", "sdr"), "names one of them twice"),
        (("--subsets", "car_position,fog"), "attribute 'fog' is unknown"),
        (("--subsets", "car_position,car_position"), "names an attribute twice"),
        (("--subsets", "car_position", "car_position"), "names a subset twice"),
        (("--evaluations", "3"), "multiple of --search.datasets-per-update 2, not 3"),
        (("--evaluations", "0"), "multiple of --search.datasets-per-update 2, not 0"),
        (("--subsets", "all", "--methods", "sdr"), "--evaluations 4 are too few for sdr on all"),
        (("--data", "/nowhere"), "/nowhere"),
        (("--preset", "small"), "--preset 'small' is unknown"),
        (("--target", "mars"), "--target 'mars' is unknown; known: twin, camvid, cityscapes"),
        (("--store", "/"), "/ is a folder; a store is a file"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, compare, tmp_path, error_line):
    assert compare(tmp_path / "run", *flags, evaluate=never) == 2
    assert complaint in error_line()
    assert not (tmp_path / "run").exists()


def test_data_must_fit_the_target(tmp_path, monkeypatch, error_line):
    monkeypatch.delenv("CAMVID_DIR", raising=False)
    common = ("--preset", "smoke", "--out", str(tmp_path / "run"), "--methods", "sdr")
    for flags, complaint in (
        (("--target", "camvid"), "CamVid needs its folder: --data DIR"),
        (("--target", "cityscapes"), "Cityscapes needs its folder: --data DIR"),
        (("--target", "twin", "--data", str(tmp_path)), "--target twin takes no --data"),
    ):
        assert main("", [*common, *flags]) == 2
        assert complaint in error_line()


def test_other_flags_do_not_continue_a_comparison(compare, tmp_path, capsys):
    out = tmp_path / "run"
    assert compare(out, "--subsets", "car_position", "--no-finals") == 0
    assert compare(out, "--subsets", "tree_position", "--no-finals") == 2
    assert "holds a run with subsets" in capsys.readouterr().err
    # Where evaluations are kept may change.
    more = ("--subsets", "car_position", "--no-finals", "--store", str(tmp_path / "s.jsonl"))
    assert compare(out, *more) == 0


def test_options_of_the_main_job_are_checked_too():
    config = replace(compare_config("twin", "smoke"), methods=("sdr",), seeds=0)
    with pytest.raises(UserError, match="--seeds must be 1 or more"):
        check(config)


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    flags = ("--preset", "smoke", "--workers", "1", "--methods", RANDOM, "sdr")
    assert main("", [*flags, "--out", str(tmp_path / "run")]) == 0
    assert "not real" in capsys.readouterr().out
    report = report_of(tmp_path / "run")
    assert report["real"] is False and len(report["rows"]) == 4
    assert all(0 < row["final"]["mean"] < 100 for row in report["rows"])
