"""The comparison: equal budgets, subsets in the whole space, kills, what failed."""

from dataclasses import replace
from functools import partial
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.compare import FORM, RANDOM, check, compared, planned
from experiments.config.studies import defaults_of
from experiments.evaluation.cost import cost_of
from experiments.run.plans import schedule
from scene.attributes import NAMES
from shell.files import read_json

from .conftest import Counted, Killed, by_preset, lines, never

defaults = partial(defaults_of, "compare")

METHODS = ("--methods", RANDOM, "random_search")


@pytest.fixture
def compare(command):
    """Runs a comparison on tiny CamVid with rewards by formula; returns the exit code."""
    return lambda out, *flags, **more: command("compare", out, *METHODS, *flags, **more)


def report_of(out) -> dict:
    """What is in ``compare.json``, without the seconds of the method itself."""
    report = read_json(out / "compare.json")
    for row in report["rows"]:
        if row["search"] is not None:
            assert row["search"].pop("method_seconds")["cpu"] >= 0
    return report


@by_preset
def test_presets_give_sdr_the_whole_budget(target, preset):
    config = replace(defaults(target, preset), methods=("sdr", "random_search"))
    check(config)
    for made in planned(config):
        assert made.evaluations == config.evaluations
        assert made.search.updates == (made.updates if made.method == "sdr" else None)
    assert config.seeds >= 2
    if preset != "smoke":  # the paper's
        assert config.subsets[0] == ("building_position", "fence_position", "tree_position")
        assert [len(subset) for subset in config.subsets] == [3, 5, 7]


def test_schedules_names_and_groups_by_hand():
    assert [schedule(48, 2, 8), schedule(48, 3, 8), schedule(8, 2, 8)] == [(8, 3), (8, 2), (4, 1)]
    assert schedule(48, 4, 8) == (6, 2)  # with 8, two of six updates would be left over
    assert schedule(300, 4, 1) == (1, 75)
    assert schedule(50, 3, 10) == (10, 1)  # no number does; two updates try the answer
    config = replace(defaults("camvid", "quick"), methods=(RANDOM, "sdr"))
    assert [row.name for row in compared(config)][-1] == "sdr, 7 attributes"
    three = ("car_position", "tree_position", "building_position")  # in as many groups
    config = replace(config, subsets=(("all",), ("car_position",), ("tree_position",), three))
    words = ("23 attributes", "car_position", "tree_position", "3 attributes")
    assert [row.name for row in compared(config)][1::2] == [f"sdr, {word}" for word in words]
    whole, *_, made = planned(config)
    assert whole.subset == NAMES and compared(config)[0].title == "all"
    assert (made.subset, made.datasets, made.updates, made.search.updates) == (three, 8, 6, 6)


@given(st.integers(1, 400), st.integers(1, 6), st.integers(1, 10))
def test_schedules_never_go_over_the_budget(evaluations, groups, datasets):
    n, each = schedule(evaluations, groups, datasets)
    assert min(datasets, 2) <= n <= datasets and n * each * groups <= evaluations


def test_a_comparison_leaves_its_figures(compare, out, capsys):
    assert compare(out) == 0
    printed = capsys.readouterr().out
    assert "64x48, 4 images, 12 steps: random_search, 3 attributes, seed 1" in printed
    report = report_of(out)
    made = [(row["attributes"], row["method"]) for row in report["rows"]]
    assert made == [*product((2, 3), (RANDOM, "random_search"))]
    random, ours = report["rows"][:2]
    # Random attributes are the same streets and nets whatever is optimised elsewhere.
    assert random["search"] is None and random["final"] == report["rows"][2]["final"]
    search = ours["search"]
    assert search["evaluations"] == len(search["rewards"]) == 4 and search["failed"] == 0
    assert search["first_third"] == search["rewards"][0]
    assert search["reward_seconds"] == {"core": 8.0, "wall": 8.0}
    assert set(search["solution"]) == {"building_position", "fence_position"}
    assert len(report["budgets"]) == 3 and report["budgets"][-1] == "64x48, 6 images, 20 steps"
    assert [row["budgets"][-1] for row in report["rows"]] == [r["final"] for r in report["rows"]]
    # Attributes outside the subset are random.
    made = {(line["search"], line["width"].count(1)) for line in lines(out / "evaluations.jsonl")}
    assert made == {(f"random_search, {n} attributes", 23 - n) for n in (2, 3)}
    # Random attributes and two answers, at each of three budgets.
    finals = lines(out / "finals.jsonl")  # random attributes are the same on both subsets
    assert len({line["key"] for line in finals}) == 3 * (2 + 4)
    assert (out / "compare.md").read_text().count("\n| ") == (2 + 4) + (2 + 2)


