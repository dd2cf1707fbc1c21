"""Rows and candidates: what they draw, with which seeds, and that each is scored once."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sdr_jax
from experiments import finals as module
from experiments.config import CANDIDATES
from experiments.finals import (
    BROAD,
    CANDIDATE_SEED,
    ROWS,
    Finals,
    candidate_proposal,
    default_proposal,
    draw_units,
    random_proposal,
)
from experiments.folder import RunFolder
from experiments.progress import Progress
from experiments.reward import Evaluation
from experiments.search import SearchResult
from experiments.targets import Split, camvid_target
from scene.attributes import ATTRIBUTES, NAMES, default_unit
from scene.workers import WorkerPool
from sdr_jax.space import slide

EDGE = np.float32(0.05)


@pytest.fixture
def result() -> SearchResult:
    """A search that chose the lowest bin of ten everywhere, and is unsure."""
    n = len(NAMES)
    return SearchResult(
        argmax=sdr_jax.Proposal(np.full(n, EDGE), np.full(n, 0.1, np.float32)),
        spread=sdr_jax.Proposal(np.full(n, 0.1, np.float32), np.full(n, 0.2, np.float32)),
        rewards=np.zeros((1, 1)),
        baselines=np.zeros(1),
        groups=np.zeros(1),
        probabilities=np.zeros((1, n, 10)),
    )


def test_random_is_the_whole_range():
    proposal = random_proposal()
    np.testing.assert_array_equal(proposal.centre, np.full(23, 0.5, np.float32))
    np.testing.assert_array_equal(proposal.width, np.ones(23, np.float32))


def test_default_is_the_street_set_by_eye():
    units = draw_units(default_proposal(0.15), 0, 400)
    centre = np.clip(default_unit(), 0.075, 1 - 0.075)
    assert np.abs(units - centre).max() <= 0.075 + 1e-6
    exact = draw_units(default_proposal(0.0), 0, 2)
    for attribute, value in zip(ATTRIBUTES, exact[0], strict=True):
        assert attribute.physical(float(value)) == pytest.approx(attribute.default, abs=1e-3)


def test_candidates_by_hand(result):
    assert candidate_proposal("argmax", result) is result.argmax
    assert candidate_proposal("spread", result) is result.spread
    # Half the range around 0.1 sticks out of it, and slides to [0, 0.5].
    broad = candidate_proposal("broad", result)
    np.testing.assert_allclose(broad.centre, np.full(23, BROAD / 2), rtol=1e-6)
    np.testing.assert_allclose(broad.width, np.full(23, BROAD), rtol=1e-6)


@pytest.mark.parametrize("name", CANDIDATES)
def test_candidates_lie_inside_the_ranges(name, result):
    centre, width = map(np.asarray, candidate_proposal(name, result))
    assert (centre - width / 2 >= -1e-6).all() and (centre + width / 2 <= 1 + 1e-6).all()


@given(st.integers(0, 2**31 - 1), st.floats(0, 1), st.floats(0, 1))
def test_rows_share_their_random_numbers(seed, centre, width):
    # u = (x - low) / width is what was drawn: the same for every proposal with the same seed.
    u = draw_units(random_proposal(), seed, 3)
    n = len(NAMES)
    proposal = slide(np.full(n, centre, np.float32), np.full(n, width, np.float32))
    low = np.asarray(proposal.centre - proposal.width / 2)
    x = draw_units(sdr_jax.Proposal(*map(np.asarray, proposal)), seed, 3)
    np.testing.assert_allclose(x, low + u * np.asarray(proposal.width), atol=1e-5)
    assert ((x >= 0) & (x <= 1)).all()


@given(st.integers(0, 2**31 - 1), st.integers(1, 1000), st.integers(1, 1000))
def test_candidates_use_no_seed_of_the_rows(seed, candidate_seeds, seeds):
    rows = range(seed, seed + seeds)
    candidates = range(CANDIDATE_SEED + seed, CANDIDATE_SEED + seed + candidate_seeds)
    assert not set(rows) & set(candidates)
    assert candidates[-1] < 2**32


@pytest.fixture
def job(tiny_camvid, monkeypatch):
    """Makes a ``Finals`` that scores by a formula, and counts."""
    config = replace(tiny_camvid, seeds=3, candidate_seeds=2, candidates=("argmax", "spread"))
    target = camvid_target(config, WorkerPool(0))
    split = target.at(48, 64)
    calls: list[tuple] = []

    def evaluate(stage, table, renderer, pool, units, seed, truth):
        calls.append((seed, len(truth.images), float(units.mean())))
        good = int(1000 * units.std()) + 100
        return Evaluation(np.array([[good, 1000]] * 2), 0.1, 0.2)

    def evaluate_real(stage, table, images, labels, seed, truth):
        calls.append((seed, len(truth.images), images.mean()))
        return Evaluation(np.array([[900, 100]] * 2), 0.0, 0.2)

    monkeypatch.setattr(module, "evaluate", evaluate)
    monkeypatch.setattr(module, "evaluate_real", evaluate_real)

    def make():
        folder = RunFolder(config, "camvid")
        progress = Progress(100, stream=io.StringIO())
        return Finals(config, target, split, folder, WorkerPool(0), progress, 1.0), folder

    return make, calls, split


def test_the_better_candidate_is_chosen_on_the_reward_images(job, result):
    make, calls, split = job
    finals, folder = make()
    chosen, scores = finals.candidates(result)
    folder.close()
    assert chosen == "spread" and set(scores) == {"argmax", "spread"}
    assert np.mean(scores["spread"]) > np.mean(scores["argmax"])
    assert {seed for seed, *_ in calls} == {CANDIDATE_SEED, CANDIDATE_SEED + 1}
    assert {images for _, images, _ in calls} == {len(split.reward.images)}


def test_rows_are_paired_and_scored_once_on_the_test_images(job, result):
    make, calls, split = job
    finals, folder = make()
    rows = finals.rows(result.argmax)
    folder.close()
    assert tuple(rows) == ROWS
    for records in rows.values():
        assert [record["seed"] for record in records] == [0, 1, 2]
    assert len(calls) == 12
    assert {images for _, images, _ in calls} == {len(split.test.images)}
    finals, folder = make()
    again = finals.rows(result.argmax)
    folder.close()
    assert again == rows and len(calls) == 12


def test_a_real_row_trains_on_the_reward_images(job, result):
    make, calls, split = job
    finals, folder = make()
    finals.rows(result.argmax)
    folder.close()
    assert split.reward.images.mean() in {mean for *_, mean in calls}


def test_a_split_has_both_sides():
    assert Split._fields == ("reward", "test")
