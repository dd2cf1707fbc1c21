"""Ask and tell: the same search as the loops, also after any interruption."""

import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sdr_jax
from benchmarks.rivals import METHODS as EVERY
from benchmarks.rivals import make, tpe
from sdr_jax import AskTell, Proposal, space
from tests.conftest import printed

from .conftest import assert_close, assert_same, driven, refuses

SPACE = space(list("abc"), bins=[3, 5, 2], groups=[["b", "a"], ["c"]])
GAUSSIAN = make("gaussian", SPACE)
SDR = sdr_jax.sdr(SPACE, updates_per_group=3, hidden=4, baseline=sdr_jax.leave_one_out())
METHODS = {"gaussian": GAUSSIAN, "sdr": SDR, "tpe": tpe(SPACE, startup=2)}
METHODS["cma_es"] = make("cma_es", SPACE)
N = 3
OTHER = space(list("abc"))


def score(proposal: Proposal) -> float:
    return -float(np.sum((proposal.centre - np.float32(0.3)) ** 2))


def drive(search: AskTell, trials: int = 5 * N, order: int = 1) -> AskTell:
    """Tell the rewards of so many trials, by default of five updates, in order or backwards."""
    while len(search.history) < trials:
        for trial in search.ask()[::order][: trials - len(search.history)]:
            search.tell(trial.id, None if trial.id % 4 == 1 else score(trial.proposal))
    return search


def test_seeds_that_would_be_another_and_folders_that_do_not_exist(tmp_path) -> None:
    for seed in (-1, 2**32):
        refuses(
            f"seed is {seed}, but must lie in 0..4294967295", AskTell, SPACE, GAUSSIAN, seed=seed
        )
    path = tmp_path / "new" / "history.jsonl"
    drive(AskTell(SPACE, GAUSSIAN, n=N, path=path), 1)
    assert len(path.read_text().splitlines()) == 1


def answers(search: AskTell) -> tuple:
    probabilities = search.method.diagnostics.probabilities(search.state)
    return search.solution(), search.spread(), probabilities, search.updates


def test_it_proposes_the_same_as_the_loop_on_the_host() -> None:
    def reward_fn(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        return jnp.asarray([score(Proposal(*pair)) for pair in zip(*proposals, strict=True)])

    state, record = driven(jax.random.key(5), GAUSSIAN, reward_fn, updates=4, n=N)
    search = AskTell(SPACE, GAUSSIAN, n=N, seed=5)
    for actions in np.asarray(record.actions):
        for trial in search.ask():
            search.tell(trial.id, score(trial.proposal))
        asked = [line["actions"] for line in search.history[-N:]]
        np.testing.assert_allclose(asked, actions, rtol=1e-5, atol=1e-6)
    # Rewards are shifted by a median, to which this method is invariant.
    assert_close(search.state.params, state.params, rtol=1e-4, atol=1e-5)


def test_data_sets_and_their_seeds_come_from_different_keys_in_every_update() -> None:
    search = AskTell(SPACE, sdr_jax.random_search(SPACE), n=N)
    seeds = []
    for _ in range(3):
        with jax.debug_key_reuse(True):
            trials = search.ask()
        for trial in trials:
            seeds.append(trial.seed)
            search.tell(trial.id, 0.5)
    assert len(set(seeds)) == 3 * N


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "sdr")) for name in METHODS]
)
def test_a_history_gives_the_same_state_again(tmp_path: Path, name: str) -> None:
    path = tmp_path / "history.jsonl"
    unbroken = drive(AskTell(SPACE, METHODS[name], n=N))
    for stop in (1, 5, 9, 15):
        drive(AskTell(SPACE, METHODS[name], n=N, path=path), stop)
    again = AskTell(SPACE, METHODS[name], n=N, path=path)
    assert again.history == unbroken.history
    assert_same(answers(again), answers(unbroken))
    # Failed trials are in the history as such, and harm no method.
    assert [line["reward"] is None for line in again.history] == [id % 4 == 1 for id in range(15)]
    assert np.isfinite(again.solution().centre).all()


@settings(max_examples=10)
@given(st.integers(0, 5 * N), st.integers(0, 2**16), st.binary(max_size=30))
def test_any_order_and_any_cut_end_alike(tmp_path_factory, stop: int, seed: int, rest) -> None:
    path = tmp_path_factory.mktemp("cut") / "history.jsonl"
    drive(AskTell(SPACE, GAUSSIAN, n=N, seed=seed, path=path), stop)
    with open(path, "ab") as file:  # what a kill may leave of a line
        file.write(rest.translate(None, b"\r\n"))
    resumed = drive(AskTell(SPACE, GAUSSIAN, n=N, seed=seed, path=path), order=-1)
    assert_same(answers(resumed), answers(drive(AskTell(SPACE, GAUSSIAN, n=N, seed=seed))))
    assert path.read_bytes().count(b"\n") == 5 * N


