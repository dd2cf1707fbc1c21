"""What comes to a street's lines: shares govern it, it overlaps nothing, and the camera stays clear."""

import math
from itertools import combinations, groupby, product

import numpy as np
import pytest
from hypothesis import given, settings

from scene import AssetPool, default_unit, sample_street, street_params
from scene.assets.catalogue import bounds, kind
from scene.ground.arms import with_junction
from scene.ground.ground import sample_ground
from scene.ground.junction import sample_junction
from scene.street.background import BEHIND, LINES_END
from scene.street.extras import MIX, Mix, extras
from scene.street.junction import junction_objects
from scene.street.lines import Setting
from scene.street.open_side import KINDS, open_side
from scene.street.plot import Plot
from scene.street.room import Rectangles, footprint
from scene.street.turning import turning
from tests.scene.conftest import DEFAULT, POOL, SEEDS

ALL = Mix(*[1.0] * len(Mix._fields))
NONE = Mix(*[0.0] * len(Mix._fields))
FULL = {"parked_share": 1.0, "queue_share": 1.0, "open_share": 1.0}


def added(seed, mix=NONE, drive=1.0, **shares):
    """What comes to an empty street."""
    ground = sample_ground(np.random.default_rng(seed), drive=drive)
    return extras(Setting(DEFAULT._replace(**shares), ground, POOL, drive), seed, [], mix)


def inside(points, family, ref, pose):
    """Which points f64[n, 3] lie in the box of an asset."""
    local, (low, high) = (points - pose[:3, 3]) @ pose[:3, :3], bounds(family, ref)
    return ((local > low) & (local < high)).all(axis=1)


@settings(max_examples=10)
@given(SEEDS)
def test_shares_of_zero_bring_nothing_and_the_same_seed_the_same(seed):
    one, again = ([(f, r, p.tobytes()) for f, r, p in added(seed, ALL, **FULL)] for _ in range(2))
    assert added(seed) == [] and one == again and len(one) > 100


@pytest.mark.parametrize("seed", range(5))
def test_vehicles_never_overlap_and_drive_on_their_side_of_the_road(seed):
    drive = 1.0 if seed % 2 else -1.0
    full, lanes = ([o for o in added(seed, drive=drive, parked_share=share, queue_share=1)
                    if o[0] in ("car", "bus", "truck")] for share in (1, 0))  # fmt: skip
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
        plot = Plot(Setting(DEFAULT, ground, AssetPool(), drive), [])
        turning(plot, 1.0, np.random.default_rng(seed))
        for _, _, pose in plot.added:
            if abs(pose[1, 3]) > ground.half_width:
                assert keeps(pose, drive, 40.0) > 1
                inside += 1
            elif abs(pose[0, 0]) > 0.75:  # it drives along the road rather than across
                assert keeps(pose, drive) > 0
                on_road += 1
    assert min(inside, on_road) > 30


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_at_junctions_what_drives_and_what_it_heeds_are_on_the_traffic_s_side(drive):
    found = dict.fromkeys(("car", "bus", "truck", "rider", "traffic sign", "traffic light"), 0)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        ground = sample_ground(rng, drive=drive)
        junction = sample_junction(rng, 1.0, ground.half_width, ground.footway)
        setting = Setting(DEFAULT, with_junction(ground, junction), AssetPool(), drive)
        objects = junction_objects(setting, rng)
        lights = [pose for family, _, pose in objects if family == "traffic light"]
        for family, _, pose in objects:
            arm = abs(pose[0, 3] - junction.x) < junction.outer
            if family not in found or abs(pose[1, 3]) < ground.half_width or not arm:
                continue
            ours = keeps(pose, drive, junction.x)
            if family == "traffic light":  # a second one stands across from the first
                ours = max(keeps(p, drive, junction.x) for p in lights if p[1, 0] == pose[1, 0])
            assert ours > 0, family
            found[family] += 1
    assert min(found.values()) > 5, found


