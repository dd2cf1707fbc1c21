"""Assets and images: which pools and streets each net sees, pairs, kills, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.finals import default_proposal, random_proposal
from experiments.stats import paired_gain
from experiments.targets import TARGETS
from PIL import Image

from experiments import study_nets
from experiments.assets_job import IMAGES, assets_config, attributes, check, main, run, stage_of
from experiments.assets_report import FORM
from experiments.config import PRESETS
from experiments.reward import Evaluation
from experiments.study import Study

from .conftest import Killed, formula, lines, never

FILES = ("assets.json", "assets.md", "assets.png")


@pytest.fixture
def study(camvid, tmp_path, monkeypatch):
    """A configuration on tiny CamVid, and the calls of a formula in the place of nets."""
    calls: list[tuple] = []

    def counted(stage, table, renderer, pool, units, seed, truth) -> Evaluation:
        """Half the assets cost a little."""
        if len(calls) == counted.limit:
            raise Killed
        calls.append((stage, pool, units, seed, truth))
        less = 0 if pool.fraction == 1 else 1 + seed % 2
        return formula(stage, table, renderer, pool, units, 10 * seed + 20 - less, truth)

    counted.limit = -1
    monkeypatch.setattr(study_nets, "evaluate", counted)
    config = replace(assets_config("camvid", "smoke"), data=camvid, workers=0, out=tmp_path / "run")
    return config, calls, counted


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("target", TARGETS)
def test_presets_are_sound(target, preset):
    config = assets_config(target, preset)
    check(config)
    assert config.fractions == (1.0, 0.5) and config.seeds >= 2
    if preset != "smoke":
        assert config.images == IMAGES
    for images in config.images:
        assert stage_of(config, images).images == images


def test_a_study_leaves_its_figures(study, capsys):
    config, calls, _ = study
    report = run(config)
    assert "Plan, in CPU seconds" in capsys.readouterr().out
    assert len(calls) == 2 * 2 * config.seeds
    for stage, pool, units, _, _ in calls:
        assert pool == config.pool._replace(fraction=pool.fraction)
        assert len(units) == stage.streets and stage.shots == config.final.shots
    # Pairs share streets and seeds, and differ in nothing but the assets.
    for images in config.images:
        full, half = (
            [c for c in calls if c[0].images == images and c[1].fraction == fraction]
            for fraction in (1, 0.5)
        )
        for ours, theirs in zip(full, half, strict=True):
            assert ours[3] == theirs[3]
            np.testing.assert_array_equal(ours[2], theirs[2])
    assert [(r["images"], r["streets"], r["fraction"]) for r in report["rows"]] == [
        (2, 1, 1.0), (2, 1, 0.5), (4, 2, 1.0), (4, 2, 0.5),
    ]  # fmt: skip
    full, half = ([net["miou"] for net in row["nets"]] for row in report["rows"][:2])
    gain, interval = paired_gain(full, half)
    assert report["rows"][0]["more_assets"] is None and gain > 0
    assert report["rows"][1]["more_assets"] == {"mean": gain, "ci95": interval}
    text = (config.out / "assets.md").read_text()
    assert "| 4 | 2 | 50 % |" in text and "attributes set by eye" in text
    assert min(Image.open(config.out / "assets.png").size) > 200


def test_killed_it_goes_on_and_ends_the_same(study, tmp_path, monkeypatch):
    config, calls, counted = study
    run(config)
    broken = replace(config, out=tmp_path / "broken")
    calls.clear()
    counted.limit = 5
    with pytest.raises(Killed):
        run(broken)
    counted.limit = -1
    run(broken)
    assert len(calls) == 8 and len(lines(broken.out / "store.jsonl")) == 9
    monkeypatch.setattr(study_nets, "evaluate", never)
    run(broken)  # what is finished is not redone
    for name in FILES:
        assert (broken.out / name).read_bytes() == (config.out / name).read_bytes()


def test_streets_are_drawn_from_what_is_asked_for(study, learnt_file):
    config, _, _ = study

    def chosen(**flags):
        return attributes(Study(replace(config, **flags), *[None] * 4), None)

    np.testing.assert_array_equal(np.stack(chosen()), np.stack(default_proposal(0.15)))
    random = chosen(attributes="random")
    np.testing.assert_array_equal(np.stack(random), np.stack(random_proposal()))
    learnt = chosen(attributes="learnt", learnt=learnt_file)
    assert learnt.centre.max() == pytest.approx(0.9)


def test_learnt_attributes_come_from_their_file(study, camvid, tmp_path, learnt_file):
    _, calls, _ = study
    out = tmp_path / "learnt"
    fixed = ("--target", "camvid", "--preset", "smoke", "--data", str(camvid), "--workers", "0")
    flags = ("--attributes", "learnt", "--learnt", str(learnt_file), "--images", "4")
    assert main("", [*fixed, *flags, "--fractions", "1", "--out", str(out)]) == 0
    assert len(calls) == 2 and calls[0][2].max() > 0.8
    report = json.loads((out / "assets.json").read_text())
    assert len(report["rows"]) == 1 and report["rows"][0]["more_assets"] is None
    assert f"learnt attributes, from {learnt_file}" in (out / "assets.md").read_text()


def test_figures_come_from_the_report_alone(study, tmp_path):
    config, _, _ = study
    run(config)
    again = tmp_path / "again"
    assert main("", ["--rederive", str(config.out / "assets.json"), "--out", str(again)]) == 0
    for name in FILES:
        assert (again / name).read_bytes() == (config.out / name).read_bytes()
    report = json.loads((again / "assets.json").read_text())
    report["rows"][1]["nets"] = [None, None]
    found = FORM.derive(report)
    assert found["rows"][1]["mean"] is None and "2 nets failed" in FORM.text(found)
    assert FORM.picture(found).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--images", "3"), "--images must be multiples of --final.shots 2"),
        (("--images", "0"), "--images must be multiples of --final.shots 2"),
        (("--images", "4", "4"), "--images 4 4 names one of them twice"),
        (("--fractions", "0.5", "0.5"), "--fractions 0.5 0.5 names one of them twice"),
        (("--fractions", "0"), "--fractions must lie in (0, 1], not 0"),
        (("--fractions", "1.5"), "--fractions must lie in (0, 1], not 1.5"),
        (("--attributes", "learnt", "--learnt", "/nowhere.json"), "/nowhere.json"),
        (("--data", "/nowhere"), "/nowhere"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, camvid, tmp_path, error_line):
    out = tmp_path / "run"
    fixed = ("--target", "camvid", "--data", str(camvid), "--preset", "smoke", "--workers", "0")
    assert main("", [*fixed, "--out", str(out), *flags]) == 2
    assert complaint in error_line()
    assert not out.exists()


def test_a_file_of_attributes_must_be_asked_for(tmp_path, learnt_file, error_line):
    flags = ("--preset", "smoke", "--out", str(tmp_path / "run"), "--learnt", str(learnt_file))
    assert main("", flags) == 2
    assert "--learnt is of no use with --attributes default" in error_line()


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert main("", ["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real" in capsys.readouterr().out
    report = json.loads((out / "assets.json").read_text())
    assert [row["images"] for row in report["rows"]] == [2, 2, 4, 4]
