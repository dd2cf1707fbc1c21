"""Augmentation keeps labels with their images, and does nothing where it is told to."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.augment import DRAWS, MIRROR, augment, blurred, coloured, draw, mirrored

seeds = st.integers(0, 2**32 - 1)


def random_batch(seed):
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 11, (4, 6, 8), dtype=np.uint8)
    images = rng.integers(0, 256, (4, 6, 8, 3), dtype=np.uint8)
    return rng, images, labels


def augmented(rng, images, labels, **switches):
    return augment(*map(jnp.asarray, (images, labels, draw(rng, len(images)))), **switches)


def test_mirror_by_hand():
    images = jnp.arange(6.0).reshape(2, 1, 3, 1)
    labels = jnp.arange(6, dtype=jnp.uint8).reshape(2, 1, 3)
    flipped, flipped_labels = mirrored(images, labels, jnp.array([0.4, 0.6]))
    np.testing.assert_array_equal(flipped[:, 0, :, 0], [[2, 1, 0], [3, 4, 5]])
    np.testing.assert_array_equal(flipped_labels[:, 0], [[2, 1, 0], [3, 4, 5]])


@given(seeds)
def test_labels_stay_aligned_with_images(seed):
    rng, images, labels = random_batch(seed)
    images[..., 0] = 20 * labels  # red tells the class
    x, y = augmented(rng, images, labels, colour=False, blur=False)
    np.testing.assert_array_equal(np.round(np.asarray(x[..., 0]) * 255), 20 * np.asarray(y, int))


@given(seeds)
def test_mirroring_twice_is_the_identity(seed):
    rng, images, labels = random_batch(seed)
    u = jnp.asarray(draw(rng, 4)[:, MIRROR])
    once = mirrored(jnp.asarray(images, jnp.float32), jnp.asarray(labels), u)
    twice = mirrored(*once, u)
    np.testing.assert_array_equal(twice[0], images)
    np.testing.assert_array_equal(twice[1], labels)


@given(seeds)
def test_the_middle_of_every_draw_changes_no_colour(seed):
    _, images, _ = random_batch(seed)
    x = jnp.asarray(images, jnp.float32) / 255
    np.testing.assert_allclose(coloured(x, jnp.full((4, DRAWS), 0.5)), x, atol=2e-4)


@given(seeds)
def test_images_stay_in_range_and_labels_untouched_by_colour(seed):
    rng, images, labels = random_batch(seed)
    x, y = augmented(rng, images, labels, mirror=False)
    assert x.shape == images.shape and x.dtype == jnp.float32
    assert 0 <= x.min() and x.max() <= 1
    np.testing.assert_array_equal(y, labels)
    x, y = augmented(rng, images, labels, mirror=False, colour=False, blur=False)
    np.testing.assert_allclose(x, images / 255.0, rtol=1e-6)
    np.testing.assert_array_equal(y, labels)


def test_blur_by_hand():
    spot = np.zeros((1, 3, 3, 1), np.float32)
    spot[0, 1, 1] = 16
    spread = blurred(jnp.asarray(spot), jnp.ones(1))[0, :, :, 0]
    np.testing.assert_allclose(spread, [[1, 2, 1], [2, 4, 2], [1, 2, 1]])
    np.testing.assert_allclose(blurred(jnp.asarray(spot), jnp.zeros(1)), spot)


@given(seeds)
def test_blur_leaves_flat_images_flat(seed):
    u = np.random.default_rng(seed).random((2, 2)).astype(np.float32)
    flat = jnp.broadcast_to(jnp.asarray(u[0])[:, None, None, None], (2, 5, 6, 3))
    np.testing.assert_allclose(blurred(flat, jnp.asarray(u[1])), flat, atol=1e-6)


def test_draws_are_the_same_for_the_same_seed():
    first, second = (draw(np.random.default_rng(3), 5, 2) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.shape == (5, 2, DRAWS) and first.dtype == np.float32
    assert first.mean() == pytest.approx(0.5, abs=0.1)
