"""From linear radiance to the stored image."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.render.sensor import KEY, MIDDLE, CameraResponse, camera_of_street, develop
from tests.scene.conftest import SEEDS

QUIET = CameraResponse(noise=0.0)
OFF = dict.fromkeys(("noise", "meter", "vignette", "halo"), 0.0)
PLAIN = CameraResponse(gain=(1, 1, 1), contrast=1.0, saturation=1.0, **OFF)


def flat(value, size=16):
    return np.full((size, size, 3), value, np.float32)


def shot(radiance, response=QUIET, seed=0):
    return develop(radiance, response, np.random.default_rng(seed))


def street(size=64):
    """Something with edges and texture, dark below and bright above."""
    scene = np.random.default_rng(5).uniform(0.02, 0.2, (size, size, 3)).astype(np.float32)
    scene[: size // 2] += 1.0
    return cv2.GaussianBlur(scene, (0, 0), 1.0)


def edge(bright, dark=0.1, at=8, size=16):
    radiance = flat(dark, size)
    radiance[:, at:] = bright
    return radiance


def test_a_grey_wall_by_hand_and_the_meter_pushes_a_street_down_under_a_bright_sky():
    # The tone curve x / (1 + x^2)^(1/2), white at 3, then sRGB.
    x = 0.4 / (1 + 0.4**2) ** 0.5 * (1 + 3**2) ** 0.5 / 3
    expected = round(255 * (1.055 * x ** (1 / 2.4) - 0.055))
    assert np.abs(shot(flat(0.4), PLAIN).astype(int) - expected).max() <= 1
    meter = PLAIN._replace(meter=0.5)
    assert np.array_equal(shot(flat(KEY), meter), shot(flat(KEY), PLAIN))
    half = PLAIN._replace(exposure=0.5)  # of the stops: four times the light counts as twice
    assert np.array_equal(shot(flat(4 * KEY), meter), shot(flat(4 * KEY), half))
    dull, bright = flat(0.1), flat(0.1)
    bright[:8] = 1.5
    assert shot(bright, meter)[8:].mean() < shot(dull, meter)[8:].mean() - 20


@given(st.floats(0, 2), st.floats(0, 2))
def test_more_light_is_never_darker(a, b):
    for response in (PLAIN, QUIET):
        assert (shot(flat(min(a, b)), response) <= shot(flat(max(a, b)), response)).all()
        assert (shot(flat(0), response) == 0).all() and (shot(flat(50), response) == 255).all()


def test_contrast_white_balance_gamma_and_exposure_do_what_they_say():
    for value, sign in ((0.5 * MIDDLE, -1), (MIDDLE, 0), (2 * MIDDLE, 1)):
        soft, hard = (shot(flat(value), PLAIN._replace(contrast=c)).mean() for c in (1.0, 1.4))
        assert np.sign(round((hard - soft) / 2)) == sign
    # And without saturation all is grey.
    assert np.ptp(shot(street(), PLAIN._replace(saturation=0.0)), axis=2).max() <= 1
    red, green, blue = shot(flat(0.3), QUIET._replace(gain=(1.2, 1.0, 0.8))).mean(axis=(0, 1))
    assert red > green > blue
    changes = {"gamma": 1.3}, {}, {"exposure": 2.0}
    dark, middle, bright = (shot(flat(0.3), QUIET._replace(**c)).mean() for c in changes)
    assert dark < middle < bright


def test_a_vignette_darkens_corners_only_and_a_fringe_moves_red_outwards_only():
    image = shot(flat(0.3, 33), PLAIN._replace(vignette=0.4))[..., 0].astype(int)
    assert image[0, 0] < image[0, 16] < image[16, 16] == shot(flat(0.3, 33), PLAIN)[0, 0, 0]
    border = edge(0.8, 0.02, 60, 65)
    image, clean = shot(border, PLAIN._replace(fringe=2.0)), shot(border, PLAIN)
    assert np.array_equal(image[..., 1:], clean[..., 1:])
    assert image[32, 60, 0] < clean[32, 60, 0] - 20


def test_blur_keeps_the_mean_and_softens_edges_and_a_halo_makes_them_overshoot():
    sharp, soft = (shot(edge(0.6), PLAIN._replace(blur=b)).astype(float) for b in (0, 1.5))
    assert soft.mean() == pytest.approx(sharp.mean(), abs=1)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.5 * np.abs(np.diff(sharp, axis=1)).max()
    image, clean = shot(edge(0.5), PLAIN._replace(halo=0.3)), shot(edge(0.5), PLAIN)
    assert image[4, 7, 0] < clean[4, 7, 0] and image[4, 8, 0] > clean[4, 8, 0]
    assert np.array_equal(image[:, :6], clean[:, :6])


def test_noise_has_the_stated_strength_and_grows_with_the_signal():
    spread = []
    for value in (0.02, 0.2):
        clean, noisy = (shot(flat(value, 256), PLAIN._replace(noise=n)) for n in (0.0, 0.02))
        spread.append(255 * 0.02 * np.sqrt(0.2 + 1.6 * clean.mean() / 255))
        assert noisy.mean() == pytest.approx(clean.mean(), abs=0.75)  # both are rounded
        assert noisy.std() == pytest.approx(spread[-1], rel=0.05)
    assert spread[1] > 1.2 * spread[0]


def test_noise_grows_with_what_the_meter_makes_of_the_light():
    response = PLAIN._replace(meter=1.0, noise=0.02)
    dim, bright = (
        (
            shot(flat(v, 256), response)
            - shot(flat(v, 256), response._replace(noise=0.0)).astype(float)
        )
        for v in (KEY / 9, KEY)
    )
    assert dim.std() == pytest.approx(3 * bright.std(), rel=0.05)


def test_the_same_generator_gives_the_same_grain_and_jpeg_keeps_the_colours():
    radiance, full = flat(0.5), CameraResponse(blur=1.0, fringe=1.0, jpeg=80)
    one, same, other = (shot(radiance, full, seed) for seed in (1, 1, 2))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    assert (radiance == 0.5).all()
    clean, low, high = (shot(street(), PLAIN._replace(jpeg=q)).astype(int) for q in (0, 20, 95))
    assert np.abs(low - clean).mean() > 1.5 * np.abs(high - clean).mean() > 0
    assert (shot(flat((0.5, 0.05, 0.02)), PLAIN._replace(jpeg=95))[..., 0] > 150).all()


@given(SEEDS)
def test_every_street_has_its_own_camera_but_what_is_off_stays_off(seed):
    full = CameraResponse(blur=0.5, fringe=0.5, jpeg=90)
    sampled = camera_of_street(full, np.random.default_rng(seed))
    assert sampled == camera_of_street(full, np.random.default_rng(seed))
    assert (
        0.25 <= sampled.exposure <= 4 and sampled.exposure != full.exposure
    )  # a factor is cut there
    assert 1 <= sampled.jpeg <= 100
    still = full._replace(variation=0.0)
    assert camera_of_street(still, np.random.default_rng(seed)) == still
    off = camera_of_street(PLAIN, np.random.default_rng(seed))
    assert (off.noise, off.blur, off.fringe, off.halo, off.vignette, off.jpeg) == (0,) * 6
