"""Requested weathers change the light and the ground, but no label."""

import numpy as np
import pytest

from scene import AssetPool, CameraResponse, TrainId
from scene.assets.catalogue import check_pool
from scene.names import WEATHERS
from scene.render import RenderSettings, renderer
from scene.render.shade import LAMP_POWER, lamplight
from scene.sky.weather import REQUESTED
from scene.street.instances import FIRST_INSTANCE, Placement
from tests.scene.conftest import POOL, refused, street


@pytest.mark.parametrize("weather", WEATHERS)
def test_a_weather_that_is_asked_for_changes_the_sky_and_nothing_else(weather):
    by_chance, requested = (
        street(seed=4, shots=2, pool=p) for p in (POOL, POOL._replace(weather=weather))
    )
    assert requested.sky.weather in {row.name for row in REQUESTED[weather]}
    assert (requested.sky.snow > 0.5) == (weather == "snow") and (requested.sky.haze < 150) == (
        weather == "fog"
    )
    assert (requested.sky.wetness >= 0.7) == (weather == "rain")
    assert requested.cameras == by_chance.cameras
    assert requested.ground == by_chance.ground
    for one, other in zip(requested.placements, by_chance.placements, strict=True):
        assert one[:4] == other[:4] and (one.pose == other.pose).all()
    frames = [
        renderer("embree").render(s, RenderSettings(64, 48, 1)) for s in (requested, by_chance)
    ]
    for one, other in zip(*frames, strict=True):
        assert (one.label == other.label).all() and (one.image != other.image).any()


def test_snow_whitens_what_is_level_and_is_torn_on_the_road():
    without, snowy = (
        renderer("embree").render(
            street(seed=4, pool=POOL._replace(weather=w)), RenderSettings(96, 72, 1)
        )[0]
        for w in ("rain", "snow")
    )
    label = snowy.label
    road, walk = (snowy.image[label == c].astype(float) for c in (TrainId.ROAD, TrainId.SIDEWALK))
    bare = without.image[label == TrainId.SIDEWALK].astype(float)
    assert walk.mean() > bare.mean() + 30 and walk.mean() > road.mean() + 10
    assert road.std() > 1.3 * without.image[label == TrainId.ROAD].std()


def test_a_lamp_lights_what_lies_below_it_by_the_square_of_the_distance():
    places = np.float32([(0, 0, 0), (0, 0, -5), (0, 0, 0), (100, 0, 0)])
    normals = np.float32([(0, 0, 1), (0, 0, 1), (0, 0, -1), (0, 0, 1)])
    light = np.zeros(4, np.float32)
    lamplight(places, normals, np.float32([(0, 0, 5)]), np.float32(1), light)
    assert light[0] == pytest.approx(LAMP_POWER / 25, rel=0.03)
    assert light[1] == pytest.approx(light[0] / 4, rel=0.03) and (light[2:] == 0).all()


def test_at_night_the_road_is_dark_but_below_a_lamp():
    sampled = street(seed=4, pool=POOL._replace(weather="night"))
    pose = np.eye(4)
    pose[:3, 3] = sampled.cameras[0].position[0] + 12, 3.0, 0.0
    lamp = Placement("lamp", 0, int(TrainId.POLE), FIRST_INSTANCE, pose)
    sampled = sampled._replace(placements=(lamp,))
    response = CameraResponse(exposure=10.0, meter=0.0, noise=0.0, variation=0.0)
    settings = RenderSettings(96, 72, 1, response=response)
    lit, unlit = (
        renderer("embree").render(
            sampled._replace(sky=sampled.sky._replace(lamps=power)), settings
        )[0]
        for power in (sampled.sky.lamps, 0.0)
    )
    assert sampled.sky.lamps > 0 and (lit.label == unlit.label).all()
    road = lit.label == TrainId.ROAD
    change = lit.image[road].astype(float).mean(axis=1) - unlit.image[road].mean(axis=1)
    assert change.max() > 40 and change.min() > -1
    near = np.abs(lit.depth[road] - 12) < 4
    assert change[near].mean() > 2 * change[lit.depth[road] > 30].mean()


def test_an_unknown_weather_is_refused_and_only_one_that_is_asked_for_is_recorded():
    refused(
        ValueError,
        "weather 'hail' is unknown; known: clear, fog, rain, snow, night",
        check_pool,
        AssetPool(weather="hail"),
    )
    assert AssetPool(weather="fog").identity == AssetPool().identity | {"weather": "fog"}
