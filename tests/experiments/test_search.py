"""The search loop with a reward that is a formula: replay, failures, and what ends it."""

import json
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

import sdr_jax
from common.errors import UserError
from experiments import session
from experiments.attribute_search.loop import _progress_line, search
from experiments.attribute_search.plans import plan_of
from experiments.attribute_search.rewards import embed
from experiments.config import make_space
from experiments.evaluation.job import Result
from scene.attributes import NAMES

from .conftest import Counted, Killed, diverge, formula, lines, main_job, never, searching, untimed
from .tasks import die

nothing_to_score = Mock(return_value=Result(float("nan"), [], 0.0, 0.0))


@pytest.fixture
def run(scored_by):
    def work(config, evaluate=formula, plan=None):
        scored_by(evaluate)
        with session.open(config) as job:
            return search(job, plan or plan_of(config))

    return work


def rewards_of(found):
    return [result.reward for result in found.results]


@pytest.fixture
def config(tiny_camvid):
    """Twelve updates of two datasets by SDR."""
    return searching(tiny_camvid, method="sdr", updates_per_group=2)


def test_every_reward_is_logged_with_its_actions(config, run):
    config = searching(config, common_random_numbers=True)
    found = run(config)
    logged = lines(config.out / "evaluations.jsonl")
    places = [("search", update, dataset) for update in range(12) for dataset in range(2)]
    assert [(r["search"], r["update"], r["dataset"]) for r in logged] == places
    assert found.probabilities.shape == (12, 23, 5)
    np.testing.assert_allclose(found.probabilities.sum(-1), 1, atol=1e-5)
    assert [result.reward for result in found.results] == [r["reward"] for r in logged]
    seeds = [r["seed"] for r in logged]  # random numbers are common to an update
    assert seeds[::2] == seeds[1::2] and len(set(seeds)) == 12
    # An attribute has an action from its group's turn on, and keeps it once learnt.
    space = make_space(config)
    for record in logged:
        decided = {a for g in space.groups[: record["update"] // 2 + 1] for a in g}
        assert {a for a, action in enumerate(record["actions"]) if action >= 0} == decided
        width = np.array(record["width"])
        np.testing.assert_allclose(width[sorted(decided)], 0.2)
        np.testing.assert_allclose(np.delete(width, sorted(decided)), 1)


def test_killed_it_gives_the_same_answer_but_not_with_a_log_of_another_run(config, run, tmp_path):
    whole = run(config)
    broken = replace(config, out=tmp_path / "killed")
    for count in (7, 15):  # before an update's second reward, and before an update's first
        with pytest.raises(Killed):
            run(broken, Counted(limit=count))
    assert len(lines(broken.out / "evaluations.jsonl")) == 7 + 15
    again = run(broken)
    for name in ("solution", "probabilities"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    assert rewards_of(again) == rewards_of(whole)
    logs = [untimed(lines(c.out / "evaluations.jsonl")) for c in (config, broken)]
    assert logs[0] == logs[1]
    path = config.out / "evaluations.jsonl"
    path.write_text(json.dumps({**lines(path)[0], "key": "0" * 64}) + "\n")
    with pytest.raises(UserError, match=f"{path}: update 0, dataset 0 was not made"):
        run(config)


def test_attributes_outside_the_subset_stay_random(tiny_camvid, run):
    subset = NAMES[3:5]
    method = sdr_jax.random_search(sdr_jax.space(subset, 5))
    plan = plan_of(tiny_camvid)._replace(name="two", search=method, subset=subset, updates=2)
    found = run(tiny_camvid, plan=plan)
    for record in lines(tiny_camvid.out / "evaluations.jsonl"):
        assert record["search"] == "two" and len(record["actions"]) == 2
        assert set(np.delete(record["width"], [3, 4])) == {1.0}
    assert found.solution.width[3:5].tolist() == pytest.approx([0.2, 0.2])
    whole = embed(plan, sdr_jax.Proposal(np.zeros((7, 2)), np.zeros((7, 2))))
    assert whole.centre.shape == (7, 23) and (whole.centre[:, 5:] == 0.5).all()


@pytest.mark.parametrize("method", [
    "sdr", "gaussian", "random_search", pytest.param("surrogate", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_failed_evaluation_is_recorded_and_left_out(tiny_camvid, run, method):
    config = searching(tiny_camvid, method=method, updates_per_group=2)
    found = run(config, Counted(failing=(3, 8)))
    logged = lines(config.out / "evaluations.jsonl")
    failed = [r["failed"] for r in logged if r["reward"] is None]
    assert failed == ["the loss is nan after 50 of 200 steps"] * 2
    rewards = rewards_of(found)
    assert np.isnan(rewards).sum() == 2 and len(rewards) == len(logged)
    assert all(np.isfinite(part).all() for part in found.solution)
    kinds = {type(value) for record in logged for value in record["actions"]}
    assert kinds == {float if method == "gaussian" else int}
    again = run(config, never)  # failed ones are not tried again
    np.testing.assert_array_equal(rewards_of(again), rewards)
    np.testing.assert_array_equal(again.solution, found.solution)


@pytest.fixture
def end(camvid, out, scored_by, capsys):
    """Exit code and the one line on standard error of a CamVid job with another reward."""

    def ended(evaluate, *flags) -> tuple[int, str]:
        scored_by(evaluate)
        # Compiles next to nothing.
        quick = ("--search.method", "random_search", "--data", str(camvid))
        code = main_job("camvid", *quick, "--out", str(out), *flags)
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err and len(captured.err.strip().splitlines()) == 1
        return code, captured.err.strip()

    return ended


@pytest.mark.parametrize(("evaluate", "flags", "code", "words"), [
    (nothing_to_score, (), 2, ["the reward is nan", "at least one labelled class"]),
    (diverge, (), 1, ["2 of 12 evaluations failed", "the loss is nan after 50 of 200 steps"]),
    (Mock(side_effect=KeyboardInterrupt), (), 130, ["stopped; the same command resumes"]),
    (die, ("--workers", "1"), 1, ["a worker process died twice", "--workers"]),
])  # fmt: skip
def test_what_ends_a_search_is_one_line(end, evaluate, flags, code, words):
    found, text = end(evaluate, *flags)
    assert found == code and all(word in text for word in words)


def test_a_disk_that_fills_up_is_named_and_the_run_goes_on_later(end, out, filling_disk):
    log = out / "evaluations.jsonl"
    filling_disk(16)  # six files, and their folder each time, come before the first reward
    code, text = end(formula)
    assert code == 2 and f"{log}: No space left on device" in text and len(lines(log)) == 4
    filling_disk(99)
    code, text = end(nothing_to_score)
    assert code == 2 and "the reward is nan" in text and len(lines(log)) == 4


def test_the_baseline_of_squared_rewards_is_shown_as_a_reward():
    search = SimpleNamespace(squared_reward=True)
    plan = SimpleNamespace(
        name="run", updates=9, method="sdr", config=SimpleNamespace(search=search)
    )
    info = SimpleNamespace(baseline=2500.0, group=0)
    latest = [Result(0.5, [], 0.0, 0.0), Result(float("nan"), [], 0.0, 0.0, "the loss is nan")]
    line = _progress_line(plan, 0, latest, info)
    assert line == "run: update 1/9, group 1 | mIoU 50.0, baseline 50.0"
    assert _progress_line(plan, 0, latest[1:], info).endswith("| all failed, baseline 50.0")
