"""The search by pools: its rewards and their names, what a kill leaves, other workers, a labelled subset."""

import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import sdr_jax
from experiments.config import MainConfig, check
from experiments.config.presets import defaults
from experiments.evaluation.cached import Cached, loaded
from experiments.evaluation.job import Result, StreetPool, Subset
from experiments.evaluation.store import identity
from experiments.run import pooled
from experiments.run.context import opened
from experiments.run.learn import candidate, learn, offered, plan_of
from experiments.run.search import search
from scene.attributes import NAMES, default_unit
from scene.proposal import Mixture, Proposal, components, moments
from seg.beside import TrainingSet
from seg.data import LabelledImages
from shell.errors import UserError
from shell.files import read_json

from .conftest import Counted, Killed, lines, never, searching


def far(recipe, source, seed, truth, parts=(), keeps=None) -> Result:
    """Worth more with buildings far off, as the labels of the streets tell; of others by seed."""
    own = source.parts[0] if isinstance(source, TrainingSet) else source
    share = 0.4
    if isinstance(own, LabelledImages):
        share = float(np.mean(loaded(own).labels == 3))
    iou = 0.3 + 0.2 * share + 0.0001 * (seed % 7)
    return Result(iou, [iou], 0.5, 1.5, parts=(iou,) * len(parts))


@pytest.fixture
def config(tiny_camvid) -> MainConfig:
    """Two rounds of twelve streets and six rewards; nets are not trained, so their size does not count."""
    search = replace(
        tiny_camvid.search,
        method="pool",
        pool=replace(tiny_camvid.search.pool, streets=12, subset=4, rewards=6, rounds=2),
    )
    train = replace(tiny_camvid.reward.train, net="lite0")
    return replace(
        tiny_camvid, search=search, reward=replace(tiny_camvid.reward, train=train), workers=0
    )


@pytest.fixture
def run(scored_by):
    """Run the search of a configuration."""

    def ran(config, scores=None):
        scored_by(scores or Counted(far))
        with opened(config) as job:
            job.begin([])
            return search(job, plan_of(config))

    return ran


def test_each_street_is_rendered_once_and_its_features_serve_all_rewards(config, run):
    scores = Counted(far)
    found = run(config, scores)
    assert len(scores.calls) == 12 and found.rewards.shape == (2, 6)
    for _, recipe, truth, seed, *_ in (("", *call) for call in scores.calls):
        assert (recipe.fidelity.streets, recipe.fidelity.shots) == (4, 1)
        assert len(truth.images) == 4 and len(truth.features[0]) == 4 * 2  # views
        assert truth.labels.max() < 11 or (truth.labels == 255).any()
        assert 0 <= seed < 2**32
    records = lines(config.out / "evaluations.jsonl")
    assert {(r["update"], r["dataset"]) for r in records} == {
        (u, k) for u in (0, 1) for k in range(6)
    }
    # What rendering took is shared by the rewards of its round.
    assert len({round(r["render_seconds"], 2) for r in records[:6]}) == 1
    assert all(r["render_seconds"] > 0.5 for r in records)
    assert not list((config.out / "shared").glob("pool-*"))  # no net wants it any more


