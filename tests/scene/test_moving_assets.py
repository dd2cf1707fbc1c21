"""Moving assets: people, their gait and clothes, how riders fit their machines, and vehicles."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.assets import bicycle, bus, car, motorcycle, person, rider
from scene.assets.families import FAMILIES
from scene.assets.parts import carried, head, vehicle, wardrobe, wheel
from scene.assets.parts.bodywork import (
    ARCH_GAP,
    Paint,
    axles,
    flank_x,
    lower_edge,
    share_at_x,
    shell,
)
from scene.assets.parts.glazing import glazing
from scene.assets.parts.human import FOREARM, HAND, UPPER_ARM, Body, bend
from scene.assets.parts.skin import mirrored, revolve, rounded_body, sheet, twin_sheets, weld
from scene.assets.parts.van import van_sides
from scene.look.materials import MATERIALS
from scene.mesh.asset import merge
from scene.mesh.mesh import Mesh
from tests.scene.conftest import SEEDS, cast, hits, make, mirror, solid

RED = (0.5, 0.0, 0.0)
BONE = st.floats(0.2, 0.5)
TOWARDS = st.tuples(st.floats(0.1, 1), st.floats(-1, 1), st.floats(0.1, 1))
MACHINES = {"bicycle": bicycle, "motorcycle": motorcycle}


@pytest.mark.parametrize("kind", rider.FAMILY.kinds)
@given(seed=SEEDS)
def test_riders_reach_saddle_bar_and_feet_of_their_machine(kind, seed):
    machine = MACHINES[rider.MOUNT[kind]]
    params = rider.sample_rider(np.random.default_rng(seed), kind)
    assert params.mount == rider.MOUNT[kind]
    vertices = rider.rider(params).mesh.vertices
    feet = machine.pedals() if machine is bicycle else (machine.FOOT, mirror(machine.FOOT))
    for point in (machine.SADDLE, machine.BAR, mirror(machine.BAR), *feet):
        nearest = np.linalg.norm(vertices - np.array(point), axis=1).min()
        assert nearest < (0.16 if point == machine.SADDLE else 0.12)
    shoulders = vertices[vertices[:, 2] > machine.BAR[2] + 0.1]  # arms are not stretched
    reach = np.linalg.norm(shoulders - np.array(machine.BAR), axis=1).min()
    assert reach < (UPPER_ARM + FOREARM + HAND) * params.body.height


def walker(phase):
    """A person walking briskly, at one phase of the step."""
    params = person.sample_person(np.random.default_rng(8), "walking in a jacket")
    return params._replace(gait="walk", phase=phase, vigour=1.0)


@pytest.mark.parametrize("phase", np.linspace(0, 0.9, 10))
def test_people_walk_on_two_legs_that_take_turns_with_arms_against_them(phase):
    mesh, pose = person.person(walker(phase)).mesh, person._pose(walker(phase))
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-9)  # one shoe is on the ground
    legs, arms = (pair[0][0] - pair[1][0] for pair in (pose.ankles, pose.hands))
    assert legs * arms < 0 or abs(legs) <= 0.3
    if phase in (0, 0.5):
        low = mesh.vertices[mesh.vertices[:, 2] < 0.16]
        left, right = (low[low[:, 1] * side > 0, 0].mean() for side in (1, -1))
        assert (left - right) * (1 if phase == 0 else -1) > 0.4  # metres ahead


@pytest.mark.parametrize("style", wardrobe.STYLES)
def test_every_style_dresses_a_body_of_one_height(style):
    outfit, curves = wardrobe.sample_outfit(np.random.default_rng(1), style, 0.3)
    changes = {"outfit": outfit._replace(hat=""), "body": Body(1.75, curves=curves), "carried": ()}
    assert 1.66 < person.person(walker(0.2)._replace(**changes)).mesh.bounds[1, 2] < 1.84


@pytest.mark.parametrize("hat", [*head._SHELLS, "full helmet"])
@pytest.mark.parametrize(
    "hairdo", ["bald", "short", "thick", "curly", "bob", "long", "ponytail", "bun"]
)
def test_hats_cover_the_crown_and_leave_the_body_alone(hat, hairdo):
    params = walker(0.1)
    bare = params.outfit._replace(hat="", hairdo="bald")
    dressed = bare._replace(hat=hat, hairdo=hairdo, hat_color=RED)
    before, after = (head.head(params.body, of, person._pose(params)) for of in (bare, dressed))
    assert after.mesh.bounds[1, 2] > before.mesh.bounds[1, 2]
    assert (after.color == RED).all(axis=1).any()


@pytest.mark.parametrize("name", carried.CARRIED)
def test_objects_are_carried_above_the_ground_and_near_a_hand(name):
    params = person.sample_person(np.random.default_rng(3), "shopping bags")
    params = params._replace(carried=(), body=Body(1.75), gait="stand")
    bare = person.person(params).mesh.vertices
    added = person.person(params._replace(carried=(name,))).mesh.vertices[len(bare) :]
    assert len(added) >= 8 and added[:, 2].min() > -0.02
    assert np.linalg.norm(added[:, None] - bare[None, ::7], axis=2).min() < 0.25


def test_bend_is_a_right_angle_for_three_four_five_and_unknown_names_are_refused():
    for end, lower, joint in ((5.0, 4.0, [1.8, 0, 2.4]), (8.0, 1.0, [6, 0, 0])):  # or straight
        bent = bend(np.zeros(3), np.array([end, 0, 0]), 3.0, lower, (0, 0, 1))
        np.testing.assert_allclose(bent, joint)
    with pytest.raises(ValueError, match="unknown style"):
        wardrobe.sample_outfit(np.random.default_rng(0), "marble", 0.0)
    with pytest.raises(ValueError, match="unknown object"):
        carried.carried("marble", Body(1.7), person._pose(walker(0.0)), (0, 0, 0), (0, 0, 0))


@given(SEEDS, BONE, BONE, TOWARDS)
def test_bend_keeps_bone_lengths(seed, upper, lower, towards):
    direction = np.random.default_rng(seed).normal(size=3)
    distance = 0.5 * (abs(upper - lower) + upper + lower)
    end = distance * direction / np.linalg.norm(direction)
    joint = bend(np.zeros(3), end, upper, lower, towards)
    bones = np.linalg.norm([joint, end - joint], axis=1)
    np.testing.assert_allclose(bones, [upper, lower], rtol=1e-6)


@pytest.mark.parametrize("kind", bicycle.FAMILY.kinds)
def test_a_bicycle_stands_on_two_separate_wheels(kind):
    asset = make("bicycle", kind, 3)
    ground = asset.mesh.vertices[asset.mesh.vertices[:, 2] < 0.02]
    front, rear = ground[ground[:, 0] > 0], ground[ground[:, 0] < 0]
    assert front[:, 0].min() - rear[:, 0].max() > 0.8 and np.abs(ground[:, 1]).max() < 0.05
    rubber = asset.mesh.vertices[asset.mesh.faces[asset.material == 4]]
    for side in (1, -1):
        points = rubber[side * rubber[:, 0, 0] > 0].reshape(-1, 3)
        distance = np.linalg.norm(points - (points.min(0) + points.max(0)) / 2, axis=1)
        assert distance.min() > 0.17  # a ring, open in the middle


@pytest.mark.parametrize("family", ["car", "bus", "truck"])
def test_vehicles_have_glass_tyres_and_lamps_at_both_ends(family):
    names = [material.name for material in MATERIALS]
    for kind in FAMILIES[family].kinds:
        asset = make(family, kind, 5)
        ahead = solid(asset.mesh).triangles_center[:, 0] > 0
        for end in (ahead, ~ahead):
            assert {names[i] for i in asset.material[end]} >= {"rubber", "lamp"}
        assert names.index("glass") in asset.material


@pytest.mark.parametrize("family", ["bus", "truck"])
def test_nothing_hides_the_rims_of_large_vehicles(family):
    outset, width = (bus.WHEEL_OUTSET, 0.3) if family == "bus" else (0.03, 0.32)
    turn = np.arange(8) * np.pi / 4 + 0.1
    for kind, seed in product(FAMILIES[family].kinds, (3, 4)):
        params = FAMILIES[family].sample(np.random.default_rng(seed), kind)
        front = bus._axles(params)[0] if family == "bus" else params.length / 2 - params.axles[0]
        triangles = solid(FAMILIES[family].build(params).mesh).triangles
        rim = (
            params.width / 2 + outset - vehicle.SHALLOW * width
        )  # of its floor, metres from the middle
        reach = 0.25 * params.wheel_radius  # between the hub and the holes
        for x, z in np.column_stack([np.cos(turn), np.sin(turn)]) * reach:
            start = np.array([front + x, 3.0, params.wheel_radius + z])
            away, _ = cast(start, np.array([[0.0, -1.0, 0.0]]), triangles)
            assert 3 - away.min() == pytest.approx(rim, abs=1e-3), kind


@pytest.mark.parametrize(("family", "module"), MACHINES.items())
def test_machines_have_saddle_and_bar_at_their_constants(family, module):
    u, v = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0, 1, 21)] * 2))
    weights = np.column_stack([1 - u, u * (1 - v), u * v])  # a grid of points on every triangle
    for kind in module.FAMILY.kinds:
        triangles = solid(make(family, kind, 7).mesh).triangles
        on_surface = np.einsum("gk,fkx->fgx", weights, triangles).reshape(-1, 3)
        for point in (module.SADDLE, module.BAR, mirror(module.BAR)):
            assert np.linalg.norm(on_surface - point, axis=1).min() < 0.06, (kind, point)


def square(x):
    """A square of one metre in the x-y plane whose corner is at ``x``."""
    return np.array([[[x, 0, 0], [x, 1, 0]], [[x + 1, 0, 0], [x + 1, 1, 0]]], float)


def test_sheets_twins_cylinders_and_rounded_bodies_by_hand():
    mesh = weld(sheet(square(0), RED), sheet(square(1), RED)).mesh
    assert (len(mesh.vertices), len(mesh.faces), solid(mesh).area) == (6, 4, pytest.approx(2.0))
    flat = square(0)
    flat[1] = flat[0]
    assert len(weld(sheet(flat, RED)).mesh.faces) == 0
    # Twin sheets are a sheet and its mirror image.
    twins = twin_sheets(square(0) + [0, 2, 0], RED)
    assert twins.mesh.bounds[:, 1] == pytest.approx([-3, 3])
    assert solid(twins.mesh).face_normals[:, 2] == pytest.approx([-1, -1, -1, -1])
    assert np.array_equal(mirrored(mirrored(twins)).mesh.faces, twins.mesh.faces)
    tube = revolve([(0.5, -1.0), (0.5, 1.0)], RED, "metal", sides=6)
    assert len(tube.mesh.vertices) == 12
    assert solid(tube.mesh).area == pytest.approx(6 * 0.5 * 2.0)  # a hexagon's side is its radius
    mesh = rounded_body([(0, 0.1, 0, 1), (1, 0.1, 0, 1), (2, 0.1, 0, 1)], RED, "paint").mesh
    assert mesh.bounds == pytest.approx(np.array([[0, -0.1, 0], [2, 0.1, 1]]))


@pytest.mark.parametrize("style", wheel.STYLES)
@given(radius=st.floats(0.2, 0.6))
def test_wheels_stand_on_the_ground_behind_their_outer_face(style, radius):
    (_, left, foot), (_, right, top) = wheel.wheel(wheel.Wheel(radius, 0.2, style)).mesh.bounds
    assert foot == pytest.approx(0, abs=0.05 * radius)
    assert top - foot == pytest.approx(2 * radius, rel=0.05) and right <= 1e-9 and left >= -0.2


@pytest.mark.parametrize("style", wheel.STYLES)
def test_no_ray_goes_through_a_wheel(style):
    radius = 0.3
    mesh = solid(wheel.wheel(wheel.Wheel(radius, 0.2, style)).mesh)
    x, z = np.random.default_rng(0).uniform(-radius, radius, (2, 4000))
    inside = np.hypot(x, z) < 0.96 * radius  # within the flat sides of its outline
    starts = np.column_stack([x, np.ones(4000), z + radius])[inside]
    assert hits(mesh, starts, np.array([[0.0, -1.0, 0.0]])).all()


BODIES = tuple(car._KINDS)
"""Kinds of cars with a shell."""


@pytest.mark.parametrize("kind", BODIES)
@given(seed=SEEDS)
def test_arches_are_circles_over_the_axles_and_flank_x_is_invertible(kind, seed):
    b = car.sample_car(np.random.default_rng(seed), kind).body
    front, rear = axles(b)
    over, middle = 2 * b.wheel_radius + ARCH_GAP, (front + rear) / 2
    assert lower_edge(b, share_at_x(b, np.array([front, rear, middle]))) == pytest.approx(
        [over, over, b.sill]
    )
    assert front - rear == pytest.approx(b.wheelbase)
    assert share_at_x(b, flank_x(b, np.linspace(0, 1, 50))) == pytest.approx(np.linspace(0, 1, 50))


@pytest.mark.parametrize("kind", ["hatchback", "pickup", "old-timer"])
def test_shells_have_their_length_and_height_and_are_symmetric(kind):
    b = car.sample_car(np.random.default_rng(4), kind).body
    mesh = shell(b, Paint(RED, RED, RED, RED, RED)).mesh
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(b.length, abs=0.02)
    assert mesh.bounds[1, 2] == pytest.approx(b.height, abs=0.02)
    points = {tuple(p) for p in np.round(mesh.vertices, 6) + 0.0}
    assert points == {tuple(p) for p in np.round(mesh.vertices * [1, -1, 1], 6) + 0.0}


def is_laid_on(b, parts, glass_only):
    """Whether all faces of parts are visible from outside and in front of the shell."""
    body = shell(b, Paint(RED, RED, RED, RED, RED))
    glass = body.material == [m.name for m in MATERIALS].index("glass")
    base = Mesh(body.mesh.vertices, body.mesh.faces[glass | (not glass_only)])
    laid = solid(merge(*parts).mesh)
    middle, normal = laid.triangles_center, laid.face_normals
    sign = np.sign(np.sum(normal * (middle - [0, 0, 0.5]), axis=1))
    outward = sign[:, None] * normal
    starts = middle + 0.05 * outward
    behind = hits(solid(base), starts, -outward)
    return not hits(solid(body.mesh), middle, outward).any() and behind.all()


@pytest.mark.parametrize("kind", BODIES)
def test_seats_and_drivers_are_seen_just_outside_the_glass_they_are_laid_on(kind):
    for seed in range(4):
        params = car.sample_car(np.random.default_rng(seed), kind)
        g = params.glazing._replace(skin=RED)
        assert is_laid_on(params.body, glazing(params.body, g, (True, True)), glass_only=True), seed


@pytest.mark.parametrize("kind", BODIES)
def test_a_driver_s_head_is_upright_hair_behind_its_seat_from_behind_and_deep_from_the_side(kind):
    params = car.sample_car(np.random.default_rng(1), kind)
    b, g = params.body, params.glazing._replace(skin=RED, seats=(0, 0.5, 0), side=1.0)
    heads = {}
    for windows in ((True, True), (False, True), (True, False)):
        panes = merge(*glazing(b, g, windows))
        centre = panes.mesh.vertices[panes.mesh.faces].mean(axis=1)
        heads[windows] = centre[(panes.color == np.float32(RED)).all(axis=1)]
    behind = heads[False, True]
    assert len(behind) and (behind[:, 0] > 0).all()  # skin is visible only from ahead
    spread = np.ptp(behind[:, 1])
    assert spread < 0.25
    sides = heads[True, False][np.abs(heads[True, False][:, 1]) > 0.5 * b.width / 2]
    assert len(sides) == 0 or np.ptp(sides[:, 0]) > 0.05


@pytest.mark.parametrize("kind", [kind for kind in BODIES if car._KINDS[kind].van])
def test_panels_seams_and_names_are_seen_just_outside_the_sides_of_vans(kind):
    for seed in range(4):
        params = car.sample_car(np.random.default_rng(seed), kind)
        unnamed, named = (
            list(van_sides(params.body, params.van._replace(letters=letters, sealed=True)))
            for letters in (None, RED)
        )
        assert len(named) > len(unnamed) + 10
        assert is_laid_on(params.body, named, glass_only=False), seed


def test_a_rickshaw_has_one_wheel_ahead_in_the_middle_and_two_behind():
    names = [material.name for material in MATERIALS]
    for seed in range(5):
        asset = make("car", "tuk-tuk", seed)
        tyres = asset.mesh.vertices[
            np.unique(asset.mesh.faces[asset.material == names.index("rubber")])
        ]
        ground = tyres[tyres[:, 2] < 0.02]
        front, rear = ground[ground[:, 0] > 0], ground[ground[:, 0] < 0]
        assert np.abs(front[:, 1]).max() < 0.08 and np.abs(rear[:, 1]).min() > 0.4
        assert front[:, 1].mean() == pytest.approx(0) == rear[:, 1].mean()
