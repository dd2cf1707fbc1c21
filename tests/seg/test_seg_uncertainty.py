"""How unsure a net is of an image: of single pixels by hand, and its properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seg.uncertainty import mean_margin


def test_one_sure_pixel_and_one_between_two_classes():
    scores = np.zeros((1, 2, 3), np.float32)
    scores[0, 0] = [60, 0, 0]
    scores[0, 1] = np.log([0.5, 0.3, 0.2])
    assert mean_margin(scores) == pytest.approx((0 + (1 - 0.2)) / 2)
    assert mean_margin(np.zeros((4, 4, 3), np.float32)) == 1
    assert mean_margin(np.zeros((4, 4, 1), np.float32)) == 0


@given(st.integers(0, 2**32 - 1), st.floats(-50, 50))
def test_no_constant_and_no_order_of_classes_changes_it_and_less_contrast_raises_it(seed, constant):
    rng = np.random.default_rng(seed)
    scores = rng.normal(0, 3, (5, 6, 4)).astype(np.float32)
    own = mean_margin(scores)
    assert 0 < own < 1 and mean_margin(scores / 2) > own
    assert mean_margin(scores + np.float32(constant)) == pytest.approx(own, abs=1e-4)
    assert mean_margin(scores[..., rng.permutation(4)]) == pytest.approx(own)
