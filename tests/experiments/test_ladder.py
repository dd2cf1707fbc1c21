"""The ladder: its rungs, who leaves when, and the same answer after a kill."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sdr_jax
from experiments import finals as module
from experiments.config import PRESETS, camvid_config, check, cityscapes_config
from experiments.finals import CANDIDATE_SEED, Finals, random_proposal
from experiments.folder import RunFolder
from experiments.ladder import (
    FINALISTS,
    Rung,
    best_of,
    climb,
    cost_of,
    hopeless,
    kept,
    ladder,
    middle,
    most_cost,
    most_nets,
)
from experiments.progress import Progress
from experiments.reward import Evaluation
from experiments.search import SearchResult
from experiments.targets import camvid_target
from scene.attributes import NAMES
from scene.workers import WorkerPool

from .conftest import lines

STAGE = camvid_config("smoke").reward
RUNGS = tuple(Rung(STAGE, tuple(range(100 * k, 100 * k + n))) for k, n in enumerate((8, 4, 2)))


def test_the_middle_stage_by_hand():
    config = camvid_config("quick")
    found = middle(config.reward, config.final)
    # sqrt(64 128) = 90.5 and sqrt(48 96) = 67.9, in multiples of 8; sqrt(12 50), sqrt(200 1000).
    assert (found.width, found.height) == (88, 64)
    assert (found.streets, found.shots, found.train.steps) == (24, 8, 447)
    assert found.train.net == config.final.train.net


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("presets", [camvid_config, cityscapes_config])
def test_rungs_lead_from_the_reward_stage_to_the_final_one(presets, preset):
    config = presets(preset)
    rungs = ladder(config)
    assert (rungs[0].stage, rungs[-1].stage) == (config.reward, config.final)
    costs = [cost_of(rung.stage) for rung in rungs]
    assert costs == sorted(costs)
    n = config.candidate_seeds
    assert [len(rung.seeds) for rung in rungs] == [4 * n, 2 * n, n]


@given(st.integers(0, 2**31 - 1), st.integers(1, 1000))
def test_no_two_rungs_share_a_seed_nor_do_candidates_and_rows(seed, nets):
    config = replace(camvid_config("smoke"), seed=seed, candidate_seeds=nets)
    seeds = [s for rung in ladder(config) for s in rung.seeds]
    others = {
        *range(seed, seed + 1000),
        *range(CANDIDATE_SEED + seed, CANDIDATE_SEED + seed + nets),
    }
    assert len(set(seeds)) == len(seeds) and not others & set(seeds)
    assert max(seeds) < 2**32


def test_equal_stages_are_one_rung():
    config = camvid_config("smoke")
    assert len(ladder(replace(config, reward=config.final))) == 1


def test_hopeless_by_hand():
    # d = -1, -2, -3: mean -2, s = 1, t(0.95, 2) = 2.92, so the upper end is -2 + 2.92 / sqrt(3) < 0.
    assert hopeless([0, 0, 0], [1, 2, 3])
    assert not hopeless([0, 0, 0], [1, 2, 3], confidence=0.99)  # t = 6.96
    assert not hopeless([0], [100])  # one pair tells nothing
    assert not hopeless([1, 2], [1, 2])


@given(st.lists(st.floats(0, 1), min_size=2, max_size=6), st.floats(-1, 1))
def test_noise_that_pairs_share_does_not_matter(values, shift):
    ours, best = np.array(values), np.array(values[::-1])
    assert not (hopeless(ours, best) and hopeless(best, ours))
    both = ours + shift, best + shift
    if abs(np.mean(ours - best)) > 1e-6:  # rounding decides nothing
        assert hopeless(*both) == hopeless(ours, best)


def test_kept_by_hand():
    assert [kept(n) for n in (1, 2, 3, 4, 5, 8)] == [1, 2, FINALISTS, 2, 3, 4]
    assert most_nets(8, RUNGS) == [64, 16, 4]
    assert most_cost(8, RUNGS) == pytest.approx(84 * cost_of(STAGE))


class Scores:
    """Rewards by a formula: worth plus noise that candidates share, or not."""

    def __init__(self, worth, own_noise=0.0):
        self.worth, self.own, self.asked = worth, own_noise, []

    def __call__(self, number, names, seeds):
        self.asked.append((number, tuple(names), tuple(seeds)))
        shared = {s: np.random.default_rng(s).normal() for s in seeds}
        return {
            n: [
                self.worth[n] + shared[s] + self.own * np.random.default_rng([s, k]).normal()
                for s in seeds
            ]
            for k, n in enumerate(names)
        }

    def nets(self):
        return sum(len(names) * len(seeds) for _, names, seeds in self.asked)


def test_the_hopeless_leave_at_once():
    scores = Scores(dict(a=0.1, b=0.2, c=0.9, d=0.3))
    best, finals = climb("abcd", RUNGS, scores)
    # Paired, the noise of seeds cancels: half of the first rung settles it.
    assert best == "c" and scores.asked[0] == (0, tuple("abcd"), (0, 1, 2, 3))
    assert scores.asked[1] == (2, ("c",), (200,)) and set(finals) == {"c"}
    assert scores.nets() == 17


def test_the_worse_half_leaves_at_each_rung():
    worth = {name: 0.01 * k for k, name in enumerate("abcdefgh")}
    scores = Scores(worth, own_noise=3.0)
    best, finals = climb(tuple(worth), RUNGS, scores)
    entered = {number: set(names) for number, names, _ in reversed(scores.asked)}
    assert len(entered[0]) == 8 and len(entered[1]) <= 4 and len(entered[2]) <= 2
    assert entered[2] <= entered[1] <= entered[0] and best in entered[2] == set(finals)
    for number, _, seeds in scores.asked:
        assert set(seeds) <= set(RUNGS[number].seeds)


@given(st.permutations([0.0, 0.1, 0.2, 0.3, 0.4]))
def test_without_noise_the_best_wins(order):
    worth = dict(zip("abcde", order, strict=True))
    best, _ = climb(tuple(worth), RUNGS, Scores(worth))
    assert best == best_of({name: [value] for name, value in worth.items()}, tuple(worth))


@given(st.integers(1, 9), st.floats(0, 2))
def test_it_never_trains_more_nets_than_planned(count, noise):
    names = "abcdefghi"[:count]
    scores = Scores({name: 0.1 * k for k, name in enumerate(names)}, noise)
    climb(names, RUNGS, scores)
    assert scores.nets() <= sum(most_nets(count, RUNGS))


@pytest.fixture
def result() -> SearchResult:
    """A search whose answer is narrow, and whose spread is wide."""
    n = len(NAMES)
    return SearchResult(
        argmax=sdr_jax.Proposal(np.full(n, np.float32(0.05)), np.full(n, np.float32(0.1))),
        spread=sdr_jax.Proposal(np.full(n, np.float32(0.1)), np.full(n, np.float32(0.2))),
        rewards=np.zeros((1, 1)),
        baselines=np.zeros(1),
        groups=np.zeros(1),
        probabilities=np.zeros((1, n, 10)),
    )


class Killed(BaseException):
    """Stands for the end of the process."""


@pytest.fixture
def job(tiny_camvid, monkeypatch):
    """Makes a ``Finals`` with a ladder that scores by a formula, and counts."""
    config = replace(tiny_camvid, ladder=True, candidates=("argmax", "spread", "broad", "random"))
    target = camvid_target(check(config), WorkerPool(0))
    calls: list[tuple] = []

    def evaluate(stage, table, renderer, pool, units, seed, truth):
        if len(calls) == evaluate.limit:
            raise Killed
        calls.append((stage, seed, truth.images.shape))
        good = int(1000 * units.std()) + seed % 97
        return Evaluation(np.array([[good, 1000]] * 2), 0.1, 0.2)

    evaluate.limit = -1
    monkeypatch.setattr(module, "evaluate", evaluate)

    def make():
        folder = RunFolder(config, "camvid")
        progress = Progress(most_cost(4, ladder(config)), stream=io.StringIO())
        split = target.at(config.final.height, config.final.width)
        cost = cost_of(config.final)
        return Finals(config, target, split, folder, WorkerPool(0), progress, cost), progress

    def score(result):
        finals, progress = make()
        try:
            return finals.candidates(result), progress
        finally:
            finals._folder.close()

    return score, calls, config, evaluate


def test_finals_climb_on_the_reward_images_of_each_size(job, result):
    score, calls, config, _ = job
    (chosen, scores), progress = score(result)
    assert chosen == "random" and chosen in scores
    for stage, _, shape in calls:
        assert shape == (4, stage.height, stage.width, 3)
    assert calls[0][0] == config.reward and calls[-1][0] == config.final
    kinds = [line["kind"] for line in lines(config.out / "finals.jsonl")]
    assert len(kinds) == len(calls) and set(kinds) <= {"rung-1", "rung-2", "rung-3"}
    assert progress.left is not None and progress.left < 1e-6


def test_a_killed_ladder_ends_as_an_unbroken_one(job, result):
    score, calls, config, evaluate = job
    (chosen, scores), _ = score(result)
    whole = len(calls)
    (config.out / "finals.jsonl").unlink()
    calls.clear()
    evaluate.limit = 5
    with pytest.raises(Killed):
        score(result)
    evaluate.limit = -1
    assert score(result)[0] == (chosen, scores)
    assert len(calls) == whole
    assert score(result)[0] == (chosen, scores) and len(calls) == whole


def test_random_may_be_a_candidate(result):
    check(replace(camvid_config("quick"), candidates=("argmax", "random")))
    found = module.candidate_proposal("random", result)
    np.testing.assert_array_equal(found.width, random_proposal().width)


def test_twins_climb_once(job, result):
    score, _, config, _ = job
    wide = result._replace(spread=module.candidate_proposal("broad", result))
    score(wide)
    rows = {line["row"] for line in lines(config.out / "finals.jsonl")}
    assert rows == {"argmax", "spread", "random"}
