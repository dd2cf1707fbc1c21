"""How unsure a network is of an image: of single pixels by hand, and which images come first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.uncertainty import Uncertainty, order, uncertainty


def test_one_sure_pixel_and_one_between_two_classes():
    scores = np.zeros((1, 2, 3), np.float32)
    scores[0, 0] = [60, 0, 0]
    scores[0, 1] = np.log([0.5, 0.3, 0.2])
    result = uncertainty(scores)
    assert result.margin == pytest.approx((0 + (1 - 0.2)) / 2)
    # Of four parts the upper two have no pixel.
    assert result.layout == pytest.approx([0, 0, 0, 0, 0, 0, 1, 0, 0, 0.5, 0.3, 0.2])
    assert uncertainty(np.zeros((4, 4, 3), np.float32)).margin == 1
    assert uncertainty(np.zeros((4, 4, 1), np.float32)) == (0, (1, 1, 1, 1))


@given(st.integers(0, 2**32 - 1), st.floats(-50, 50))
def test_no_constant_and_no_order_of_classes_changes_it_and_less_contrast_raises_it(seed, constant):
    rng = np.random.default_rng(seed)
    scores = rng.normal(0, 3, (5, 6, 4)).astype(np.float32)
    margin = uncertainty(scores).margin
    assert 0 < margin < 1 and uncertainty(scores / 2).margin > margin
    assert uncertainty(scores + np.float32(constant)).margin == pytest.approx(margin, abs=1e-4)
    assert uncertainty(scores[..., rng.permutation(4)]).margin == pytest.approx(margin)


def test_a_neighbour_of_the_first_comes_after_a_surer_image_of_another_place():
    layout, close_layout, other_layout = (0.0, 1.0), (0.01, 0.99), (1.0, 0.0)
    uncertainties = [
        Uncertainty(0.7, other_layout),
        Uncertainty(0.9, layout),
        Uncertainty(0.8, close_layout),
    ]
    assert order(uncertainties, 1) == [1, 2, 0]  # alone, the least sure is what counts
    assert order(uncertainties, 2) == order(uncertainties, 3) == [1, 0, 2]
    assert order([], 3) == []


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_each_image_is_in_the_order_once_and_those_behind_go_by_margin(seed, first):
    rng = np.random.default_rng(seed)
    uncertainties = [
        Uncertainty(float(m), tuple(rng.random(4).tolist())) for m in rng.random(9).round(1)
    ]
    indices = order(uncertainties, first)
    assert sorted(indices) == list(range(9))
    rest = [uncertainties[k].margin for k in indices[first:]]
    assert rest == sorted(rest, reverse=True)
    assert uncertainties[indices[0]].margin == max(image.margin for image in uncertainties)
    same = [uncertainties[3]] * 5
    assert sorted(order(same, 5)) == [0, 1, 2, 3, 4]
