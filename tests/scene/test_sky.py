"""Sun, sky, clouds, weather and haze."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.sky.clouds import KINDS, SIZE, cloud_relief
from scene.sky.sky import BRIGHTEST, SURROUNDINGS, panorama, sample_sky
from scene.sky.weather import SKIES
from tests.scene.conftest import SEEDS

ELEVATION = st.floats(math.radians(8), math.radians(80))
AZIMUTH = st.floats(-math.pi, math.pi)
LOW, HIGH = math.radians(8), math.radians(60)
COLUMNS = 256


def sky(seed=0, intensity=1.0, elevation=0.6, azimuth=0.0, **more):
    rng = np.random.default_rng(seed)
    return sample_sky(rng, intensity=intensity, elevation=elevation, azimuth=azimuth, **more)


def skies(elevation, share=1.0, count=400):
    return [sky(seed, elevation=elevation, share=share) for seed in range(count)]


def one_of(name, elevation=LOW, count=600):
    return next(s for s in (sky(k, elevation=elevation) for k in range(count)) if s.weather == name)


def test_the_sun_stands_where_its_angles_say_weak_and_red_if_low_and_clouds_hide_it():
    long = math.sqrt(3) / 2
    for elevation, azimuth, direction in ((30, 0, [long, 0, 0.5]), (60, 90, [0, 0.5, long])):
        sampled = sky(elevation=math.radians(elevation), azimuth=math.radians(azimuth))
        assert sampled.sun_direction == pytest.approx(direction, abs=1e-6)
    low, high = (sky(elevation=math.radians(e), share=0.001).sun for e in (8, 70))
    assert (low < high).all() and low[2] / low[0] < 0.8 * high[2] / high[0]
    light = [s.sun.mean() for s in sorted(skies(HIGH), key=lambda s: s.cover)]
    assert np.mean(light[:80]) > 5 * np.mean(light[-80:])
    clear, grey = (sky()._replace(cover=c) for c in (0.0, 1.0))
    around = SURROUNDINGS * clear.sun  # what sunlit walls give back
    expected = 0.55 * (clear.zenith + clear.horizon) / 2 + around
    np.testing.assert_allclose(clear.ambient, expected, rtol=1e-5)
    np.testing.assert_allclose(grey.ambient, 0.75 * grey.cloud + around, rtol=1e-5)


@given(SEEDS, st.floats(0.3, 1.7), ELEVATION, AZIMUTH)
def test_all_light_is_proportional_to_the_intensity(seed, intensity, elevation, azimuth):
    one, more = (sky(seed, i, elevation, azimuth) for i in (1.0, intensity))
    for name in ("sun", "zenith", "horizon", "cloud", "ambient"):
        np.testing.assert_allclose(getattr(more, name), intensity * getattr(one, name), rtol=1e-5)
    expected = np.minimum(intensity * panorama(one, COLUMNS), BRIGHTEST)
    free = panorama(one, COLUMNS) < BRIGHTEST
    np.testing.assert_allclose(panorama(more, COLUMNS)[free], expected[free], rtol=1e-3)


@given(SEEDS, ELEVATION, AZIMUTH)
def test_light_is_positive_and_the_weather_is_in_range(seed, elevation, azimuth):
    sampled = sky(seed, 1.0, elevation, azimuth)
    row = next(w for w in SKIES if w.name == sampled.weather)
    for name in ("cover", "haze", "wetness"):
        low, high = getattr(row, name)
        assert low * 0.999 <= getattr(sampled, name) <= high * 1.001
    assert np.linalg.norm(sampled.sun_direction) == pytest.approx(1, abs=1e-6)
    image = panorama(sampled, COLUMNS)
    assert image.shape == (COLUMNS // 4, COLUMNS, 3) and image.dtype == np.float32
    assert ((image > 0) & (image <= BRIGHTEST)).all() and (sampled.sun > 0).all()


def test_there_are_many_weathers_under_a_low_sun_and_cloud_closes_where_asked_to():
    names = [w.name for w in SKIES]
    assert {s.weather for s in skies(LOW)} == set(names) and len(set(names)) == len(names) >= 14
    assert {w.clouds for w in SKIES} == set(KINDS)
    # A small share knows only the first.
    assert {s.weather for s in skies(LOW, share=0.25)} == {w.name for w in SKIES[:4]}
    assert {s.weather for s in skies(LOW, share=0.001, count=20)} == {SKIES[0].name}
    assert one_of("rain").wetness >= 0.7 and one_of("clear").wetness == 0
    low = {w.name for w in SKIES if w.below < 90}
    counts = [sum(s.weather in low for s in skies(math.radians(e))) for e in (2, 13, 23)]
    assert counts[0] > 2 * counts[1] > counts[2] == 0
    for closed in (True, False):
        sampled = [sky(k, closed=closed) for k in range(60)]
        assert len({s.weather for s in sampled}) > 3
        assert all((s.cover >= 0.8 and s.sun.max() < 0.3) == closed for s in sampled)
        assert all(
            np.array_equal(s.cloud_offset, sky(k).cloud_offset) for k, s in enumerate(sampled)
        )


@given(SEEDS, ELEVATION)
def test_the_horizon_has_the_colour_of_haze_and_straight_up_that_of_the_zenith(seed, elevation):
    sampled = sky(seed, 1.0, elevation)._replace(sun=np.zeros(3, np.float32))
    edge = panorama(sampled, COLUMNS)[0]
    np.testing.assert_allclose(edge, np.broadcast_to(sampled.horizon, edge.shape), rtol=0.02)
    top = panorama(sampled._replace(cover=-1.0), COLUMNS)[-1]
    np.testing.assert_allclose(top, np.broadcast_to(sampled.zenith, top.shape), rtol=1e-3)


@pytest.mark.parametrize("name", ["clear", "fair cumulus", "cirrus"])
def test_a_clear_sky_has_colour_down_to_the_horizon_and_is_no_brighter_than_a_sunlit_wall(name):
    sampled = one_of(name, HIGH)._replace(cover=-1.0)
    image = panorama(sampled, COLUMNS)
    away = image[:, :: COLUMNS // 8].min(axis=1)  # not towards the sun
    red, _, blue = away.T
    assert (blue > 1.4 * red).all() and (away[-1] < away[0]).all()
    assert away.max() < 0.6 * sampled.sun.max()


def test_closed_cloud_is_three_times_as_bright_overhead_as_at_the_horizon():
    sampled = one_of("bright overcast")._replace(cover=1.0, relief=0.0, sun=np.zeros(3, np.float32))
    image = panorama(sampled, COLUMNS).mean(axis=(1, 2))
    low = image[np.searchsorted(np.linspace(0, 1, len(image)) ** 2 * 90, 10)]  # 10 degrees up
    up = (3 + 6 * np.sin(np.radians([10, 90]))) / 7
    assert image[-1] / low == pytest.approx(up[1] / up[0], rel=0.1)


@pytest.mark.parametrize(("elevation", "azimuth"), [(0.3, 0.0), (0.9, 1.2), (0.6, -2.5)])
def test_a_clear_sky_is_brightest_where_the_sun_stands(elevation, azimuth):
    clear = one_of("clear")._replace(cover=-1.0)
    at = sky(elevation=elevation, azimuth=azimuth).sun_direction
    image = panorama(clear._replace(sun_direction=at), 1024)
    row, column = np.unravel_index(image.mean(axis=2).argmax(), image.shape[:2])
    assert math.pi / 2 * ((row + 0.5) / 256) ** 2 == pytest.approx(elevation, abs=0.03)
    assert -math.pi + 2 * math.pi * (column + 0.5) / 1024 == pytest.approx(azimuth, abs=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_cover_is_the_share_of_cloud_in_a_map_and_the_map_tiles(kind):
    relief = cloud_relief(kind)
    assert relief.shape == (SIZE, SIZE, 3) and not relief.flags.writeable
    assert np.abs(relief[..., 1:]).max() <= 1
    for cover in (0.2, 0.5, 0.9):
        assert (relief[..., 0] > 1 - cover).mean() == pytest.approx(cover, abs=1e-3)
    for axis in (0, 1):
        inner = np.abs(np.diff(relief[..., 0], axis=axis)).mean()
        ends = np.take(relief[..., 0], 0, axis) - np.take(relief[..., 0], -1, axis)
        assert np.abs(ends).mean() < 3 * inner
