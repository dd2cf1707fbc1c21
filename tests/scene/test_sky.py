"""Sun, sky, clouds and haze."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.render.shade import sky_image
from scene.sky import CLOUD_SIZE, cloud_map, sample_sky

SEEDS = st.integers(0, 2**32 - 1)
ELEVATION = st.floats(math.radians(8), math.radians(80))
AZIMUTH = st.floats(-math.pi, math.pi)


def sky(seed=0, intensity=1.0, elevation=0.6, azimuth=0.0):
    rng = np.random.default_rng(seed)
    return sample_sky(rng, intensity=intensity, elevation=elevation, azimuth=azimuth)


def directions(n=500):
    d = np.random.default_rng(0).normal(size=(n, 3))
    d[:, 2] = np.abs(d[:, 2])
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def test_the_sun_stands_where_its_angles_say():
    ahead = sky(elevation=math.radians(30), azimuth=0).sun_direction
    left = sky(elevation=math.radians(60), azimuth=math.pi / 2).sun_direction
    assert ahead == pytest.approx([math.sqrt(3) / 2, 0, 0.5], abs=1e-6)
    assert left == pytest.approx([0, 0.5, math.sqrt(3) / 2], abs=1e-6)


@given(SEEDS, st.floats(0.3, 1.7), ELEVATION, AZIMUTH)
def test_all_light_is_proportional_to_the_intensity(seed, intensity, elevation, azimuth):
    one, more = (sky(seed, i, elevation, azimuth) for i in (1.0, intensity))
    for name in ("sun", "zenith", "horizon", "cloud", "ambient"):
        np.testing.assert_allclose(getattr(more, name), intensity * getattr(one, name), rtol=1e-5)
    np.testing.assert_allclose(
        sky_image(more, directions()), intensity * sky_image(one, directions()), rtol=1e-3
    )


@given(SEEDS, ELEVATION, AZIMUTH)
def test_light_is_positive_and_the_weather_is_in_range(seed, elevation, azimuth):
    drawn = sky(seed, 1.0, elevation, azimuth)
    assert 0 <= drawn.cover <= 1
    assert 200 <= drawn.haze <= 5000
    assert np.linalg.norm(drawn.sun_direction) == pytest.approx(1, abs=1e-6)
    image = sky_image(drawn, directions())
    assert np.isfinite(image).all()
    assert (image > 0).all()
    assert (drawn.sun > 0).all()


def test_a_low_sun_is_weaker_and_redder():
    low, high = sky(elevation=math.radians(8)).sun, sky(elevation=math.radians(70)).sun
    assert (low < high).all()
    assert low[2] / low[0] < 0.8 * high[2] / high[0]


def test_an_overcast_sky_hides_the_sun():
    sun = {s.cover: s.sun.mean() for s in map(sky, range(200))}
    covers = sorted(sun)
    assert np.mean([sun[c] for c in covers[:20]]) > 5 * np.mean([sun[c] for c in covers[-20:]])


def test_houses_hide_more_of_a_clear_sky_than_of_a_grey_one():
    clear, grey = (sky()._replace(cover=c) for c in (0.0, 1.0))
    np.testing.assert_allclose(clear.ambient, 0.55 * (clear.zenith + clear.horizon) / 2, rtol=1e-5)
    np.testing.assert_allclose(grey.ambient, 0.75 * grey.cloud, rtol=1e-5)


def test_straight_up_a_clear_sky_has_its_zenith_colour_and_at_the_horizon_its_horizon_colour():
    clear = sky(azimuth=0, elevation=0.2)._replace(cover=-1.0)
    up, back = np.array([[0, 0, 1], [-1, 0, 0]], np.float32)
    image = sky_image(clear, np.stack([up, back]))
    np.testing.assert_allclose(image[0], clear.zenith, rtol=1e-4)
    np.testing.assert_allclose(image[1], clear.horizon, rtol=1e-4)


def test_the_sky_is_brightest_around_the_sun():
    clear = sky(elevation=0.8)._replace(cover=-1.0)
    away = np.array([[-clear.sun_direction[0], 0, clear.sun_direction[2]]], np.float32)
    toward, other = sky_image(clear, np.concatenate([clear.sun_direction[None], away]))
    np.testing.assert_allclose(toward - other, 0.35 * clear.sun, rtol=1e-2)


@pytest.mark.parametrize("cover", [0.2, 0.5, 0.9])
def test_cover_is_the_share_of_cloud_in_the_map(cover):
    assert (cloud_map() > 1 - cover).mean() == pytest.approx(cover, abs=1e-3)


def test_the_cloud_map_tiles():
    clouds = cloud_map()
    assert clouds.shape == (CLOUD_SIZE, CLOUD_SIZE)
    inner = np.abs(np.diff(clouds, axis=0)).mean()
    assert np.abs(clouds[0] - clouds[-1]).mean() < 2 * inner
    assert not clouds.flags.writeable
