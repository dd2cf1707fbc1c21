"""Pre-training: nested subsets, one net's way, what is remembered, and what is refused."""

import math
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.config.jobs import defaults_of
from experiments.evaluation import in_worker, transfer
from experiments.evaluation.job import Recipe, Result, Start
from experiments.studies import pretrain
from experiments.studies.pretrain import FORM, fine_fidelity
from scene.assets.catalogue import AssetPool
from scene.proposal import random_proposal
from seg.data import LabelledImages

from .conftest import Counted, diverge, formula, lines, never, transferred

defaults = partial(defaults_of, "pretrain")


@pytest.fixture
def measured(reported, learnt_file):
    """The report of given attributes, in figures and in words."""
    return partial(reported, "pretrain", "--learnt", str(learnt_file))


@given(st.integers(0, 2**32 - 1), st.integers(1, 400))
def test_smaller_subsets_lie_within_larger_ones(seed, images):
    fractions = [1.0, 0.05, 0.25, 0.1]
    subsets = pretrain.subsets(images, fractions, seed)
    assert [len(k) for k in subsets] == [pretrain.chosen_images(images, f) for f in fractions]
    assert subsets[0].tolist() == list(range(images))
    assert set(subsets[1]) <= set(subsets[3]) <= set(subsets[2]) <= set(subsets[0])
    assert all((np.diff(k) > 0).all() for k in subsets)
    # The choice does not depend on which other fractions are asked for.
    np.testing.assert_array_equal(pretrain.subsets(images, [0.25], seed)[0], subsets[2])


def test_subsets_and_the_fine_tuning_by_hand():
    shares = ((367, 0.05), (8, 0.0625), (8, 0.06))  # halves go up
    assert [pretrain.chosen_images(*share) for share in shares] == [18, 1, 0]
    assert not np.array_equal(
        pretrain.subsets(100, [0.1], 0)[0], pretrain.subsets(100, [0.1], 1)[0]
    )
    config = defaults("camvid", "quick")
    assert fine_fidelity(config).train == replace(config.final.train, steps=333, lr=0.01 / 3)
    train = fine_fidelity(replace(config, finetune_steps=7, finetune_lr=0.5)).train
    assert (train.steps, train.lr, train.warmup) == (7, 0.5, 3)
    assert config.seeds >= 4 and config.fractions == (0.05, 0.1, 0.25, 1.0)


@pytest.fixture
def way(monkeypatch):
    """Follows one net with stubs for rendering, training and scoring; lists what was trained."""
    fidelity = defaults("camvid", "smoke").final
    blank = LabelledImages(np.zeros((6, 48, 64, 3), np.uint8), np.zeros((6, 48, 64), np.uint8))
    numbered = blank.images[:4] + np.arange(4, dtype=np.uint8)[:, None, None, None]
    real, done = LabelledImages(numbered, blank.labels[:4]), []

    def train(seed, images, labels, settings, classes, params=None, **_):
        done.append((settings.steps, images[:, 0, 0, 0].tolist(), params))
        if way.diverges == settings.steps:
            diverge()
        return f"net {len(done)}"

    monkeypatch.setattr(in_worker, "train", train)
    monkeypatch.setattr(transfer, "timed_set", lambda *_: (blank, 0.0))

    def predict_heads(params, images, *_, **__):
        predictions = np.ones((len(images), 1, 48, 64), np.uint8)
        predictions[..., 0, : len(done)] = 0  # the more, the later the net
        return predictions

    monkeypatch.setattr(in_worker, "predict_heads", predict_heads)

    def way(row):
        recipe = Recipe(fidelity, "camvid", "embree", AssetPool())
        fine = recipe._replace(
            fidelity=replace(fidelity, train=replace(fidelity.train, steps=3, warmup=0))
        )
        proposal = random_proposal() if row in ("random", "learnt") else None
        start = Start(recipe, proposal, on_subset=row == "longer")
        return transfer.transfer(
            start, fine, 5, real, [np.array([2]), np.array([0, 2])], real
        ), done

    way.diverges = -1
    return way


def test_a_net_is_pre_trained_once_and_fine_tuned_on_every_subset(way):
    (one, two), done = way("learnt")
    assert done == [(20, [0] * 6, None), (3, [2], "net 1"), (3, [0, 2], "net 1")]
    assert one.failed is two.failed is None and one.reward < two.reward  # by the stub
    assert two.render_seconds == 0 <= one.render_seconds


