"""From linear radiance to the stored image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.sensor import CameraResponse, develop

QUIET = CameraResponse(noise=0.0)


def flat(value, size=16):
    return np.full((size, size, 3), value, np.float32)


def shot(radiance, response=QUIET, seed=0):
    return develop(radiance, response, np.random.default_rng(seed))


def test_a_grey_wall_by_hand():
    # The tone curve x / (1 + x^4)^(1/4), then sRGB.
    x = 0.4 / (1 + 0.4**4) ** 0.25
    expected = round(255 * (1.055 * x ** (1 / 2.4) - 0.055))
    assert (shot(flat(0.4), QUIET._replace(exposure=1.0)) == expected).all()


def test_black_is_black_and_the_sun_is_white():
    assert (shot(flat(0)) == 0).all()
    assert (shot(flat(50)) == 255).all()


@given(st.floats(0, 2), st.floats(0, 2))
def test_more_light_is_never_darker(a, b):
    low, high = sorted((a, b))
    assert shot(flat(low)).max() <= shot(flat(high)).min()


def test_white_balance_gamma_and_exposure_do_what_they_say():
    grey = shot(flat(0.3)).mean()
    warm = shot(flat(0.3), QUIET._replace(gain=(1.2, 1.0, 0.8))).mean(axis=(0, 1))
    assert warm[0] > warm[1] > warm[2]
    assert shot(flat(0.3), QUIET._replace(gamma=1.3)).mean() < grey
    assert shot(flat(0.3), QUIET._replace(exposure=2.0)).mean() > grey


def test_blur_keeps_the_mean_and_softens_edges():
    edge = flat(0.1)
    edge[:, 8:] = 0.6
    sharp, soft = (shot(edge, QUIET._replace(blur=b)).astype(float) for b in (0, 1.5))
    assert soft.mean() == pytest.approx(sharp.mean(), abs=1)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.5 * np.abs(np.diff(sharp, axis=1)).max()


def test_noise_has_the_stated_strength_and_grows_with_the_signal():
    response = CameraResponse(noise=0.02)
    spread = {}
    for value in (0.02, 0.2):
        clean, noisy = shot(flat(value, 128)), shot(flat(value, 128), response)
        signal = clean.mean() / 255
        spread[value] = noisy.std()
        assert noisy.mean() == pytest.approx(clean.mean(), abs=0.5)
        assert noisy.std() == pytest.approx(255 * 0.02 * np.sqrt(0.2 + 1.6 * signal), rel=0.05)
    assert spread[0.2] > spread[0.02]


def test_the_same_generator_gives_the_same_grain():
    response = CameraResponse()
    assert np.array_equal(shot(flat(0.3), response, 1), shot(flat(0.3), response, 1))
    assert not np.array_equal(shot(flat(0.3), response, 1), shot(flat(0.3), response, 2))


def test_the_input_is_left_alone():
    radiance = flat(0.5)
    shot(radiance, CameraResponse(blur=1.0))
    assert (radiance == 0.5).all()
