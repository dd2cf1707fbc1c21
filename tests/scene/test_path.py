"""Roads that bend and slope, and junctions: where things lie, and what labels say of the ground."""

import math

import numpy as np
import pytest
from hypothesis import given

from scene import RenderSettings, TrainId, sample_street
from scene.ground.extent import STRIP
from scene.ground.ground import ground_height
from scene.ground.path import STRAIGHT, Path, heading_at, height_at, nearest, sample_path, to_world
from scene.street.camera import Camera
from scene.street.clearing import VEHICLES, boxes
from scene.street.placing import pose_at
from tests.scene.conftest import DEFAULT, POOL, SEEDS, chosen, street

SHAPED = DEFAULT._replace(bend=25.0, gradient=10.0, junction_share=1.0)


def test_a_quarter_circle_a_steady_slope_and_a_straight_road():
    end = 20 * math.pi
    path = Path(((0, 1 / 40), (end, 1 / 40)), ((0, 0.1), (end, 0.1)))
    assert to_world(path, end, 0.0) == pytest.approx([40, 40], abs=1e-3)
    assert to_world(path, end, 10.0) == pytest.approx([30, 40], abs=1e-3)
    assert heading_at(path, end) == pytest.approx(math.pi / 2, abs=1e-4)
    assert height_at(path, end) == pytest.approx(0.1 * end)
    x, away = nearest(path, np.array([[30.0, 40.0]]), last=80.0)
    assert x == pytest.approx(end, abs=1e-3) and away == pytest.approx(10, abs=1e-3)
    assert sample_path(np.random.default_rng(0), 0.0, 0.0) == STRAIGHT
    assert to_world(STRAIGHT, 7.0, -3.0) == pytest.approx([7, -3])


@given(SEEDS)
def test_a_course_keeps_to_its_limits_and_is_straight_and_level_at_a_junction(seed):
    path = sample_path(np.random.default_rng(seed), 1 / 40, 0.1, 50.0)
    heading = heading_at(path, np.arange(-40.0, 350.0))
    assert np.ptp(heading) <= math.pi / 2 + 0.02 and np.abs(np.diff(heading)).max() <= 1 / 40
    slope = np.diff(height_at(path, np.arange(-40.0, 350.0)))
    assert np.abs(slope).max() <= 0.1 and np.abs(np.diff(slope)).max() < 0.002
    assert np.ptp(height_at(path, np.arange(31.0, 70.0))) < 1e-9
    assert np.ptp(heading_at(path, np.arange(17.0, 84.0))) < 1e-9


@given(SEEDS)
def test_what_stands_in_a_shaped_street_stands_on_its_ground(seed):
    drawn = sample_street(SHAPED, seed, 2, POOL)
    again = sample_street(SHAPED, seed, 2, POOL)
    assert [p.pose.tobytes() for p in drawn.placements] == [
        p.pose.tobytes() for p in again.placements
    ]
    ground, found = drawn.ground, 0
    for p in drawn.placements:
        (x,), (away,) = nearest(ground.path, p.pose[None, :2, 3])
        assert np.linalg.det(p.pose[:3, :3]) == pytest.approx(1)
        if away < STRIP - 1 and p.family != "building" and -38 < x < 340:
            side = pose_at(ground, x, 1.0, 0.0)[:3, 1]
            y = float(side[:2] @ (p.pose[:2, 3] - to_world(ground.path, x, 0.0)))
            assert p.pose[2, 3] == pytest.approx(ground_height(ground, y, float(x)), abs=0.01)
            found += 1
    assert found > 50
    for camera in drawn.cameras:
        (x,), (away,) = nearest(ground.path, np.array([camera.position[:2]]))
        assert away == pytest.approx(DEFAULT.camera_position_x, abs=0.01)
        assert camera.yaw == pytest.approx(
            DEFAULT.camera_rotation_y - heading_at(ground.path, x), abs=0.01
        )


@given(SEEDS)
def test_no_vehicle_of_an_arm_reaches_over_a_kerb_and_no_house_over_an_arm(seed):
    drawn = sample_street(SHAPED, seed, 1, POOL)
    junction = drawn.ground.junction
    standing = [(p.family, p.asset, p.pose) for p in drawn.placements]
    for p, low, high in zip(drawn.placements, *boxes(drawn.ground, standing), strict=True):
        x, y = (low + high) / 2
        if math.copysign(1, y) not in junction.arms or not 14 < abs(y) < 80:
            continue
        if p.family in VEHICLES and abs(x) < junction.outer:
            assert -junction.half_width < low[0] and high[0] < junction.half_width
        if p.family == "building":
            least = junction.outer - 1  # steps and awnings stand out by less than a metre
            assert low[0] > least or high[0] < -least


@pytest.mark.parametrize("seed", [3, 11, 13])
def test_labels_from_above_are_those_of_the_place(seed):
    ground = sample_street(SHAPED, seed, 1, POOL).ground
    junction, path = ground.junction, ground.path
    east, north = to_world(path, junction.x, 0.0).tolist()
    height = float(height_at(path, junction.x))
    yaw = -float(heading_at(path, junction.x))
    camera = Camera((east, north, height + 40), yaw, math.pi / 2)
    drawn = street(seed=seed)._replace(placements=(), ground=ground, cameras=(camera,))
    (frame,) = chosen("embree").render(drawn, RenderSettings(120, 120, fov=60, shadows=False))
    at = ((np.arange(120) + 0.5) / 60 - 1) * math.tan(math.radians(30)) * 40
    wrong = 0
    for row, v in enumerate(-at):
        for column, u in enumerate(-at):
            near = [junction.paved(junction.x + v, u, d) or abs(u) < ground.half_width + d
                    for d in (-0.3, 0.3)]  # fmt: skip
            if near[0] == near[1]:
                wrong += near[0] != (frame.label[row, column] == TrainId.ROAD)
    assert wrong == 0 and (frame.label == TrainId.SIDEWALK).mean() > 0.05
