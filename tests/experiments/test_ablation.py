"""The ablation: what each variant leaves out, equal evaluations, kills, and what is refused."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from experiments import presets
from experiments.ablation import job
from experiments.ablation.job import STUDY, VARIANTS, defaults, searches, shuffled
from experiments.ablation.report import FORM
from experiments.cli import main
from experiments.presets import CAMVID_GROUPS, PRESETS, TARGETS
from experiments.study.skeleton import do
from scene.attributes import NAMES

from .conftest import Killed, formula, lines

FILES = ("ablation.json", "ablation.md", "ablation.png")
RECORDED = Path(__file__).parents[2] / "docs" / "results" / "ablation.json"
command = partial(main, "ablation", defaults, partial(do, STUDY), "")


@pytest.fixture
def ablate(camvid, tmp_path, scored_by):
    """A configuration on tiny CamVid, and the calls of a formula in the place of nets."""
    calls: list[tuple] = []

    def counted(*task):
        if len(calls) == counted.limit:
            raise Killed
        calls.append(task)
        return formula(*task)

    counted.limit = -1
    scored_by(counted)
    config = replace(defaults("camvid", "smoke"), data=camvid, workers=0, out=tmp_path / "run")
    search = replace(config.search, method="random_search")
    return replace(config, search=search, variants=VARIANTS), calls, counted


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("method", ["sdr", "actor_critic"])
def test_every_variant_has_the_whole_budget(target, preset, method):
    config = defaults(target, preset)
    config = replace(config, search=replace(config.search, method=method))
    if preset == "smoke":  # two for each of the six groups
        config = replace(config, evaluations=12, variants=VARIANTS)
    job.check(config)
    for made in searches(config).values():
        assert made.evaluations == config.evaluations and made.method == method


@given(st.integers(0, 2**31 - 1))
def test_shuffled_groups_are_a_partition_of_the_same_sizes(seed):
    found = shuffled(CAMVID_GROUPS, NAMES, seed)
    assert [len(group) for group in found] == [len(group) for group in CAMVID_GROUPS]
    assert sorted(name for group in found for name in group) == sorted(NAMES)
    assert found == shuffled(CAMVID_GROUPS, NAMES, seed) != shuffled(CAMVID_GROUPS, NAMES, seed + 1)
    assert found != CAMVID_GROUPS


def test_variants_leave_out_what_they_say():
    config = defaults("camvid", "quick")
    assert config.groups == CAMVID_GROUPS and config.search.relaxation == 0.3
    changed = {
        "no_relaxation": replace(config, search=replace(config.search, relaxation=0.0)),
        "no_groups": replace(config, groups=(NAMES,)),
        "shuffled_groups": replace(config, groups=shuffled(CAMVID_GROUPS, NAMES, 0)),
    }
    words = ("environment", "positions", "densities")
    left_out = {f"no_{word}": getattr(presets, word.upper()) for word in words}
    for variant in VARIANTS:
        assert job.without(config, variant) == changed.get(variant, config)
        assert set(job.subset_of(variant)) == set(NAMES) - set(left_out.get(variant, ()))
    made = searches(config)
    assert made["no_positions"].subset == job.subset_of("no_positions")
    assert made["no_relaxation"].options.relaxation == 0


def test_an_ablation_leaves_its_figures(ablate, capsys):
    config, calls, _ = ablate
    report = do(STUDY, config)
    printed = capsys.readouterr().out
    assert "Plan, in CPU seconds" in printed and "no_relaxation: update 2/2 | mIoU" in printed
    rows = {row["variant"]: row for row in report["rows"]}
    assert tuple(rows) == VARIANTS and rows["random"]["search"] is None
    for name in searches(config):
        found = rows[name]["search"]
        assert len(found["rewards"]) == 4 and found["core_seconds"] == 8
        widths = {attribute: wide for attribute, (_, wide) in found["solution"].items()}
        if name == "no_relaxation":
            assert set(widths.values()) == {0.0}
        if name == "no_positions":
            assert {a for a, w in widths.items() if w == 1} == set(presets.POSITIONS)
            assert found["attributes"] == 16
    # Without a group's structure random search draws the same: no net is trained twice.
    logged = [lines(config.out / name) for name in ("evaluations.jsonl", "finals.jsonl")]
    assert sum(map(len, logged)) == len(calls) < 7 * 4 + 8 * 2
    assert rows["no_groups"]["paper"] == -7.9 and rows["random"]["paper"] is None
    text = (config.out / "ablation.md").read_text()
    assert "| no groups: all 23 in one |" in text and "NOT of this run" in text
    assert min(Image.open(config.out / "ablation.png").size) > 200


def test_killed_it_goes_on_and_ends_the_same(ablate, tmp_path):
    config, calls, counted = ablate
    some = replace(config, variants=("full", "no_positions"))
    do(STUDY, some)
    made, broken = len(calls), replace(some, out=tmp_path / "broken")
    calls.clear()
    for limit in (3, made - 1):  # within a search, and within the final nets
        counted.limit = limit
        with pytest.raises(Killed):
            do(STUDY, broken)
    counted.limit = -1
    do(STUDY, broken)
    assert len(calls) == made  # what is done is not redone
    for name in FILES:
        assert (broken.out / name).read_bytes() == (some.out / name).read_bytes()


def test_a_recorded_report_is_derived_anew(tmp_path):
    assert command(["--rederive", str(RECORDED), "--out", str(tmp_path / "run")]) == 0
    report = json.loads(RECORDED.read_text())
    assert FORM.derive(report) == report
    report["rows"][1]["nets"] = [None] * 3
    report["rows"][1]["search"]["rewards"][0] = None
    found = FORM.derive(report)
    assert found["rows"][1]["mean"] is None and "3 nets failed" in FORM.text(found)
    assert "1 evaluations failed and are left out of their update" in FORM.text(found)
    assert FORM.figures["ablation.png"](found).startswith(b"\x89PNG")


@pytest.mark.parametrize(("flags", "complaint"), [
    (("--variants", "full", "full"), "--variants full full names one of them twice"),
    (("--variants", "no_groups"), "--variants must hold full"),
    (("--method", "sdr"), "--evaluations 4 are too few for sdr on 23 attributes"),
    (("--method", "random_attributes"), "random_attributes searches for nothing"),
])  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, tmp_path, error_line):
    assert command(["--preset", "smoke", "--out", str(tmp_path / "run"), *flags]) == 2
    assert complaint in error_line() and not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "flags", ["--variants no_fog", "--learnt x.json", "--reward-kind mmd", "--candidates argmax"]
)
def test_what_has_no_effect_is_no_flag(flags, tmp_path):
    with pytest.raises(SystemExit, match="2"):
        command(["--preset", "smoke", "--out", str(tmp_path / "run"), *flags.split()])


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert command(["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real" in capsys.readouterr().out
    report = json.loads((out / "ablation.json").read_text())
    assert all(0 < row["mean"] < 100 for row in report["rows"])
