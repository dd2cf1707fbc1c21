"""What the methods that fit a model to all rewards learn from them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import Method, Proposal, actor_critic, linear, run_on_host, space

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
METHODS = {"actor_critic": actor_critic(SPACE), "linear": linear(SPACE)}


@pytest.fixture(params=METHODS)
def method(request: pytest.FixtureRequest) -> Method:
    return METHODS[request.param]


def test_an_effect_is_found_and_what_has_none_stays_wide(method: Method) -> None:
    """Only b matters, and noise hides the rest."""

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        noise = 0.2 * jax.random.normal(rng_key, proposals.centre.shape[:1])
        return 70 - 4 * jnp.abs(proposals.centre[:, 1] - 0.7) + noise

    state, record = run_on_host(jax.random.key(0), method, reward, 20, 4)
    solution, spread = method.solution(state), method.spread(state)
    np.testing.assert_allclose(solution.centre[1], 0.7, atol=1e-6)
    np.testing.assert_allclose(spread.width[1], 0.2, atol=0.15)
    others = np.asarray([0, 2, 3])
    assert np.mean(np.asarray(spread.width)[others]) > 0.6
    if method is METHODS["actor_critic"]:  # the other has no policy
        entropy = np.asarray(record.info.entropy)
        assert entropy[0] == pytest.approx(np.log([3, 5, 2, 4]).sum(), rel=1e-5)
        assert entropy[-1] < entropy[0] - 1


def test_interactions_within_a_group_are_learnt(method: Method) -> None:
    """Where d and a agree in sign it is good; neither matters alone."""

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        return (proposals.centre[:, 0] - 0.5) * (proposals.centre[:, 3] - 0.5)

    state, _ = run_on_host(jax.random.key(1), method, reward, 15, 4)
    centre = method.solution(state).centre
    assert float(reward(jax.random.key(0), Proposal(centre[None], centre[None]))[0]) > 0.12
