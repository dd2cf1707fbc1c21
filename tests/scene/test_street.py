"""Lines of objects along a road, the camera's drive, and the background that closes the horizon."""

import math
from itertools import groupby, pairwise, product

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from scene import AssetPool, TrainId
from scene.assets import catalogue
from scene.ground.ground import ground_height, ground_heights
from scene.ground.path import STRAIGHT
from scene.look.materials import material_id
from scene.street.background import BEHIND, LINES_END, VISTA_END, background
from scene.street.camera import camera_room
from scene.street.clearing import clear_of_camera
from scene.street.instances import (
    FIRST_INSTANCE,
    WHEELED,
    Placement,
    Stand,
    bounds,
    footprint,
    poses,
)
from scene.street.lines import JITTER, LINE_END, LINE_START, LINES, NARROW, lines_of
from scene.street.plot import Setting
from tests.scene.conftest import DEFAULT, POOL, SEEDS, UNITS, lines_alone, street

LINE_OF = {family: line for line, mix in LINES.items() for family in mix}


def same(a, b):
    """Whether two lists of placements are equal to the bit, except for instance ids."""
    one, other = (
        [p._replace(pose=p.pose.tobytes(), instance=0) for p in sampled] for sampled in (a, b)
    )
    return one == other


def foreground(placements):
    """Placements on lines, without the background."""
    return [p for p in placements if p.pose[0, 3] < LINES_END and abs(p.pose[1, 3]) < BEHIND]


def by_line(params=DEFAULT, seed=0):
    """Placements of every line; a rider's machine and a sign's post go with the first part."""
    lines = {line: [] for line in LINES}
    for _, parts in groupby(foreground(street(params, seed).placements), lambda p: id(p.pose)):
        first, *others = parts
        lines[LINE_OF[first.family]] += [first, *others]
    return lines


def objects(placements):
    """One placement per object: riders without their machines, signs without their posts."""
    return [next(parts) for _, parts in groupby(foreground(placements), lambda p: id(p.pose))]


@given(UNITS, SEEDS)
def test_the_same_arguments_give_the_same_street_and_another_seed_another(unit, seed):
    a, b, other = (street(lines_alone(unit), s, 2) for s in (seed, seed, seed ^ 1))
    assert same(a.placements, b.placements) and not same(a.placements, other.placements)
    assert (a.cameras, a.ground, a.seed) == (b.cameras, b.ground, b.seed)
    assert a.cameras != other.cameras and a.ground != other.ground
    assert all(np.array_equal(x, y) for x, y in zip(a.sky, b.sky, strict=True))
    assert not all(np.array_equal(x, y) for x, y in zip(a.sky, other.sky, strict=True))


@given(UNITS, SEEDS)
def test_every_object_stands_on_the_ground_and_the_camera_drives_on_at_its_height(unit, seed):
    params = lines_alone(unit)
    sampled = street(params, seed)
    wheeled = {id(p.pose) for p in sampled.placements if p.family in WHEELED}
    for number, p in enumerate(sampled.placements, FIRST_INSTANCE):
        assert p.instance == number
        y, z = p.pose[1:3, 3]
        if id(p.pose) not in wheeled:  # by a kerb they stand on its lower side
            by_kerb = abs(abs(y) - sampled.ground.half_width) < 8
            assert z == ground_height(sampled.ground, y) or (by_kerb and z == 0)
            assert p.pose[:3, 2].tolist() == [0, 0, 1]  # upright
        assert p.pose[:3, :3] @ p.pose[:3, :3].T == pytest.approx(np.eye(3))
        low = catalogue.bounds(p.family, p.asset)[0, 2]
        lifted = p.family in ("rider", "traffic sign", "traffic light")  # by a machine or a post
        assert low > 0.05 if lifted else abs(low) <= 0.02
    for camera in street(params, seed, 5).cameras:
        _, y, z = camera.position
        assert z == pytest.approx(ground_height(sampled.ground, y) + params.camera_position_y)
        assert (camera.yaw, camera.pitch) == (params.camera_rotation_y, params.camera_rotation_x)
        assert 0 <= camera.position[0] <= 60 + 24
    x = [c.position[0] for c in street(seed=5, shots=6).cameras]  # spread over the drive
    assert all(10 * k <= v <= 10 * (k + 1) for k, v in enumerate(x))


