"""The answer: candidates, how they are judged, the ladder they climb, and the same choice after a kill."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from experiments.config import MainConfig, check
from experiments.presets import defaults
from experiments.reward.miou import Outcome
from experiments.run import judge, ladder
from experiments.run.context import opened
from experiments.run.learn import BROAD, CANDIDATE_SEED, candidate, distinct, learn, work_of
from experiments.run.search import Found
from scene.attributes import NAMES
from scene.proposal import default_proposal, random_proposal, slide
from shell.errors import UserError

from .conftest import Counted, Killed, by_preset, lines

LOW = defaults(MainConfig, "camvid", "smoke").reward
RUNGS = tuple(ladder.Rung(LOW, tuple(range(100 * k, 100 * k + n))) for k, n in enumerate((8, 4, 2)))
LADDER = {"ladder": True, "candidates": ("argmax", "spread", "broad", "random")}


@pytest.fixture
def found() -> Found:
    """A search that chose the lowest bin of ten everywhere, and is unsure."""
    answers = (slide(np.full(23, at), width) for at, width in ((0.05, 0.1), (0.1, 0.2), (0.7, 0.1)))
    nothing = np.zeros((1, 1))
    return Found(*answers, [], nothing, nothing, nothing, nothing, 0.0, 0.0)


def test_candidates_by_hand(found):
    config = defaults(MainConfig, "twin", "smoke")
    assert candidate("argmax", found, config) is found.solution
    assert candidate("spread", found, config) is found.spread
    np.testing.assert_array_equal(candidate("random", found, config), random_proposal())
    by_eye = default_proposal(config.default_width)
    np.testing.assert_array_equal(candidate("default", found, config), by_eye)
    # Half the range around 0.1 sticks out of it, and slides to [0, 0.5].
    broad = candidate("broad", found, config)
    np.testing.assert_allclose(broad.centre, np.full(23, BROAD / 2), rtol=1e-6)
    np.testing.assert_allclose(broad.width, np.full(23, BROAD), rtol=1e-6)
    assert candidate("seen", found, config) is found.best
    # Its camera is the one found, the rest where the search began; half of the streets are of each.
    camera = candidate("camera", found, config)
    own = np.array([name.startswith("camera") for name in NAMES])
    np.testing.assert_array_equal(camera.centre, np.where(own, 0.05, by_eye.centre).astype("f4"))
    np.testing.assert_array_equal(camera.width, np.where(own, 0.1, by_eye.width).astype("f4"))
    half = candidate("half", found, config)
    assert half.shares == (0.5, 0.5)
    np.testing.assert_array_equal(half.proposals, (found.solution, camera))
    # Twins hold one place; that of by eye, or of the first.
    streets = {"argmax": found.solution, "spread": found.solution, "half": half, "random": camera}
    assert distinct(streets) == ["argmax", "half", "random"]
    twins = {"argmax": by_eye, "camera": half, "half": half, "default": by_eye}
    assert distinct(twins) == ["camera", "default"]


@given(st.lists(st.integers(1, 30), min_size=1, max_size=9), st.none() | st.integers(1, 12))
def test_parts_are_cut_between_sequences_where_there_are_enough(lengths, count):
    names = [str(k) for k, length in enumerate(lengths) for _ in range(length)]
    if count is not None and count > len(names):
        with pytest.raises(UserError, match=f"--parts {count} .* {len(names)} give the reward"):
            judge.parts_of(names, count)
        return
    parts = judge.parts_of(names, count)
    assert len(parts) == (count or min(max(2, len(lengths)), 4, len(names)))
    assert [k for part in parts for k in range(*part)] == list(range(len(names)))
    starts = {0, *np.cumsum(lengths).tolist()}
    if len(parts) <= len(lengths):
        assert {first for first, _ in parts} <= starts
    else:
        assert starts <= {k for part in parts for k in part}


def test_parts_and_the_surest_by_hand():
    camvid = ["0001TP"] * 62 + ["0016E5"] * 204
    assert judge.parts_of(camvid) == ((0, 62), (62, 266))
    assert judge.parts_of(camvid, 3) == ((0, 62), (62, 164), (164, 266))
    assert judge.parts_of(["a"] * 5) == ((0, 2), (2, 5)) and judge.parts_of(["a"]) == ((0, 1),)
    safe = [[0.4, 0.2], [0.4, 0.2]]
    # Gains .1 +- 0, and .15 +- .3 / 2 (standard error of .45, .45, -.15, -.15 is .173).
    sure, wild = [[0.5, 0.3], [0.5, 0.3]], [[0.85, 0.05], [0.85, 0.05]]
    rewards = {"safe": safe, "sure": sure, "wild": wild, "uneven": [[0.9, 0.19], [0.9, 0.19]]}
    assert judge.surest(rewards, ["sure", "wild", "safe"], "safe") == "sure"
    assert judge.surest(rewards, ["wild", "safe"], "safe") == "safe"
    # On average it gains most, but it loses on the second part.
    assert judge.surest(rewards, ["uneven", "safe"], "safe") == "safe"
    assert judge.surest(rewards, ["uneven", "safe"]) == "uneven"
    # It loses a little on the second part, by less than seeds differ there; then by more.
    for little, answer in ((0.05, "slight"), (0.2, "safe")):
        slight = [[0.9, 0.2 - little + 0.1], [0.9, 0.2 - little - 0.1]]
        assert judge.surest({"safe": safe, "slight": slight}, ["slight", "safe"], "safe") == answer
    half = {"safe": safe, "half": [[np.nan] * 2, [0.5, 0.3]], "none": [[np.nan] * 2] * 2}
    assert judge.surest(half, ["none", "half", "safe"], "safe") == "half"


@given(arrays(float, (4, 3, 2), elements=st.floats(0, 1)), st.floats(-1, 1))
def test_the_answer_is_never_below_the_safe_candidate(rewards, shift):
    named = dict(zip("abcd", rewards, strict=True))
    best = judge.surest(named, "abcd", "c")
    assert judge.gains(named, "abcd", "c")[best].mean() >= 0
    if shift == round(shift, 3):  # what all share does not matter; rounding decides nothing
        moved = {name: np.round(own, 3) + shift for name, own in named.items()}
        exact = {name: np.round(own, 3) for name, own in named.items()}
        gain = [judge.gains(each, "abcd", "c") for each in (exact, moved)]
        for name in "abcd":
            np.testing.assert_allclose(gain[0][name], gain[1][name], atol=1e-9)


def test_the_middle_the_hopeless_and_who_is_kept_by_hand():
    config = defaults(MainConfig, "camvid", "quick")
    between = ladder.middle(config.reward, config.final)
    # sqrt(240 480) = 339.4 and sqrt(176 360) = 251.7, in multiples of 8; sqrt(24 100), sqrt(150 300).
    assert (between.size, between.streets, between.shots) == ("336x248", 49, 4)
    assert (between.train.steps, between.train.net) == (212, config.final.train.net)
    assert [ladder.kept(n) for n in (1, 2, 3, 4, 5, 8)] == [1, 2, ladder.FINALISTS, 2, 3, 4]
    assert ladder.most_nets(8, RUNGS) == [64, 16, 4]
    assert ladder.most_cost(8, RUNGS) == pytest.approx(84 * ladder.cost_of(LOW))
    # d = -1, -2, -3: mean -2, s = 1, t(0.95, 2) = 2.92, so the upper end is -2 + 2.92 / sqrt(3) < 0.
    assert ladder.hopeless([0, 0, 0], [1, 2, 3])
    assert ladder.hopeless([0, np.nan, 0, 0], [1, 9, 2, 3])  # failed nets tell nothing
    assert not ladder.hopeless([0, 0, 0], [1, 2, 3], confidence=0.99)  # t = 6.96
    assert not ladder.hopeless([0], [100])  # nor does one pair
    assert not ladder.hopeless([1, 2], [1, 2])
    assert ladder.best_of({"a": [np.nan], "b": [0.1, np.nan]}, "ab") == "b"


@by_preset
def test_rungs_lead_from_the_reward_to_the_final_fidelity(target, preset):
    config = defaults(MainConfig, target, preset)
    rungs = ladder.ladder(config.reward, config.final, 3, config.seed)
    assert (rungs[0].fidelity, rungs[-1].fidelity) == (config.reward, config.final)
    costs = [ladder.cost_of(rung.fidelity) for rung in rungs]
    assert costs == sorted(costs) and [len(rung.seeds) for rung in rungs] == [12, 6, 3]
    assert len(ladder.fidelities(config.final, config.final)) == 1


@given(st.integers(0, 2**31 - 1), st.integers(1, 1000))
def test_rungs_candidates_and_rows_share_no_seed(seed, nets):
    config = defaults(MainConfig, "camvid", "smoke")
    rungs = ladder.ladder(config.reward, config.final, nets, seed)
    seeds = [s for rung in rungs for s in rung.seeds]
    first = CANDIDATE_SEED + seed
    others = [*range(seed, seed + 1000), *range(first, first + nets)]
    assert len({*seeds, *others}) == len(seeds) + len(others) and max(seeds) < 2**32


class Scores:
    """Rewards by a formula: worth plus noise that candidates share, or not."""

    def __init__(self, worth, own_noise=0.0):
        self.worth, self.own, self.asked = worth, own_noise, []

    def __call__(self, number, names, seeds):
        self.asked.append((number, tuple(names), tuple(seeds)))

        def score(k, name, seed):
            noise = np.random.default_rng(seed).normal()
            return self.worth[name] + noise + self.own * np.random.default_rng([seed, k]).normal()

        return {name: [[score(k, name, s)] for s in seeds] for k, name in enumerate(names)}

    def nets(self):
        return sum(len(names) * len(seeds) for _, names, seeds in self.asked)


def test_the_hopeless_leave_at_once_and_the_worse_half_at_each_rung():
    scores = Scores(dict(a=0.1, b=0.2, c=0.9, d=0.3))
    best, finals = ladder.climb("abcd", RUNGS, scores)
    # Paired, the noise of seeds cancels: half of the first rung settles it.
    assert best == "c" and scores.asked[0] == (0, tuple("abcd"), (0, 1, 2, 3))
    assert scores.asked[1] == (2, ("c",), (200,)) and set(finals) == {"c"} and scores.nets() == 17
    worth = {name: 0.01 * k for k, name in enumerate("abcdefgh")}
    scores = Scores(worth, own_noise=3.0)
    best, finals = ladder.climb(tuple(worth), RUNGS, scores)
    entered = {number: set(names) for number, names, _ in reversed(scores.asked)}
    assert len(entered[0]) == 8 and len(entered[1]) <= 4 and len(entered[2]) <= 2
    assert entered[2] <= entered[1] <= entered[0] and best in entered[2] == set(finals)
    assert all({*seeds} <= {*RUNGS[number].seeds} for number, _, seeds in scores.asked)


@given(st.integers(1, 9), st.just(0.0) | st.floats(0, 3), st.booleans())
def test_the_safe_candidate_reaches_the_top_within_the_planned_nets(count, noise, given):
    names = "abcdefghi"[:count]
    scores, safe = Scores({name: 0.5 * k for k, name in enumerate(names)}, noise), names[0]
    best, finals = ladder.climb(names, RUNGS, scores, *([safe] if given else []))
    assert scores.nets() <= sum(ladder.most_nets(count, RUNGS))
    assert (not given or safe in finals) and (noise or best == names[-1])


@pytest.fixture
def job(tiny_camvid, scored_by):
    """Learns with rewards that are higher the wider a proposal is; the search is one of six updates."""

    def wide(recipe, source, seed, truth, parts=()) -> Outcome:
        reward = source.width.mean() / 2 + seed % 97 / 1000
        return Outcome(reward, [], 0.1, 0.2, parts=(reward,) * len(parts))

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
    assert learnt.chosen == "random" and set(learnt.scores) == {"argmax", "random"}
    np.testing.assert_array_equal(learnt.streets, random_proposal())
    assert len(learnt.parts) == 2 and "images of" in learnt.parts[0]
    assert all(len(parts) == 2 for own in learnt.scores.values() for parts in own)
    finals = lines(config.out / "finals.jsonl")
    assert [len(line["parts"]) for line in finals] == [2] * 4
    seeds = {(line["seed"], line["side"]) for line in finals}
    assert seeds == {(CANDIDATE_SEED, "reward"), (CANDIDATE_SEED + 1, "reward")}
    assert (config.out / "attributes.json").exists()
    made = len(job.scores.calls)
    assert job(**two)[0].scores == learnt.scores and len(job.scores.calls) == made


def test_a_candidate_that_failed_once_is_judged_by_its_other_nets(job):
    job.scores.failing = (13,)  # the first after twelve rewards
    learnt, _, config = job(candidate_seeds=3, candidates=("argmax", "random"))
    assert learnt.chosen == "random"
    assert sum(line["failed"] is not None for line in lines(config.out / "finals.jsonl")) == 1


def test_candidates_climb_on_the_reward_images_of_each_size_and_again_after_a_kill(job):
    learnt, progress, config = job(**LADDER)
    assert learnt.chosen == "random" and learnt.chosen in learnt.scores
    for recipe, _, _, truth, *_ in job.scores.calls:
        assert truth.images.shape == (4, recipe.fidelity.height, recipe.fidelity.width, 3)
    first, *_, last = (recipe.fidelity for recipe, *_ in job.scores.calls)
    assert (first, last) == (config.reward, config.final)
    kinds = [line["nets"] for line in lines(config.out / "finals.jsonl")]
    assert len(kinds) == len(job.scores.calls) - 12 and set(kinds) <= {"rung-1", "rung-2", "rung-3"}
    assert progress.left is not None and progress.left < 1e-6
    made = len(job.scores.calls)
    (config.out / "finals.jsonl").unlink()
    job.scores.calls.clear()
    job.scores.limit = 5
    with pytest.raises(Killed):
        job(**LADDER)
    job.scores.limit = -1
    assert job(**LADDER)[0].scores == learnt.scores and len(job.scores.calls) == made - 12
