"""Strips along sidewalks, ages of roads, and surfaces of sidewalks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import AssetPool, default_unit, sample_street, street_params
from scene.ground.build import ground_surfaces
from scene.ground.extent import KERB_WIDTH
from scene.ground.ground import plain, sample_ground, with_sides
from scene.ground.litter import leaves, puddles
from scene.ground.relief import DRIVE_LIFT
from scene.ground.verge import DEEPEST, LEAST_FOOTWAY, UNDER
from scene.look.materials import material_id
from scene.look.surfaces import ASPHALT, SIDEWALKS, VERGES
from scene.render import RenderSettings, renderer
from scene.street.camera import Camera
from scene.street.furniture import OVERHANG, plantings
from scene.street.instances import footprint
from scene.street.plot import Plot, Setting
from scene.street.street import Street
from tests.scene.conftest import POOL, SEEDS, solid

SIDEWALK, TERRAIN = 2, 3
FROM_ABOVE = RenderSettings(width=64, height=64, samples=1)
EXTENDED = street_params(default_unit("extended"))


def sided(seed, share, front=9.0):
    """A ground with the strips along its sidewalks, and houses on the left only."""
    ground = sample_ground(np.random.default_rng(seed), asphalt=0.0)
    rngs = tuple(np.random.default_rng([seed, side]) for side in range(2))
    return with_sides(ground, share, (None, front), rngs)


def level_area(ground, instance, low, high):
    """Square metres of a surface's level faces between two distances from the centre line."""
    asset = ground_surfaces(ground)[instance].asset
    mesh = solid(asset.mesh)
    y = np.abs(mesh.triangles[..., 1])
    flat = (y.min(axis=1) > low - 1e-6) & (y.max(axis=1) < high + 1e-6)
    flat &= np.ptp(mesh.triangles[..., 2], axis=1) < 1e-9
    return mesh.area_faces[flat].sum()


@given(SEEDS)
def test_a_verge_takes_the_sidewalks_place_leaves_room_to_walk_and_ends_where_one_walks_over_it(
    seed,
):
    sampled = sided(seed, 1.0)
    inner, outer = sampled.half_width + KERB_WIDTH, sampled.outer
    for roadside in sampled.sides:
        low, high = roadside.verge
        assert roadside.green.name in {row.name for row in VERGES} and roadside.rear == 0.0
        assert inner - 1e-9 <= low < high <= outer + 1e-9
        assert (low, high) == (inner, outer) or high - low <= outer - inner - LEAST_FOOTWAY + 1e-9
    level = plain(sampled)._replace(sides=sampled.sides)
    bare = level_area(plain(sampled), SIDEWALK, inner, outer)
    green = level_area(level, TERRAIN, inner, outer)
    assert green == pytest.approx(640 * sum(np.ptp(roadside.verge) for roadside in sampled.sides))
    assert level_area(level, SIDEWALK, inner, outer) + green == pytest.approx(bare)
    crossed = level._replace(crosswalks=(40.0,), driveways=((60.0, 1.0), (60.0, -1.0)))
    assert level_area(crossed, TERRAIN, inner, outer) < green - 2
    top = ground_surfaces(crossed)[TERRAIN].asset.mesh.vertices
    verge = top[(np.abs(top[:, 1]) < outer - 1e-6) | np.isclose(np.abs(top[:, 1]), inner)]
    assert (np.abs(verge[:, 0] - 60) > 1.8).all()


@given(SEEDS, st.floats(5, 30))
def test_without_a_verge_paving_reaches_below_houses_that_are_near(seed, front):
    sampled = sided(seed, 0.0, front)
    open_side, built = sampled.sides
    assert open_side.green is None and built.green is None and open_side.rear == 0.0
    near = front - sampled.outer < DEEPEST
    assert built.rear == (front + UNDER if near else 0.0)
    level = plain(sampled)._replace(sides=sampled.sides)
    for side in (1.0, -1.0):
        land = ground_surfaces(level)[TERRAIN].asset.mesh.vertices[:, 1] * side
        assert land[land > 0].min() == pytest.approx(sampled.rear(side))


@given(SEEDS, st.floats(0, 1), st.floats(0, 1))
def test_shares_are_ordered_whoever_has_a_verge_or_asphalt_keeps_it_at_a_greater_share(seed, a, b):
    less, more = sorted((a, b))
    few, many = sided(seed, less).sides, sided(seed, more).sides
    assert all(x == y for x, y in zip(few, many, strict=True) if x.green)
    less, more = (sample_ground(np.random.default_rng(seed), asphalt=s) for s in (less, more))
    asphalt = {row.name for row in ASPHALT} - {row.name for row in SIDEWALKS}
    assert less == more or (less.sidewalk.name not in asphalt and more.sidewalk.name in asphalt)


def test_a_sidewalk_of_asphalt_is_about_as_dark_as_the_road_and_its_kerb_little_lighter():
    grounds = [sample_ground(np.random.default_rng(seed), asphalt=1.0) for seed in range(200)]
    ratio = np.array([np.mean(g.sidewalk.color) / np.mean(g.road.color) for g in grounds])
    assert 0.65 < ratio.min() and ratio.max() < 1.6 and 0.9 < np.median(ratio) < 1.2
    others = [sample_ground(np.random.default_rng(seed), asphalt=0.0) for seed in range(200)]
    assert np.mean([g.kerb for g in grounds]) < 0.9 * np.mean([g.kerb for g in others])