@pytest.mark.parametrize(("row", "trained"), [
    ("scratch", [(3, [2], None), (3, [0, 2], None)]),
    ("longer", [(20, [2], None), (3, [2], "net 1"), (20, [0, 2], None), (3, [0, 2], "net 3")]),
])  # fmt: skip
def test_other_nets_see_real_images_only_and_one_that_diverges_is_an_outcome(way, row, trained):
    assert way(row)[1] == trained
    way.diverges = trained[0][0]
    outcomes, _ = way(row)
    assert [o.failed for o in outcomes] == ["the loss is nan after 50 of 200 steps"] * 2


def test_a_measurement_leaves_its_figures(measured, out):
    report, text = measured("--rows", "scratch", "random", "learnt", "longer", "--seeds", "4")
    places = [(row["row"], (row["fraction"], row["images"])) for row in report["rows"]]
    assert places == [*product(("scratch", "random", "learnt", "longer"), ((0.25, 1), (1.0, 4)))]
    scratch, _, random = report["rows"][:3]
    assert (scratch["mean"], random["mean"]) == pytest.approx((11.15, 16.15))
    assert [net["miou"] for net in scratch["nets"]] == pytest.approx([11.0, 11.1, 11.2, 11.3])
    tests = {(t["row"], t["against"], t["fraction"]): t for t in report["tests"]}
    gain, none = tests["random", "scratch", 0.25], tests["learnt", "random", 1.0]
    assert (gain["difference"], gain["stars"]) == (pytest.approx(5), "**")
    assert none["stars"] == "" and len(tests) == 5 * 2
    assert "are only fine-tuned." in text and r"\*\*" in text
    assert len(lines(out / "finals.jsonl")) == 4 * 2 * 4


def test_what_a_store_or_half_a_run_knows_is_not_trained_again(command, learnt_file, tmp_path):
    out, again, other = (tmp_path / name for name in ("run", "again", "other"))
    shared, two = ("--store", str(tmp_path / "shared.jsonl")), ("--rows", "scratch", "random")

    def asked(out, *flags):
        net = Counted(transferred)
        learnt = () if "--rows" in flags else ("--learnt", str(learnt_file))
        assert command("pretrain", out, *learnt, *flags, transfer=net) == 0
        return [len(task[-2]) for task in net.calls]

    assert asked(out, *shared, *two) == [2] * 4
    # Another share, and other fine-tuning, are other nets; rows that are there already are known.
    shares = ("--fractions", "0.5", "1.0")
    assert asked(again, *shared, *shares) == [2, 2, 1, 1, 1, 1]  # the longest first
    assert asked(other, *shared, "--finetune-steps", "5", "--rows", "random") == [2, 2]
    # As a kill within the writing of the last net's second score leaves it.
    log = out / "finals.jsonl"
    log.write_bytes(log.read_bytes()[:-40])
    assert asked(out, *two, "--store", "None") == [1]
    keys = [line["key"] for name in (out, again) for line in lines(name / "finals.jsonl")]
    assert len(keys) == 8 + 12 and len(set(keys)) == 16


def test_nets_that_failed_are_told_and_left_out(measured):
    def sometimes(*task):
        outcomes = transferred(*task)
        if task[2] == 0 and task[0].streets is None:
            outcomes[0] = Result(math.nan, [], 0.0, 1.0, "the loss is nan")
        return outcomes

    report, text = measured(transfer=sometimes)
    assert report["rows"][0]["nets"][0] is None and report["rows"][0]["ci95"] is None
    pair = ("learnt", "scratch", 0.25)
    (test,) = (t for t in report["tests"] if (t["row"], t["against"], t["fraction"]) == pair)
    assert "p_value" not in test and "because their training failed: 1." in text
    assert FORM.derive(report) == report
    assert measured(transfer=never) == (report, text)  # a failure is remembered, too


def test_tests_of_one_report_are_corrected_for_their_number(measured):
    """Holm (1979): stars are those of corrected values, and one test alone stays as it is."""
    report, _ = measured("--seeds", "3", "--fractions", "0.25")
    rows = {"scratch": (10, 12, 14), "random": (15, 17, 19), "learnt": (15.2, 17.2, 19.2)}
    for row in report["rows"]:
        row["nets"] = [{"miou": value, "class_iou": [None] * 11} for value in rows[row["row"]]]
    tests = FORM.derive(report)["tests"]
    p_values = [test["p_value"] for test in tests]
    # 5.2 and 5 points at a standard error of 1.63: p = 0.034 and 0.037, by three and two tests 0.10.
    assert [(test["row"], test["against"]) for test in tests] == [
        ("learnt", "scratch"), ("random", "scratch"), ("learnt", "random"),
    ]  # fmt: skip
    assert 0.01 < p_values[0] < p_values[1] < 0.05 < p_values[2]
    corrected = [3 * p_values[0], 3 * p_values[0], p_values[2]]
    assert [test["p_corrected"] for test in tests] == pytest.approx(corrected)
    assert [test["stars"] for test in tests] == ["", "", ""]
    for row in report["rows"]:
        row["nets"] = row["nets"] if row["row"] != "learnt" else [None] * 3
    (alone,) = (test for test in FORM.derive(report)["tests"] if "p_value" in test)
    assert alone["p_corrected"] == alone["p_value"] == p_values[1] and alone["stars"] == "*"


