"""Group coordinate descent by itself, with a learner that only counts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import space
from sdr_jax.coordinate_descent import Descent, active, begin, begun, concat, descend, lay_out

SPACE = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["c"], ["b", "a"]])
GROUPS = lay_out(SPACE, updates_each=2)
CONCAT = jax.jit(lambda descent, sampled: concat(GROUPS, descent, sampled))
BEST = jnp.asarray([1, 4])  # of both slots


def learn(learner: dict, group: jax.Array) -> tuple[dict, jax.Array, jax.Array]:
    return {"x": learner["x"] + 1, "y": learner["y"] * 2}, BEST, group


@jax.jit
def step(descent: Descent, learners: dict) -> tuple[Descent, dict, jax.Array]:
    return descend(GROUPS, descent, learners, learn)


def after(updates: int) -> tuple[Descent, dict]:
    descent, learners = begin(GROUPS), {"x": jnp.zeros((2, 3)), "y": jnp.ones(2)}
    for _ in range(updates):
        descent, learners, _ = step(descent, learners)
    return descent, learners


def test_layout_by_hand() -> None:
    slots, group, slot, _ = GROUPS
    assert slots.members.tolist() == [[2, 3], [1, 0]]
    assert slots.present.tolist() == [[True, False], [True, True]]
    assert slots.bins.sum(axis=2).tolist() == [[2, 5], [5, 3]]
    assert group.tolist() == [1, 1, 0]
    assert slot.tolist() == [1, 0, 0]
    assert GROUPS.updates == 4


@pytest.mark.parametrize(
    ("updates", "turn", "fixed", "ever"),
    [
        (0, 0, [-1, -1, -1], []),
        (1, 0, [-1, -1, -1], [2]),
        (2, 1, [-1, -1, 1], [2]),
        (3, 1, [-1, -1, 1], [0, 1, 2]),
        (4, 1, [4, 1, 1], [0, 1, 2]),
        (6, 1, [4, 1, 1], [0, 1, 2]),  # after the end
    ],
)
def test_the_course_by_hand(updates: int, turn: int, fixed: list, ever: list) -> None:
    descent, learners = after(updates)
    assert active(GROUPS, descent) == turn
    assert descent.fixed.tolist() == fixed
    assert np.flatnonzero(begun(GROUPS, descent)).tolist() == ever
    done = min(updates, 4)
    assert descent.updates == done
    assert learners["y"].tolist() == [2.0 ** min(done, 2), 2.0 ** max(done - 2, 0)]


@given(st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_only_the_active_group_is_touched(updates: int, seed: int) -> None:
    descent, _ = after(updates)
    rng = np.random.default_rng(seed)
    learners = {"x": jnp.asarray(rng.normal(size=(2, 3))), "y": jnp.asarray(rng.normal(size=2))}
    moved, touched, info = step(descent, learners)
    for name in learners:
        still = np.arange(2) != int(info) if updates < 4 else np.ones(2, bool)
        old, new = np.asarray(learners[name]), np.asarray(touched[name])
        assert old[still].tobytes() == new[still].tobytes()
        assert np.all(old[~still] != new[~still])
    assert moved.updates == min(updates + 1, 4)


def test_the_concat_of_the_equation() -> None:
    sampled = jnp.asarray([[0, 2], [1, 0]])
    assert CONCAT(after(1)[0], sampled).tolist() == [[-1, -1, 0], [-1, -1, 1]]
    assert CONCAT(after(2)[0], sampled).tolist() == [[2, 0, 1], [0, 1, 1]]
    assert CONCAT(after(4)[0], sampled).tolist() == [[4, 1, 1]] * 2
