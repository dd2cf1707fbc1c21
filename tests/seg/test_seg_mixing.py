"""Images mixed with a training set: how often they are drawn, their weight, what a network learns of them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg import TrainSettings, predict
from seg.data import LabelledImages
from seg.losses import class_shares, weights_of_shares
from seg.mixing import batch_indices, extra_count, mean_share, mixed
from seg.pyramid import channel_statistics, features
from seg.step import plan
from seg.train import train
from seg.views import view_images

from .conftest import SEEDS, assert_close, assert_same, pixels, refuses

FROZEN = TrainSettings(net="lite0", steps=3, batch=4, warmup=0)
IMAGES, LABELS = pixels(6, 48, 64, 3), pixels(6, 48, 64, seed=1, below=3)


@given(SEEDS, st.floats(0.01, 0.99), st.integers(1, 40), st.integers(1, 40))
def test_every_batch_holds_the_share_and_every_image_its_part(seed, share, first, few):
    steps, batch = 30, 4
    indices = batch_indices(np.random.default_rng(seed), (first, few), share, steps * batch)
    is_extra = indices.reshape(steps, batch) >= first
    assert set(is_extra.sum(1)) <= {np.floor(share * batch), np.ceil(share * batch)}
    assert (
        is_extra.sum() == extra_count(share, steps * batch)
        and abs(is_extra.sum() - share * 120) <= 0.5
    )
    counts = np.bincount(indices, minlength=first + few)
    for part in (counts[:first], counts[first:]):
        assert len(part) in (first, few) and np.ptp(part) <= 1


@given(SEEDS, st.floats(0.01, 0.99), st.floats(0, 1))
def test_a_share_changes_linearly_from_the_first_batch_to_the_last(seed, share, last):
    steps, batch = 40, 4
    indices = batch_indices(np.random.default_rng(seed), (30, 5), share, steps * batch, last)
    extra_images = (indices >= 30).reshape(steps, batch).sum(1)
    expected = batch * (share + (last - share) * (np.arange(steps) + 0.5) / steps)
    assert np.abs(np.cumsum(extra_images) - np.cumsum(expected)).max() <= 1
    assert abs(extra_images.sum() - extra_count(mean_share(share, last), steps * batch)) <= 1
    same = batch_indices(np.random.default_rng(seed), (30, 5), share, steps * batch, share)
    np.testing.assert_array_equal(
        same, batch_indices(np.random.default_rng(seed), (30, 5), share, steps * batch)
    )


def test_a_set_with_none_beside_it_is_drawn_as_ever():
    settings = TrainSettings(steps=5, batch=4, warmup=4)
    alone, same = plan(7, 6, settings), plan(7, [6], settings, 1.0)
    np.testing.assert_array_equal(alone.batch_indices, same.batch_indices)
    rng = np.random.default_rng(7)
    whole = np.concatenate([rng.permutation(6) for _ in range(4)])[:20]
    np.testing.assert_array_equal(alone.batch_indices.ravel(), whole)


def test_parts_that_count_by_their_size_are_the_whole():
    maps = features(IMAGES, FROZEN)
    parts = [tuple(m[where] for m in maps) for where in (slice(0, 4), slice(4, 6))]
    statistics = mixed([4 / 6, 2 / 6], [channel_statistics(part) for part in parts])
    assert_close(statistics, channel_statistics(maps), rtol=2e-3, atol=2e-5)
    second = channel_statistics(parts[1])
    np.testing.assert_allclose(mixed([0.5, 0.5], [second, second])[1], second[1], rtol=1e-5)
    shares = [class_shares(part, 3) for part in (LABELS[:4], LABELS[4:])]
    weights = weights_of_shares(shares[0] * 4 / 6 + shares[1] * 2 / 6)
    np.testing.assert_allclose(weights, weights_of_shares(class_shares(LABELS, 3)))


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_a_net_believes_whom_it_sees_more_often(share):
    """Both sets show the same images and call them by different names."""
    settings = TrainSettings(steps=40, batch=10, warmup=2, lr=1e-2, weighted=False)
    images, blank = pixels(2, 32, 32, 3, seed=1), np.zeros((2, 32, 32), np.uint8)
    extra = LabelledImages(images[:1], blank[:1] + 1)
    params = train(0, images, blank, settings, 2, extra=extra, share=share)
    share_of_ones = np.mean(predict(params, images, settings, 2))
    assert share_of_ones == pytest.approx(float(share > 0.5), abs=0.05)


def test_features_beside_are_those_computed_and_set_the_head_s_statistics():
    fit = partial(train, 0, IMAGES[:4], LABELS[:4], FROZEN, 3)
    few = LabelledImages(IMAGES[4:], LABELS[4:])
    computed, alone = fit(extra=few), fit()
    views = [features(view_images(part, FROZEN), FROZEN) for part in (IMAGES[:4], IMAGES[4:])]
    assert_same(computed, fit(features=views[0], extra=few._replace(features=views[1])))
    mean, _ = mixed([0.5, 0.5], [channel_statistics(view) for view in views])
    np.testing.assert_array_equal(computed["statistics"]["head"]["mean"], mean)
    one, other = (net["params"]["head"]["mix"]["kernel"] for net in (alone, computed))
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(("change", "message"), [
    ({"share": 0.0}, r"must lie in \(0, 1\); got 0"),
    ({"share": 1.0}, r"must lie in \(0, 1\); got 1"),
    ({"images": IMAGES[:2, :40]}, r"size of the others, \(48, 64, 3\); got \(40, 64, 3\)"),
    ({"labels": LABELS[:2] + 3}, "label 5 is none of 3 classes"),
    ({"labels": LABELS[:1]}, "one per pixel"),
])  # fmt: skip
def test_what_cannot_stand_beside_is_refused(change, message):
    few = LabelledImages(IMAGES[:2], LABELS[:2])
    share = change.pop("share", 0.5)
    net = partial(train, extra=few._replace(**change), share=share)
    refuses(message, net, 0, IMAGES, LABELS, replace(FROZEN, net="compact"), 3)