def test_a_search_may_use_some_of_the_images_that_nets_are_tuned_on(
    reported, counted, command, tmp_path
):
    """As in the paper: 500 images of Cityscapes give the reward, and nets are tuned on all 2,975."""
    validated_on, tuned = [], []

    def scores(recipe, source, seed, truth, *more, **also):
        validated_on.append(truth.images.tobytes())
        return formula(recipe, source, seed, truth, *more, **also)

    def tunes(start, fine, seed, real, chosen, truth):
        tuned.append(len(real.images))
        return transferred(start, fine, seed, real, chosen, truth)

    words = ("--rows", "learnt", "--fractions", "1.0", "--method", "random_search")
    report, text = reported(
        "pretrain", *words, "--search-images", "2", evaluate=scores, transfer=tunes
    )
    assert len(set(validated_on)) == 1 and tuned == [4, 4]
    assert [row["images"] for row in report["rows"]] == [
        4
    ] and "used at most 2 of these images" in text
    other, others = tmp_path / "other", []  # they are those of --reward-images in other jobs

    def same(recipe, source, seed, truth, *more, **also):
        others.append(truth.images.tobytes())
        return formula(recipe, source, seed, truth, *more, **also)

    flags_of_main = ("--reward-images", "2", *words)
    assert command("pretrain", other, *flags_of_main, evaluate=same, transfer=transferred) == 0
    assert set(others) == set(validated_on)


def test_scratch_alone_needs_no_attributes(reported, out):
    report, text = reported("pretrain", "--rows", "scratch")
    assert report["tests"] == lines(out / "evaluations.jsonl") == [] and "Learnt" not in text


def test_what_each_share_has_learnt_is_planned_as_a_start_of_its_own():
    def starts(learn_on):
        config = replace(
            defaults("twin", "smoke"),
            rows=("scratch", "random", "learnt"), fractions=(0.5, 1.0), learn_on=learn_on,
        )  # fmt: skip
        return [
            w.number / config.seeds for w in pretrain.plan(config, None) if "pre-training" in w.what
        ]

    assert (starts("all"), starts("share")) == ([2], [3])  # random, and learnt once or twice


def test_attributes_may_be_learnt_from_the_share_that_nets_are_tuned_on(
    command, reported, learnt_file, out, tmp_path, error_line
):
    """Searches score on those images alone, and nets of all seeds are tuned on them."""
    validated_on, tuned = [], []

    def scores(recipe, source, seed, truth, *more, **also):
        validated_on.append(len(truth.images))
        return formula(recipe, source, seed, truth, *more, **also)

    def tunes(start, fine, seed, real, chosen, truth):
        tuned.append((start.streets is not None, [k.tolist() for k in chosen]))
        return transferred(start, fine, seed, real, chosen, truth)

    words = "--rows scratch learnt --fractions 0.5 1.0 --learn-on share --method random_search"
    flags = words.split()
    report, text = reported("pretrain", *flags, evaluate=scores, transfer=tunes)
    (half,) = pretrain.subsets(4, [0.5], 0)
    assert set(validated_on) == {2, 4} and validated_on.count(2) >= 8  # rewards
    scratch, learnt = ([chosen for was, chosen in tuned if was is kind] for kind in (False, True))
    assert scratch == [[half.tolist(), [0, 1, 2, 3]]] * 2
    assert learnt == [[half.tolist()]] * 2 + [[[0, 1, 2, 3]]] * 2
    places = [(row["row"], row["images"]) for row in report["rows"][2:]]
    assert places == [("learnt", 2), ("learnt", 4)] and "with its labels alone" in text
    kept = sorted(path.name for path in (out / "attributes").iterdir())
    assert kept == ["learnt-0.5.json", "learnt-1.json"]
    assert command("pretrain", out, *flags, evaluate=never, transfer=never) == 0  # all is known
    exclusive = ("--learn-on", "share", "--learnt", str(learnt_file))
    assert command("pretrain", tmp_path / "other", *exclusive) == 2
    assert "--learnt has no effect with --learn-on share" in error_line(begun=True)