def test_asking_again_returns_the_trials_without_a_reward() -> None:
    search = AskTell(SPACE, GAUSSIAN, n=N)
    first = search.ask()
    assert [trial.id for trial in first] == [0, 1, 2]
    search.tell(1, 0.5, note="kept")
    assert search.history[0]["note"] == "kept"
    assert [(t.id, t.seed) for t in search.ask()] == [(t.id, t.seed) for t in (first[0], first[2])]
    search.tell(2, 0.5)
    assert search.updates == 0
    search.tell(0, 0.5)
    assert (search.updates, [trial.id for trial in search.ask()]) == (1, [3, 4, 5])


@pytest.mark.parametrize("offset", [0.0, 1e9])
def test_scores_are_kept_unchanged_and_small_differences_between_large_ones_count(offset) -> None:
    search = AskTell(space(["a"], bins=[4]), sdr_jax.random_search(space(["a"], bins=[4])), n=4)
    rewards: list[float] = []
    for _ in range(3):
        for trial in search.ask():
            rewards.append(offset + 0.125 * trial.id * (-1) ** trial.id)
            search.tell(trial.id, rewards[-1])
    assert [line["reward"] for line in search.history] == rewards
    best = search.history[int(np.argmax(rewards))]
    assert search.solution().centre == (best["actions"][0] + 0.5) / 4


@pytest.mark.parametrize("n", [1, 4])
@pytest.mark.parametrize("name", ["surrogate", "intervals", "random_search"])
def test_a_first_penalty_costs_later_scores_no_digits(name: str, n: int) -> None:
    """The best answer scores 0 and others down to -3; in single precision -1e9 and these are one number."""
    two = space(list("ab"), bins=[4, 4])
    best = np.asarray([0.625, 0.125])
    search = AskTell(two, make(name, two, 0.0), n=n)
    while len(search.history) < 120:
        for trial in search.ask():
            centre = np.asarray(trial.proposal.centre, float)
            reward = -1e9 if trial.id == 0 else -float(np.sum(4 * (centre - best) ** 2))
            search.tell(trial.id, reward)
    np.testing.assert_allclose(search.solution().centre, best, atol=1e-6)
    assert max(line["reward"] for line in search.history) == 0


@pytest.mark.parametrize(("share", "spread"), [(0.3, 0.0), (0.6, 0.0), (0.3, 1e3), (0.45, 1e3)])
def test_many_or_different_penalties_cost_other_scores_no_digits(
    share: float, spread: float
) -> None:
    """A method gets the differences between successes; it starts again a few times, not in every update."""
    method, updates, rng = sdr_jax.random_search(SPACE), [], np.random.default_rng(0)

    def update(state: object, actions: jax.Array, rewards: jax.Array) -> tuple:
        updates.append(np.asarray(rewards))
        return method.update(state, actions, rewards)

    search = AskTell(SPACE, method._replace(update=update), n=4)
    scores = rng.uniform(-3, 0, 80)
    failed = (rng.permutation(80) < share * 80) | (np.arange(80) < 3)
    scores[failed] = -1e9 - spread * rng.uniform(size=failed.sum())
    for _ in range(20):
        for trial in search.ask():
            search.tell(trial.id, float(scores[trial.id]))
    shifted = np.concatenate(updates[-4:])[~failed[-16:]]
    expected = scores[-16:][~failed[-16:]]
    np.testing.assert_allclose(shifted - shifted[0], expected - expected[0], atol=1e-3)
    assert len(updates) < 20 + 3 * 20


@pytest.mark.parametrize("name", EVERY)
def test_a_flat_score_gives_no_answer(name: str) -> None:
    method = make(name, SPACE)
    search = AskTell(SPACE, method, n=2)
    before = search.solution(), search.spread()
    for _ in range(3):
        for trial in search.ask():
            search.tell(trial.id, 0.1)
    assert_same((search.solution(), search.spread()), before)
    for trial in search.ask():
        search.tell(trial.id, 0.1 * trial.id)
    assert_same(search.solution(), Proposal(*map(np.asarray, method.solution(search.state))))


def test_a_method_that_is_not_shift_invariant_gets_rewards_unchanged() -> None:
    method = sdr_jax.sdr(SPACE, hidden=4, squared_reward=True)
    state = method.init(jax.random.split(jax.random.key(0))[0])
    search = AskTell(SPACE, method, n=3)
    search.ask()
    expected, _ = method.update(state, search._actions, jnp.asarray([0.5, 0.6, 0.7], jnp.float32))
    for id, reward in enumerate([0.5, 0.6, 0.7]):
        search.tell(id, reward)
    assert_same(search.state, expected)


