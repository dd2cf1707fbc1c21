"""Roads that bend and slope, and junctions: positions of objects, and labels of the ground."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings

from scene import RenderSettings, TrainId
from scene.assets.catalogue import asset
from scene.ground import path as paths
from scene.ground.extent import STRIP
from scene.ground.ground import ground_height
from scene.ground.path import Path, heading_at, height_at, nearest, place_at, sample_path, to_world
from scene.render.geometry import build
from scene.render.road import on_road
from scene.street.camera import Camera
from scene.street.clearing import VEHICLES
from scene.street.instances import WHEELED, bounds
from scene.street.junction import junction_objects
from scene.street.plot import Setting
from tests.scene.conftest import DEFAULT, POOL, SEEDS, chosen, street

SHAPED = DEFAULT._replace(bend=25.0, gradient=10.0, junction_share=1.0)


def test_a_quarter_circle_of_40_metres_and_a_straight_road():
    end = 20 * math.pi
    path = Path(((0, 1 / 40), (end, 1 / 40)), ((0, 0.1), (end, 0.1)))
    assert to_world(path, end, 0.0) == pytest.approx([40, 40], abs=1e-3)
    assert heading_at(path, end) == pytest.approx(math.pi / 2, abs=1e-4)
    assert height_at(path, end) == pytest.approx(0.1 * end)
    x, away = nearest(path, np.array([[30.0, 40.0]]), last=80.0)
    assert x == pytest.approx(end, abs=1e-3) and away == pytest.approx(10, abs=1e-3)
    assert sample_path(np.random.default_rng(0), 0.0, 0.0) == paths.STRAIGHT == street().ground.path


@given(SEEDS)
def test_one_place_is_where_many_say_to_the_bit(seed):
    rng = np.random.default_rng(seed)
    path = sample_path(rng, 1 / 40, 0.1)
    x = np.append(rng.uniform(-100, 720, 20), [-80.0, 0.0, 12.5, 700.0])
    y = np.where(rng.random(len(x)) < 0.3, 0.0, rng.normal(0, 8, len(x)))
    places = [place_at(path, *at) for at in zip(x.tolist(), y.tolist(), strict=True)]
    many = *to_world(path, x, y).T, heading_at(path, x), height_at(path, x)
    np.testing.assert_array_equal(places, np.stack(many, axis=1))


@given(SEEDS)
def test_a_course_keeps_to_its_limits_and_is_straight_and_level_at_a_junction(seed):
    path, x = sample_path(np.random.default_rng(seed), 1 / 40, 0.1, 50.0), np.arange(-40.0, 350.0)
    heading, slope = heading_at(path, x), np.diff(height_at(path, x))
    assert np.ptp(heading) <= math.pi / 2 + 0.02 and np.abs(np.diff(heading)).max() <= 1 / 40
    assert np.abs(slope).max() <= 0.1 and np.abs(np.diff(slope)).max() < 0.002
    assert np.ptp(height_at(path, x[71:110])) + np.ptp(heading_at(path, x[57:124])) < 1e-9


@settings(max_examples=12)
@given(SEEDS)
def test_what_stands_in_a_shaped_street_stands_on_its_ground_and_out_of_the_arms(seed):
    sampled = street(SHAPED, seed)
    assert np.array_equal(sampled.placements[-1].pose, street(SHAPED, seed).placements[-1].pose)
    ground, junction = sampled.ground, sampled.ground.junction
    places = np.array([p.pose[:2, 3] for p in sampled.placements])
    along, away = nearest(ground.path, places)
    line, one_metre_left = (to_world(ground.path, along, y) for y in (0.0, 1.0))
    left = ((places - line) * (one_metre_left - line)).sum(axis=1)
    near = (away < STRIP - 1) & (along > -38) & (along < 340)
    # The road is straight at a junction, but need not run along the world's axes.
    heading = float(heading_at(ground.path, junction.x))
    c, s = math.cos(heading), math.sin(heading)
    turn, origin = np.eye(4), np.eye(4)
    turn[:2, :2] = [[c, s], [-s, c]]
    origin[:2, 3] = -to_world(ground.path, junction.x, 0.0)
    boxed = bounds([p._replace(pose=turn @ origin @ p.pose) for p in sampled.placements])[:, :, :2]
    boxed = zip(sampled.placements, *np.moveaxis(boxed, 1, 0), strict=True)
    exact = []
    for k, (p, low, high) in enumerate(boxed):
        assert p.pose[:3, :3] @ p.pose[:3, :3].T == pytest.approx(np.eye(3))
        if near[k] and p.family != "building":  # houses go down to the lowest ground below them
            height = ground_height(ground, float(left[k]), float(along[k]))
            # By a kerb, vehicles tilt, and all else goes down to its lower side.
            off, kerb = p.pose[2, 3] - height, ground.kerb_height
            exact.append(abs(off) < 0.01)
            assert -kerb - 0.01 < off < (kerb if p.family in WHEELED else 0) + 0.01
        x, y = (low + high) / 2
        if math.copysign(1, y) in junction.arms and 14 < abs(y) < 80:
            if p.family in VEHICLES and abs(x) < junction.outer:
                assert -junction.half_width < low[0] and high[0] < junction.half_width
            if p.family == "building":  # steps and awnings stand out by less than a metre
                assert low[0] > junction.outer - 1 or high[0] < 1 - junction.outer
    assert np.mean(exact) > 0.8


@pytest.mark.parametrize("seed", [3, 11, 13])
def test_labels_of_a_junction_from_above_are_those_of_the_place(seed):
    ground = street(SHAPED, seed).ground
    junction, path = ground.junction, ground.path
    east, north = to_world(path, junction.x, 0.0).tolist()
    place = (east, north, height_at(path, junction.x) + 40)
    camera = Camera(place, -heading_at(path, junction.x), math.pi / 2)
    sampled = street(seed=seed)._replace(placements=(), ground=ground, cameras=(camera,))
    (frame,) = chosen("embree").render(sampled, RenderSettings(120, 120, fov=60, shadows=False))
    at = (1 - (np.arange(120) + 0.5) / 60) * math.tan(math.radians(30)) * 40
    for (row, column), label in np.ndenumerate(frame.label):
        x, y = junction.x + at[row], at[column]
        half = ground.half_width
        inner, outer = (junction.paved(x, y, d) or abs(y) < half + d for d in (-0.3, 0.3))
        assert inner != outer or inner == (label == TrainId.ROAD)
    assert (frame.label == TrainId.SIDEWALK).mean() > 0.05


@pytest.mark.parametrize("seed", range(3))
def test_points_of_the_ground_are_found_again_where_the_road_goes(seed):
    sampled = street(SHAPED, seed)
    path, geometry = sampled.ground.path, build(sampled)
    rng = np.random.default_rng(seed)
    for surface in (1, 2, 3):
        shape = geometry.shapes[surface - 1]
        faces = rng.choice(np.flatnonzero(shape.normal.any(axis=1)), 3000).astype(np.int32)
        share = rng.dirichlet(np.ones(3), len(faces))[:, :, None]
        points = (share * shape.vertices[shape.faces[faces]]).sum(axis=1).astype(np.float32)
        instance, normals = np.full(len(faces), surface, np.int32), shape.normal[faces]
        places, turned = on_road(geometry, path, instance, faces, points, normals)
        x, y, above = places.astype(float).T
        off = np.linalg.norm(to_world(path, x, y) - points[:, :2], axis=1)
        climbed = np.abs(height_at(path, x) + above - points[:, 2])
        # The open land keeps its place in the world; so does what lies where the road is straight.
        land = np.abs(places[:, :2] - points[:, :2]).max(axis=1) < 0.01
        assert surface == 3 or not land.all()
        most = (0.05, 0.07, 0.3)[surface - 1]  # far from the road, faces are large
        assert off[~land].max() < most and climbed[~land].max() < most
        level = normals[:, 2] > 0.99
        assert level.any() and (turned[level & ~land, 2] > 0.999).all()
        steep = ~land & (np.abs(normals[:, 2]) < 0.3)  # kerbs face the road, whichever way it goes
        assert (np.abs(turned[steep, 1]) > 0.95).sum() >= 0.8 * steep.sum()
    unchanged = on_road(
        geometry._replace(road_vertices=()), paths.STRAIGHT, instance, faces, points, normals
    )
    assert np.array_equal(unchanged, (points, normals))


def test_points_of_a_house_are_found_in_its_own_frame_however_it_stands():
    """Otherwise textures would stretch on walls at an angle to the world's axes."""
    sampled = street(SHAPED, 3)
    path, geometry = sampled.ground.path, build(sampled)
    turned = 0
    for placement in sampled.placements:
        if placement.family not in ("building", "wall"):
            continue
        shape = geometry.shapes[geometry.shape[placement.instance]]
        count = min(len(shape.faces), 40)
        faces = np.arange(count, dtype=np.int32)
        asset_points, pose = shape.vertices[shape.faces[faces, 0]], placement.pose
        points = (asset_points @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
        normals = (shape.normal[faces] @ pose[:3, :3].T).astype(np.float32)
        instance = np.full(count, placement.instance, np.int32)
        places, flat = on_road(geometry, path, instance, faces, points, normals)
        assert places[:, :2] == pytest.approx(asset_points[:, :2], abs=0.01)
        assert flat[:, :2] == pytest.approx(shape.normal[faces, :2], abs=0.01)
        steep = np.abs(normals[:, 2]) < 0.5
        assert places[steep, 2] == pytest.approx(asset_points[steep, 2], abs=0.01)
        turned += abs(pose[0, 0]) < 0.95
    assert turned > 5


def test_no_sky_shows_between_the_houses_of_a_row_along_an_arm():
    gaps = []
    params = SHAPED._replace(building_probability=1.0)
    for seed in range(8):
        ground = street(SHAPED, seed).ground
        stands = junction_objects(
            Setting(params, ground, POOL, ground.drive), np.random.default_rng(seed)
        )
        for side, hand in product(ground.junction.arms, (1.0, -1.0)):
            row = []
            for s in stands:
                on_arm = s.y * side > 0 and (s.x - ground.junction.x) * hand > 0
                if on_arm and s.family == "building" and abs(abs(s.yaw) - math.pi / 2) < 0.01:
                    corners = asset("building", s.ref).mesh.vertices
                    walls = corners[corners[:, 2] < 2.0, 0]  # below the eaves
                    row.append((abs(s.y) + walls.min(), abs(s.y) + walls.max()))
            gaps += [begin - end for (_, end), (begin, _) in pairwise(sorted(row))]
    gaps = np.array(gaps)
    assert len(gaps) > 30 and gaps.min() > -0.5
    assert np.mean(gaps < 0.01) > 0.7  # the others have a passage beside them
