"""Every renderer: exact labels, instances and depth, and images that follow the light."""

import math

import numpy as np
import pytest

from scene import CLASS_NAMES, CameraResponse, Street, TrainId
from scene.assets.families import FAMILIES
from scene.attributes import BY_NAME
from scene.classes import VOID
from scene.dataset.formats.segments import panoptic_ids
from scene.ground.ground import plain, sample_ground
from scene.ground.path import STRAIGHT, Path, place_at
from scene.mesh.solids import box
from scene.preview.closeup import asset_street
from scene.render import RENDERERS, RenderSettings, check_settings, renderer, shot
from scene.render.embree import depth_buffer, sunlight
from scene.render.geometry import SKY_INSTANCE, build
from scene.render.protocol import pixel_rays, through_middles
from scene.sky.sky import sample_sky
from scene.street.camera import Camera, camera_axes
from scene.street.instances import Placement
from tests.scene.conftest import DEFAULT, chosen, refused, street

SMALL = RenderSettings(width=96, height=64)
QUIET = SMALL._replace(response=CameraResponse(noise=0.0, meter=0.0, halo=0.0, variation=0.0))
LEVEL = Camera((0.0, 0.0, 1.5), yaw=0.0, pitch=0.0)


@pytest.fixture(params=RENDERERS)
def draw(request):
    """``draw(street, settings)``: the first frame, by each renderer in turn."""
    by = chosen(request.param)
    return lambda sampled, settings=QUIET: by.render(sampled, settings)[0]


def bare_street(*placements, camera=LEVEL, cover=0.0, intensity=1.0, elevation=0.7, azimuth=1.2):
    """Road and sky only, with the given placements; unpainted asphalt."""
    light = {"intensity": intensity, "elevation": elevation, "azimuth": azimuth}
    sampled = (sample_sky(np.random.default_rng(seed), **light) for seed in range(200))
    sky = next(sky for sky in sampled if sky.weather == "clear")._replace(cover=cover, haze=1e5)
    ground = plain(sample_ground(np.random.default_rng(0)))._replace(half_width=5.0, footway=3.0)
    return Street(tuple(placements), (camera,), sky, ground, seed=0)


