"""The answer: candidates, the test that selects one, the ladder, and the same choice after a kill."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from experiments.config import SEED_END, MainConfig, check, presets
from experiments.config.presets import defaults
from experiments.evaluation.job import Result
from experiments.run import selection
from experiments.run.context import opened
from experiments.run.learn import (
    BROAD,
    REFERENCE,
    candidate,
    distinct,
    learn,
    selection_seeds,
    work_of,
)
from experiments.run.search import Found
from experiments.searches import ManyConfig, configured
from scene.proposal import default_proposal, random_proposal, slide
from shell.errors import UserError

from .conftest import Counted, Killed, lines

NOISE = 1.0
"""Points of mIoU by which nets of one training set vary."""


@pytest.fixture
def found() -> Found:
    """A search that chose the lowest bin of ten everywhere, and is unsure."""
    answers = (slide(np.full(23, at), width) for at, width in ((0.05, 0.1), (0.1, 0.2), (0.7, 0.1)))
    nothing = np.zeros((1, 1))
    return Found(*answers, [], nothing, nothing, nothing, nothing)


def test_candidates_by_hand(found):
    config = defaults(MainConfig, "twin", "smoke")
    assert candidate("argmax", found, config) is found.solution
    assert candidate("seen", found, config) is found.best
    np.testing.assert_array_equal(candidate("random", found, config), random_proposal())
    hand_set = default_proposal(config.default_width)
    np.testing.assert_array_equal(candidate("default", found, config), hand_set)
    # Half the range around 0.1 sticks out of it, and slides to [0, 0.5].
    broad = candidate("broad", found, config)
    np.testing.assert_allclose(broad.centre, np.full(23, BROAD / 2), rtol=1e-6)
    np.testing.assert_allclose(broad.width, np.full(23, BROAD), rtol=1e-6)
    # Candidates alike are one; the hand-set street, or the first.
    streets = {"argmax": found.solution, "seen": found.solution, "random": broad}
    assert distinct(streets) == ["argmax", "random"]
    assert distinct({"argmax": hand_set, "seen": broad, "default": hand_set}) == ["seen", "default"]


@given(st.lists(st.integers(1, 30), min_size=1, max_size=9), st.none() | st.integers(1, 12))
def test_parts_are_cut_between_sequences_where_there_are_enough(lengths, count):
    names = [str(k) for k, length in enumerate(lengths) for _ in range(length)]
    if count is not None and count > len(names):
        with pytest.raises(UserError, match=f"--parts {count} .* {len(names)} give the reward"):
            selection.parts_of(names, count)
        return
    parts = selection.parts_of(names, count)
    assert len(parts) == (count or min(max(2, len(lengths)), 4, len(names)))
    assert [k for part in parts for k in range(*part)] == list(range(len(names)))
    starts = {0, *np.cumsum(lengths).tolist()}
    if len(parts) <= len(lengths):
        assert {first for first, _ in parts} <= starts
    else:
        assert starts <= {k for part in parts for k in part}


def test_parts_by_hand():
    camvid = ["0001TP"] * 62 + ["0016E5"] * 204
    assert selection.parts_of(camvid) == ((0, 62), (62, 266))
    assert selection.parts_of(camvid, 3) == ((0, 62), (62, 164), (164, 266))
    assert selection.parts_of(["a"] * 5) == ((0, 2), (2, 5)) and selection.parts_of(["a"]) == (
        (0, 1),
    )


def test_selection_by_hand():
    # Gains .2, .3, .4; s^2 of the layout is half of their variance .01, so t = .3 / (.1 / sqrt 3).
    safe = [0.1, 0.3, 0.2]
    found = selection.select({"a": [0.3, 0.6, 0.6], "safe": safe}, "safe")
    assert found.t["a"] == pytest.approx(3 * math.sqrt(3)) and found.means["a"] == pytest.approx(
        0.5
    )
    assert found.critical == pytest.approx(stats.t.ppf(0.95, 2), abs=0.01)
    assert (
        found.chosen == "a"
        and found.verdict == "replaced: a is significantly better at family-wise 5 %"
    )
    # Twice the noise: t = 2.6 < 2.92.
    found = selection.select({"a": [0.2, 0.6, 0.7], "safe": safe}, "safe")
    assert found.t["a"] == pytest.approx(1.5 * math.sqrt(3)) and found.chosen == "safe"
    assert found.verdict == "kept: no challenger is significantly better at family-wise 5 %"
    # A failed net drops its seed for all.
    scores = {"a": [0.3, 0.6, 0.6, np.nan], "safe": [*safe, 9.0]}
    assert selection.select(scores, "safe").means == pytest.approx({"a": 0.5, "safe": 0.2})
    # Of those that pass the best mean, though a worse one comes first.
    scores = {"b": [0.2, 0.41, 0.3], "a": [0.3, 0.51, 0.4], "safe": safe}
    assert selection.select(scores, "safe").chosen == "a"


def test_what_cannot_be_tested_is_said():
    found = selection.select({"default": [0.40], "argmax": [0.48]}, "default")
    assert (found.chosen, found.verdict, found.t) == ("default", "not tested: one seed", {})
    found = selection.select({"default": [0.4, np.nan], "argmax": [0.5, 0.5]}, "default")
    assert (found.chosen, found.verdict) == ("default", "not tested: one seed without a failed net")
    found = selection.select({"default": [np.nan], "argmax": [0.5]}, "default")
    assert (found.chosen, found.verdict) == ("default", "not tested: no seed without a failed net")
    found = selection.select({"default": [0.4, 0.5]}, "default")
    assert found.chosen == "default" and "no challenger differs" in found.verdict
    found = selection.select({"argmax": [0.4, 0.5], "random": [0.6, 0.5]}, "default")
    assert found.chosen == "random" and found.critical is None
    assert found.verdict.startswith("not tested: no hand-set street among the candidates")


@pytest.mark.parametrize(
    ("k", "n", "value"), [(1, 6, 2.015), (1, 11, 1.812), (2, 6, 2.15), (3, 6, 2.24), (4, 6, 2.30)]
)
def test_critical_values_are_those_of_dunnetts_table(k, n, value):
    assert selection.critical_value(k, n) == pytest.approx(value, abs=0.01)


@given(arrays(float, (3, 4), elements=st.floats(0, 1).map(lambda v: round(v, 3))), st.floats(-1, 1))
def test_what_all_candidates_of_a_seed_share_decides_nothing(scores, shift):
    shared = np.array([0, shift, -shift, 2 * shift])
    found, moved = (
        selection.select(dict(zip("abc", y, strict=True)), "c") for y in (scores, scores + shared)
    )
    for name in found.t:
        known = np.isfinite(found.t[name]) and abs(found.t[name]) < 1e3
        assert not known or moved.t[name] == pytest.approx(found.t[name], rel=1e-3, abs=1e-6)


def test_errors_of_both_kinds():
    config, rng = defaults(MainConfig, "camvid", "quick"), np.random.default_rng(0)
    shape, candidates = config.candidate_seeds, config.candidates

    def taken(gain: float, runs: int = 2500) -> dict[str, float]:
        found = []
        for _ in range(runs):
            seeds = rng.normal(0, 1, shape)  # what nets of a seed share
            scores = {
                name: seeds + rng.normal(gain * (name == "argmax"), NOISE, shape)
                for name in candidates
            }
            found.append(selection.select(scores, REFERENCE).chosen)
        return {name: found.count(name) / runs for name in candidates}

    assert 0.03 < 1 - taken(0)[REFERENCE] <= 0.07
    assert taken(2)["argmax"] >= 0.8


@given(st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1))
def test_searches_share_no_seeds_of_their_selection(one, other):
    def seeds(seed, method="intervals", space="scenex", **changes):
        config = defaults(MainConfig, "camvid", "smoke", seed=seed, candidate_seeds=10, **changes)
        config = replace(config, space=space, search=replace(config.search, method=method))
        return selection_seeds(config)

    own = seeds(one)
    assert len(set(own)) == len(own) == 10 and all(0 <= s < SEED_END for s in own)
    others = [seeds(one, "sdr"), seeds(one, space="extended"), seeds(one + 1), seeds(other)]
    assert all(set(own).isdisjoint(theirs) for theirs in others[: 4 if one != other else 3])
    # They depend on nothing else of the job, nor on which job it is.
    assert own == seeds(one, seeds=9, workers=7, out=Path("elsewhere"))
    own_methods = {"methods": ("intervals",), "candidate_seeds": 10}
    study = presets.defaults(ManyConfig, "camvid", "smoke", seed=one, **own_methods)
    same = configured(study)[f"intervals-{one}"]
    assert selection_seeds(same) == own


@pytest.fixture
def job(tiny_camvid, scored_by):
    """Learns with rewards that are higher the wider a proposal is; the search is one of six updates."""

    def wide(recipe, source, seed, truth, parts=()) -> Result:
        reward = source.width.mean() / 2 + seed % 97 / 1000
        return Result(reward, [], 0.1, 0.2, parts=(reward,) * len(parts))

    def work(**changes):
        config = replace(tiny_camvid, **changes)
        check(config)
        with opened(config) as run:
            run.begin(work_of(config))
            return learn(run), run.progress, config

    work.scores = Counted(wide)
    scored_by(work.scores)
    return work


def test_the_better_candidate_is_chosen_on_the_reward_images(job):
    two = {"candidate_seeds": 2, "candidates": ("argmax", "random")}
    learnt, _, config = job(**two)
    assert learnt.selection.chosen == "random" and set(learnt.selection.scores) == {
        "argmax",
        "random",
    }
    np.testing.assert_array_equal(learnt.streets, random_proposal())
    assert len(learnt.parts) == 2 and "images of" in learnt.parts[0]
    assert all(len(parts) == 2 for own in learnt.by_part.values() for parts in own)
    finals = lines(config.out / "finals.jsonl")
    assert [len(line["parts"]) for line in finals] == [2] * 4
    seeds = {(line["seed"], line["side"]) for line in finals}
    assert seeds == {(seed, "reward") for seed in selection_seeds(config)}
    assert (config.out / "attributes.json").exists()
    made = len(job.scores.calls)
    assert job(**two)[0].selection == learnt.selection and len(job.scores.calls) == made


def test_a_seed_with_a_failed_net_is_left_out_for_all(job):
    job.scores.failing = (13,)  # the first after twelve rewards
    learnt, _, config = job(candidate_seeds=3, candidates=("argmax", "random"))
    assert learnt.selection.chosen == "random"
    assert sum(line["failed"] is not None for line in lines(config.out / "finals.jsonl")) == 1
    scores = np.array(list(learnt.selection.scores.values()))
    known = np.isfinite(scores).all(axis=0)
    assert known.sum() == 2
    assert list(learnt.selection.means.values()) == pytest.approx(scores[:, known].mean(axis=1))


def test_parts_that_another_run_has_not_scored_are_left_open(job, tmp_path):
    own = {"candidate_seeds": 2, "candidates": ("argmax", "random"), "store": tmp_path / "store"}
    learnt, *_ = job(**own)
    made = len(job.scores.calls)
    again, *_ = job(**own, parts=3, out=tmp_path / "other")
    assert len(job.scores.calls) == made and again.selection == learnt.selection
    assert len(again.parts) == 3 and again.by_part == {name: [(), ()] for name in learnt.by_part}


def test_candidates_share_their_seeds_and_go_on_after_a_kill(job):
    own = {"candidate_seeds": 3, "candidates": ("argmax", "seen", "broad", "random")}
    learnt, progress, config = job(**own)
    final = (4, config.final.height, config.final.width, 3)
    assert {truth.images.shape for _, _, _, truth, *_ in job.scores.calls[12:]} == {final}
    finals = lines(config.out / "finals.jsonl")
    assert len(finals) == len(job.scores.calls) - 12
    rows = set(learnt.selection.scores)
    assert sorted(line["seed"] for line in finals) == sorted(selection_seeds(config) * len(rows))
    assert {(line["nets"], line["row"]) for line in finals} == {("candidate", row) for row in rows}
    assert progress.left is not None and progress.left < 1e-6
    made = len(job.scores.calls)
    (config.out / "finals.jsonl").unlink()
    job.scores.calls.clear()
    job.scores.limit = 3
    with pytest.raises(Killed):
        job(**own)
    job.scores.limit = -1
    assert job(**own)[0].selection == learnt.selection and len(job.scores.calls) == made - 12
