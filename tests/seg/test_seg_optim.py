"""Schedules and optimisers."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.optim import backbone_multiplier, deeplab_multiplier, descend, optimizer, poly_schedule

from .conftest import SEEDS, assert_close, refuses


def test_poly_decay_and_warm_up_by_hand():
    rates = poly_schedule(5e-4, 1000)
    assert rates.dtype == np.float32 and rates.shape == (1000,)
    assert rates[0] == pytest.approx(5e-4) and rates[500] == pytest.approx(5e-4 * 0.5**0.9)
    assert rates[-1] == pytest.approx(5e-4 * 0.001**0.9)
    rates = poly_schedule(1.0, 10, power=1.0, warmup=3)
    np.testing.assert_allclose(rates[:4], [0.25, 0.5 * 0.9, 0.75 * 0.8, 0.7], rtol=1e-6)


@given(st.integers(1, 300), st.floats(0.1, 3), st.integers(0, 40))
def test_rates_are_positive_and_fall_after_the_warm_up(steps, power, warmup):
    rates = poly_schedule(0.1, steps, power, warmup)
    assert (rates > 0).all() and rates.max() <= np.float32(0.1)
    assert (np.diff(rates[warmup:]) < 0).all()


@pytest.mark.parametrize(("multipliers", "of_fc8", "of_biases", "bias_decay"), [
    ("none", 1, 1, 0.1), ("deeplab", 10, 2, 0.0),
])  # fmt: skip
def test_two_sgd_steps_by_hand(multipliers, of_fc8, of_biases, bias_decay):
    transform = optimizer("sgd", 0.9, weight_decay=0.1, lr_multipliers=multipliers)
    layer = {"kernel": jnp.array([1.0]), "bias": jnp.array([1.0])}
    gradient = params = {"fc8_1": layer, "vgg16": {"conv1_1": layer}}
    state = transform.init(params)
    for _ in range(2):
        direction, state = transform.update(gradient, state, params)
        params = descend(params, direction, 0.5)

    def by_hand(rate, decay):
        first = 1 + decay
        after = 1 - rate * first
        return after - rate * (0.9 * first + 1 + decay * after)

    for params_of_layer, rate in (
        (params["vgg16"]["conv1_1"], 0.5),
        (params["fc8_1"], 0.5 * of_fc8),
    ):
        expected = {"kernel": by_hand(rate, 0.1), "bias": by_hand(rate * of_biases, bias_decay)}
        assert_close(params_of_layer, expected, rtol=1e-5)


@given(SEEDS)
def test_adam_is_optax_adam(seed):
    rng = np.random.default_rng(seed)
    transform, reference = optimizer("adam"), optax.adam(0.01)
    a = b = {"w": jnp.asarray(rng.normal(size=3), jnp.float32)}
    state_a, state_b = transform.init(a), reference.init(b)
    for _ in range(3):
        gradient = {"w": jnp.asarray(rng.normal(size=3), jnp.float32)}
        direction, state_a = transform.update(gradient, state_a, a)
        a = descend(a, direction, 0.01)
        updates, state_b = reference.update(gradient, state_b, b)
        b = optax.apply_updates(b, updates)
    assert_close(a, b, rtol=1e-5)


def test_multipliers_as_published_adam_takes_them_and_lion_is_unknown():
    layers = {"conv1_1/kernel": 1, "conv1_1/bias": 2, "fc6_2/kernel": 1, "norm1_1/scale": 1}
    for path, factor in (layers | {"fc8_4/kernel": 10, "fc8_4/bias": 20}).items():
        assert deeplab_multiplier(tuple(path.split("/"))) == factor
    for path, factor in {"backbone/block1/expand/kernel": 0.1, "head/score/kernel": 1}.items():
        assert backbone_multiplier(tuple(path.split("/"))) == factor
    transform = optimizer("adam", lr_multipliers="deeplab")
    params = {"fc8_1": {"kernel": jnp.array([1.0]), "bias": jnp.array([1.0])}}
    direction, _ = transform.update(params, transform.init(params), params)
    np.testing.assert_allclose(direction["fc8_1"]["kernel"], [10.0], rtol=1e-4)
    np.testing.assert_allclose(direction["fc8_1"]["bias"], [20.0], rtol=1e-4)
    refuses("unknown optimizer 'lion'; known optimizers: adam, sgd", optimizer, "lion")
