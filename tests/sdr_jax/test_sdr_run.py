import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import (
    Method,
    Proposal,
    drive,
    ema,
    leave_one_out,
    random_search,
    refuse_failures,
    run,
    sdr,
    space,
    squared_percent,
)
from shell.errors import UserError

TARGET = jnp.asarray([0.85, 0.15, 0.05, 0.85, 0.05])
FIVE = space(list("abcde"), bins=[10, 10, 10, 10, 4], groups=[["a", "b"], ["c", "d", "e"]])


def bandit(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
    noise = 0.01 * jax.random.normal(rng_key, (len(proposals.centre),))
    return 1 - jnp.abs(proposals.centre - TARGET[None, :]).mean(axis=1) + noise


def centre(method: Method, seed: int, n: int, reward_fn: object = bandit) -> np.ndarray:
    state, _ = jax.jit(lambda key: run(key, method, reward_fn, n=n))(jax.random.key(seed))
    return np.asarray(method.solution(state).centre)


def test_the_whole_method_learns_under_one_jit() -> None:
    method = sdr(FIVE, baseline=leave_one_out(), normalise=True)
    actual = np.stack([centre(method, seed, n=4) for seed in range(2)])
    # Within a bin and a half of the optimum for every attribute and seed.
    assert np.abs(actual[:, :4] - TARGET[None, :4]).max() < 0.16
    assert np.abs(actual[:, 4] - 0.125).max() < 1e-6


def test_the_authors_options_learn_too() -> None:
    method = sdr(
        FIVE,
        baseline=ema(includes_current=True),
        transform=squared_percent,
        unoptimised="half",
    )
    found = bandit(jax.random.key(0), Proposal(*[jnp.asarray(centre(method, 0, n=4))[None]] * 2))
    random = 1 - jnp.abs(jnp.linspace(0.05, 0.95, 10)[:, None] - TARGET[None, :]).mean()
    assert found[0] > random + 0.2


TABLE = jnp.asarray(
    [[0, 0, 0, 0], [0.75, 0, 0, 0], [0.5, 0.5, 0, 0], [0.25, 0.25, 0.25, 0]]
)  # the nearer the building the better, but never in front of the tree


@pytest.mark.parametrize(
    ("groups", "expected"), [([["building", "tree"]], 0.75), ([["building"], ["tree"]], 0.5)]
)
def test_correlated_attributes_need_a_common_group(groups: list, expected: float) -> None:
    pair = space(["building", "tree"], bins=4, groups=groups)
    method = sdr(pair, baseline=leave_one_out(), updates_per_group=80)

    def table(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        # An undecided attribute is random: draw its bin.
        random = jax.random.uniform(rng_key, proposals.centre.shape)
        unit = proposals.centre + (random - 0.5) * proposals.width
        bins = jnp.clip((unit * 4).astype(int), 0, 3)
        return TABLE[bins[:, 0], bins[:, 1]]

    found = (centre(method, 0, n=16, reward_fn=table) * 4).astype(int)
    assert TABLE[found[0], found[1]] == expected


def test_run_is_the_loop_on_the_host() -> None:
    method = sdr(FIVE, updates_per_group=3, hidden=8)
    state, record = jax.jit(lambda key: run(key, method, bandit, n=2))(jax.random.key(7))
    assert record.actions.shape == (6, 2, 5)
    assert record.rewards.shape == (6, 2)
    assert record.info.group.tolist() == [0, 0, 0, 1, 1, 1]
    steps = list(drive(jax.random.key(7), method, bandit, n=2))
    np.testing.assert_array_equal([one.actions for _, one in steps], record.actions)
    driven, _ = steps[-1]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), driven, state)


def test_updates_must_be_known() -> None:
    with pytest.raises(ValueError, match="how many"):
        run(jax.random.key(0), random_search(FIVE), bandit)


@pytest.mark.parametrize(
    ("failed", "total", "fine"),
    [(0, 1, True), (1, 1, True), (2, 8, False), (3, 30, True), (4, 30, False), (7, 70, True)],
)
def test_a_tenth_of_the_evaluations_may_fail(failed: int, total: int, fine: bool) -> None:
    if fine:
        return refuse_failures(failed, total, "why")
    with pytest.raises(UserError, match=f"{failed} of {total} evaluations failed.*: why"):
        refuse_failures(failed, total, "why")