def test_killed_it_gives_the_same_answer(config, run, tmp_path, monkeypatch):
    whole = run(config)
    broken = replace(config, out=tmp_path / "killed")
    for count in (3, 4):  # in the first round, and in the second
        with pytest.raises(Killed):
            run(broken, Counted(far, limit=count))
        assert len(list((broken.out / "shared").glob("pool-*"))) == 1
    with monkeypatch.context() as patch:  # the second round's pool is there already
        patch.setattr("experiments.evaluation.cache.render_street", never)
        again = run(broken)
    for name in ("solution", "rewards", "probabilities"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    for name, streets in whole.answers.items():
        for (share, own), (theirs, other) in zip(
            components(streets), components(again.answers[name]), strict=True
        ):
            assert share == theirs
            np.testing.assert_array_equal(own.probabilities, other.probabilities)
    known = run(broken, never)  # nor is anything done that is known
    np.testing.assert_array_equal(known.rewards, whole.rewards)


def test_a_pool_goes_on_where_it_was_killed(config, run, monkeypatch):
    from experiments.evaluation import cache

    monkeypatch.setattr(cache, "CHUNK", 5)
    real, calls = cache.render_street, []

    def some(unit, seed, index, *rest):
        if len(calls) == 7:
            raise Killed
        calls.append(index)
        return real(unit, seed, index, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(cache, "render_street", some)
        with pytest.raises(Killed):
            run(config)
    pieces = sorted((config.out / "shared").glob("pool-*.pieces/*.npz"))
    assert [piece.name for piece in pieces] == ["000000.npz"]
    rendered = []
    monkeypatch.setattr(
        cache, "render_street", lambda *task: rendered.append(task[2]) or real(*task)
    )
    whole = run(config)
    assert rendered[:7] == [*range(5, 12)]
    shutil.rmtree(config.out)
    np.testing.assert_array_equal(run(config).rewards, whole.rewards)


def test_a_damaged_piece_is_made_anew(config, run, monkeypatch, tmp_path):
    from experiments.evaluation import cache

    monkeypatch.setattr(cache, "CHUNK", 5)
    whole = run(config)
    again = replace(config, out=tmp_path / "again")
    with monkeypatch.context() as patch:
        patch.setattr(cache, "_assemble", never)
        with pytest.raises(AssertionError):
            run(again)
    for piece in (again.out / "shared").glob("pool-*.pieces/*.npz"):
        piece.write_bytes(piece.read_bytes()[:-100])
    np.testing.assert_array_equal(run(again).rewards, whole.rewards)


def test_a_subset_is_named_by_its_streets_and_their_pool():
    def name(pool: str, picked: tuple[int, ...], seed: int = 0) -> str:
        held = Cached("folder")
        names = {identity("c", Subset(StreetPool(pool, at), picked), seed) for at in (None, held)}
        assert len(names) == 1  # wherever it lies
        return names.pop()

    ways = [name("a", (1, 2)), name("a", (1, 3)), name("b", (1, 2)), name("a", (1, 2), 1)]
    assert len(set(ways)) == 4


def test_it_learns_what_the_rewards_say_and_its_answers_are_candidates(config, run):
    more = replace(config.search.pool, streets=48, subset=12, rewards=24)
    config = searching(
        replace(config, candidates=("last", "previous", "mixed", "random")), pool=more
    )
    assert offered(config) == config.candidates
    found = run(config)
    last = candidate("last", found, config)
    assert isinstance(last, Mixture) and len(last.shares) == 2
    assert candidate("previous", found, config) is found.answers["previous"]
    assert sum(found.answers["mixed"].shares) == pytest.approx(1)
    assert found.solution.centre.shape == (23,)
    first = moments(components(found.answers["mixed"])[-1][1]).centre
    np.testing.assert_allclose(first, default_unit(), atol=0.26)


def test_beside_a_labelled_subset_nets_have_it_too(config, run):
    scores = Counted(far)
    run(replace(config, few=1), scores)
    for call in scores.calls:
        assert isinstance(call[1], TrainingSet) and len(call[1].parts[0].images) == 4


def test_attributes_outside_the_subset_stay_random(config, run, scored_by):
    subset = NAMES[3:5]
    method = sdr_jax.pool(sdr_jax.space(subset, 5))
    scored_by(Counted(far))
    with opened(config) as job:
        job.begin([])
        found = search(job, plan_of(config)._replace(search=method, subset=subset))
    ((_, own),) = components(found.answers["last"])
    np.testing.assert_allclose(np.delete(own.probabilities, [3, 4], axis=0), 0.2)
    assert found.solution.width[6] == 1


@pytest.mark.slow
def test_one_worker_and_two_give_the_same_rewards(config, tmp_path):
    small = replace(config.reward, width=64, height=48, train=replace(config.reward.train, steps=4))
    found = []
    for workers in (1, 2):
        own = replace(config, reward=small, workers=workers, out=tmp_path / f"{workers}")
        with opened(own) as job:
            job.begin([])
            found.append(search(job, plan_of(own)).rewards)
    np.testing.assert_array_equal(*found)


def test_the_whole_choice_is_written_and_read(config, scored_by):
    scored_by(Counted(far))
    config = replace(config, candidates=("last", "mixed"))
    with opened(config) as job:
        job.begin([])
        learnt = learn(job)
    assert learnt.selection.chosen in offered(config)
    rows = read_json(config.out / "attributes.json")["components"]
    assert len(rows[0]["attributes"]["car_interval"]["unit"]["probabilities"]) == 5


@pytest.mark.parametrize(("change", "says"), [
    ({"pool": {"subset": 13}}, "--search.pool.subset 13 is more than the 12 streets"),
    ({"pool": {"rewards": 1}}, "--search.pool.rewards must be 2 or more, not 1"),
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