def test_scores_too_large_for_single_precision_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    search = AskTell(SPACE, GAUSSIAN, n=2, path=path)
    for reward in (1.1e15, -1e31, 1e300):
        culprit = f"reward is {reward:g}, but must lie within +-1e+15"
        refuses(re.escape(culprit), search.tell, search.ask()[0].id, reward)
    assert search.history == [] and len(search.ask()) == 2
    search.tell(0, -1e15)
    path.write_text(path.read_text().replace("1000000000000000.0", "1e+20"))
    refuses(
        "line 1: reward must be null or a number within", AskTell, SPACE, GAUSSIAN, n=2, path=path
    )


def test_whole_numbers_are_rewards_whoever_wrote_them(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    for trial in (search := AskTell(SPACE, GAUSSIAN, n=2, path=path)).ask():
        search.tell(trial.id, float(trial.id))
    for number in "01":
        path.write_text(path.read_text().replace(f'"reward": {number}.0', f'"reward": {number}'))
    assert [type(json.loads(line)["reward"]) for line in path.open()] == [int, int]
    assert_same(AskTell(SPACE, GAUSSIAN, n=2, path=path).state, search.state)


def test_penalties_among_scores_are_counted() -> None:
    search = AskTell(SPACE, make("surrogate", SPACE), n=5)
    for update in range(3):
        for trial in search.ask():
            crashed = update == 2 and trial.id % 5 == 1
            search.tell(trial.id, -1e6 if crashed else score(trial.proposal))
        assert search.clipped == (update == 2)


@pytest.mark.parametrize("reward", [None, np.nan, np.inf, -np.inf])
def test_what_is_no_number_counts_as_failed(reward: float | None) -> None:
    search = AskTell(SPACE, SDR, n=2)
    for trial in search.ask():
        search.tell(trial.id, reward)
    assert [line["reward"] for line in search.history] == [None, None] and search.updates == 1
    assert np.isfinite(search.method.diagnostics.probabilities(search.state)).all()


def test_wrong_use_is_refused_and_a_method_of_so_many_updates_ends(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    one, other = (AskTell(SPACE, GAUSSIAN, n=2, path=path) for _ in range(2))
    one.tell(0, 1.0)
    refuses("changed by another process", other.tell, 1, 1.0, error=RuntimeError)
    refuses("trial 0 waits for no reward; waiting are 1", one.tell, 0, 1.0)
    refuses("seed is a field", one.tell, 1, 1.0, seed=3)
    refuses("n is 0", AskTell, SPACE, GAUSSIAN, n=0)
    ended = drive(AskTell(SPACE, SDR, n=N), 6 * N)
    assert ended.ask() == []
    refuses("none is waiting", ended.tell, 18, 1.0)
    wrong = "[]", "nonsense", '{"id": NaN}', '{"id": [1]}', '{"id": 0, "reward": "1"}'
    for line in wrong:
        path.write_text(f"{line}\n{{}}\n")
        refuses(r"history.jsonl: line 1", AskTell, SPACE, GAUSSIAN, n=N, path=path)


@pytest.mark.parametrize(
    "change", [dict(seed=1), dict(n=2), dict(method=sdr_jax.random_search(OTHER), space=OTHER)]
)
def test_the_history_of_another_search_is_refused(tmp_path: Path, change: dict) -> None:
    path = tmp_path / "history.jsonl"
    drive(AskTell(SPACE, GAUSSIAN, n=N, path=path), 4)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"history.jsonl: line \d does not belong to this search"):
        AskTell(**{"space": SPACE, "method": GAUSSIAN, "n": N, "path": path} | change)
    assert path.read_bytes() == before


def test_methods_run_on_the_cpu_where_there_is_a_gpu() -> None:
    # A second device stands for the GPU, the default device.
    code = """
import jax
from sdr_jax import AskTell, space
from sdr_jax.registry import make

jax.config.update("jax_default_device", jax.devices()[1])
attributes = space(list("abc"))
search = AskTell(attributes, make("surrogate", attributes), n=2)
for trial in search.ask():
    search.tell(trial.id, trial.id)
(device,) = {d for leaf in jax.tree.leaves(search.state) for d in getattr(leaf, "devices", set)()}
print(search.updates, device == jax.devices()[0], jax.numpy.ones(1).devices() == {jax.devices()[1]})
"""
    assert printed(code, XLA_FLAGS="--xla_force_host_platform_device_count=2") == ["1 True True"]