def test_older_roads_have_more_repairs_more_dust_and_paler_paint():
    def means(wear):
        grounds = [sample_ground(np.random.default_rng(seed), wear=wear) for seed in range(60)]
        paint = material_id("marking")
        bright = []
        for ground in grounds[:12]:
            road = ground_surfaces(ground._replace(road=grounds[0].road))[1].asset
            bright += [road.color[road.material == paint].mean()]
        fresh = np.mean([g.road.name == "fresh asphalt" for g in grounds])
        return [np.mean([g.patches for g in grounds]), np.mean([g.dust for g in grounds]),
                -np.nanmean(bright), -fresh]  # fmt: skip

    new, usual, old = means(0.0), means(0.45), means(1.0)
    assert new[:2] == [0, 0] and all(a < b < c for a, b, c in zip(new, usual, old, strict=True))


def seen_from_above(ground, seed):
    """Shares of sidewalk and terrain in a view of 30 m of the bare ground."""
    sky = sample_street(EXTENDED, seed, 1, POOL).sky
    camera = Camera((30.0, 0.0, 34.0), 0.0, math.pi / 2)
    frame = renderer("embree").render(Street((), (camera,), sky, ground, seed), FROM_ABOVE)[0]
    return np.bincount(frame.label.ravel(), minlength=256)[[1, 9]] / frame.label.size


@pytest.mark.parametrize("shaped", [False, True])
def test_the_share_of_terrain_in_labels_grows_with_the_share_of_verges(shaped):
    flat = {} if shaped else {"bend": 0.0, "gradient": 0.0, "junction_share": 0.0}
    shares = []
    for share in (0.0, 0.5, 1.0):
        params = EXTENDED._replace(green_verge_share=share, **flat)
        grounds = [sample_street(params, seed, 1, POOL).ground for seed in range(8)]
        shares.append(np.mean([seen_from_above(g, k) for k, g in enumerate(grounds)], axis=0))
    sidewalk, terrain = np.transpose(shares)
    assert (np.diff(terrain) > 0.01).all() and (np.diff(sidewalk) < -0.01).all()


@given(SEEDS, st.booleans())
def test_leaves_lie_on_paving_and_water_on_the_road(seed, green):
    sampled = sided(seed, float(green))._replace(leaves=300, puddles=5)
    sampled = plain(sampled)._replace(leaves=300, puddles=5, sides=sampled.sides)
    rng = np.random.default_rng(seed)
    half, outer = sampled.half_width, sampled.outer
    (water,), (wet,) = puddles(sampled, rng), leaves(sampled, rng, road=True)
    for part in (water, wet):
        assert np.abs(part.corners[..., 1]).max() < half and part.corners[..., 2].max() < 0.02
    assert areas(water.corners).min() > 1e-4 and 3 < areas(water.corners).sum() < 40
    (dry,) = leaves(sampled, rng, road=False)
    y = dry.corners[..., 1]
    assert (np.abs(y) > half + KERB_WIDTH).all() and (np.abs(y) < outer).all()
    for side in (-1.0, 1.0):
        low, high = sampled.side(side).verge
        on_side = side * y[side * y[:, 0] > 0]
        assert not ((on_side > low) & (on_side < high)).any()


@given(SEEDS)
def test_plants_stand_on_green_verges_alone(seed):
    for share in (0.0, 1.0):
        sampled = sided(seed, share)
        plot = Plot(Setting(EXTENDED, sampled, POOL, 1.0))
        for side in (-1.0, 1.0):
            plantings(plot, side, 1.0, np.random.default_rng(seed))
        assert share or not plot.stands
        for stand in plot.stands:
            low, high = sampled.side(math.copysign(1, stand.y)).verge
            _, _, _, wide = footprint((stand.family, stand.ref))
            assert stand.family == "bush"
            assert low - OVERHANG / 2 < abs(stand.y) - wide + 1e-9
            assert abs(stand.y) + wide - 1e-9 < high + OVERHANG / 2
            assert all(abs(stand.x - x) > 2 for x, s in sampled.driveways if s * stand.y > 0)


def test_some_verges_are_planted():
    ground, counts = sided(3, 1.0), []
    for share in (0.0, 0.5, 1.0):
        plot = Plot(Setting(EXTENDED, ground, AssetPool(), 1.0))
        plantings(plot, 1.0, share, np.random.default_rng(0))
        counts.append(len(plot.stands))
    assert counts[0] == 0 < counts[1] < counts[2]


def areas(corners):
    """Areas of level four-cornered faces [n, 4, 3]."""
    x, y = corners[..., 0], corners[..., 1]
    return np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)) / 2


def test_drives_lie_on_what_they_cross_and_reach_the_house():
    sampled = plain(sided(3, 0.0))._replace(driveways=((20.0, 1.0),), sides=sided(3, 0.0).sides)
    mesh = ground_surfaces(sampled)[SIDEWALK].asset.mesh.vertices
    drive = mesh[np.isclose(mesh[:, 2], sampled.kerb_height + DRIVE_LIFT)]
    assert drive[:, 1].max() == pytest.approx(9.0 - 0.3)
    assert (np.abs(drive[:, 0] - 20) < 1.7).all()
