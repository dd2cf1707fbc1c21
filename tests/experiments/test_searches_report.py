"""What the report of many searches says of methods, with model selection and without."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from experiments.config.studies import defaults_of
from experiments.evaluation.cost import cost_of
from experiments.searches import check, configured, derive, plan_of, rows, text, work
from shell.errors import UserError


def nets(*scores):
    return [{"miou": score, "class_iou": []} for score in scores]


BASELINES = {
    "random": nets(30.0, 32.0), "default": nets(34.0, 36.0), "real": nets(40.0, 40.0),
}  # fmt: skip


def search(seed, chosen, own, **more):
    found = {
        "method": "sdr",
        "seed": seed,
        "chosen_candidate": chosen,
        "rewards": [20.0, 30.0, 40.0],
    }
    return {**found, "nets": own, **more}


def report(*searches, **more):
    about = {"note": "some", "scored_at": "480x360", "test_images": 1, "seeds": 2, "starts": {}}
    budget = {"rewards_at": "240x176", "space": "scenex", **more}
    return derive({**about, **budget, "baselines": BASELINES, "searches": list(searches)})


def test_a_method_has_a_row_with_model_selection_and_one_without():
    found = report(
        search(0, "default", nets(34.0, 36.0), own_nets=nets(31.0, 31.0)),
        search(1, "half", nets(36.0, 38.0), own_nets=nets(33.0, 35.0)),
    )
    rows = {(row["name"], row["judged"]): row for row in found["rows"]}
    assert rows["sdr", True]["mean"] == 36.0
    assert rows["sdr", True]["gain_over_default"]["mean"] == 1.0
    assert rows["sdr", False]["mean"] == 32.5
    assert rows["sdr", False]["gain_over_default"]["mean"] == -2.5
    assert [each["own_answer"] for each in found["searches"]] == [31.0, 34.0]
    page = text(found)
    assert "learnt by sdr, without model selection | 2 | 32.5" in page
    assert "Answers that are hand-set: 1 of 2 of sdr." in page


def test_reports_from_before_own_answers_had_nets_are_read():
    found = report(search(0, "half", nets(36.0, 38.0)))
    assert [row["judged"] for row in found["rows"]] == [True] * 4
    page = text(found)
    assert "without model selection" not in page and "that are hand-set" not in page


def test_searches_at_equal_core_minutes_have_no_selection_and_end_with_their_methods_answer():
    config = replace(
        defaults_of("searches", "labelmefacade", "quick"),
        core_minutes=15.0, methods=("intervals", "random_search", "sdr"), searches=2,
    )  # fmt: skip
    check(config)
    plans = {name: plan_of(own, name) for name, own in configured(config).items()}
    assert list(plans) == [f"{m}-{k}" for k in (0, 1) for m in config.methods]
    seconds = [plan.evaluations * cost_of(config.reward) for plan in plans.values()]
    assert all(0.75 * 15 * 60 < each <= 15 * 60 for each in seconds)
    counts = {kind.what: kind.nets for kind in work(config)}
    assert counts["nets of candidates, 6 searches"] == 6  # one each: nothing is chosen
    names = [row.name for row in rows(config, SimpleNamespace(few_names=()))]
    assert [name for name in names if "sdr" in name] == ["sdr-0", "sdr-1"]
    with pytest.raises(
        UserError, match=r"--core-minutes 0\.1 are too few for one update of intervals"
    ):
        check(replace(config, core_minutes=0.1))
    page = text(report(search(0, "argmax", nets(36.0, 38.0)), core_minutes=15.0))
    assert "rewards for 15 minutes of a core" in page and "its answer is its method's own" in page
