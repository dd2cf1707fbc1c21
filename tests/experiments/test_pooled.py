"""The search by pools: its credits and their names, what a kill leaves, other workers, a labelled subset."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import sdr_jax
from experiments.config import MainConfig, check
from experiments.config.presets import defaults
from experiments.evaluation import cache, runner
from experiments.evaluation.cached import Cached
from experiments.evaluation.job import StreetPool
from experiments.evaluation.store import identity
from experiments.run import pooled
from experiments.run.context import opened
from experiments.run.learn import candidate, learn, offered, plan_of
from experiments.run.search import Found, search
from scene.attributes import NAMES, default_unit
from scene.proposal import Mixture, Proposal, components, moments
from shell.errors import UserError
from shell.files import read_json

from .conftest import Counted, Killed, formula, lines, never, searching


@pytest.fixture
def config(tiny_camvid) -> MainConfig:
    """Two rounds of twelve streets."""
    pool = replace(tiny_camvid.search.pool, streets=12, rounds=2)
    train = replace(tiny_camvid.reward.train, net="lite0")
    reward = replace(tiny_camvid.reward, train=train)
    return searching(replace(tiny_camvid, reward=reward), method="pool", pool=pool)


@pytest.fixture
def run(monkeypatch):
    """Run the search of a configuration; stubs are functions of the cache, and the credits of a pool."""

    def ran(config, **stubs):
        with opened(config) as job, monkeypatch.context() as patch:
            for name, stub in stubs.items():
                patch.setattr(runner if name == "credited" else cache, name, stub)
            job.begin([])
            return search(job, plan_of(config))

    return ran


def same(one: Found, other: Found) -> None:
    """Both searches gave streets the same credits, and ended with the same answers."""
    for name in ("solution", "rewards", "probabilities"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert [own.credits for own in one.results] == [own.credits for own in other.results]
    for name, streets in one.answers.items():
        for (share, own), (theirs, others) in zip(
            components(streets), components(other.answers[name]), strict=True
        ):
            assert share == theirs
            np.testing.assert_array_equal(own.probabilities, others.probabilities)


def test_each_street_is_rendered_once_and_gets_a_credit(config, run):
    rendered = Counted(cache.render_street)
    found = run(config, render_street=rendered)
    assert [index for _, _, index, *_ in rendered.calls] == [*range(12)] * 2
    assert len({(seed, index) for _, seed, index, *_ in rendered.calls}) == 24
    assert found.rewards.shape == (2, 1) and np.all((found.rewards > 0) & (found.rewards < 1))
    for result in found.results:
        assert len(result.credits) == 12 and np.std(result.credits) > 1e-4
        assert abs(np.sum(result.credits)) < 1e-3 * np.abs(result.credits).sum()
    records = lines(config.out / "evaluations.jsonl")
    assert [(r["update"], r["dataset"], r["steps"]) for r in records] == [(0, 0, 0), (1, 0, 0)]
    assert all(len(r["credits"]) == 12 and r["render_seconds"] > 0 for r in records)
    assert not list((config.out / "shared").glob("pool-*"))  # no net wants it any more


def test_killed_it_gives_the_same_answer(config, run, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "CHUNK", 5)
    whole = run(config)
    for name, limit, missing in (
        ("render_street", 7, 24 - 5),  # whole pieces stay
        ("credited", 0, 12),
        ("render_street", 12, 12),
        ("credited", 1, 0),
    ):
        broken = replace(config, out=tmp_path / f"{name}-{limit}")
        stub = Counted(vars(runner if name == "credited" else cache)[name], limit)
        with pytest.raises(Killed):
            run(broken, **{name: stub})
        rendered = Counted(cache.render_street)
        same(run(broken, render_street=rendered), whole)
        assert len(rendered.calls) == missing, name
        same(run(broken, render_street=never, credited=never), whole)  # all is known


def test_a_damaged_piece_is_made_anew(config, run, monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "CHUNK", 5)
    whole = run(config)
    again = replace(config, out=tmp_path / "again")
    with pytest.raises(AssertionError):
        run(again, _assemble=never)
    pieces = sorted((again.out / "shared").glob("pool-*.pieces/*.npz"))
    assert [piece.name for piece in pieces] == ["000000.npz", "000005.npz", "000010.npz"]
    pieces[1].write_bytes(pieces[1].read_bytes()[:-100])
    rendered = Counted(cache.render_street)
    same(run(again, render_street=rendered), whole)
    assert [index for _, _, index, *_ in rendered.calls[:-12]] == [*range(5, 10)]


def test_a_pool_is_named_by_its_streets_wherever_they_lie():
    def name(pool: str, seed: int = 0) -> str:
        pools = [StreetPool(pool, at) for at in (None, Cached("folder"))]
        (found,) = {identity("c", own, seed) for own in pools}
        return found

    assert len({name("a"), name("b"), name("a", 1)}) == 3


def test_its_answers_are_candidates(config, run):
    config = replace(config, candidates=("last", "previous", "mixed", "random"))
    assert offered(config) == config.candidates
    found = run(config)
    last = candidate("last", found, config)
    assert isinstance(last, Mixture) and len(last.shares) == 2
    assert candidate("previous", found, config) is found.answers["previous"]
    assert sum(found.answers["mixed"].shares) == pytest.approx(1)
    assert found.solution.centre.shape == (23,)
    first = moments(components(found.answers["mixed"])[-1][1]).centre
    np.testing.assert_allclose(first, default_unit(), atol=0.26)


def test_a_labelled_subset_is_in_every_training_set(config, run, tmp_path):
    alone, beside = run(config), run(replace(config, few=1, out=tmp_path / "few"))
    assert beside.rewards[0] != alone.rewards[0]  # of the same streets
    assert not np.allclose(beside.results[0].credits, alone.results[0].credits, rtol=0.01)
    assert lines(tmp_path / "few" / "evaluations.jsonl")[0]["few"] == 1


def test_attributes_outside_the_subset_stay_random(config):
    subset = NAMES[3:5]
    method = sdr_jax.pool(sdr_jax.space(subset, 5))
    with opened(config) as job:
        job.begin([])
        found = search(job, plan_of(config)._replace(search=method, subset=subset))
    ((_, own),) = components(found.answers["last"])
    np.testing.assert_allclose(np.delete(own.probabilities, [3, 4], axis=0), 0.2)
    assert found.solution.width[6] == 1


@pytest.mark.slow
def test_one_worker_and_two_give_the_same_credits(config, run, tmp_path):
    more = searching(config, pool=replace(config.search.pool, streets=20))  # two tasks of a worker
    same(*(run(replace(more, workers=n, out=tmp_path / f"{n}")) for n in (1, 2)))


def test_the_whole_choice_is_written_and_read(config, scored_by):
    scored_by(formula)
    config = replace(config, candidates=("last", "mixed"))
    with opened(config) as job:
        job.begin([])
        learnt = learn(job)
    assert learnt.selection.chosen in offered(config)
    rows = read_json(config.out / "attributes.json")["components"]
    assert len(rows[0]["attributes"]["car_interval"]["unit"]["probabilities"]) == 5


@pytest.mark.parametrize(("change", "says"), [
    ({"pool": {"streets": 1}}, "--search.pool.streets must be 2 or more, not 1"),
    ({"pool": {"bound": 0.0}}, "--search.pool.bound must be positive"),
    ({"trunk": "tuned"}, "--method pool keeps the features of a frozen trunk"),
    ({"net": "compact"}, "has the net compact"),
    ({"candidates": ("seen", "broad")}, "--candidates seen broad: --method pool has last"),
    ({"reward_kind": "mmd"}, "--method pool needs --reward-kind miou"),
])  # fmt: skip
def test_what_it_cannot_do(config, change, says):
    if "pool" in change:
        config = searching(config, pool=replace(config.search.pool, **change["pool"]))
    elif {"trunk", "net"} & set(change):
        train = replace(config.reward.train, **change)
        config = replace(config, reward=replace(config.reward, train=train))
    else:
        config = replace(config, **change)
    with pytest.raises(UserError, match=says):
        check(config)


def test_defaults_of_every_target_can_be_searched():
    for target in ("twin", "camvid", "labelmefacade"):
        check(searching(partial(defaults, MainConfig)(target, "quick"), method="pool"))


def test_streets_are_uniform_on_their_intervals_and_below_one():
    centre, width = np.float32([0.5, 0.3, 0.95, 1.0]), np.float32([1.0, 0.2, 0.0, 0.0])
    many = Proposal(*(np.tile(part, (20_000, 1)) for part in (centre, width)))
    units = pooled.drawn(np.random.default_rng(3), many)
    assert units.shape == (20_000, 4) and units.dtype == np.float32
    assert np.all((units >= 0) & (units < 1))
    assert np.all(np.abs(units - centre[None]) <= width[None] / 2 + 1e-6)
    np.testing.assert_allclose(units.mean(0), centre, atol=0.01)
    np.testing.assert_allclose(units.std(0), width / 12**0.5, atol=0.01)
