"""Pre-training: nested subsets, one net's way, tests by hand, kills, and what is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from experiments.finals import draw_units, random_proposal
from experiments.outcome import Outcome
from experiments.stats import welch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scene.catalogue import AssetPool
from scipy import stats

from experiments import pretrain_job, pretrain_nets
from experiments.config import camvid_config
from experiments.pretrain_job import fine_stage, main, pretrain_config
from experiments.pretrain_nets import Start, chosen_images, subsets, transfer
from experiments.pretrain_report import FORM
from experiments.reward import Truth
from scene.dataset import Dataset
from seg.train import TrainingError

from .conftest import Killed, lines, never

FILES = ("pretrain.json", "pretrain.md", "pretrain.png")


def tuned_by_formula(start, fine, renderer, pool, seed, real, chosen, truth):
    """Worth more with more images, and with pre-training; a little noise by seed and row."""
    worth = 0.1 + 0.05 * (start.units is not None) + 0.01 * start.on_subset + 0.001 * (seed % 7)
    return [Outcome(worth + 0.01 * len(k), [worth] * 11, 0.5, 1.5) for k in chosen]


@pytest.fixture
def pretrain(camvid, learnt_file, monkeypatch):
    """Measures on tiny CamVid with a formula in the place of nets; returns the exit code."""

    def start(out, *flags, transfer=tuned_by_formula):
        monkeypatch.setattr(pretrain_job, "transfer", transfer)
        fixed = ("--target", "camvid", "--preset", "smoke", "--data", str(camvid), "--workers", "0")
        return main("", [*fixed, "--learnt", str(learnt_file), "--out", str(out), *flags])

    return start


def report_of(out) -> dict:
    return json.loads((out / "pretrain.json").read_text())


@given(st.integers(0, 2**32 - 1), st.integers(1, 400))
def test_smaller_subsets_lie_within_larger_ones(seed, images):
    fractions = [1.0, 0.05, 0.25, 0.1]
    found = subsets(images, fractions, seed)
    assert [len(k) for k in found] == [chosen_images(images, f) for f in fractions]
    assert found[0].tolist() == list(range(images))
    assert set(found[1]) <= set(found[3]) <= set(found[2]) <= set(found[0])
    assert all((np.diff(k) > 0).all() for k in found)
    # The choice does not depend on which other fractions are asked for.
    np.testing.assert_array_equal(subsets(images, [0.25], seed)[0], found[2])


def test_subsets_by_hand():
    assert chosen_images(367, 0.05) == 18 and chosen_images(8, 0.0625) == 1  # halves go up
    assert chosen_images(8, 0.06) == 0
    assert not np.array_equal(subsets(100, [0.1], 0)[0], subsets(100, [0.1], 1)[0])


def test_welch_by_hand():
    # Means 2 and 7, variances 1 and 20 / 3: t = -5 / sqrt(1 / 3 + 5 / 3).
    found = welch([1, 2, 3], [4, 6, 8, 10])
    assert found.difference == pytest.approx(-5) and found.t == pytest.approx(-5 / math.sqrt(2))
    degrees = 2**2 / ((1 / 3) ** 2 / 2 + (5 / 3) ** 2 / 3)
    assert found.degrees == pytest.approx(degrees)
    assert found.p_value == pytest.approx(2 * stats.t.sf(5 / math.sqrt(2), degrees))
    assert 0.01 < found.p_value < 0.05 and found.stars == "*"
    assert welch([3, 1, 2], [8, 4, 10, 6]).p_value == pytest.approx(found.p_value)
    assert welch([1, 2, 3], [101, 102, 103]).stars == "**"
    assert welch([1, 2, 3], [2, 3, 4]).stars == ""
    assert welch([1], [2, 3]) is None and welch([1, 1], [2, 2]) is None


def test_fine_tuning_is_a_third_unless_told():
    config = pretrain_config("camvid", "quick")
    fine = fine_stage(config).train
    assert (fine.steps, fine.lr) == (333, pytest.approx(0.01 / 3))
    assert replace(fine, steps=1000, lr=0.01) == config.final.train
    told = fine_stage(replace(config, finetune_steps=7, finetune_lr=0.5)).train
    assert (told.steps, told.lr, told.warmup) == (7, 0.5, 3)
    assert config.seeds >= 4 and config.fractions == (0.05, 0.1, 0.25, 1.0)


@pytest.fixture
def way(monkeypatch):
    """Follows one net with stubs for rendering, training and scoring; lists what was trained."""
    stage = camvid_config("smoke").final
    images = np.zeros((6, 48, 64, 3), np.uint8)
    real = Truth(
        np.arange(4, dtype=np.uint8)[:, None, None, None] + np.zeros((4, 48, 64, 3), np.uint8),
        np.zeros((4, 48, 64), np.uint8),
    )
    done: list[tuple] = []

    def train(seed, images, labels, settings, params=None):
        done.append((settings.steps, images[:, 0, 0, 0].tolist(), params))
        if way.diverges == settings.steps:
            raise TrainingError("the loss is nan")
        return f"net {len(done)}"

    def score(params, images, labels, settings):
        return np.array([[len(done), 100], [100, 100]])

    def render(*task):
        return Dataset(images, np.zeros(images.shape[:3], np.uint8))

    for name, stub in (("train", train), ("score", score), ("render", render)):
        monkeypatch.setattr(pretrain_nets, name, stub)

    def way(row):
        units = None
        if row in ("random", "learnt"):
            units = draw_units(random_proposal(), 0, stage.streets)
        fine = replace(stage.train, steps=3)
        start = Start(stage, units, on_subset=row == "longer")
        chosen = [np.array([2]), np.array([0, 2])]
        return transfer(start, fine, "embree", AssetPool(), 5, real, chosen, real), done

    way.diverges = -1
    return way


def test_a_net_is_pre_trained_once_and_fine_tuned_on_every_subset(way):
    outcomes, done = way("learnt")
    rendered = [0] * 6
    assert done == [(20, rendered, None), (3, [2], "net 1"), (3, [0, 2], "net 1")]
    assert [o.failed for o in outcomes] == [None, None]
    assert outcomes[0].reward < outcomes[1].reward  # by the stub
    assert outcomes[1].render_seconds == 0 <= outcomes[0].render_seconds


def test_nets_from_scratch_are_only_fine_tuned(way):
    assert way("scratch")[1] == [(3, [2], None), (3, [0, 2], None)]


def test_longer_nets_train_on_the_subset_first(way):
    assert way("longer")[1] == [
        (20, [2], None), (3, [2], "net 1"), (20, [0, 2], None), (3, [0, 2], "net 3"),
    ]  # fmt: skip


def test_training_that_diverges_is_an_outcome(way):
    way.diverges = 20
    outcomes, done = way("random")
    assert [o.failed for o in outcomes] == ["the loss is nan"] * 2 and len(done) == 1
    way.diverges = 3
    assert [o.failed for o in way("scratch")[0]] == ["the loss is nan"] * 2


def test_a_measurement_leaves_its_figures(pretrain, tmp_path, capsys):
    out = tmp_path / "run"
    assert pretrain(out, "--rows", "scratch", "random", "learnt", "longer", "--seeds", "4") == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[1] == "Plan, in CPU seconds:" and " left" in printed
    report = report_of(out)
    assert [(row["row"], row["fraction"], row["images"]) for row in report["rows"]] == [
        (row, *share)
        for row in ("scratch", "random", "learnt", "longer")
        for share in ((0.25, 1), (1.0, 4))
    ]
    scratch, _, random = report["rows"][:3]
    assert scratch["mean"] == pytest.approx(11.15) and random["mean"] == pytest.approx(16.15)
    assert [net["miou"] for net in scratch["nets"]] == pytest.approx([11.0, 11.1, 11.2, 11.3])
    tests = {(t["row"], t["against"], t["fraction"]): t for t in report["tests"]}
    assert len(tests) == 5 * 2
    assert tests["random", "scratch", 0.25]["difference"] == pytest.approx(5)
    assert tests["random", "scratch", 0.25]["stars"] == "**"
    assert tests["learnt", "random", 1.0]["stars"] == ""
    text = (out / "pretrain.md").read_text()
    assert "get the steps of the fine-tuning only" in text and r"\*\*" in text
    assert min(Image.open(out / "pretrain.png").size) > 200
    assert len(lines(out / "finals.jsonl")) == 4 * 2 * 4


def test_killed_it_goes_on_and_ends_the_same(pretrain, tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert pretrain(whole) == 0
    left = [True, False, False, False]

    def dying(*task):
        if left.pop():
            raise Killed
        return tuned_by_formula(*task)

    with pytest.raises(Killed):
        pretrain(broken, transfer=dying)
    log = broken / "finals.jsonl"
    assert len(lines(log)) == 3 * 2
    # As a kill within the writing of the last net's second score leaves it.
    log.write_bytes(log.read_bytes()[:-40])
    asked = []

    def counting(*task):
        asked.append(len(task[-2]))
        return tuned_by_formula(*task)

    assert pretrain(broken, transfer=counting) == 0
    assert asked == [1, 2, 2, 2]
    assert [(broken / f).read_bytes() for f in FILES] == [(whole / f).read_bytes() for f in FILES]
    assert pretrain(broken, transfer=never) == 0


def test_a_measurement_is_derived_anew(pretrain, tmp_path, capsys):
    out, again = tmp_path / "run", tmp_path / "again"
    assert pretrain(out) == 0
    assert main("", ["--rederive", str(out / "pretrain.json"), "--out", str(again)]) == 0
    assert [(again / f).read_bytes() for f in FILES] == [(out / f).read_bytes() for f in FILES]


def test_nets_that_failed_are_told_and_left_out(pretrain, tmp_path):
    def sometimes(*task):
        outcomes = tuned_by_formula(*task)
        failed = Outcome(math.nan, [], 0.0, 1.0, "the loss is nan")
        return [failed if task[4] == 0 else outcome for outcome in outcomes]

    out = tmp_path / "run"
    assert pretrain(out, transfer=sometimes) == 0
    report = report_of(out)
    assert all(row["nets"][0] is None and row["ci95"] is None for row in report["rows"])
    assert all("p_value" not in test for test in report["tests"])
    assert "6 nets failed" in (out / "pretrain.md").read_text()
    assert FORM.derive(report) == report


def test_scratch_alone_needs_no_attributes(pretrain, tmp_path, capsys):
    out = tmp_path / "run"
    assert pretrain(out, "--rows", "scratch", "--learnt", "None") == 0
    assert report_of(out)["tests"] == [] and lines(out / "evaluations.jsonl") == []
    assert "Learnt" not in (out / "pretrain.md").read_text()


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (
            ("--fractions", "0.1"),
            "--fractions 0.1 selects none of the 4 reward images; 0.25 or more",
        ),
        (("--fractions", "0"), "--fractions must lie in (0, 1], not 0"),
        (("--fractions", "1.5"), "--fractions must lie in (0, 1], not 1.5"),
        (("--fractions", "nan"), "--fractions must lie in (0, 1], not nan"),
        (("--fractions", "1", "1"), "names one of them twice"),
        (
            ("--rows", "scratch", "imagenet"),
            "--rows must be some of scratch, random, learnt, longer",
        ),
        (("--rows", "scratch", "scratch"), "names one of them twice"),
        (("--finetune-steps", "0"), "--finetune-steps must be 1 or more"),
        (("--finetune-lr", "-1"), "--finetune-lr must be positive"),
        (("--learnt", "/nowhere.json"), "--learnt /nowhere.json: No such file"),
        (("--data", "/nowhere"), "/nowhere"),
        (("--preset", "small"), "--preset 'small' is unknown"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, pretrain, tmp_path, error_line):
    assert pretrain(tmp_path / "run", *flags, transfer=never) == 2
    assert complaint in error_line()
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert main("", ["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real data" in capsys.readouterr().out
    report = report_of(out)
    assert report["real"] is False and len(report["rows"]) == 3 * 2
    assert all(0 < row["mean"] < 100 for row in report["rows"])
