"""The ablation: what each variant leaves out, equal evaluations, what failed."""

from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.config import presets
from experiments.config.jobs import VARIANTS, defaults_of
from experiments.config.presets import CAMVID_GROUPS
from experiments.studies import ablation as job
from experiments.tables.skeleton import do
from scene.attributes import NAMES

from .conftest import by_preset, lines, searching


@by_preset
@pytest.mark.parametrize("method", ["sdr", "surrogate"])
def test_every_variant_has_the_whole_budget(target, preset, method):
    config = searching(defaults_of("ablation", target, preset), method=method)
    if preset == "smoke":  # two for each of the six groups
        config = replace(config, evaluations=12, variants=VARIANTS)
    job.check(config)
    for plan in job.plan_all(config).values():
        assert plan.evaluations == config.evaluations and plan.method == method


@given(st.integers(0, 2**31 - 1))
def test_shuffled_groups_are_a_partition_of_the_same_sizes(seed):
    groups, again, other = (job.shuffled(CAMVID_GROUPS, NAMES, s) for s in (seed, seed, seed + 1))
    assert [len(group) for group in groups] == [len(group) for group in CAMVID_GROUPS]
    assert sorted(name for group in groups for name in group) == sorted(NAMES)
    assert other != groups == again != CAMVID_GROUPS


def test_variants_leave_out_what_they_say():
    config = defaults_of("ablation", "camvid", "quick")
    assert config.groups == CAMVID_GROUPS and config.search.relaxation == 0.3
    changed = {
        "no_relaxation": searching(config, relaxation=0.0),
        "no_groups": replace(config, groups=(NAMES,)),
        "shuffled_groups": replace(config, groups=job.shuffled(CAMVID_GROUPS, NAMES, 0)),
    }
    words = ("environment", "positions", "densities")
    left_out = {f"no_{word}": getattr(presets, word.upper()) for word in words}
    for variant in VARIANTS:
        assert job.without(config, variant) == changed.get(variant, config)
        assert set(job.subset_of(variant, config)) == set(NAMES) - set(left_out.get(variant, ()))
    plans = job.plan_all(config)
    assert plans["no_positions"].subset == job.subset_of("no_positions", config)
    assert plans["no_relaxation"].config.search.relaxation == 0


def test_an_ablation_leaves_its_figures(tiny, counted, capsys):
    config = searching(
        tiny(partial(defaults_of, "ablation"), variants=VARIANTS), method="random_search"
    )
    rows = {row["variant"]: row for row in do(job.STUDY, config)["rows"]}
    assert "no_relaxation: update 2/2 | mIoU" in capsys.readouterr().out
    assert tuple(rows) == VARIANTS and rows["random"]["search"] is None
    for name in job.plan_all(config):
        search = rows[name]["search"]
        assert len(search["rewards"]) == 4 and search["core_seconds"] == 8
        widths = {attribute: wide for attribute, (_, wide) in search["solution"].items()}
        if name == "no_relaxation":
            assert set(widths.values()) == {0.0}
        if name == "no_positions":
            assert {a for a, w in widths.items() if w == 1} == set(presets.POSITIONS)
            assert search["attributes"] == 16
    # Without a group's structure random search draws the same: no net is trained twice.
    logged = [lines(config.out / name) for name in ("evaluations.jsonl", "finals.jsonl")]
    keys = [{line["key"] for line in log} for log in logged]  # variants may ask for the same
    assert sum(map(len, keys)) == len(counted.calls) < 7 * 4 + 8 * 2
    assert rows["no_groups"]["paper"] == -7.9 and rows["random"]["paper"] is None
    text = (config.out / "ablation.md").read_text()
    assert "| no groups: all attributes in one |" in text and "NOT of this run" in text


def test_what_failed_is_told_and_left_out(tiny, counted):
    config = searching(
        tiny(partial(defaults_of, "ablation"), variants=("random", "full")), method="random_search"
    )
    report = do(job.STUDY, config)
    report["rows"][1]["nets"] = [None] * len(report["rows"][1]["nets"])
    report["rows"][1]["search"]["rewards"][0] = None
    derived = job.FORM.derive(report)
    assert derived["rows"][1][
        "mean"
    ] is None and "because their training failed: 2." in job.FORM.text(derived)
    assert "Evaluations left out because they failed: 1." in job.FORM.text(derived)
    assert job.FORM.figures["ablation.png"](derived).startswith(b"\x89PNG")