def at(family, x, y, z=0.0, index=0, instance=4):
    """A placement facing along the road."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return Placement(family, index, int(FAMILIES[family].train_id), instance, pose)


def project(point, camera, settings):
    """Column and row (of pixels, as floats) where a world point appears."""
    right, up, forward = camera_axes(camera) @ (np.asarray(point) - camera.position)
    scale = settings.width / 2 / math.tan(math.radians(settings.fov) / 2)
    return settings.width / 2 + scale * right / forward, settings.height / 2 - scale * up / forward


def test_axes_are_right_handed_and_rays_span_the_field_of_view_symmetrically():
    assert camera_axes(LEVEL) == pytest.approx(np.array([[0, -1, 0], [0, 0, 1], [1, 0, 0]]))
    turned = camera_axes(LEVEL._replace(yaw=math.radians(30), pitch=math.radians(10)))
    assert turned @ turned.T == pytest.approx(np.eye(3))
    assert (turned[2, 1:] < 0).all() and turned[0, 2] == 0  # to the right and down, no roll
    rolled = camera_axes(LEVEL._replace(roll=math.radians(90)))  # right looks down, the top right
    assert rolled == pytest.approx(np.array([[0, 0, -1], [0, -1, 0], [1, 0, 0]]))
    x, y = pixel_rays(RenderSettings(width=8, height=16, fov=90), 1)
    assert x == pytest.approx(np.arange(-3.5, 4) / 4)
    assert y == pytest.approx(np.arange(7.5, -8, -1) / 4)
    for samples in range(1, 9):
        settings = through_middles(SMALL._replace(samples=samples))
        x, y = pixel_rays(settings, settings.samples)
        assert 0 < settings.samples <= samples and settings.samples % 2
        middle = slice(settings.samples // 2, None, settings.samples)
        expected = pixel_rays(SMALL, 1)
        assert x[middle] == pytest.approx(expected[0]) and y[middle] == pytest.approx(expected[1])


def test_a_camera_sees_with_its_own_lens_exposure_and_white_balance(draw):
    post, wide = at("lamp", 12, 1), QUIET._replace(fov=90)

    def seen(settings=QUIET, **changes):
        return draw(bare_street(post, camera=LEVEL._replace(**changes)), settings)

    by_camera = seen(field_of_view=math.radians(90), roll=0.2)
    np.testing.assert_array_equal(by_camera.image, seen(wide, roll=0.2).image)
    assert by_camera.label[0, 0] == TrainId.SKY and not np.array_equal(
        by_camera.label, seen(wide).label
    )
    changes = {}, {"exposure": 1.5}, {"warmth": 1}
    default, bright, warm = (seen(**change).image.mean(axis=(0, 1)) for change in changes)
    assert (bright > default + 5).all()
    assert warm[0] > default[0] + 5 and warm[1] == pytest.approx(default[1], abs=1)
    assert warm[2] < default[2] - 5


@pytest.mark.parametrize("name", RENDERERS)
def test_every_camera_has_its_own_lens(name):
    narrow, wide = (LEVEL._replace(field_of_view=math.radians(fov)) for fov in (30, 100))
    sampled = bare_street(at("lamp", 12, 1))
    one, other = (
        chosen(name).render(sampled._replace(cameras=cameras), QUIET)
        for cameras in ((narrow, wide), (wide, narrow))
    )
    for frame, same in zip(one, reversed(other), strict=True):
        np.testing.assert_array_equal(frame.depth, same.depth)
    assert not np.array_equal(one[0].depth, one[1].depth)


@pytest.mark.parametrize(("change", "message"), [
    ({"width": 4}, "4x320 is too small"), ({"height": 0}, "640x0 is too small"),
    ({"width": 100_000, "height": 100_000}, "has more than 50,000,000 pixels"),
    ({"width": 64.0}, "width must be a whole number, not 64.0"),
    ({"samples": "2"}, "samples must be a whole number, not '2'"),
    *(({"samples": samples}, f"samples must lie in 1..8, not {samples}") for samples in (0, 9)),
    *(({"fov": fov}, f"fov must lie in 5..150 degrees, not {fov}") for fov in (0.0, math.nan)),
])  # fmt: skip
def test_settings_out_of_range_are_refused_by_name(change, message):
    refused(ValueError, message, check_settings, RenderSettings(**change))


def test_renderers_check_their_settings_and_an_unknown_one_is_refused(draw):
    refused(ValueError, "samples", draw, bare_street(), SMALL._replace(samples=0))
    blind = LEVEL._replace(yaw=math.nan), LEVEL._replace(field_of_view=0.01)
    for camera, words in zip(blind, ("yaw must be a finite number, not nan", "fov"), strict=True):
        cameras = LEVEL, camera
        refused(ValueError, words, draw, bare_street()._replace(cameras=cameras), SMALL)
    refused(ValueError, "unknown renderer 'vulkan'; known: embree, opengl", renderer, "vulkan")


def test_depth_of_the_road_is_height_over_slope_up_to_the_kerb_and_above_it_is_sky(draw):
    frame = draw(bare_street())
    _, y = pixel_rays(QUIET, 1)
    slope = np.broadcast_to(-y[:, None], frame.depth.shape)
    road = frame.instance == 1
    assert road.mean() > 0.2
    # Near the horizon floats run out; there a per mille of error is allowed.
    np.testing.assert_allclose(frame.depth[road], (1.5 / slope)[road], rtol=1e-3)
    assert (frame.label[:31] == TrainId.SKY).all()
    assert set(np.unique(frame.label[33:])) == {TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN}
    settings, row = QUIET._replace(width=160, height=120), 76
    frame = draw(bare_street(), settings)
    column, _ = project((frame.depth[row, 80], 5.0, 0.0), LEVEL, settings)
    road = np.flatnonzero(frame.label[row] == TrainId.ROAD)
    assert [road.min(), road.max() + 1] == pytest.approx([column, 160 - column], abs=1)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_box_is_labelled_where_projection_says(draw, samples, monkeypatch):
    cube = box((1.0, 2.0, 1.0), (0, 0, 0), (0.8, 0.1, 0.1))
    monkeypatch.setattr("scene.assets.catalogue.asset", lambda family, index: cube)
    settings = QUIET._replace(width=200, height=100, samples=samples)
    camera = Camera((1.0, 0.5, 1.6), yaw=0.1, pitch=0.05)
    # An index that no cache has seen.
    frame = draw(bare_street(at("bus", 11.5, 0, 0.5, index=10**6), camera=camera), settings)
    front = [(11.0, y, z) for y in (-1, 1) for z in (0.5, 1.5)]
    columns, rows = np.array([project(p, camera, settings) for p in front]).T
    bus = frame.label == TrainId.BUS
    pixels = np.argwhere(bus)
    assert (frame.instance[bus] == 4).all()
    ends = [*pixels.min(axis=0), pixels[:, 0].max() + 1]
    assert ends == pytest.approx([rows.min(), columns.min(), rows.max()], abs=1.5)
    centre = round(rows.mean()), round(columns.mean())
    expected = camera_axes(camera)[2] @ (np.array([11.0, 0, 1.0]) - camera.position)
    assert bus[centre] and frame.depth[centre] == pytest.approx(expected, rel=0.01)


def test_normals_are_in_the_camera_s_frame_unit_face_it_and_are_zero_in_the_sky(draw):
    frame = draw(bare_street(camera=LEVEL._replace(pitch=0.3, yaw=0.4)))
    up = [0, math.cos(0.3), math.sin(0.3)]
    assert np.abs(frame.normal[frame.instance == 1] - up).max() < 1e-3
    frame = draw(street(seed=3))
    sky = frame.instance == SKY_INSTANCE
    assert (frame.normal[sky] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(frame.normal[~sky], axis=1), 1, atol=1e-3)
    x, y = pixel_rays(QUIET, 1)
    rays = np.stack(np.broadcast_arrays(x, y[:, None], -1.0), axis=-1)
    assert ((frame.normal * rays).sum(axis=-1)[~sky] < 1e-3).all()


@pytest.mark.parametrize("name", RENDERERS)
def test_a_lap_is_called_after_every_stage(name):
    stages: list[str] = []
    chosen(name).render(street(shots=2), QUIET, stages.append)
    assert stages == ["build", "bvh", "rays", "shade", "rays", "shade"]


def test_faces_are_seen_from_both_sides(draw):
    for camera in (LEVEL, LEVEL._replace(position=(12.0, 0.0, 1.5), yaw=math.pi)):
        frame = draw(bare_street(at("traffic sign", 6, 0, 0), camera=camera))
        assert (frame.label == TrainId.TRAFFIC_SIGN).sum() > 20


@pytest.mark.parametrize(("family", "kind", "share"), [
    ("fence", "guard rail", 1.0), ("fence", "bow top", 0.0),
    ("slab", "paved bay", 1.0), ("slab", "asphalt bay", 0.0),
    ("person", "suitcase", 0.3), ("person", "pushing a pram", 0.5), ("person", "pushing a buggy", 0.4),
    ("person", "shopping bags", 0.0), ("company", "with a large dog", 0.4),
    ("company", "sitting with a phone", 0.25),
])  # fmt: skip
def test_labels_ignore_what_cityscapes_gives_no_class(draw, family, kind, share):
    """Guard rails, parking that is set off, wheeled luggage, prams, dogs and benches; not what is carried."""
    row = FAMILIES[family]
    frame = draw(asset_street(family, row.kind_cycle.index(kind), 96 / 64, 50))
    label, void = frame.label[frame.instance == 4], frame.label == VOID
    assert set(np.unique(label)) <= {row.train_id, VOID} and len(label) > 300
    assert (label == VOID).mean() == pytest.approx(share, abs=0.1 if 0 < share < 1 else 0)
    assert (frame.instance[void] == 4).all()
    assert ((panoptic_ids(frame.label, frame.instance) == 0) == void).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_parts_of_a_frame_agree(draw, seed):
    sampled = street(seed=seed)
    frame = draw(sampled, SMALL)
    assert frame.image.shape == (64, 96, 3)
    assert [a.dtype for a in frame[:5]] == [np.uint8, np.uint8, np.uint16, np.float32, np.float32]
    void = frame.label == VOID  # what labels ignore
    assert np.array_equal(frame.label[~void], build(sampled).train_id[frame.instance][~void])
    sky = frame.instance == SKY_INSTANCE
    assert ((frame.depth == 0) == sky).all() and ((frame.label == TrainId.SKY) == sky).all()
    assert (frame.depth[~sky] > 0.04).all() and frame.depth.max() < 1000


def test_labels_do_not_depend_on_light_or_quality_nor_much_on_samples(draw):
    sampled = street(seed=1)
    flat_settings = SMALL._replace(shadows=False, occlusion=False, textures=False)
    one, dark = draw(sampled), draw(sampled._replace(sky=street(seed=2).sky))
    assert (one.label == dark.label).all() and (
        one.label == draw(sampled, flat_settings).label
    ).all()
    for samples in (2, 4):  # their labels are those of a ray through each pixel's middle
        even = draw(sampled, QUIET._replace(samples=samples))
        assert (even.image != one.image).any()
        assert all(a.tobytes() == b.tobytes() for a, b in zip(even[1:5], one[1:5], strict=True))
    three = draw(sampled, QUIET._replace(samples=3))
    assert (one.label != three.label).mean() < 0.003  # twigs, at most
    assert np.abs(one.image.astype(int) - three.image).mean() > 0.5  # yet edges are smoother


def test_the_same_street_gives_the_same_bytes_and_noise_is_drawn_anew_for_every_shot(draw):
    a, b, other = (draw(street(seed=seed), SMALL) for seed in (5, 5, 6))
    assert all(x.tobytes() == y.tobytes() for x, y in zip(a[:5], b[:5], strict=True))
    assert a.camera == b.camera
    assert (a.image != other.image).mean() > 0.5 and (a.label != other.label).any()
    sampled = bare_street()
    quiet = SMALL._replace(response=SMALL.response._replace(noise=0.0))  # the street's own camera
    clean, noisy = draw(sampled, quiet), draw(sampled, SMALL)
    assert 0.5 < (noisy.image.astype(int) - clean.image).std() < 8
    a, b = renderer("embree").render(sampled._replace(cameras=(LEVEL, LEVEL)), SMALL)
    assert a.label.tobytes() == b.label.tobytes() and a.image.tobytes() != b.image.tobytes()


def test_a_shadow_falls_away_from_the_sun_and_darkens(draw):
    # The sun stands left, ahead: the shadow of a bus on the left falls on the road.
    sampled = bare_street(at("bus", 14, 4.5), elevation=0.6, azimuth=math.pi / 2)
    with_it, without = draw(sampled), draw(sampled, QUIET._replace(shadows=False))
    change = with_it.image.mean(axis=2) - without.image.mean(axis=2)
    road = with_it.label == TrainId.ROAD
    darker = road & (change < -10)
    assert darker.sum() > 200 and change[road].max() < 5  # and nothing gets lighter
    x = with_it.depth[darker]
    y = -(np.nonzero(darker)[1] + 0.5 - 48) / 48 * math.tan(math.radians(25)) * x
    # A bus is 2.8 m or so high; at this elevation its shadow reaches height / tan(0.6).
    assert -4 < y.min() < 2.5 and 8 < np.median(x) < 22


@pytest.mark.parametrize(("samples", "most"), [(1, 0.7), (2, 0.35)])
def test_the_light_of_few_rays_is_that_of_one_for_every_spot(samples, most, monkeypatch):
    settings, cast, ask = QUIET._replace(width=200, height=120, samples=samples), [], sunlight.free
    sampled = street(seed=1)._replace(sky=bare_street().sky)
    monkeypatch.setattr(sunlight, "free", lambda *a: cast.append(len(a[3])) or ask(*a))
    few, rays = renderer("embree").render(sampled, settings)[0], sum(cast)
    monkeypatch.setattr(sunlight, "_others", lambda first, lit, *_: np.flatnonzero(lit < 0))
    change = renderer("embree").render(sampled, settings)[0].image.astype(int) - few.image
    assert rays < most * (few.instance > 0).sum() * samples**2 and rays < sum(cast) - rays
    assert 0 < np.abs(change).mean() < 0.5 and abs(change.mean()) < 0.2


def test_samples_are_shaded_as_one_where_they_see_one_surface():
    sampled, settings = street(seed=1), SMALL._replace(samples=2)
    around = shot.surroundings(sampled, build(sampled), settings)
    rays = shot.sample_rays(sampled.cameras[0], settings)
    hits = depth_buffer.nearest(around.geometry, sampled.cameras[0], settings, rays)
    spots = shot.visible(around, rays, hits, settings).spots
    assert len(spots.sample) < 0.5 * len(hits.face)
    assert (np.add.reduceat(spots.share, spots.first[:-1]) == 4).all()
    assert (hits.instance[spots.sample][spots.owner] == hits.instance).all()


def test_occlusion_darkens_what_is_close_to_other_things_and_textures_roughen_the_asphalt(draw):
    sampled = street(seed=2)
    with_it, without = draw(sampled), draw(sampled, QUIET._replace(occlusion=False))
    solid = with_it.label != TrainId.SKY
    change = with_it.image[solid].astype(int) - without.image[solid]
    assert change.mean() < -2 and np.array_equal(with_it.image[~solid], without.image[~solid])
    sampled = bare_street(camera=LEVEL._replace(pitch=0.3))
    rough, flat = draw(sampled), draw(sampled, QUIET._replace(textures=False))
    grain = [np.diff(f.image[-20:, 40:56].astype(float), axis=1).std() for f in (rough, flat)]
    assert grain[0] > 1.5 * grain[1]


def test_textures_of_the_ground_follow_a_bend(draw):
    """From above, a bent road looks like a straight one at the same place along it."""
    settings = QUIET._replace(shadows=False, occlusion=False)
    straight = bare_street()._replace(cameras=())
    ground = straight.ground._replace(
        road=straight.ground.road._replace(material="patched asphalt")
    )
    images = []
    for path in (STRAIGHT, Path(bends=((-40.0, 1 / 40), (100.0, 1 / 40)))):
        patches = []
        for x, y in ((30.0, 1.0), (55.0, -2.0)):
            place = place_at(path, x, y)
            above = Camera((place.east, place.north, 3.0), -place.heading, math.radians(89.9))
            sampled = straight._replace(ground=ground._replace(path=path), cameras=(above,))
            patches.append(draw(sampled, settings).image[8:-8, 12:-12, 1].ravel())
        images.append(patches)
    for one, other in zip(*images, strict=True):
        assert one.std() > 2 and np.corrcoef(one, other)[0, 1] > 0.7
    assert abs(np.corrcoef(*images[1])[0, 1]) < 0.5  # elsewhere it looks different


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_wetness_goes_by_the_height_above_the_road_not_by_that_of_the_road(draw, slope):
    place, over = (18.0, -2.0, slope * 18.0), (0.0, 0.0, 4.0)
    camera = LEVEL._replace(position=over, pitch=0.1 - math.atan(slope))
    bent = bare_street(at("car", *place), camera=camera)
    path = Path(slopes=((-40.0, slope), (350.0, slope)))
    bent = bent._replace(ground=bent.ground._replace(path=path))
    wet, dry = (draw(bent._replace(sky=bent.sky._replace(wetness=w))) for w in (0.7, 0.0))
    changed = (wet.image != dry.image).any(axis=2)
    near = (wet.depth > 0) & (wet.depth < 60)
    paved = near & np.isin(wet.label, (TrainId.ROAD, TrainId.SIDEWALK)) & (wet.normal[..., 1] > 0.9)
    car = wet.label == TrainId.CAR
    assert paved.sum() > 500 and changed[paved].mean() > 0.98
    assert car.sum() > 50 and changed[car].mean() < 0.02


def test_the_picture_brightens_with_the_sun_and_haze_takes_distant_things_into_the_horizon(draw):
    images = [draw(bare_street(intensity=i)).image.astype(float) for i in (0.3, 0.9, 1.7)]
    dim, normal, bright = images
    assert (dim <= normal).all() and (normal <= bright).all()
    assert dim[:20].mean() < normal[:20].mean() - 20
    assert dim[40:].mean() < normal[40:].mean() - 10 < bright[40:].mean() - 20
    clear = bare_street()
    hazy = clear._replace(sky=clear.sky._replace(haze=120.0))
    change = np.abs(draw(clear).image.astype(float) - draw(hazy).image)[:, 40:56]
    assert change[58:].mean() < change[33:35].mean() / 3


def test_every_class_occurs_over_some_streets(draw):
    changes = {"person_interval": 4.0, "bicycle_interval": 5.0, "pole_interval": 8.0, "car_interval": 8.0,
               "building_position": 14.0, "fence_position": 10.0, "fence_interval": 6.0}  # fmt: skip
    assert all(BY_NAME[name].low <= v <= BY_NAME[name].high for name, v in changes.items())
    missing = set(range(len(CLASS_NAMES)))
    for seed in range(40):
        missing -= set(np.unique(draw(street(DEFAULT._replace(**changes), seed)).label).tolist())
        if not missing:
            break
    assert not missing


def test_few_pixels_are_clipped_on_sunny_hand_set_streets():
    clipped = []
    settings = RenderSettings(96, 72, 1)
    for seed in range(40):
        sampled = street(seed=seed)
        if sampled.sky.cover < 0.6 and sampled.sky.sun.max() > 0.8:
            [frame] = renderer("embree").render(sampled, settings)
            clipped.append((frame.image == 255).any(axis=2).mean())
        if len(clipped) == 10:
            break
    assert len(clipped) == 10 and np.mean(clipped) <= 0.05
