"""Cross-entropy and soft Jaccard loss with ignored pixels, and class weights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from seg.losses import class_shares, cross_entropy, soft_jaccard, weights_of_shares

from .conftest import SEEDS, assert_close, normal

CLASSES = 5


def test_loss_and_class_weights_by_hand():
    labels = jnp.array([[0, 1, 255]], jnp.uint8)
    assert cross_entropy(jnp.zeros((1, 3, 7)), labels) == pytest.approx(np.log(7), rel=1e-6)
    logits = jnp.log(jnp.array([[0.5, 0.5], [0.8, 0.2], [0.1, 0.9]]))
    labels = jnp.array([0, 1, 255], jnp.uint8)
    weights = jnp.array([1.0, 3.0])
    expected = (1 * np.log(2) + 3 * np.log(5)) / 4
    assert cross_entropy(logits, labels, weights) == pytest.approx(expected, rel=1e-6)
    labels = np.array([[[0, 0, 0, 1], [255, 255, 255, 255]]], np.uint8)
    raw = np.array([0.76, 0.26, 0.01]) ** -0.75
    weights, ignored = (
        weights_of_shares(class_shares(image, 3)) for image in (labels, np.full_like(labels, 255))
    )
    np.testing.assert_allclose(weights, raw / raw.mean(), rtol=1e-6)
    np.testing.assert_allclose(ignored, np.ones(3))


@pytest.mark.parametrize("weights", [None, jnp.arange(1.0, CLASSES + 1)])
def test_all_void_is_zero_with_zero_gradient(weights):
    labels = jnp.full((2, 4, 3), 255, jnp.uint8)
    logits = jnp.full((2, 4, 3, CLASSES), 3.0)
    loss, gradient = jax.value_and_grad(cross_entropy)(logits, labels, weights)
    assert loss == 0 and not gradient.any() and jnp.isfinite(gradient).all()


def test_the_soft_jaccard_loss_by_hand():
    """Of three classes two occur: the third is not in the mean, though it has probability."""
    p = np.array([[0.5, 0.3, 0.2], [0.2, 0.7, 0.1], [0.1, 0.8, 0.1], [0.9, 0.1, 0.0]], np.float32)
    labels = jnp.array([[0, 1], [1, 255]], jnp.uint8)
    logits = jnp.log(jnp.asarray(p) + 1e-12).reshape(2, 2, 3)
    first = (0.5 + 1) / (0.5 + 0.2 + 0.1 + 1 - 0.5 + 1)
    second = (0.7 + 0.8 + 1) / (0.3 + 0.7 + 0.8 + 2 - 1.5 + 1)
    expected = 1 - (first + second) / 2
    assert soft_jaccard(logits, labels) == pytest.approx(expected, rel=1e-5)
    right = 50 * jax.nn.one_hot(labels, 3)
    assert soft_jaccard(right, labels) == pytest.approx(0, abs=1e-6)
    void = jnp.full((2, 2), 255, jnp.uint8)
    loss, gradient = jax.value_and_grad(soft_jaccard)(logits, void)
    assert loss == 0 and not gradient.any()


@settings(max_examples=8)
@given(SEEDS)
def test_loss_and_gradient_are_those_of_the_formula(seed):
    rng = np.random.default_rng(seed)
    labels = np.where(rng.random((2, 4, 3)) < 0.3, 255, rng.integers(0, CLASSES, (2, 4, 3)))
    labels[0, 0, 0] = 1
    logits, labels = normal(2, 4, 3, CLASSES, seed=seed), jnp.asarray(labels, jnp.uint8)
    weights = jnp.asarray(rng.uniform(0.5, 2, CLASSES), jnp.float32)

    def formula(logits, weights):
        picked = jax.nn.one_hot(labels, CLASSES)  # zeros where ignored
        nats = -jnp.sum(picked * jax.nn.log_softmax(logits), axis=-1)
        return jnp.sum(nats * (picked @ weights)) / jnp.sum(picked @ weights)

    def loss_of(logits, weights):
        return cross_entropy(logits, labels, weights)

    result, expected = (jax.value_and_grad(f, (0, 1))(logits, weights) for f in (loss_of, formula))
    assert_close(result, expected, atol=1e-5)
    unweighted = jax.value_and_grad(cross_entropy)(logits, labels)
    assert_close(unweighted, jax.value_and_grad(formula)(logits, jnp.ones(CLASSES)), atol=1e-5)
