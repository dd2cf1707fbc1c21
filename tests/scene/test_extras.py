"""Ingredients of streets: their shares, no overlaps, and a clear camera."""

import math
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings

from scene import AssetPool, default_unit, sample_street, street_params
from scene.assets.catalogue import bounds, kind
from scene.ground.arms import with_junction
from scene.ground.ground import sample_ground
from scene.ground.junction import sample_junction
from scene.streams import stream
from scene.street.background import BEHIND, LINES_END
from scene.street.clearance import Rectangle, Rectangles
from scene.street.extras import MIX, Mix, extras
from scene.street.instances import objects, poses, rectangles
from scene.street.junction import junction_objects
from scene.street.open_side import KINDS, open_side
from scene.street.plot import Plot, Setting
from scene.street.turning import turning
from tests.scene.conftest import DEFAULT, POOL, SEEDS

ALL = Mix(*[1.0] * len(Mix._fields))
NONE = Mix(*[0.0] * len(Mix._fields))
FULL = {"parked_share": 1.0, "queue_share": 1.0, "open_share": 1.0}


def added(seed, mix=NONE, drive=1.0, **shares):
    """Objects added to an empty street."""
    ground = sample_ground(np.random.default_rng(seed), drive=drive)
    plot = Plot(Setting(DEFAULT._replace(**shares), ground, POOL, drive))
    extras(plot, seed, mix)
    return plot.stands


def posed(stands, drive=1.0):
    """Families, references and poses of objects on a straight road."""
    ground = sample_ground(np.random.default_rng(0), drive=drive)
    return [(*s[:2], pose) for s, pose in zip(stands, poses(ground, stands), strict=True)]


def inside(points, family, ref, pose):
    """Which points f64[n, 3] are in the box of an asset."""
    local, (low, high) = (points - pose[:3, 3]) @ pose[:3, :3], bounds(family, ref)
    return ((local > low) & (local < high)).all(axis=1)


@settings(max_examples=10)
@given(SEEDS)
def test_shares_of_zero_bring_nothing_and_the_same_seed_the_same(seed):
    one, repeated = (added(seed, ALL, **FULL) for _ in range(2))
    assert added(seed) == [] and one == repeated and len(one) > 100


@pytest.mark.parametrize("seed", range(5))
def test_vehicles_never_overlap_and_drive_on_their_side_of_the_road(seed):
    drive = 1.0 if seed % 2 else -1.0
    full, lanes = (
        [
            o
            for o in posed(added(seed, drive=drive, parked_share=share, queue_share=1), drive)
            if o[0] in ("car", "bus", "truck")
        ]
        for share in (1, 0)
    )
    assert len(full) > 30 and all(p[0, 0] * p[1, 3] * drive > 0 for _, _, p in lanes)
    share = np.stack(np.meshgrid(*[np.linspace(0.02, 0.98, 9)] * 2, [0.5]), -1).reshape(-1, 3)
    for (family, ref, pose), other in combinations(full, 2):
        low, high = bounds(family, ref)
        assert not inside((low + share * (high - low)) @ pose[:3, :3].T + pose[:3, 3], *other).any()


def keeps(pose, drive, x=None):
    """How far, metres, an object is on the traffic's side of a street's middle, seen the way that it looks.

    The street is the road, or one that meets it ``x`` metres along.
    """
    heading = pose[0, 0] if x is None else pose[1, 0]
    return drive * heading * (pose[1, 3] if x is None else x - pose[0, 3])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_traffic_of_side_streets_keeps_to_the_side_of_the_road_s_own(drive, side):
    ground = sample_ground(np.random.default_rng(0), drive=drive)._replace(
        side_streets=((40.0, side),), driveways=()
    )
    inside = on_road = 0
    for seed in range(40):
        plot = Plot(Setting(DEFAULT, ground, AssetPool(), drive))
        turning(plot, 1.0, np.random.default_rng(seed))
        for _, _, pose in posed(plot.stands, drive):
            if abs(pose[1, 3]) > ground.half_width:
                assert keeps(pose, drive, 40.0) > 1
                inside += 1
            elif abs(pose[0, 0]) > 0.75:  # it drives along the road rather than across
                assert keeps(pose, drive) > 0
                on_road += 1
    assert min(inside, on_road) > 30


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_at_junctions_what_drives_and_what_it_heeds_are_on_the_traffic_s_side(drive):
    counts = dict.fromkeys(("car", "bus", "truck", "rider", "traffic sign", "traffic light"), 0)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        ground = sample_ground(rng, drive=drive)
        junction = sample_junction(rng, 1.0, ground.half_width, ground.footway)
        setting = Setting(DEFAULT, with_junction(ground, junction), AssetPool(), drive)
        found_here = posed(junction_objects(setting, rng), drive)
        lights = [pose for family, _, pose in found_here if family == "traffic light"]
        for family, _, pose in found_here:
            arm = abs(pose[0, 3] - junction.x) < junction.outer
            if family not in counts or abs(pose[1, 3]) < ground.half_width or not arm:
                continue
            on_side = keeps(pose, drive, junction.x)
            if family == "traffic light":  # a second one stands across from the first
                on_side = max(keeps(p, drive, junction.x) for p in lights if p[1, 0] == pose[1, 0])
            assert on_side > 0, family
            counts[family] += 1
    assert min(counts.values()) > 5, counts


