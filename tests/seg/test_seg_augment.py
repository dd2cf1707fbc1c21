"""Augmentation keeps labels with their images, and does nothing where it is switched off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

import seg.augment
from seg import TrainSettings
from seg.augment import DRAWS, augment, blurred, coloured, draw, mirrored, mixed, noisy, scaled
from seg.views import view_images, view_labels, views

from .conftest import SEEDS, pixels


def random_batch(seed):
    images, labels = pixels(4, 6, 8, 3, seed=seed), pixels(4, 6, 8, seed=seed + 1, below=11)
    images[..., 0] = 20 * labels  # red tells the class
    return np.random.default_rng(seed), images, labels


def augmented(rng, images, labels, **switches):
    arrays = map(jnp.asarray, (images, labels, draw(rng, len(images))))
    return augment(*arrays, TrainSettings(**switches).augment_spec, jax.random.key(0))


def test_mirror_and_blur_by_hand():
    labels = jnp.arange(6, dtype=jnp.uint8).reshape(2, 1, 3)
    flipped = mirrored(1.0 * labels[..., None], labels, jnp.array([0.4, 0.6]))
    for mirrored_array in (flipped[0][..., 0], flipped[1]):
        np.testing.assert_array_equal(mirrored_array[:, 0], [[2, 1, 0], [3, 4, 5]])
    spot = jnp.zeros((1, 3, 3, 1)).at[0, 1, 1].set(16)
    spread = blurred(spot, jnp.ones(1))[0, :, :, 0]
    np.testing.assert_allclose(spread, [[1, 2, 1], [2, 4, 2], [1, 2, 1]])
    np.testing.assert_allclose(blurred(spot, jnp.zeros(1)), spot)
    flat = jnp.full((2, 5, 6, 3), 0.7)  # borders, too
    np.testing.assert_allclose(blurred(flat, jnp.array([0.4, 1.0])), flat, atol=1e-6)


@settings(max_examples=8)
@given(SEEDS)
def test_images_stay_in_range_and_labels_aligned_and_untouched_by_colour(seed):
    rng, images, labels = random_batch(seed)
    x, y = augmented(rng, images, labels, colour=False, blur=False)
    np.testing.assert_array_equal(np.round(np.asarray(x[..., 0]) * 255), 20 * np.asarray(y, int))
    x, y = augmented(rng, images, labels, mirror=False, mix=True, noise=True)
    assert x.shape == images.shape and x.dtype == jnp.float32
    assert 0 <= x.min() and x.max() <= 1
    np.testing.assert_array_equal(y, labels)
    x, y = augmented(rng, images, labels, mirror=False, colour=False, blur=False)
    np.testing.assert_allclose(x, images / 255.0, rtol=1e-6)
    np.testing.assert_array_equal(y, labels)


@settings(max_examples=8)
@given(SEEDS)
def test_the_middle_of_every_draw_changes_no_colour(seed):
    _, images, labels = random_batch(seed)
    x, middle = jnp.asarray(images, jnp.float32) / 255, jnp.full((4, DRAWS), 0.5)
    np.testing.assert_allclose(coloured(x, middle), x, atol=2e-4)
    np.testing.assert_allclose(mixed(x, middle), x, atol=1e-6)
    same, named = scaled(x, jnp.asarray(labels), middle)
    np.testing.assert_array_equal(named, labels)
    np.testing.assert_allclose(same, x, atol=1e-5)


def test_scaling_by_hand():
    """Twice as large, cut at the lower right; half as large, at the upper left."""
    image = jnp.arange(16.0).reshape(1, 4, 4, 1) / 16
    labels = jnp.arange(16, dtype=jnp.uint8).reshape(1, 4, 4)
    x, y = scaled(image, labels, jnp.ones((1, DRAWS)))
    np.testing.assert_array_equal(y[0], np.repeat(np.repeat([[10, 11], [14, 15]], 2, 0), 2, 1))
    np.testing.assert_allclose(x[0, 3, 3, 0], 15 / 16)
    np.testing.assert_allclose(x[0, 2, 1:3, 0], np.array([13.25, 13.75]) / 16, atol=1e-6)
    x, y = scaled(image, labels, jnp.zeros((1, DRAWS)))
    np.testing.assert_array_equal(y[0], [[5, 7, 255, 255], [13, 15, 255, 255]] + [[255] * 4] * 2)
    np.testing.assert_allclose(x[0, 2:], seg.augment.GREY, atol=1e-6)
    # Small pixels are averages: those around the first 2x2, weighted by their distance.
    assert 2.5 / 16 < x[0, 0, 0, 0] < 5 / 16


@settings(max_examples=8)
@given(SEEDS)
def test_scaled_labels_stay_with_their_pixels(seed):
    """Big flat squares: away from borders, picture and label tell the same."""
    rng = np.random.default_rng(seed)
    labels = np.kron(rng.integers(0, 5, (2, 3, 4)), np.ones((1, 8, 8), int)).astype(np.uint8)
    images = jnp.asarray(labels[..., None] / 10.0, jnp.float32)
    x, y = map(np.asarray, scaled(images, jnp.asarray(labels), jnp.asarray(draw(rng, 2))))
    inside = y != 255
    assert inside.any() and (np.abs(x[..., 0] * 10 - y) < 1e-3)[inside].mean() > 0.35
    np.testing.assert_allclose(x[~inside], seg.augment.GREY, atol=1e-5)


def test_mixing_keeps_grey_noise_has_its_size_and_draws_repeat():
    grey = jnp.full((2, 32, 32, 3), 0.5)
    np.testing.assert_allclose(mixed(grey, jnp.asarray(draw(np.random.default_rng(0), 2))), grey)
    red = jnp.zeros((1, 1, 1, 3)).at[..., 0].set(0.8)
    pink = mixed(red, jnp.ones((1, DRAWS)))[0, 0, 0]
    np.testing.assert_allclose(pink, [0.4, 0.2, 0.2], atol=1e-6)
    x = noisy(jax.random.key(0), grey, jnp.array([0.0, 1.0]))
    np.testing.assert_array_equal(x[0], grey[0])
    assert 0.035 < float(jnp.std(x[1])) < 0.045
    first, second = (draw(np.random.default_rng(3), 5, 2) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.shape == (5, 2, DRAWS) and first.dtype == np.float32
    assert first.mean() == pytest.approx(0.5, abs=0.1)


def test_views_are_the_images_then_augmented_ones():
    _, images, labels = random_batch(0)

    def views_of(settings, indices=slice(None)):
        x, y = images[indices], labels[indices]
        arrays = view_images(x, settings), view_labels(x, y, settings)
        for array, array_of_views in zip(arrays, views(x, y, settings), strict=True):
            np.testing.assert_array_equal(array, array_of_views)
        return arrays

    view_rows, named = views_of(TrainSettings(colour=False, blur=False, views=3))
    turned = images[:, :, ::-1]
    np.testing.assert_array_equal(view_rows, np.concatenate([images, turned, images]))
    np.testing.assert_array_equal(named * 20, view_rows[..., 0])
    full = TrainSettings(scale=True, mix=True, noise=True, views=2)
    view_rows, named = views_of(full)
    assert (
        view_rows.shape == (8, 6, 8, 3) and named.shape == (8, 6, 8) and view_rows.dtype == np.uint8
    )
    np.testing.assert_array_equal(view_rows[:4], images)
    assert not np.array_equal(view_rows[4:], turned) and (named[4:] == 255).any()
    np.testing.assert_array_equal(view_rows, views_of(full)[0])
    # An image's views do not depend on the other images.
    for part, whole in zip(views_of(full, slice(1, 3)), (view_rows, named), strict=True):
        np.testing.assert_array_equal(part, whole[[1, 2, 5, 6]])
    np.testing.assert_array_equal(views_of(TrainSettings(views=1))[0], images)