def test_only_greenery_that_no_camera_comes_near_is_far():
    sampled = street(shots=4)
    far = [p for p in sampled.placements if p.far]
    assert {p.train_id for p in far} == {TrainId.VEGETATION}
    for camera in sampled.cameras:
        assert min(math.dist(camera.position[:2], p.pose[:2, 3]) for p in far) > 25


@given(UNITS, SEEDS)
def test_all_objects_of_a_line_share_its_distance_on_both_sides(unit, seed):
    params = lines_alone(unit)
    ground = street(params, seed).ground
    setting = Setting(params, ground, POOL, ground.drive)
    for stand in lines_of(setting, seed, (), apart=False):
        name = LINE_OF.get(stand.family, "pole")
        distance = getattr(params, f"{name}_position") if not stand.part else abs(stand.y)
        # Facades step back by up to 10 cm, lest neighbours that overlap lie in one plane.
        spare = 0.1 if name in ("building", "fence") else 0.0
        if -1e-9 <= abs(stand.y) - distance <= spare + 1e-9:
            continue
        assert stand.family not in WHEELED  # what is narrow stands on one side of the kerb
        assert abs(abs(stand.y) - distance) < NARROW
        assert abs(distance - ground.half_width) < NARROW + spare


def wheels(family, ref):
    """Where an asset touches the ground at each end and side, f64[n, 2] in its own frame."""
    corners = catalogue.asset(family, ref).mesh.vertices
    low = corners[corners[:, 2] < 0.03]
    quarters = (low[np.all(low[:, :2] * signs > 0, axis=1)] for signs in product((1, -1), repeat=2))
    return np.array([placement.mean(axis=0)[:2] for placement in quarters if len(placement)])


@pytest.mark.parametrize("position", [3.4, 4.3])
def test_no_wheel_of_a_vehicle_over_a_kerb_is_in_the_air_or_in_the_ground(position):
    params = DEFAULT._replace(car_position=position, car_interval=8.0, parked_share=0.5)
    off, tilted = [], 0
    for seed in range(12):
        sampled = street(params, seed, pool=AssetPool())
        for p in foreground(sampled.placements):
            if p.family not in ("car", "bus", "truck"):
                continue
            touching = np.pad(wheels(p.family, p.asset), ((0, 0), (0, 1)))
            x, y, z = (touching @ p.pose[:3, :3].T + p.pose[:3, 3]).T
            # The ground below the middle of a tyre, or below one of its sides.
            below = [ground_heights(sampled.ground, x, y + edge) for edge in (-0.1, 0.0, 0.1)]
            off.append(np.abs(z - below).min(axis=0).max())
            tilted += p.pose[2, 2] < 1 - 1e-6
    assert len(off) > 300 and tilted > 30
    # Of a vehicle that stands askew over a kerb only three wheels can be on the ground.
    assert np.mean(np.array(off) > 0.05) < 0.04


