"""Road, sidewalk and terrain: positions and markings."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given

from scene.classes import TrainId
from scene.ground import markings
from scene.ground.build import GROUND_INSTANCES, ground_surfaces
from scene.ground.extent import FOOTWAYS, HALF_WIDTHS, KERB_HEIGHTS, KERB_WIDTH
from scene.ground.ground import ground_height, plain, sample_ground
from scene.look.materials import material_id
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS
from scene.mesh.quads import discs, flat, grid, rectangles, strokes, to_asset
from tests.scene.conftest import SEEDS, solid


def ground(seed, **arguments):
    return sample_ground(np.random.default_rng(seed), **arguments)


def ground_assets(sampled):
    """The three surfaces in the world."""
    return {instance: surface.asset for instance, surface in ground_surfaces(sampled).items()}


def painted_on(sampled):
    """Corners [n, 3, 3] of the triangles painted on its road."""
    road = ground_assets(sampled)[1]
    return solid(road.mesh).triangles[road.material == material_id("marking")]


def areas(outlines):
    """Areas of four-cornered outlines [n, 4, 2], by the shoelace formula."""
    x, y = outlines[..., 0], outlines[..., 1]
    return np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)) / 2


def test_the_ground_is_flat_but_for_the_kerb_and_of_many_widths():
    for y, height in ((0, 0), (4.9, 0), (-4.9, 0), (5.5, 0.1), (-30, 0.1)):
        assert ground_height(ground(0)._replace(half_width=5.0, kerb_height=0.1), y) == height
    sampled = [ground(seed) for seed in range(200)]
    for name, (low, high) in (("half_width", HALF_WIDTHS), ("footway", FOOTWAYS),
                              ("kerb_height", KERB_HEIGHTS)):  # fmt: skip
        widths = [(getattr(g, name) - low) / (high - low) for g in sampled]
        assert 0 <= min(widths) < 0.1 and 0.9 < max(widths) <= 1


@given(SEEDS)
def test_road_sidewalk_and_terrain_keep_to_their_strips_and_have_no_degenerate_face(seed):
    assert [TrainId(t).name for t in GROUND_INSTANCES.values()] == ["ROAD", "SIDEWALK", "TERRAIN"]
    sampled = ground(seed)._replace(side_streets=())
    assets = ground_assets(sampled)
    road, sidewalk, terrain = (assets[k].mesh.vertices for k in GROUND_INSTANCES)
    half, outer = pytest.approx(sampled.half_width), pytest.approx(sampled.outer)
    reach = np.abs(sidewalk[:, 1])
    assert np.abs(road[:, 1]).max() == half == reach.min() and reach.max() == outer
    assert road[:, 2].max() < 0.02  # paint
    assert sidewalk[:, 2].max() < sampled.kerb_height + 0.01
    terrain = terrain[terrain[:, 0] < 300]
    assert np.abs(terrain[:, 1]).min() == outer
    assert terrain[np.abs(terrain[:, 1]) < 90, 2] == pytest.approx(sampled.kerb_height)
    assets = ground_assets(ground(seed)).values()
    for asset in assets:
        assert np.isfinite(asset.mesh.vertices).all() and solid(asset.mesh).area_faces.min() > 1e-6
        assert 0 <= asset.color.min() and asset.color.max() <= 1
    assert sum(len(a.color) for a in assets) < 6000


@given(SEEDS)
def test_a_plain_ground_is_level_asphalt_without_paint(seed):
    sampled = plain(ground(seed))
    road, sidewalk, terrain = ground_assets(sampled).values()
    assert (road.mesh.vertices[:, 2] == 0).all() and len(set(road.material.tolist())) == 1
    assert (
        np.unique(np.abs(terrain.mesh.vertices[:, 2] - sampled.kerb_height).round(3)).max() <= 0.01
    )
    assert solid(road.mesh).area == pytest.approx(640 * 2 * sampled.half_width)
    footways = solid(sidewalk.mesh)
    paved = footways.area_faces[
        footways.triangles[..., 2].min(axis=1) > sampled.kerb_height - 0.02
    ].sum()
    assert paved == pytest.approx(640 * 2 * (sampled.footway - 0.02), rel=1e-3)


@given(SEEDS)
def test_markings_lie_on_the_asphalt_and_the_kerb_drops_at_driveways_only(seed):
    sampled = ground(seed)
    paint = painted_on(sampled)
    assert paint[..., 2] == pytest.approx(0.008)
    assert (np.abs(paint[..., 1]) < sampled.half_width).all()
    bare = sampled._replace(legends=(), boxes=(), side_streets=(), crosswalks=(30.0, 80.0))
    away = np.abs(painted_on(bare)[..., 0] - 30.0)
    # Whatever reaches into the crossing belongs to it.
    assert (away.min(axis=1) < 3.9).sum() == (away.max(axis=1) < 3.7).sum() > 10
    sidewalk = ground_assets(sampled)[2].mesh.vertices
    kerb = sidewalk[np.isclose(np.abs(sidewalk[:, 1]), sampled.half_width + KERB_WIDTH)]
    low = kerb[kerb[:, 2] < sampled.kerb_height - 0.001]
    gaps = [(*gap, 1.8) for gap in sampled.driveways] + [
        (*gap, 5.0) for gap in sampled.side_streets
    ]
    for x, y, _ in low:
        assert min(abs(x - p) - half for p, side, half in gaps if side * y > 0) < 1e-6
    assert bool(len(low)) == bool(sampled.driveways or sampled.side_streets)


def test_a_crosswalk_crosses_the_whole_road_and_stop_lines_stand_in_the_lane_that_comes_up():
    bare = plain(ground(0))._replace(crosswalks=(20.0,))
    for kind in ("zebra", "studs"):
        paint, half = painted_on(bare._replace(crossing=kind)), bare.half_width
        y = paint[np.abs(paint[..., 0] - 20).max(axis=1) < 1.7, :, 1]
        assert y.min() < -half + 0.8 and y.max() > half - 1.05
    for drive in (1.0, -1.0):
        paint = painted_on(bare._replace(drive=drive, give_way=False))
        x, y = paint[..., 0].mean(axis=1) - 20, paint[..., 1].mean(axis=1)
        stop = np.abs(np.abs(x) - 3.0) < 0.2
        assert np.sign(x[stop] * y[stop]).tolist() == [-drive] * 4


def test_dashes_have_their_length_and_spacing_and_keep_out_of_kept_places():
    outline = markings.dashes(1.0, 3.0, 2.0, 0.2)
    assert areas(outline) == pytest.approx(0.6)
    assert np.diff(outline[:, 0, 0]) == pytest.approx(5.0)
    assert outline[..., 1].mean() == pytest.approx(1.0)
    outline = rectangles(np.arange(0.0, 10), np.arange(1.0, 11), np.array(0.0), np.array(1.0))
    remaining = markings.clear_of(outline, ((2.5, 4.0), (9.0, 20.0)))
    assert sorted(remaining[:, 0, 0]) == [0, 1, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("kind", [*markings.ARROWS, *(" ".join(w) for w in markings.WORDS)])
@pytest.mark.parametrize("heading", [1.0, -1.0])
def test_legends_lie_in_their_lane_and_run_ahead(kind, heading):
    outline = markings.legend(markings.Legend(kind, 50.0, 2.3, heading))
    ahead = heading * (outline[..., 0] - 50)
    assert -0.2 < ahead.min() < 0.5 and 1.5 < ahead.max() < 6
    assert 0 < outline[..., 1].min() and outline[..., 1].max() < 5 and areas(outline).min() > 1e-3


def test_words_read_from_left_to_right_for_the_driver_and_a_right_arrow_points_right():
    # The upright of an L is at its left: half a letter's width from its foot's end.
    (upright, foot) = markings.word(("L",))
    assert upright[:, 0].mean() < foot[:, 0].mean()
    two = markings.word(("KEEP", "CLEAR"))
    assert two[: len(markings.word(("KEEP",))), :, 1].min() > two[-1, :, 1].max()
    turned = markings.legend(markings.Legend("STOP", 0.0, 0.0, 1.0))
    assert turned[..., 1].max() == pytest.approx(-markings.word(("STOP",))[..., 0].min())
    arrows = (markings.legend(markings.Legend(kind, 0, 0, 1.0)) for kind in ("right", "left"))
    right, left = (arrow[..., 1].mean() for arrow in arrows)
    assert right < 0 < left == pytest.approx(-right)


def test_teeth_point_at_who_waits_boxes_fill_their_rectangle_and_bays_lie_along_their_kerb():
    teeth = markings.give_way(10.0, 0.0, 5.0, 1.0)
    assert teeth[:, 0, 0] == pytest.approx([9.4] * 6)  # the tip
    assert areas(teeth) == pytest.approx(0.5 * 0.6 / 2)
    outline = markings.box_junction(10.0, 19.0, 5.0)
    ends = [*outline.min(axis=(0, 1)), *outline.max(axis=(0, 1))]
    assert ends == pytest.approx([10, -4.65, 19, 4.65], abs=0.15) and len(outline) > 20
    for style, side in product(("boxes", "ticks"), (1.0, -1.0)):
        y = side * markings.parking(5.0, side, style)[..., 1]
        assert 2.5 < y.min() < 3.01 and y.max() < 5.0


def test_outlines_have_the_area_of_their_shape_and_become_two_triangles_each():
    sides = rectangles(np.array(1), np.array(3), np.array([0, 5]), np.array([2, 9]))
    assert areas(sides) == pytest.approx([4, 8])
    assert areas(strokes(np.array([[0, 0]]), np.array([[3, 4]]), 0.2)) == pytest.approx(1.0)
    assert areas(discs(np.array([[5.0, 5.0]]), 2.0, 64)).sum() == pytest.approx(4 * np.pi, rel=0.01)
    cells = grid(np.array([0.0, 1, 2]), np.array([0.0, 1]), np.zeros((3, 2)))
    assert cells.shape == (2, 4, 3)
    asset = to_asset([flat(cells[..., :2], 0.5, np.array([[0.1] * 3, [0.2] * 3]), "grass")])
    assert solid(asset.mesh).area_faces == pytest.approx(0.5)
    assert asset.color[:, 0] == pytest.approx([0.1, 0.1, 0.2, 0.2])
    assert (asset.mesh.vertices[:, 2] == 0.5).all()


def test_grounds_vary_and_are_pure_and_a_share_of_the_surfaces_is_the_first_of_them():
    grounds = [ground(seed, asphalt=0.0) for seed in range(120)]
    assert grounds == [ground(seed, asphalt=0.0) for seed in range(120)]
    for name, rows in (("road", ROADS), ("sidewalk", SIDEWALKS), ("terrain", TERRAINS)):
        assert {getattr(g, name).name for g in grounds} == {row.name for row in rows}
    assert {g.edge_lines for g in grounds} == {0, 1, 2}
    assert {g.centre for g in grounds} == {"dashed", "double", "one side", "hatched", "none"}
    a, b = (ground_assets(grounds[3])[1] for _ in range(2))
    assert (a.mesh.vertices == b.mesh.vertices).all() and (a.color == b.color).all()
    for share, allowed in ((0.01, 1), (0.5, 4)):
        grounds = [ground(seed, share=share) for seed in range(60)]
        assert {g.road.name for g in grounds} == {s.name for s in ROADS[:allowed]}
        assert {g.terrain.name for g in grounds} == {s.name for s in TERRAINS[:allowed]}
