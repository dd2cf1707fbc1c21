"""Many searches: plans at equal cost, some attributes alone, and what the report says of methods."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import UserError
from common.files import read_json
from experiments.attribute_search.plans import plan, schedule
from experiments.config.jobs import defaults_of
from experiments.evaluation.cost import cost_of
from experiments.studies.searches import check, configure_all, derive, plan_of, rows, text, work
from scene.attributes import NAMES

from .conftest import lines


def nets(*scores):
    return [{"miou": score, "class_iou": []} for score in scores]


BASELINES = {
    "random": nets(30.0, 32.0), "default": nets(34.0, 36.0), "real": nets(40.0, 40.0),
}  # fmt: skip


def search(seed, nets, **more):
    return {"method": "sdr", "seed": seed, "rewards": [20.0, 30.0, 40.0], "nets": nets, **more}


def report(*searches, **more):
    about = {"note": "some", "scored_at": "480x360", "test_images": 1, "seeds": 2, "starts": {}}
    budget = {"rewards_at": "240x176", "space": "scenex", **more}
    return derive({**about, **budget, "baselines": BASELINES, "searches": list(searches)})


def test_a_method_has_a_row_over_its_searches_and_nets():
    derived = report(search(0, nets(34.0, 36.0)), search(1, nets(36.0, 38.0)))
    rows = {row["name"]: row for row in derived["rows"]}
    assert rows["sdr"]["mean"] == 36.0 and rows["sdr"]["gain_over_default"]["mean"] == 1.0
    assert "optimised by sdr | 2 | 36.0" in text(derived)


def test_methods_of_other_libraries_need_a_checkout(monkeypatch):
    config = replace(defaults_of("searches", "twin", "smoke"), methods=("tpe", "sdr"))
    check(config)
    monkeypatch.setitem(sys.modules, "benchmarks.rivals", None)
    with pytest.raises(
        UserError, match=r"^--methods: tpe needs a checkout: benchmarks/rivals is not"
    ):
        check(config)


def test_searches_at_equal_core_minutes():
    config = replace(
        defaults_of("searches", "labelmefacade", "quick"),
        core_minutes=15.0, methods=("intervals", "random_search", "sdr"), searches=2,
    )  # fmt: skip
    check(config)
    plans = {name: plan_of(one, name) for name, one in configure_all(config).items()}
    assert list(plans) == [f"{m}-{k}" for k in (0, 1) for m in config.methods]
    seconds = [plan.evaluations * cost_of(config.reward) for plan in plans.values()]
    assert all(0.75 * 15 * 60 < spent <= 15 * 60 for spent in seconds)
    counts = {kind.what: kind.number for kind in work(config)}
    assert list(counts) == ["rewards of the search, 6 searches"]
    names = [row.name for row in rows(config, SimpleNamespace(few_names=()))]
    assert [name for name in names if "sdr" in name] == ["sdr-0", "sdr-1"]
    with pytest.raises(
        UserError, match=r"--core-minutes 0\.1 are too few for one update of intervals"
    ):
        check(replace(config, core_minutes=0.1))
    page = text(report(search(0, nets(36.0, 38.0)), core_minutes=15.0))
    assert "rewards for 15 minutes of a core" in page


def test_failed_evaluations_are_told():
    failing = search(0, nets(36.0, 38.0), rewards=[None, 30.0, 40.0])
    page = text(report(failing, core_minutes=15.0))
    assert "Evaluations left out because they failed: 1." in page


def test_at_equal_cost_some_attributes_are_searched_and_the_others_random(command, out):
    subset = ("building_position", "fence_position")
    flags = ("--methods", "intervals", "random_search", "--searches", "1", "--core-minutes", "0.05")
    assert command("searches", out, *flags, "--subset", *subset) == 0
    report = read_json(out / "searches.json")
    assert (report["core_minutes"], report["subset"]) == (0.05, [*subset])
    ours, theirs = (len(search["rewards"]) for search in report["searches"])
    logged = lines(out / "evaluations.jsonl")
    assert len(logged) == ours + theirs and 1 <= ours == theirs
    others = [k for k, name in enumerate(NAMES) if name not in subset]
    assert {(line["centre"][k], line["width"][k]) for line in logged for k in others} == {(0.5, 1)}
    assert any(line["width"] != [1] * len(NAMES) for line in logged)
    page = (out / "searches.md").read_text()
    assert "; building_position, fence_position were optimised, the others are random. " in page


def test_schedules_and_groups_by_hand():
    assert [schedule(48, 2, 8), schedule(48, 3, 8), schedule(8, 2, 8)] == [(8, 3), (8, 2), (4, 1)]
    assert schedule(48, 4, 8) == (6, 2)  # with 8, two of six updates would be left over
    assert schedule(300, 4, 1) == (1, 75)
    assert schedule(50, 3, 10) == (10, 1)  # no number does; two updates try the answer
    three = ("car_position", "tree_position", "building_position")  # in as many groups
    config = defaults_of("ablation", "camvid", "quick")
    search_plan = plan(config, "some", "sdr", three, 48)
    assert (
        search_plan.subset,
        search_plan.datasets,
        search_plan.updates,
        search_plan.search.updates,
    ) == (three, 8, 6, 6)


@given(st.integers(1, 400), st.integers(1, 6), st.integers(1, 10))
def test_schedules_never_go_over_the_budget(evaluations, groups, datasets):
    n, updates = schedule(evaluations, groups, datasets)
    assert min(datasets, 2) <= n <= datasets and n * updates * groups <= evaluations
