"""What studies share: attributes from a file or by search, nets scored once, reports derived anew."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.errors import UserError
from experiments.finals import Finals, default_proposal, random_proposal
from experiments.outcome import Outcome
from experiments.study_config import StudyConfig, check_study, defaults_on, read_learnt
from experiments.study_nets import score_nets
from experiments.study_report import Form, class_means, nets, rewrite, statistics, write

import sdr_jax
from experiments import finals, search, study_nets, study_report, summary
from experiments.reward import Truth
from experiments.study import Work, learnt_attributes, opened, plan_text, search_work
from scene.attributes import NAMES
from seg.train import TrainingError

from .conftest import formula, formula_real, lines


@pytest.fixture
def config(camvid, tmp_path) -> StudyConfig:
    return replace(
        defaults_on(StudyConfig, "camvid", "smoke"), data=camvid, workers=0, out=tmp_path / "run"
    )


@pytest.fixture
def worth(monkeypatch):
    """Puts formulas in the place of nets; returns the list of calls."""
    calls: list[tuple] = []

    def counted(function):
        def call(*task):
            calls.append(task)
            return function(*task)

        return call

    for module in (search, finals, study_nets):
        monkeypatch.setattr(module, "evaluate", counted(formula))
    for module in (finals, study_nets):
        monkeypatch.setattr(module, "evaluate_real", counted(formula_real))
    return calls


def test_learnt_attributes_are_those_of_the_main_job_and_made_once(config, worth, tmp_path):
    shared = replace(config, store=tmp_path / "shared.jsonl")
    with opened(shared) as study:
        plan = search_work(shared)
        progress = study.begin(plan)
        learnt = learnt_attributes(study, progress)
        assert len(worth) == sum(work.nets for work in plan) == 12 + 2
        # The main job's rows are the same nets: they, too, are made once.
        sources = {
            "random": random_proposal(),
            "default": default_proposal(shared.default_width),
            "learnt": learnt,
        }
        ours = score_nets(study, "table", sources, shared.final, progress)
        split = study.target.at(shared.final.height, shared.final.width)
        made = len(worth)
        rows = Finals(
            shared, study.target, split, study.folder, study.workers, progress, 1.0, study.store
        ).rows(learnt)
        assert len(worth) == made + shared.seeds  # those on real images
        for row in sources:
            assert [line["miou"] for line in rows[row]] == [o.reward for o in ours[row]]
    worth.clear()
    again = replace(shared, out=tmp_path / "again")
    with opened(again) as study:
        found = learnt_attributes(study, study.progress(1))
    assert worth == []
    np.testing.assert_array_equal(np.stack(found), np.stack(learnt))
    written = read_learnt(again.out / "attributes.json")
    np.testing.assert_array_equal(np.stack(written), np.stack(learnt))


def test_a_file_of_attributes_saves_the_search(config, worth, learnt_file):
    given = replace(config, learnt=learnt_file)
    assert search_work(given) == []
    with opened(given) as study:
        found = learnt_attributes(study, study.progress(1))
    assert worth == [] and found.centre.shape == (len(NAMES),)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        ("{", "is no JSON file"),
        ("[1]", "expected a JSON object"),
        ('{"fog": 0.5}', "unknown attribute 'fog'"),
        ('{"car_position": 0.5}', "is missing; all 23 must be given"),
        (json.dumps(dict.fromkeys(NAMES, 2)), "unit values must lie in [0, 1]"),
    ],
)
def test_other_files_are_no_attributes(config, tmp_path, content, words):
    path = tmp_path / "attributes.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(UserError) as error:
        check_study(replace(config, learnt=path))
    assert words in str(error.value) and f"--learnt {path}" in str(error.value)


def test_nets_are_paired_and_made_once(config, worth):
    real = Truth(np.zeros((3, 48, 64, 3), np.uint8), np.zeros((3, 48, 64), np.uint8))
    sources = {"real": real, "random": random_proposal()}
    with opened(config) as study:
        found = score_nets(study, "some", sources, config.final, study.progress(1))
        assert len(worth) == 4 and list(found) == ["real", "random"]
        # Rendered: units, seed and truth end the task; real: seed and truth.
        assert [task[-2] for task in worth] == [0, 1, 0, 1]
        again = score_nets(study, "some", sources, config.final, study.progress(1))
        assert len(worth) == 4
        for name in sources:
            pairs = zip(found[name], again[name], strict=True)
            assert all(a.reward == b.reward and a.class_iou == b.class_iou for a, b in pairs)
        assert all(outcome.stored for name in sources for outcome in again[name])
        # Other assets are other nets.
        half = study._replace(config=replace(config, asset_fraction=0.5))
        score_nets(half, "some", {"random": random_proposal()}, config.final, study.progress(1))
        assert len(worth) == 6
    with opened(config) as study:
        score_nets(study, "some", sources, config.final, study.progress(1))
    assert len(worth) == 6 and len(lines(config.out / "finals.jsonl")) == 2


def test_failed_nets_are_told_and_not_remembered(config, monkeypatch):
    def failing(*task):
        raise TrainingError("the loss is nan")

    monkeypatch.setattr(study_nets, "evaluate_real", failing)
    real = Truth(np.zeros((3, 48, 64, 3), np.uint8), np.zeros((3, 48, 64), np.uint8))
    with opened(config) as study:
        found = score_nets(study, "some", {"real": real}, config.final, study.progress(1))
    assert [outcome.failed for outcome in found["real"]] == ["the loss is nan"] * 2
    assert nets(found["real"]) == [None, None]
    assert lines(config.out / "finals.jsonl") == []


def test_what_cannot_be_done_shows_before_the_folder_is_made(config):
    def refuse(target):
        raise UserError(f"not on {target.name}")

    with pytest.raises(UserError, match="not on camvid"), opened(config, refuse):
        raise AssertionError
    assert not config.out.exists()
    with opened(config), pytest.raises(UserError, match="in use"), opened(config):
        raise AssertionError


def test_the_plan_tells_nets_seconds_and_time():
    stage = defaults_on(StudyConfig, "camvid", "quick").final
    text = plan_text([Work.at("nets, 3 sets x 5 seeds", 15, stage), Work("b", 10, stage, 6.0)], 2)
    assert "15 x   50.3  nets, 3 sets x 5 seeds (compact, 128x96, 400 images, 1000 steps)" in text
    # (15 x 50.3 + 10 x 6) / 2 = 407 s
    assert "About 7 min on 2 worker(s), without compiling" in text


def test_statistics_leave_failed_nets_out():
    found = statistics([10.0, None, 14.0], [9.0, 5.0, 11.0])
    assert found["mean"] == 12 and found["gain"]["mean"] == 2  # of 1 and 3
    assert statistics([None, 3.0], [1.0, None])["gain"] is None
    assert statistics([None], None) == {"mean": None, "ci95": None, "gain": None}
    outcomes = [Outcome(0.2, [0.2, None], 1, 1), Outcome(0.4, [0.4, None], 1, 1)]
    assert class_means(nets(outcomes), ["a", "b"]) == {"a": pytest.approx(30), "b": None}


FORM = Form(
    "some",
    lambda report: {**report, "mean": float(np.mean(report["scores"]))},
    lambda report: f"{report['mean']}",
    lambda report: b"picture",
)


def test_a_report_is_derived_anew_from_its_scores(tmp_path):
    report = write(FORM, {"scores": [1, 2]}, tmp_path)
    assert report["mean"] == 1.5 and (tmp_path / "some.md").read_text() == "1.5\n"
    file = tmp_path / "some.json"
    file.write_text(file.read_text().replace("1.5", "99"))  # only scores count
    assert rewrite(FORM, file, tmp_path / "b" / "c") == report
    assert (tmp_path / "b" / "c" / "some.png").read_bytes() == b"picture"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        ("{", "is no JSON file"),
        ('{"study": "other"}', "is no report of experiments.some"),
        ('{"study": "some"}', "does not hold what experiments.some writes"),
    ],
)
def test_other_files_are_no_reports(tmp_path, content, words):
    if content is not None:
        (tmp_path / "some.json").write_text(content)
    with pytest.raises(UserError, match=words):
        rewrite(FORM, tmp_path / "some.json", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_attributes_are_read_as_they_are_written(tmp_path):
    """To the last bit, or nets trained on them would not be those in the store."""
    rng = np.random.default_rng(0)
    centre, width = rng.uniform(0.3, 0.7, (2, len(NAMES))).astype(np.float32)
    proposal = sdr_jax.Proposal(centre, width / 2)
    path = tmp_path / "attributes.json"
    path.write_text(json.dumps(summary.attributes(proposal)))
    np.testing.assert_array_equal(np.stack(read_learnt(path)), np.stack(proposal))


def test_the_report_says_what_was_done(config):
    with opened(config) as study:
        about = study_report.about(study, config.final)
    assert (about["target"], about["reward_images"], about["test_images"]) == ("camvid", 4, 2)
    assert about["scored_at"] == "64x48" and len(about["classes"]) == 11
