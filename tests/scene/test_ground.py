"""Road, sidewalk and terrain: where they lie and what is painted on them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.classes import TrainId
from scene.ground.build import GROUND_INSTANCES, ground_assets
from scene.ground.extent import FOOTWAYS, HALF_WIDTHS, KERB_HEIGHT, KERB_WIDTH
from scene.ground.ground import ground_height, plain, sample_ground
from scene.ground.markings import (
    ARROWS,
    WORDS,
    Legend,
    box_junction,
    clear_of,
    dashes,
    give_way,
    legend,
    parking,
    word,
)
from scene.look.materials import material_id
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS
from scene.mesh.quads import discs, flat, grid, rectangles, strokes, to_asset

SEEDS = st.integers(0, 2**32 - 1)


def ground(seed, **arguments):
    return sample_ground(np.random.default_rng(seed), **arguments)


def of_material(asset, name):
    """Corners [n, 3, 3] of the triangles of one material."""
    return asset.mesh.triangles[asset.material == material_id(name)]


def areas(outlines):
    """Areas of four-cornered outlines [n, 4, 2], by the shoelace formula."""
    x, y = outlines[..., 0], outlines[..., 1]
    return np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)) / 2


# -- the three surfaces --------------------------------------------------------------------------


@pytest.mark.parametrize(("y", "height"), [(0, 0), (4.9, 0), (-4.9, 0), (5.5, 0.12), (-30, 0.12)])
def test_the_ground_is_flat_but_for_the_kerb(y, height):
    assert ground_height(ground(0)._replace(half_width=5.0), y) == height


def test_carriageways_and_sidewalks_are_of_many_widths():
    drawn = [ground(seed) for seed in range(200)]
    for widths, (low, high) in (
        ([g.half_width for g in drawn], HALF_WIDTHS),
        ([g.footway for g in drawn], FOOTWAYS),
    ):
        assert low <= min(widths) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(widths) <= high


def test_the_three_surfaces_are_road_sidewalk_and_terrain():
    assert [TrainId(t).name for t in GROUND_INSTANCES.values()] == ["ROAD", "SIDEWALK", "TERRAIN"]
    assert set(ground_assets(ground(0))) == set(GROUND_INSTANCES)


@given(SEEDS)
def test_each_surface_keeps_to_its_strip(seed):
    drawn = ground(seed)._replace(side_streets=())
    road, sidewalk, terrain = ground_assets(drawn).values()
    reach = [np.abs(a.mesh.vertices[:, 1]) for a in (road, sidewalk, terrain)]
    assert reach[0].max() == pytest.approx(drawn.half_width)
    assert reach[1].min() == pytest.approx(drawn.half_width)
    assert reach[1].max() == pytest.approx(drawn.outer)
    assert reach[2][terrain.mesh.vertices[:, 0] < 300].min() == pytest.approx(drawn.outer)
    assert road.mesh.vertices[:, 2].max() < 0.02  # paint
    assert sidewalk.mesh.vertices[:, 2].max() < KERB_HEIGHT + 0.01
    near = (reach[2] < 90) & (terrain.mesh.vertices[:, 0] < 300)
    assert terrain.mesh.vertices[near, 2] == pytest.approx(KERB_HEIGHT)


@given(SEEDS)
def test_a_plain_ground_is_level_asphalt_without_paint(seed):
    drawn = plain(ground(seed))
    road, sidewalk, terrain = ground_assets(drawn).values()
    assert (road.mesh.vertices[:, 2] == 0).all()
    assert len(set(road.material.tolist())) == 1
    assert np.unique(np.abs(terrain.mesh.vertices[:, 2] - KERB_HEIGHT).round(3)).max() <= 0.01
    assert road.mesh.area == pytest.approx(640 * 2 * drawn.half_width)
    level = sidewalk.mesh.triangles[..., 2].min(axis=1) > 0.1
    paved = sidewalk.mesh.area_faces[level].sum()
    assert paved == pytest.approx(640 * 2 * (drawn.footway - 0.02), rel=1e-3)


@given(SEEDS)
def test_the_ground_is_no_heavier_than_it_may_be_and_has_no_degenerate_face(seed):
    for asset in ground_assets(ground(seed)).values():
        assert np.isfinite(asset.mesh.vertices).all()
        assert asset.mesh.area_faces.min() > 1e-6
        assert ((asset.color >= 0) & (asset.color <= 1)).all()
    assert sum(len(a.color) for a in ground_assets(ground(seed)).values()) < 6000


@given(SEEDS)
def test_the_kerb_drops_at_driveways_and_side_streets_only(seed):
    drawn = ground(seed)
    sidewalk = ground_assets(drawn)[2].mesh.vertices
    kerb = sidewalk[np.isclose(np.abs(sidewalk[:, 1]), drawn.half_width + KERB_WIDTH)]
    low = kerb[kerb[:, 2] < KERB_HEIGHT - 0.01]
    for x, y, _ in low:
        gaps = [(p, 1.8) for p, s in drawn.driveways if s * y > 0]
        gaps += [(p, 5.0) for p, s in drawn.side_streets if s * y > 0]
        assert min(abs(x - p) - half for p, half in gaps) < 1e-6
    assert bool(len(low)) == bool(drawn.driveways or drawn.side_streets)


# -- paint ---------------------------------------------------------------------------------------


@given(SEEDS)
def test_markings_lie_on_the_asphalt_and_within_it(seed):
    drawn = ground(seed)
    painted = of_material(ground_assets(drawn)[1], "marking")
    assert painted[..., 2] == pytest.approx(0.008)
    assert (np.abs(painted[..., 1]) < drawn.half_width).all()


@given(SEEDS)
def test_lines_keep_clear_of_crosswalks(seed):
    drawn = ground(seed)._replace(legends=(), boxes=(), side_streets=(), crosswalks=(30.0, 80.0))
    with_them = of_material(ground_assets(drawn)[1], "marking")
    crossing = np.abs(with_them[..., 0] - 30.0).max(axis=1) < 3.7
    assert crossing.sum() > 10
    # Whatever reaches into the crossing belongs to it.
    touching = np.abs(with_them[..., 0] - 30.0).min(axis=1) < 3.9
    assert touching.sum() == crossing.sum()


@pytest.mark.parametrize("kind", ["zebra", "studs"])
def test_a_crosswalk_crosses_the_whole_road(kind):
    drawn = plain(ground(0))._replace(crosswalks=(20.0,), crossing=kind)
    near = of_material(ground_assets(drawn)[1], "marking")
    near = near[np.abs(near[..., 0] - 20).max(axis=1) < 1.7]
    assert near[..., 1].min() < -drawn.half_width + 0.8
    assert near[..., 1].max() > drawn.half_width - 1.05


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_stop_lines_stand_before_the_crossing_in_the_lane_that_comes_up(drive):
    drawn = plain(ground(0))._replace(crosswalks=(20.0,), drive=drive, give_way=False)
    painted = of_material(ground_assets(drawn)[1], "marking")
    x, y = painted[..., 0].mean(axis=1) - 20, painted[..., 1].mean(axis=1)
    stop = np.abs(np.abs(x) - 3.0) < 0.2
    assert stop.sum() == 4
    assert (np.sign(y[stop]) == -np.sign(x[stop]) * drive).all()


def test_dashes_have_their_length_and_spacing():
    outline = dashes(1.0, 3.0, 2.0, 0.2)
    assert areas(outline) == pytest.approx(0.6)
    assert np.diff(outline[:, 0, 0]) == pytest.approx(5.0)
    assert outline[..., 1].mean() == pytest.approx(1.0)


def test_what_reaches_into_a_kept_place_is_left_out():
    outline = rectangles(np.arange(0.0, 10), np.arange(1.0, 11), np.array(0.0), np.array(1.0))
    kept = clear_of(outline, ((2.5, 4.0), (9.0, 20.0)))
    assert sorted(kept[:, 0, 0]) == [0, 1, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("kind", [*ARROWS, *(" ".join(w) for w in WORDS)])
@pytest.mark.parametrize("heading", [1.0, -1.0])
def test_legends_lie_in_their_lane_and_run_ahead(kind, heading):
    outline = legend(Legend(kind, 50.0, 2.3, heading))
    ahead = heading * (outline[..., 0] - 50)
    assert -0.2 < ahead.min() < 0.5
    assert 1.5 < ahead.max() < 6
    assert outline[..., 1].min() > 0
    assert outline[..., 1].max() < 5
    assert areas(outline).min() > 1e-3


def test_words_read_from_left_to_right_for_the_driver():
    # The upright of an L is at its left: half a letter's width from its foot's end.
    (upright, foot) = word(("L",))
    assert upright[:, 0].mean() < foot[:, 0].mean()
    two = word(("KEEP", "CLEAR"))
    assert two[: len(word(("KEEP",))), :, 1].min() > two[-1, :, 1].max()
    turned = legend(Legend("STOP", 0.0, 0.0, 1.0))
    assert turned[..., 1].max() == pytest.approx(-word(("STOP",))[..., 0].min())


def test_a_right_arrow_points_right():
    right, left = (legend(Legend(k, 0, 0, 1.0))[..., 1].mean() for k in ("right", "left"))
    assert right < 0 < left
    assert right == pytest.approx(-left)


def test_teeth_point_at_the_driver_who_waits():
    teeth = give_way(10.0, 0.0, 5.0, 1.0)
    assert len(teeth) == 6
    assert teeth[:, 0, 0] == pytest.approx(9.4)  # the tip
    assert areas(teeth) == pytest.approx(0.5 * 0.6 / 2)


@pytest.mark.parametrize("style", ["boxes", "ticks"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_parking_bays_lie_along_their_kerb(style, side):
    y = side * parking(5.0, side, style)[..., 1]
    assert 2.5 < y.min() < 3.01
    assert y.max() < 5.0


def test_a_box_junction_fills_its_rectangle_and_no_more():
    outline = box_junction(10.0, 19.0, 5.0)
    low, high = outline.reshape(-1, 2).min(axis=0), outline.reshape(-1, 2).max(axis=0)
    assert low == pytest.approx([10, -4.65], abs=0.15)
    assert high == pytest.approx([19, 4.65], abs=0.15)
    assert len(outline) > 20


# -- faces ---------------------------------------------------------------------------------------


def test_outlines_have_the_area_of_their_shape():
    assert areas(rectangles(np.array(1), np.array(3), np.array([0, 5]), np.array([2, 9]))) == (
        pytest.approx([4, 8])
    )
    assert areas(strokes(np.array([[0, 0]]), np.array([[3, 4]]), 0.2)) == pytest.approx(1.0)
    assert areas(discs(np.array([[5.0, 5.0]]), 2.0, 64)).sum() == pytest.approx(4 * np.pi, rel=0.01)


def test_quads_become_two_triangles_each():
    cells = grid(np.array([0.0, 1, 2]), np.array([0.0, 1]), np.zeros((3, 2)))
    assert cells.shape == (2, 4, 3)
    outline = cells[..., :2]
    asset = to_asset([flat(outline, 0.5, np.array([[0.1] * 3, [0.2] * 3]), "grass")])
    assert asset.mesh.area_faces == pytest.approx(0.5)
    assert asset.color[:, 0] == pytest.approx([0.1, 0.1, 0.2, 0.2])
    assert (asset.mesh.vertices[:, 2] == 0.5).all()


# -- what is drawn -------------------------------------------------------------------------------


def test_grounds_vary_and_are_pure():
    grounds = [ground(seed) for seed in range(120)]
    assert grounds == [ground(seed) for seed in range(120)]
    assert {g.road.name for g in grounds} == {s.name for s in ROADS}
    assert {g.sidewalk.name for g in grounds} == {s.name for s in SIDEWALKS}
    assert {g.terrain.name for g in grounds} == {s.name for s in TERRAINS}
    assert {g.edge_lines for g in grounds} == {0, 1, 2}
    assert {g.centre for g in grounds} == {"dashed", "double", "one side", "hatched", "none"}
    a, b = (ground_assets(grounds[3])[1] for _ in range(2))
    assert a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
    assert a.color.tobytes() == b.color.tobytes()


@pytest.mark.parametrize(("share", "known"), [(0.01, 1), (0.5, 4)])
def test_a_share_of_the_surfaces_is_the_first_of_them(share, known):
    grounds = [ground(seed, share=share) for seed in range(60)]
    assert {g.road.name for g in grounds} == {s.name for s in ROADS[:known]}
    assert {g.terrain.name for g in grounds} == {s.name for s in TERRAINS[:known]}