def objects_of(standing):
    """Objects: their parts, which share a pose."""
    return [list(parts) for _, parts in groupby(standing, lambda stand: id(stand[2]))]


def in_something(objects, before, passed_over=()):
    """Of objects in their order, those of which a part stands in something that stood before it."""
    taken, found = Rectangles(), []
    for family, ref, pose in before:
        taken.add(footprint([(family, ref)], pose))
    for parts in objects:
        boxes = [footprint([(family, ref)], pose) for family, ref, pose in parts]
        if any(taken.meet(box, 0.0) for box in boxes):
            found.append(parts)
        for box in boxes if parts[0][0] not in passed_over else ():
            taken.add(box)
    return found


def test_neither_riders_nor_what_they_ride_stand_in_something():
    riders = 0
    for seed in range(25):
        objects = objects_of(added(seed, MIX._replace(riders=1.0), parked_share=1, queue_share=0.5))
        bad = in_something(objects, [], ("slab", "land", "paving"))
        assert not [parts for parts in bad if parts[0][0] == "rider"]
        riders += sum(parts[0][0] == "rider" for parts in objects)
    assert riders > 250


def test_what_stands_at_a_junction_stands_in_nothing_that_was_there(monkeypatch):
    seen = {}

    def wanted(*arguments):
        seen["wanted"] = junction_objects(*arguments)
        return seen["wanted"]

    def last(setting, seed, standing, mix):
        seen["standing"] = list(standing)
        return []

    monkeypatch.setattr("scene.street.street.junction_objects", wanted)
    monkeypatch.setattr("scene.street.street.extras", last)
    counts = dict.fromkeys(("person", "lamp", "tree", "car", "rider"), 0)
    for seed in range(30):
        sample_street(DEFAULT._replace(junction_share=1.0, person_position=8.0), seed, 1, POOL)
        own = {id(pose) for family, _, pose in seen["wanted"] if family != "building"}
        before = [stand for stand in seen["standing"] if id(stand[2]) not in own]
        objects = objects_of(stand for stand in seen["standing"] if id(stand[2]) in own)
        assert in_something(objects, before) == []
        for parts in objects:
            counts[parts[0][0]] = counts.get(parts[0][0], 0) + 1
    assert min(counts.values()) > 5, counts


def share_of_water(params, count):
    """Of so many open sides."""
    ground, found = sample_ground(np.random.default_rng(0)), 0
    for seed in range(count):
        plot = Plot(Setting(params, ground, AssetPool(), 1.0), [])
        open_side(plot, 1.0, np.random.default_rng(seed))
        land = {kind(family, ref) for family, ref, _ in plot.added if family == "land"}
        found += bool(land & {"water", "green water"})
    return found / count


@pytest.mark.parametrize("space", ["scenex", "extended"])
def test_water_lies_beside_the_road_as_often_as_the_table_says_in_both_spaces(space):
    params = street_params(default_unit(space))
    assert share_of_water(params, 80) == pytest.approx(KINDS["water"], abs=0.08)
    assert share_of_water(params._replace(gradient=2.01), 20) == 0  # it would lie on a slope


def test_the_camera_stays_clear_open_sides_have_no_houses_and_all_ingredients_come_up():
    families = set()
    for seed, share in product(range(5), (0.0, 1.0)):
        params = DEFAULT._replace(parked_share=1.0, queue_share=1.0, open_share=share)
        drawn = sample_street(params, seed, 4, AssetPool(), ALL)
        lenses = np.array([camera.position for camera in drawn.cameras])
        near = [p for p in drawn.placements if math.hypot(*p.pose[:2, 3] / (LINES_END, BEHIND)) < 1]
        solid = [p for p in near if p.family not in ("tree", "bush", "lamp")]
        assert not any(inside(lenses, p.family, p.asset, p.pose).any() for p in solid)
        assert (sum(p.family in ("building", "train") for p in near) > 10) == (share == 0)
        families |= {p.family for p in near}
    assert families >= {"slab", "land", "paving", "bollard", "shelter", "scaffold", "company"}
