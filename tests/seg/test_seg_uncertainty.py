"""How unsure a net is of an image: of single pixels by hand, and which images come first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.uncertainty import Uncertainty, order, uncertainty


def test_one_sure_pixel_and_one_between_two_classes():
    scores = np.zeros((1, 2, 3), np.float32)
    scores[0, 0] = [60, 0, 0]
    scores[0, 1] = np.log([0.5, 0.3, 0.2])
    own = uncertainty(scores)
    assert own.margin == pytest.approx((0 + (1 - 0.2)) / 2)
    # Of four parts the upper two have no pixel.
    assert own.layout == pytest.approx([0, 0, 0, 0, 0, 0, 1, 0, 0, 0.5, 0.3, 0.2])
    assert uncertainty(np.zeros((4, 4, 3), np.float32)).margin == 1
    assert uncertainty(np.zeros((4, 4, 1), np.float32)) == (0, (1, 1, 1, 1))


@given(st.integers(0, 2**32 - 1), st.floats(-50, 50))
def test_no_constant_and_no_order_of_classes_changes_it_and_less_contrast_raises_it(seed, constant):
    rng = np.random.default_rng(seed)
    scores = rng.normal(0, 3, (5, 6, 4)).astype(np.float32)
    own = uncertainty(scores).margin
    assert 0 < own < 1 and uncertainty(scores / 2).margin > own
    assert uncertainty(scores + np.float32(constant)).margin == pytest.approx(own, abs=1e-4)
    assert uncertainty(scores[..., rng.permutation(4)]).margin == pytest.approx(own)


def test_a_neighbour_of_the_first_comes_after_a_surer_image_of_another_place():
    here, near, there = (0.0, 1.0), (0.01, 0.99), (1.0, 0.0)
    own = [Uncertainty(0.7, there), Uncertainty(0.9, here), Uncertainty(0.8, near)]
    assert order(own, 1) == [1, 2, 0]  # alone, the least sure is what counts
    assert order(own, 2) == order(own, 3) == [1, 0, 2]
    assert order([], 3) == []


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_each_image_is_in_the_order_once_and_those_behind_go_by_margin(seed, first):
    rng = np.random.default_rng(seed)
    own = [Uncertainty(float(m), tuple(rng.random(4).tolist())) for m in rng.random(9).round(1)]
    found = order(own, first)
    assert sorted(found) == list(range(9))
    rest = [own[k].margin for k in found[first:]]
    assert rest == sorted(rest, reverse=True)
    assert own[found[0]].margin == max(each.margin for each in own)
    same = [own[3]] * 5
    assert sorted(order(same, 5)) == [0, 1, 2, 3, 4]
