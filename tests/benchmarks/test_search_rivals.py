"""Search methods of other libraries; what all methods keep to is in test_sdr_every_method.py."""

import sys
from itertools import pairwise

import jax
import numpy as np
import pytest

from benchmarks.rivals import cma_es, gaussian_process, tpe
from sdr_jax import space
from sdr_jax.bins import bin_centres
from tests.conftest import refuses
from tests.sdr_jax.conftest import KEY, tell
from tests.trees import assert_same

SPACE = space(["a", "b", "c"], bins=[2, 10, 5])


@pytest.mark.parametrize(("method", "module", "package"), [
    (cma_es, "cmaes", "cmaes"), (tpe, "optuna", "optuna"),
    (gaussian_process, "sklearn", "scikit-learn"),
])  # fmt: skip
def test_a_missing_library_is_named_with_what_to_install(monkeypatch, method, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    refuses(rf"{package}: pip install {package}", method, SPACE, error=ImportError)


@pytest.mark.parametrize("make", [cma_es, tpe, gaussian_process])
def test_states_stay_valid(make) -> None:
    """As with the pure methods, nothing is changed in place."""
    method, other = make(SPACE), make(SPACE)
    state = method.init(KEY)
    for t in range(6):
        unknown, _ = other.sample(jax.random.key(t), state, 3)  # a state from elsewhere
        (first, _), (again, proposal) = (method.sample(jax.random.key(t), state, 3) for _ in "ab")
        np.testing.assert_array_equal(first, again)
        np.testing.assert_array_equal(first, unknown)
        (left, _), (state, _) = (tell(method, first, [1, 2, 3], state) for _ in "ab")
        assert_same(method.solution(left), method.solution(state))
        distance = np.abs(proposal.centre[..., None] - bin_centres(SPACE)[None])
        assert np.all(distance.min(axis=2) == 0)


def test_a_generation_is_filled_over_any_number_of_updates() -> None:
    method = cma_es(SPACE, population=6)
    rng = np.random.default_rng(0)
    actions, rewards = np.float32(rng.uniform(size=(14, 3))), np.float32(rng.uniform(size=14))
    ends = []
    for cuts in ([0, 14], [0, 1, 6, 9, 14]):
        state = None
        for a, b in pairwise(cuts):
            state, _ = tell(method, actions[a:b], rewards[a:b], state)
        assert (state.optimizer.generation, len(state.generation)) == (2, 2)
        ends.append(state.optimizer.mean)
    np.testing.assert_array_equal(*ends)


def test_cma_es_leaves_its_generator_alone_and_says_where_it_tries() -> None:
    method = cma_es(SPACE)
    rng = np.random.default_rng(0)
    rewards = np.float32(rng.uniform(size=28))
    state, _ = tell(method, np.float32(rng.uniform(size=(28, 3))), rewards)

    def left() -> list:
        return [np.asarray(part).tolist() for part in state.optimizer._rng.get_state()]

    before = left()
    method.sample(jax.random.key(1), state, 3)
    p = np.asarray(method.diagnostics.probabilities(state))
    assert left() == before
    _, proposals = method.sample(jax.random.key(2), state, 2000)
    for probabilities, column, bins in zip(
        p, np.asarray(proposals.centre).T, SPACE.bins, strict=True
    ):
        counts, _ = np.histogram(column, bins, (0, 1))
        np.testing.assert_allclose(probabilities[:bins], counts / 2000, atol=0.11)


def test_tpe_answers_with_the_best_evaluation() -> None:
    method = tpe(SPACE)
    state, _ = tell(method, [[0, 1, 2], [1, 9, 4], [1, 8, 3]], [0.1, 0.9, np.nan])
    np.testing.assert_allclose(method.solution(state).centre, [0.75, 0.95, 0.9], rtol=1e-6)
    p = np.asarray(method.diagnostics.probabilities(state))
    np.testing.assert_allclose(p[0, :2], [0.25, 0.75])
    np.testing.assert_allclose(p[1], [0.05] * 9 + [0.55], rtol=1e-5)


def test_a_gaussian_process_answers_with_the_highest_mean_not_the_luckiest() -> None:
    """One draw of a bin says more than the truth, and its neighbours and its repeats say less."""
    method = gaussian_process(space(["a"], bins=[10]))
    tried = np.asarray([2] * 8 + [7] * 5 + [*range(10)])
    worth = np.where(tried == 2, 1.0, 0.0) + np.tile([0.2, -0.2], 12)[: len(tried)]
    worth[8] = 1.5
    state, _ = tell(method, np.int32(tried[:, None]), worth)
    np.testing.assert_allclose(method.solution(state).centre, [0.25])


def test_a_gaussian_process_looks_where_it_expects_to_improve() -> None:
    """Rewards rise towards the last bins of both, so it samples there; by chance one time in 16."""
    method = gaussian_process(space(["a", "b"], bins=[8, 8]), startup=1)
    tried = np.asarray([[a, b] for a in range(0, 6, 2) for b in range(0, 6, 2)], np.int32)
    state, _ = tell(method, tried, tried.sum(axis=1))
    actions = np.asarray(method.sample(KEY, state, 3)[0])
    assert np.all(actions >= 4) and np.any(actions >= 6)


def test_a_gaussian_process_leaves_a_best_that_is_certain_for_bins_that_are_not() -> None:
    """Its expected gain is about 0, and that of bins without evaluations large, each time of another one."""
    method = gaussian_process(space(["a"], bins=[10]), startup=1)
    tried = np.asarray([4] * 20 + [0, 2, 8], np.int32)
    worth = np.where(tried == 4, 1.0, 0.0) + 0.05 * np.tile([1.0, -1.0], 12)[: len(tried)]
    state, _ = tell(method, tried[:, None], worth)
    np.testing.assert_allclose(method.solution(state).centre, [0.45])
    chosen = method.sample(KEY, state, 4)[0].ravel().tolist()
    assert len(set(chosen)) == 4 and not set(chosen) & set(tried.tolist())
