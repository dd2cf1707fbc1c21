"""Vehicles and two-wheelers: their parts, curved surfaces, wheels, and the shell of a car."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.assets import bicycle, car, motorcycle
from scene.assets.families import FAMILIES
from scene.assets.parts.bodywork import ARCH_GAP, Paint, at, axles, low, share, shell
from scene.assets.parts.skin import mirrored, revolve, sheet, slab, twin_sheets, weld
from scene.assets.parts.wheel import STYLES, Wheel, wheel
from scene.look.materials import MATERIALS
from tests.scene.conftest import SEEDS, make, mirror


@pytest.mark.parametrize("kind", bicycle.KINDS)
def test_a_bicycle_stands_on_two_separate_wheels(kind):
    asset = make("bicycle", kind, 3)
    ground = asset.mesh.vertices[asset.mesh.vertices[:, 2] < 0.02]
    front, rear = ground[ground[:, 0] > 0], ground[ground[:, 0] < 0]
    assert front[:, 0].min() - rear[:, 0].max() > 0.8
    assert np.abs(ground[:, 1]).max() < 0.05
    rubber = asset.mesh.vertices[asset.mesh.faces[asset.material == 4]]
    for half in (rubber[rubber[:, 0, 0] > 0], rubber[rubber[:, 0, 0] < 0]):
        points = half.reshape(-1, 3)
        distance = np.linalg.norm(points - (points.min(0) + points.max(0)) / 2, axis=1)
        assert distance.min() > 0.17  # a ring, open in the middle


@pytest.mark.parametrize("family", ["car", "bus", "truck"])
def test_vehicles_have_glass_tyres_and_lamps_at_both_ends(family):
    names = [material.name for material in MATERIALS]
    for kind in FAMILIES[family].kinds:
        asset = make(family, kind, 5)
        middle = asset.mesh.triangles_center
        for ahead in (True, False):
            end = (middle[:, 0] > 0) == ahead
            assert {names[i] for i in asset.material[end]} >= {"rubber", "lamp"}
        assert (asset.material == names.index("glass")).any()


@pytest.mark.parametrize("family", ["bicycle", "motorcycle"])
def test_machines_have_their_saddle_and_bar_where_they_say(family):
    module = {"bicycle": bicycle, "motorcycle": motorcycle}[family]
    u, v = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0, 1, 21)] * 2))
    weights = np.column_stack([1 - u, u * (1 - v), u * v])  # a grid of points on every triangle
    for kind in module.KINDS:
        triangles = make(family, kind, 7).mesh.triangles
        on_surface = np.einsum("gk,fkx->fgx", weights, triangles).reshape(-1, 3)
        for point in (module.SADDLE, module.BAR, mirror(module.BAR)):
            assert np.linalg.norm(on_surface - point, axis=1).min() < 0.06, (kind, point)


RED = (0.5, 0.0, 0.0)


def square(x):
    """A square of one metre in the x-y plane whose corner is at ``x``."""
    return np.array([[[x, 0, 0], [x, 1, 0]], [[x + 1, 0, 0], [x + 1, 1, 0]]], float)


def body(kind, seed):
    return car.sample_car(np.random.default_rng(seed), kind).body


def test_welded_squares_share_an_edge_and_faces_without_area_are_dropped():
    one = weld(sheet(square(0), RED), sheet(square(1), RED))
    assert len(one.mesh.vertices) == 6 and len(one.mesh.faces) == 4
    assert one.mesh.area == pytest.approx(2.0)
    flat = square(0)
    flat[1] = flat[0]
    assert len(weld(sheet(flat, RED)).mesh.faces) == 0


def test_twin_sheets_are_a_sheet_and_its_mirror_image():
    twins = twin_sheets(square(0) + [0, 2, 0], RED)
    assert twins.mesh.bounds[:, 1] == pytest.approx([-3, 3])
    assert twins.mesh.face_normals[:, 2] == pytest.approx([-1, -1, -1, -1])
    again = mirrored(mirrored(twins))
    assert np.array_equal(again.mesh.faces, twins.mesh.faces)


def test_a_cylinder_of_revolution_is_as_large_as_its_polygon_and_a_slab_as_its_stations():
    tube = revolve([(0.5, -1.0), (0.5, 1.0)], RED, "metal", sides=6)
    assert len(tube.mesh.vertices) == 12
    assert tube.mesh.area == pytest.approx(6 * 0.5 * 2.0)  # a hexagon's side is its radius
    mesh = slab([(0, 0.1, 0, 1), (1, 0.1, 0, 1), (2, 0.1, 0, 1)], RED, "paint").mesh
    assert mesh.bounds == pytest.approx(np.array([[0, -0.1, 0], [2, 0.1, 1]]))


@pytest.mark.parametrize("style", STYLES)
@given(radius=st.floats(0.2, 0.6))
def test_wheels_stand_on_the_ground_behind_their_outer_face(style, radius):
    low_corner, high = wheel(Wheel(radius, 0.2, style)).mesh.bounds
    assert low_corner[2] == pytest.approx(0, abs=0.05 * radius)
    assert high[2] - low_corner[2] == pytest.approx(2 * radius, rel=0.05)
    assert high[1] <= 1e-9 and low_corner[1] >= -0.2


@pytest.mark.parametrize("kind", car.KINDS)
@given(seed=SEEDS)
def test_arches_are_circles_over_the_axles_and_shares_of_the_length_are_told_both_ways(kind, seed):
    b = body(kind, seed)
    front, rear = axles(b)
    over, middle = 2 * b.wheel_radius + ARCH_GAP, (front + rear) / 2
    assert low(b, share(b, np.array([front, rear, middle]))) == pytest.approx([over, over, b.sill])
    assert front - rear == pytest.approx(b.wheelbase)
    assert share(b, at(b, np.linspace(0, 1, 50))) == pytest.approx(np.linspace(0, 1, 50))


@pytest.mark.parametrize("kind", ["hatchback", "pickup", "old-timer"])
def test_shells_are_as_long_and_high_as_they_say_and_alike_on_both_sides(kind):
    b = body(kind, 4)
    mesh = shell(b, Paint(RED, RED, RED, RED, RED)).mesh
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(b.length, abs=0.02)
    assert mesh.bounds[1, 2] == pytest.approx(b.height, abs=0.02)
    points = {tuple(p) for p in np.round(mesh.vertices, 6) + 0.0}
    assert points == {tuple(p) for p in np.round(mesh.vertices * [1, -1, 1], 6) + 0.0}
