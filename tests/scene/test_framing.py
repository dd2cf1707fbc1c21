"""Positions of shots: clear of all objects, and with a street in view."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import AssetPool, TrainId, default_unit, street_params
from scene.assets.catalogue import bounds
from scene.classes import OWN
from scene.dataset.render import street_of
from scene.ground.ground import ground_height
from scene.ground.path import STRAIGHT, nearest, to_world
from scene.proposal import draw, random_proposal
from scene.render import RenderSettings, renderer
from scene.render.embree import depth_buffer
from scene.render.embree.renderer import scene_bvh
from scene.render.framing import HEIGHT, WIDTH, class_shares, framed, judged
from scene.render.geometry import build
from scene.render.protocol import seen_through
from scene.render.shot import sample_rays
from scene.street.camera import AGAIN, ASIDE, DRIVE, SEARCH, SPARE, Camera, nearest_free
from scene.street.instances import EAVES, standing
from tests.scene.conftest import SEEDS, chosen, street

SETTINGS = RenderSettings(64, 32)
EXTENDED = random_proposal("extended")
LOW = 9.0
"""Degrees below the horizon that a frame has to reach to show enough ground."""


def drawn(seed, shots=1, proposal=EXTENDED, index=0):
    (unit,) = draw(proposal, seed, 1, start=index)
    return street_of(unit, seed, index, shots, AssetPool())


def seen(sampled, settings=SETTINGS):
    geometry = build(sampled)
    return framed(sampled, geometry, scene_bvh(geometry), settings)


def corners_of(placements):
    """Corners f64[n, 4, 2] in the world of the rectangles below placements."""
    boxes = np.stack([bounds(p.family, p.asset)[:, :2] for p in placements])
    houses = [p.family == "building" for p in placements]
    boxes[houses] += [[EAVES, 0.0], [-EAVES, -EAVES]]  # overhead
    poses = np.stack([p.pose for p in placements])
    corners = np.stack([boxes[:, (0, 1, 1, 0), 0], boxes[:, (0, 0, 1, 1), 1]], axis=2)
    return np.einsum("nij,nkj->nki", poses[:, :2, :2], corners) + poses[:, None, :2, 3]


def away(point, corners):
    """Distances of a point from rectangles f64[n, 4, 2], metres; 0 inside."""
    start = corners[:, 0]
    sides = np.stack([corners[:, 1] - start, corners[:, 3] - start], axis=1)
    length = np.linalg.norm(sides, axis=2)
    along = np.einsum("nij,nj->ni", sides, point - start) / length
    return np.linalg.norm(along - np.clip(along, 0, length), axis=1)


def test_a_place_is_free_beside_every_rectangle_and_the_nearest_of_them():
    half = math.sqrt(0.5)
    #        x    y   cos   sin  long wide
    rows = [[10, 2.0, 1.0, 0.0, 2.0, 0.5],
            [10, 4.9, 0.0, 1.0, 0.5, 2.0],
            [30, 0.0, half, half, 1.0, 1.0],
            [50, 0.0, 1.0, 0.0, 1.0, 9.0]]  # fmt: skip
    obstacles = np.array(rows)
    x = np.array([0.0, 10.0, 12.9, 13.1, 30.0, 50.0])
    places = nearest_free(STRAIGHT, x, 3.0, obstacles)
    # Beside two that leave 1.9 m between them: below both; past both: where it was; beside a turned square
    # that reaches sqrt(2) times as far: where it was, too, or, from its middle, there; at a wall: nowhere.
    reach = 2 * math.sqrt(2)
    assert places[:5].tolist() == pytest.approx([3.0, 0.5, 0.5, 3.0, 3.0]) and np.isnan(places[5])
    assert nearest_free(STRAIGHT, x, 2.0, obstacles)[4] == pytest.approx(reach)
    assert nearest_free(STRAIGHT, x, -2.0, obstacles)[4] == pytest.approx(-reach)
    assert nearest_free(STRAIGHT, x, 3.0, obstacles[:0]).tolist() == [3.0] * 6


@given(SEEDS, st.sampled_from(["scenex", "extended"]))
def test_cameras_stand_a_metre_beside_all_that_stands_at_their_own_height(seed, space):
    (unit,) = draw(random_proposal(space), seed, 1)
    params, sampled = street_params(unit), street_of(unit, seed, 0, 2, AssetPool())
    solid = [p for p in sampled.placements if p.family not in ("slab", "land", "paving", "tree")]
    stems = ("lamp", "signpost", "traffic sign", "traffic light")  # arms and boards are overhead
    corners = corners_of([p for p in solid if p.family not in stems])
    places = [place for camera in sampled.cameras for place in (camera, *camera.further)]
    x, _ = nearest(sampled.ground.path, np.array([place.position[:2] for place in places]))
    assert len(places) <= 2 * (1 + AGAIN) and (x > -1).all() and (x < DRIVE + SEARCH + 1).all()
    for camera in sampled.cameras:
        if camera.further:
            for place in (camera, *camera.further):
                assert (
                    away(place.position[:2], corners).min() > SPARE - 0.01
                )  # what leans is shorter from above
    if space == "scenex":  # where its attribute says
        lane = sampled.ground.drive * params.camera_position_x
        assert to_world(sampled.ground.path, x, lane) == pytest.approx(
            np.array([place.position[:2] for place in places]), abs=0.01
        )
    level = math.hypot(*(np.subtract(places[0].position, places[-1].position)[:2])) > 0
    assert level  # it drives on
    if sampled.ground.path.straight:
        for place in places:
            along, across, height = place.position
            assert abs(across) <= ASIDE
            above = height - ground_height(sampled.ground, across, along)
            assert above == pytest.approx(params.camera_position_y)
            turned = (place.yaw, place.pitch, place.roll, place.field_of_view)
            assert turned == (params.camera_rotation_y, params.camera_rotation_x,
                              params.camera_roll, params.field_of_view)  # fmt: skip


def test_posts_are_kept_away_from_by_their_stems():
    sampled = street()
    _, rows = standing([p for p in sampled.placements if p.family == "lamp"])
    assert len(rows) > 3 and (rows[:, 4:] <= 0.3).all()


def test_a_shot_needs_ground_and_not_one_thing_alone():
    def passes(**shares):
        class_shares = np.zeros(OWN + 1)
        for name, share in shares.items():
            class_shares[TrainId[name.upper()]] = share
        return judged(class_shares)

    assert passes(sky=0.5, building=0.42, road=0.05, terrain=0.03) == (pytest.approx(0.08), True)
    assert passes(sky=0.5, building=0.43, road=0.04, terrain=0.03) == (pytest.approx(0.07), False)
    assert passes(terrain=0.86, sky=0.14) == (0.86, False)
    assert passes(car=0.86, road=0.14) == (0.14, False)
    assert passes(terrain=0.84, sky=0.16)[1] and passes(road=1.0)[1]
    assert passes(building=0.92, sidewalk=0.08)[1] and not passes(building=0.93, sidewalk=0.07)[1]


@pytest.mark.parametrize("seed", range(4))
def test_the_small_label_image_is_what_the_depth_buffer_sees(seed):
    sampled = drawn(seed)
    geometry, camera = build(sampled), sampled.cameras[0]
    small = seen_through(camera, RenderSettings(WIDTH, HEIGHT))
    hits = depth_buffer.nearest(geometry, camera, small, sample_rays(camera, small))
    label = geometry.train_id[hits.instance]
    shares = class_shares(camera, geometry, scene_bvh(geometry), RenderSettings(320, 99))
    assert shares == pytest.approx(
        np.bincount(label, minlength=OWN + 1) / label.size, abs=2 / label.size
    )


def test_it_is_taken_again_until_it_shows_a_street_and_else_where_most_ground_is_seen():
    sampled = street(seed=2)
    lane = sampled.cameras[0]
    up, down = lane._replace(pitch=-1.2, further=()), lane._replace(pitch=-0.35, further=())
    good = lane._replace(further=())

    def choice(*places):
        (chosen_camera,) = seen(
            sampled._replace(cameras=(places[0]._replace(further=places[1:]),))
        ).cameras
        return chosen_camera

    assert choice(good, up) == good
    assert choice(up, up, good, lane) == good._replace(retaken=2)
    assert choice(up, down, up) == down._replace(retaken=2, refused=True)
    assert choice(up) == up  # it has no other place
    framed_twice = seen(seen(sampled))
    assert framed_twice == seen(sampled) and len(framed_twice.cameras) == 1
    # A camera without other places is used as it is.
    aside = Camera((20.0, 0.0, 1.5), 0.3, -1.0)
    (frame,) = renderer("embree").render(sampled._replace(cameras=(aside,)), SETTINGS)
    assert frame.camera is aside


@pytest.mark.parametrize("name", ["embree", "opengl"])
def test_pictures_of_any_size_and_renderer_are_taken_from_the_same_place(name):
    sampled = drawn(7, 2)
    level = sampled.cameras[0]._replace(pitch=-1.2)
    sampled = sampled._replace(cameras=(level, sampled.cameras[1]))
    expected = seen(sampled).cameras
    assert expected[0].retaken and not expected[1].retaken
    for size in ((40, 30), (96, 40)):
        frames = chosen(name).render(sampled, RenderSettings(*size))
        assert [frame.camera for frame in frames] == list(expected)


def horizon(unit):
    """Degrees from the horizon down to the lower edge of the label image."""
    params = street_params(unit)
    wide = params.field_of_view or math.radians(SETTINGS.fov)
    half = math.atan(math.tan(wide / 2) * HEIGHT / WIDTH)
    return math.degrees(half + params.camera_rotation_x)


def counts(space, streets, seed=11):
    """Numbers of random streets that are retaken, refused, and refused although they look down."""
    retaken = refused = able = lost = 0
    for index, unit in enumerate(draw(random_proposal(space), seed, streets)):
        (camera,) = seen(street_of(unit, seed, index, 1, AssetPool())).cameras
        retaken, refused = retaken + (camera.retaken > 0), refused + camera.refused
        able += horizon(unit) >= LOW
        lost += camera.refused and horizon(unit) >= LOW
    return retaken, refused, able, lost


def test_nearly_all_frames_of_random_streets_show_a_street():
    retaken, refused, able, lost = counts("extended", 24)
    assert retaken <= 3 and refused <= 1 and lost == 0 and able >= 20
    hand = street_params(default_unit())
    for seed in range(6):
        (camera,) = seen(street(hand, seed)).cameras
        assert not camera.refused


@pytest.mark.slow
@pytest.mark.parametrize(
    ("space", "most", "least_able"), [("extended", 0.03, 0.98), ("scenex", 0.03, 0.98)]
)
def test_of_500_random_streets_those_refused_hardly_look_down(space, most, least_able):
    """Where a frame ends less than ``LOW`` degrees below the horizon, one car hides all its ground."""
    retaken, refused, able, lost = counts(space, 500)
    assert retaken <= 0.15 * 500 and refused <= most * 500
    assert able - lost >= least_able * able and able >= 0.94 * 500