def test_killed_it_goes_on_and_ends_the_same(compare, tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    flags = ("--subsets", "building_position")
    assert compare(whole, *flags) == 0
    for count in (3, 3, 8):  # within a search, and within the nets of the first and last budgets
        with pytest.raises(Killed):
            compare(broken, *flags, evaluate=Counted(limit=count))
    with open(broken / "finals.jsonl", "a") as file:
        file.write('{"key": "12')  # as a kill within a write leaves it
    logs = ("evaluations.jsonl", "finals.jsonl")
    assert [len(lines(broken / name)) for name in logs] == [4, 10]
    assert compare(broken, *flags) == 0
    assert report_of(broken) == report_of(whole)
    assert compare(broken, *flags, evaluate=never) == 0  # what is finished is not redone


def test_all_attributes_without_finals_record_rewards_for_other_runs(compare, tmp_path):
    one, two, store = tmp_path / "one", tmp_path / "two", tmp_path / "shared.jsonl"
    flags = ("--subsets", "all", "--no-finals", "--store", str(store))
    assert compare(one, *flags, "--methods", "random_search") == 0
    (row,) = report_of(one)["rows"]
    assert (row["attributes"], row["subset"], row["final"]) == (23, "all", None)
    records = lines(store)[1:]
    assert [100 * r["reward"] for r in records] == row["search"]["rewards"]
    assert all(r["side"] == "reward" and r["width"] == [0.2] * 23 for r in records)
    assert len({tuple(r["centre"]) for r in records}) > 1
    assert compare(two, *flags, evaluate=never) == 0 and len(lines(store)) == 1 + 4
    assert report_of(two)["rows"][1] == row
    assert "random attributes" in (two / "compare.md").read_text()


def test_a_failed_evaluation_is_told_and_left_out(compare, out):
    sometimes = Counted(failing=(1, 2, 23))  # all of an update, and random's second net
    flags = ("--subsets", "building_position,car_position", "--no-cheap-finals")
    assert compare(out, *flags, "--evaluations", "20", evaluate=sometimes) == 0
    random, ours = report_of(out)["rows"]
    assert ours["search"]["failed"] == 2 and ours["search"]["rewards"][:2] == [None, None]
    assert random["final"]["miou"][1] is None and random["final"]["ci95"] is None
    assert ours["final"]["ci95"] is not None and ours["final"]["gain"]["ci95"] is None
    said = (out / "compare.md").read_text()
    assert "2 evaluations failed and are left out of their update." in said
    assert "1 nets failed in training" in said


def test_a_report_of_failures_alone(compare, out):
    assert compare(out, "--subsets", "building_position,fence_position") == 0
    recorded = read_json(out / "compare.json")
    for row in recorded["rows"]:
        row["budgets"] = [{"miou": [None] * 2} for _ in row["budgets"]]
        if row["search"] is not None:
            row["search"]["rewards"] = [None] * len(row["search"]["rewards"])
    found = FORM.derive(recorded)
    assert found["rows"][1]["final"]["mean"] is found["rows"][1]["search"]["first_third"] is None
    # Two nets at each of three budgets, of random attributes and of an answer.
    assert f"{2 * 3 * 2} nets failed" in FORM.text(found)
    assert FORM.figures["compare.png"](found).startswith(b"\x89PNG")


def test_at_equal_core_minutes_every_search_takes_as_long(compare, out):
    config = replace(defaults("labelmefacade", "quick"), methods=("tpe", "sdr"), core_minutes=15.0)
    check(config)
    for made in planned(config):
        assert 0.75 * 15 * 60 < made.evaluations * cost_of(config.reward) <= 15 * 60
    flags = ("--methods", "intervals", "random_search", "--subsets", "all", "--no-cheap-finals")
    assert compare(out, *flags, "--core-minutes", "0.05") == 0
    report = report_of(out)
    assert (report["evaluations"], report["core_minutes"]) == (None, 0.05)
    ours, theirs = (row["search"]["evaluations"] for row in report["rows"])
    assert len(lines(out / "evaluations.jsonl")) == ours + theirs and 1 <= ours == theirs


def test_what_no_search_can_do_is_one_line(compare, out, error_line):
    assert compare(out, "--core-minutes", "0.0001") == 2
    assert "0.0001 are too few for one update of random_search" in error_line()
    assert not out.exists()
