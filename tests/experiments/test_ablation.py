"""The ablation: what each variant leaves out, equal evaluations, kills, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.stats import paired_gain
from experiments.targets import TARGETS
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from experiments import compare_search, study_nets
from experiments.ablation_config import (
    VARIANTS,
    ablation_config,
    check,
    comparison,
    plan,
    searched,
    shuffled,
)
from experiments.ablation_job import main, run
from experiments.ablation_report import FORM
from experiments.config import CAMVID_GROUPS, DENSITIES, ENVIRONMENT, POSITIONS, PRESETS
from experiments.store import Store
from scene.attributes import NAMES

from .conftest import Killed, formula, lines, never

FILES = ("ablation.json", "ablation.md", "ablation.png")


@pytest.fixture
def ablate(camvid, tmp_path, monkeypatch):
    """A configuration on tiny CamVid, and the calls of a formula in the place of nets."""
    calls: list[tuple] = []

    def counted(*task):
        if len(calls) == counted.limit:
            raise Killed
        calls.append(task)
        return formula(*task)

    counted.limit = -1
    for module in (compare_search, study_nets):
        monkeypatch.setattr(module, "evaluate", counted)
    config = replace(
        ablation_config("camvid", "smoke"), data=camvid, workers=0, out=tmp_path / "run"
    )
    search = replace(config.search, method="random_search")
    return replace(config, search=search, variants=VARIANTS), calls, counted


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("method", ["sdr", "actor_critic"])
def test_every_variant_has_the_whole_budget(target, preset, method):
    config = ablation_config(target, preset)
    config = replace(config, search=replace(config.search, method=method))
    if preset == "smoke":
        # Two for each of the six groups.
        config = replace(config, evaluations=12, variants=VARIANTS)
    check(config)
    for variant in searched(config):
        made = plan(config, variant)
        assert made.datasets * made.updates == config.evaluations
        assert made.method == method


@given(st.integers(0, 2**31 - 1))
def test_shuffled_groups_are_a_partition_of_the_same_sizes(seed):
    found = shuffled(CAMVID_GROUPS, NAMES, seed)
    assert [len(group) for group in found] == [len(group) for group in CAMVID_GROUPS]
    assert sorted(name for group in found for name in group) == sorted(NAMES)
    assert found == shuffled(CAMVID_GROUPS, NAMES, seed)


def test_other_seeds_shuffle_otherwise():
    found = {shuffled(CAMVID_GROUPS, NAMES, seed) for seed in range(5)}
    assert len(found) == 5 and CAMVID_GROUPS not in found


def test_variants_leave_out_what_they_say():
    config = ablation_config("camvid", "quick")
    full = comparison(config, "full")
    assert full.subsets == (NAMES,) and full.groups == CAMVID_GROUPS
    assert full.search.relaxation == 0.3
    relaxed = comparison(config, "no_relaxation")
    assert relaxed.search.relaxation == 0 and relaxed.groups == CAMVID_GROUPS
    assert comparison(config, "no_groups").groups == (NAMES,)
    mixed = comparison(config, "shuffled_groups")
    assert mixed.groups == shuffled(CAMVID_GROUPS, NAMES, 0) != CAMVID_GROUPS
    for variant, left_out in (
        ("no_environment", ENVIRONMENT), ("no_positions", POSITIONS), ("no_densities", DENSITIES),
    ):  # fmt: skip
        made = comparison(config, variant)
        assert set(made.subsets[0]) == set(NAMES) - set(left_out)
        assert plan(config, variant).subset == made.subsets[0]
        assert made.groups == CAMVID_GROUPS and made.search.relaxation == 0.3


def test_an_ablation_leaves_its_figures(ablate, capsys):
    config, calls, _ = ablate
    report = run(config)
    printed = capsys.readouterr().out
    assert "Plan, in CPU seconds" in printed and "Variant: no relaxation" in printed
    rows = {row["variant"]: row for row in report["rows"]}
    assert tuple(rows) == VARIANTS and rows["random"]["search"] is None
    for name in searched(config):
        found = rows[name]["search"]
        assert len(found["rewards"]) == 4 and found["core_seconds"] == 8
        widths = {attribute: wide for attribute, (_, wide) in found["solution"].items()}
        if name == "no_relaxation":
            assert set(widths.values()) == {0.0}
        if name == "no_positions":
            assert {a for a, w in widths.items() if w == 1} == set(POSITIONS)
            assert found["attributes"] == 16
    # Without a group's structure random search draws the same: no net is trained twice.
    assert len(Store(config.out / "store.jsonl")) == len(calls) < 7 * 4 + 8 * 2
    full, ours = ([net["miou"] for net in rows[n]["nets"]] for n in ("full", "no_positions"))
    gain, interval = paired_gain(ours, full)
    assert rows["no_positions"]["gain"] == {"mean": gain, "ci95": interval}
    assert rows["no_groups"]["paper"] == -7.9 and rows["random"]["paper"] is None
    text = (config.out / "ablation.md").read_text()
    assert "| no groups: all 23 in one |" in text and "NOT of this run" in text
    assert min(Image.open(config.out / "ablation.png").size) > 200


def test_killed_it_goes_on_and_ends_the_same(ablate, tmp_path, monkeypatch):
    config, calls, counted = ablate
    some = replace(config, variants=("full", "no_relaxation", "no_positions"))
    run(some)
    made, broken = len(calls), replace(some, out=tmp_path / "broken")
    for limit in (3, made - 1):  # within a search, and within the final nets
        calls.clear()
        counted.limit = limit - len(lines(broken.out / "store.jsonl")[1:])
        with pytest.raises(Killed):
            run(broken)
    counted.limit = -1
    run(broken)
    for module in (compare_search, study_nets):
        monkeypatch.setattr(module, "evaluate", never)
    run(broken)  # what is finished is not redone
    for name in FILES:
        assert (broken.out / name).read_bytes() == (some.out / name).read_bytes()


def test_figures_come_from_the_report_alone(ablate, tmp_path):
    config, _, _ = ablate
    run(replace(config, variants=("full", "no_groups"), seeds=1))
    again = tmp_path / "again"
    assert main("", ["--rederive", str(config.out / "ablation.json"), "--out", str(again)]) == 0
    for name in FILES:
        assert (again / name).read_bytes() == (config.out / name).read_bytes()
    report = json.loads((again / "ablation.json").read_text())
    report["rows"][1]["nets"] = [None]
    report["rows"][1]["search"]["rewards"][0] = None
    found = FORM.derive(report)
    assert found["rows"][1]["mean"] is None and "2 nets failed" in FORM.text(found)
    assert FORM.picture(found).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--variants", "full", "no_fog"), "--variants 'no_fog' is unknown; known: full"),
        (("--variants", "full", "full"), "names one of them twice"),
        (("--variants", "no_groups"), "--variants must hold full"),
        (("--evaluations", "3"), "multiple of --search.datasets-per-update 2, not 3"),
        (("--method", "sdr"), "--evaluations 4 are too few for sdr on all"),
        (("--method", "random_attributes"), "random_attributes searches for nothing"),
        (("--learnt", "x.json"), "x.json"),
        (("--reward-kind", "mmd"), "the ablation knows miou only"),
        (("--data", "/nowhere"), "/nowhere"),
        (("--rederive", "/nowhere.json"), "/nowhere.json"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, camvid, tmp_path, error_line):
    out = tmp_path / "run"
    fixed = ("--target", "camvid", "--data", str(camvid), "--preset", "smoke", "--workers", "0")
    assert main("", [*fixed, "--out", str(out), *flags]) == 2
    assert complaint in error_line()
    assert not out.exists()


def test_learnt_attributes_have_no_use(camvid, tmp_path, learnt_file, error_line):
    flags = ("--preset", "smoke", "--out", str(tmp_path / "run"), "--learnt", str(learnt_file))
    assert main("", flags) == 2
    assert "--learnt has no use here" in error_line()


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert main("", ["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real" in capsys.readouterr().out
    report = json.loads((out / "ablation.json").read_text())
    assert all(0 < np.mean([net["miou"] for net in row["nets"]]) < 100 for row in report["rows"])