def test_buildings_are_placed_by_their_near_face_and_look_at_the_road():
    placements = by_line(seed=3)["building"]
    near = np.abs(bounds(placements)[:, :, 1]).min(axis=1)
    assert len(placements) > 10
    # Steps, awnings and sills stand out by less than a metre; walls go back from the line.
    assert (near > DEFAULT.building_position - 1.0).all()
    assert (near < DEFAULT.building_position + 0.2).all()
    for p in placements:
        assert p.pose[1, 1] == pytest.approx(math.copysign(1, p.pose[1, 3]))
    # The bounds of a turned placement, by hand.
    pose = np.array([[0.0, -1, 0, 10], [1, 0, 0, 3], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    low, high = catalogue.bounds("car", 0)
    (box,) = bounds([Placement("car", 0, 13, 4, pose)])
    ends = [(10 - high[1], 3 + low[0], 0.5 + low[2]), (10 - low[1], 3 + high[0], 0.5 + high[2])]
    assert box == pytest.approx(np.array(ends))


@given(SEEDS, st.sampled_from(list(LINES)), st.floats(0, 1))
def test_moving_or_thinning_a_line_leaves_all_others_as_they_are(seed, changed, unit):
    before = by_line(seed=seed)
    # From sidewalk to terrain, so that the height of the ground is the same.
    moved = by_line(DEFAULT._replace(**{f"{changed}_position": 9 + 5 * unit}), seed)
    thinned = by_line(DEFAULT._replace(**{f"{changed}_interval": 33.0}), seed)
    assert all(same(before[name], moved[name]) for name in before if name != changed)
    one, other = ([(*p[:3], p.pose[0, 3]) for p in lines[changed]] for lines in (before, moved))
    assert one == other
    for name in before:
        assert same(before[name], thinned[name]) == (name != changed)


@given(SEEDS, st.floats(1.5, 50))
def test_neighbours_are_an_interval_apart_give_or_take_the_jitter(seed, interval):
    people = objects(by_line(DEFAULT._replace(person_interval=interval), seed)["person"])
    for side in (1, -1):
        x = np.array([p.pose[0, 3] for p in people if p.pose[1, 3] * side > 0])
        assert (np.abs(np.diff(x) - interval) <= 2 * JITTER * interval + 1e-9).all()
        assert ((x >= LINE_START - JITTER * interval) & (x <= LINE_END + JITTER * interval)).all()
        assert abs(len(x) - (LINE_END - LINE_START) / interval) <= 2


@pytest.mark.parametrize("probability", [0.0, 0.3, 1.0])
def test_building_slots_and_the_camera_s_side_have_their_probability(probability):
    params = DEFAULT._replace(building_probability=probability)
    counts = [len(by_line(params, seed)["building"]) for seed in range(40)]
    slots = 2 * (LINE_END - LINE_START) / DEFAULT.building_interval
    assert np.mean(counts) / slots == pytest.approx(probability, abs=0.04)
    params = DEFAULT._replace(camera_position_probability=probability)
    right = [street(params, s).cameras[0].position[1] < 0 for s in range(60)]
    assert abs(np.mean(right) - probability) <= 0.15 * (probability == 0.3)


def test_families_of_a_line_come_in_their_shares_riders_on_machines_signs_on_posts():
    wide = AssetPool(0, 20)  # riders of every kind
    placements = [p for seed in range(20) for p in street(seed=seed, pool=wide).placements]
    pairs = set()
    for p, other in pairwise(foreground(placements)):
        if p.family in ("rider", "traffic sign", "traffic light"):
            assert other.pose is p.pose
            pairs.add(f"{p.family} on {other.family}")
    riders = {"rider on bicycle", "rider on motorcycle"}
    assert pairs == {*riders, "traffic sign on signpost", "traffic light on signpost"}
    poles = [p.family for seed in range(60) for p in objects(by_line(seed=seed)["pole"])]
    shares = {family: poles.count(family) / len(poles) for family in LINES["pole"]}
    assert shares == pytest.approx(LINES["pole"], abs=0.05)


def test_no_sign_or_light_and_no_built_in_rider_is_in_the_air(shelf):
    """Whatever a pool leaves out."""
    shelf("rider/them.stl", trimesh.creation.box((0.6, 0.6, 1.8)))
    folder = shelf("traffic sign/stop.stl", trimesh.creation.box((0.02, 0.7, 0.7)))
    assert "signpost" not in catalogue.missing_families(AssetPool(own=folder, use="own"))
    pools = {
        AssetPool(own=folder, use="own"): {"traffic sign", "rider"},
        POOL._replace(without=("signpost",)): {"rider"},
        POOL._replace(without=("bicycle", "motorcycle")): {"traffic sign", "traffic light"},
    }
    for pool, expected in pools.items():
        placements = [p for seed in range(3) for p in street(seed=seed, pool=pool).placements]
        hanging = [p for p in placements if p.family in ("traffic sign", "traffic light", "rider")]
        assert {p.family for p in hanging} == expected
        for p in hanging:
            below = [o.family for o in placements if o.pose is p.pose and o is not p]
            assert below or (p.family == "rider" and isinstance(p.asset, str))


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_doors_of_buses_are_on_the_side_of_the_kerb(drive):
    params = DEFAULT._replace(camera_position_probability=float(drive < 0), car_interval=5.0)
    sides, wide = [], AssetPool(0, 28)
    for seed in range(20):
        for p in foreground(street(params, seed, pool=wide).placements):
            if p.family != "bus":
                continue
            asset = catalogue.asset("bus", p.asset)
            glass = asset.material == material_id("glass")
            corners = asset.mesh.vertices[asset.mesh.faces]
            (doors,) = np.where(glass & (corners[..., 2].min(axis=1) < 0.7))
            y = corners[doors][..., 1].mean()
            sides.append(abs(p.pose[1, 3] + p.pose[1, 1] * y) - abs(p.pose[1, 3]))
    assert len(sides) > 20 and min(sides) > 1
    row = [Stand(*what, 0, 100, 0) for what in (("bus", 0), ("bus", "their/own.glb"), ("car", 0))]
    ground = street().ground._replace(drive=drive)
    assert (np.linalg.det(poses(ground, row)) < 0).tolist() == [drive > 0, False, False]


@pytest.mark.parametrize("space", ["scenex", "extended"])
def test_a_bus_and_the_camera_in_its_way_keep_apart(space):
    # A line of vehicles where the camera drives.
    blocked = {"camera_position_x": 3.0, "car_position": 3.0, "car_interval": 12.0}
    params = DEFAULT._replace(**blocked, camera_position_probability=0.0)
    if space == "extended":
        params = params._replace(field_of_view=1.0)
    moved = 0
    for seed in range(20):
        sampled = street(params, seed, 4)
        vehicles = [p for p in foreground(sampled.placements) if LINE_OF.get(p.family) == "car"]
        low, high = np.moveaxis(bounds(vehicles), 1, 0)
        aside = [abs(abs(p.pose[1, 3]) - 3.0) > 1e-9 for p in vehicles]
        for camera in sampled.cameras:
            gaps = np.maximum(low - camera.position, camera.position - high)[:, :2]
            assert gaps.max(axis=1).min() > 0.5  # some stand askew in their boxes
            elsewhere = abs(camera.position[1]) != 3.0
            assert space == "extended" or not elsewhere
            moved += elsewhere if space == "extended" else any(aside)
    assert moved > 30


def test_an_object_in_the_camera_s_way_is_moved_no_farther_than_needed():
    room = camera_room(STRAIGHT, np.array([20.0]), 1.8)
    (x, y, _, _, long, wide) = room[0].tolist()
    assert (x, y, long, wide) == pytest.approx((22.0, 1.8, 3.0, 1.0))
    half = footprint(("car", 0))[3]
    near = Stand("car", 0, 22.0, 1.8 + 1.0 + half - 0.1, 0.0)
    far = [near._replace(x=40.0), near._replace(y=near.y + 0.2)]
    sign = [
        Stand("signpost", 0, 21.0, 1.8, 0.0),
        Stand("traffic sign", 0, 21.0, 1.8, 0.0, part=True),
    ]
    cleared_stands = clear_of_camera(STRAIGHT, [near, *far, *sign], room)
    assert cleared_stands[:3] == [near._replace(y=near.y + 0.25), *far]
    assert (
        cleared_stands[3][2:4] == cleared_stands[4][2:4] != (21.0, 1.8) and cleared_stands[4].part
    )
    # One that no short move gets out is left out, with its parts.
    wall = np.array([[22.0, 1.8, 1.0, 0.0, 50.0, 50.0]])
    assert clear_of_camera(STRAIGHT, [near, *sign], wall) == []
    assert clear_of_camera(STRAIGHT, [near], room[:0]) == [near]


def stands(seed, params=DEFAULT):
    return background(params, np.random.default_rng(seed))


@given(SEEDS, UNITS)
def test_it_lies_beyond_the_lines_and_is_pure_and_no_larger_than_a_street(seed, unit):
    for stand in stands(seed, lines_alone(unit)):
        assert stand.x >= LINES_END or abs(stand.y) >= BEHIND
        assert stand.x < VISTA_END + 60 and stand.family in ("building", "tree", "bush")
    assert stands(seed) == stands(seed) != stands(seed + 1) and 40 < len(stands(seed)) < 160
    # A row of houses looks down the road from its end: a building's front is at its local -y.
    assert any(abs(s.y) < 20 and s.yaw == -math.pi / 2 for s in stands(seed))


@pytest.mark.parametrize(("probability", "low", "high"), [(0.0, 0.0, 0.12), (1.0, 0.5, 0.9)])
def test_it_is_town_where_there_are_buildings_and_country_elsewhere(probability, low, high):
    params = DEFAULT._replace(building_probability=probability)
    families = [s.family for seed in range(30) for s in stands(seed, params)]
    assert low <= families.count("building") / len(families) <= high
    assert families.count("tree") / len(families) > 0.1


@given(SEEDS)
def test_it_leaves_lines_cameras_and_ground_as_they_are(seed):
    sampled = street(seed=seed, shots=2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scene.street.street.background", lambda params, rng: [])
        bare = street(seed=seed, shots=2)
    assert (bare.cameras, bare.ground) == (sampled.cameras, sampled.ground)
    unchanged = sampled.placements[: len(bare.placements)]
    assert [p[:4] for p in unchanged] == [p[:4] for p in bare.placements]
    assert len(sampled.placements) > len(bare.placements)
