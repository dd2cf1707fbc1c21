"""How unsure a net is of an image: of single pixels by hand, and which images come first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.uncertainty import ClassEntropy, class_entropy, uncertainties

SURE = 40.0


def test_one_sure_pixel_and_one_between_two_classes():
    scores = np.zeros((1, 2, 3), np.float32)
    scores[0, 0] = [SURE, 0, 0]
    scores[0, 1] = [0, SURE, SURE]
    own = class_entropy(scores)
    np.testing.assert_allclose(own.shares, [0.5, 0.25, 0.25], atol=1e-9)
    half = np.log(2) / np.log(3)
    np.testing.assert_allclose(own.entropy, [0, half / 4, half / 4], atol=1e-9)
    assert class_entropy(np.zeros((4, 4, 1), np.float32)).entropy == pytest.approx([0])


@given(st.integers(0, 2**32 - 1), st.floats(-50, 50))
def test_entropy_is_within_0_and_1_and_no_constant_changes_it(seed, constant):
    scores = np.random.default_rng(seed).normal(0, 3, (5, 6, 4)).astype(np.float32)
    own, other = class_entropy(scores), class_entropy(scores + np.float32(constant))
    assert 0 < own.entropy.sum() < 1 and own.shares.sum() == pytest.approx(1)
    np.testing.assert_allclose(other.entropy, own.entropy, atol=1e-4)
    even = class_entropy(0 * scores)
    assert even.entropy.sum() == pytest.approx(1)
    assert uncertainties([even, even]) == pytest.approx([1, 1])
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        np.testing.assert_allclose(class_entropy(1e4 * scores).entropy.sum(), 0, atol=1e-2)


def test_doubt_about_a_rare_class_counts_for_more_than_the_same_about_a_large_one():
    large = ClassEntropy(np.array([0.9, 0.1]), np.array([0.1, 0.0]))
    rare = ClassEntropy(np.array([0.9, 0.1]), np.array([0.0, 0.1]))
    first, second = uncertainties([large, rare])
    assert (first, second) == pytest.approx((0.1 / 0.9 / 2, 0.1 / 0.1 / 2))