def test_an_approach_to_a_junction_has_lights_of_one_colour():
    pairs = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        ground = sample_ground(rng)
        junction = sample_junction(rng, 1.0, ground.half_width, ground.footway)
        setting = Setting(DEFAULT, with_junction(ground, junction), AssetPool(), -1.0)
        approaches: dict[tuple[float, float], list[int | str]] = {}
        for stand in junction_objects(setting, rng):
            if stand.family == "traffic light":
                of_road = stand.yaw in (0.0, math.pi)
                key = stand.yaw, (stand.x if of_road else stand.y)
                approaches.setdefault(key, []).append(stand.ref)
        for lights in approaches.values():
            pairs += len(lights) > 1
            assert len(set(lights)) == 1
    assert pairs > 5


def in_something(ground, before, stands, passed_over=()):
    """Objects that overlap an earlier one."""
    occupied, overlapping = Rectangles(), []
    occupied.extend(rectangles(ground.path, before))
    for parts in objects(stands):
        footprints = rectangles(ground.path, parts)
        if occupied.meet(Rectangle(*footprints[0]), 0.0):
            overlapping.append(parts)
        if parts[0].family not in passed_over:
            occupied.extend(footprints)
    return overlapping


def test_neither_riders_nor_what_they_ride_stand_in_something():
    riders, ground = 0, sample_ground(np.random.default_rng(0))
    for seed in range(25):
        stands = added(seed, MIX._replace(riders=1.0), parked_share=1, queue_share=0.5)
        bad = in_something(ground, [], stands, ("slab", "land", "paving"))
        assert not [parts for parts in bad if parts[0].family == "rider"]
        riders += sum(stand.family == "rider" for stand in stands)
    assert riders > 250


def test_what_stands_at_a_junction_stands_in_nothing_that_was_there(monkeypatch):
    captured = {}

    def last(plot, seed, mix):
        captured.update(plot=plot, stands=list(plot.stands))

    monkeypatch.setattr("scene.street.street.extras", last)
    counts = dict.fromkeys(("person", "lamp", "tree", "car", "rider"), 0)
    for seed in range(30):
        params = DEFAULT._replace(junction_share=1.0, person_position=8.0)
        sample_street(params, seed, 1, POOL)
        plot, stands = captured["plot"], captured["stands"]
        junction_stands = set(junction_objects(plot.street, stream(seed, "corners")))
        lines = [s for s in stands if s not in junction_stands or s.family == "building"]
        placed_stands = [s for s in stands if s in junction_stands and s.family != "building"]
        assert in_something(plot.ground, lines, placed_stands) == []
        for parts in objects(placed_stands):
            counts[parts[0].family] = counts.get(parts[0].family, 0) + 1
    assert min(counts.values()) > 5, counts


def share_of_water(params, count):
    """Number of open sides with water."""
    ground, water = sample_ground(np.random.default_rng(0)), 0
    for seed in range(count):
        plot = Plot(Setting(params, ground, AssetPool(), 1.0))
        open_side(plot, 1.0, np.random.default_rng(seed))
        land = {kind(s.family, s.ref) for s in plot.stands if s.family == "land"}
        water += bool(land & {"water", "green water"})
    return water / count


@pytest.mark.parametrize("space", ["scenex", "extended"])
def test_water_lies_beside_the_road_as_often_as_the_table_says_in_both_spaces(space):
    params = street_params(default_unit(space))
    assert share_of_water(params, 80) == pytest.approx(KINDS["water"], abs=0.08)
    assert share_of_water(params._replace(gradient=2.01), 20) == 0  # it would lie on a slope


def test_the_camera_stays_clear_open_sides_have_no_houses_and_all_ingredients_come_up():
    families = set()
    for seed, share in product(range(5), (0.0, 1.0)):
        params = DEFAULT._replace(parked_share=1.0, queue_share=1.0, open_share=share)
        sampled = sample_street(params, seed, 4, AssetPool(), ALL)
        lenses = np.array([camera.position for camera in sampled.cameras])
        near = [
            p for p in sampled.placements if math.hypot(*p.pose[:2, 3] / (LINES_END, BEHIND)) < 1
        ]
        solid = [p for p in near if p.family not in ("tree", "bush", "lamp")]
        assert not any(inside(lenses, p.family, p.asset, p.pose).any() for p in solid)
        assert (sum(p.family in ("building", "train") for p in near) > 10) == (share == 0)
        families |= {p.family for p in near}
    assert families >= {"slab", "land", "paving", "bollard", "shelter", "scaffold", "company"}
