"""Road and rail vehicles and two-wheelers: sizes, ground, colours, parts."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings

from scene.assets import bicycle
from scene.look.materials import MATERIALS
from tests.scene.asset_checks import Limits, check_sound, kinds, make, mirror, module_of, seeds

FAMILIES: dict[str, Limits] = {
    "car": Limits((3.2, 1.7, 1.2), (5.8, 2.6, 2.7), 4200),
    "bus": Limits((6.5, 2.2, 2.5), (19.2, 3.1, 4.6), 4000),
    "truck": Limits((5.5, 2.2, 2.4), (17.5, 3.1, 4.4), 4000),
    "train": Limits((10, 2.2, 3.2), (22.5, 3.1, 5.4), 4000),
    "bicycle": Limits((1.5, 0.4, 0.9), (2.0, 0.75, 1.15), 2000),
    "motorcycle": Limits((1.6, 0.6, 1.1), (2.6, 1.0, 1.55), 2800),
}


@pytest.mark.parametrize(("family", "kind"), kinds(FAMILIES))
@settings(max_examples=6)
@given(seed=seeds)
def test_plausible(family: str, kind: str, seed: int) -> None:
    asset, limits = make(family, kind, seed), FAMILIES[family]
    low, high = asset.mesh.bounds
    assert (high - low >= limits.low).all() and (high - low <= limits.high).all(), high - low
    assert abs(low[2]) < 0.02
    if family == "train":
        assert 0 <= low[1] < 0.1
    else:
        assert abs(low[1] + high[1]) < 0.1
    assert abs(low[0] + high[0]) < 0.2
    check_sound(asset, limits.triangles, 0.85)
    assert (asset.mesh.area_faces < 1e-8).sum() <= 4


@pytest.mark.parametrize("kind", bicycle.KINDS)
def test_a_bicycle_stands_on_two_separate_wheels(kind: str) -> None:
    asset = make("bicycle", kind, 3)
    ground = asset.mesh.vertices[asset.mesh.vertices[:, 2] < 0.02]
    front, rear = ground[ground[:, 0] > 0], ground[ground[:, 0] < 0]
    assert len(front) and len(rear)
    assert front[:, 0].min() - rear[:, 0].max() > 0.8
    assert np.abs(ground[:, 1]).max() < 0.05

    rubber = asset.mesh.vertices[asset.mesh.faces[asset.material == 4]]
    for half in (rubber[rubber[:, 0, 0] > 0], rubber[rubber[:, 0, 0] < 0]):
        hub = (half.reshape(-1, 3).min(0) + half.reshape(-1, 3).max(0)) / 2
        distance = np.linalg.norm(half.reshape(-1, 3) - hub, axis=1)
        assert distance.min() > 0.17  # a ring, open in the middle


@pytest.mark.parametrize("family", ["car", "bus", "truck"])
def test_vehicles_have_glass_tyres_and_lamps_at_both_ends(family: str) -> None:
    names = [material.name for material in MATERIALS]
    for kind in module_of(family).KINDS:
        asset = make(family, kind, 5)
        middle = asset.mesh.triangles_center
        for ahead in (True, False):
            end = (middle[:, 0] > 0) == ahead
            assert {names[i] for i in asset.material[end]} >= {"rubber", "lamp"}
        assert (asset.material == names.index("glass")).any()


@pytest.mark.parametrize("family", ["bicycle", "motorcycle"])
def test_machines_have_their_saddle_and_bar_where_they_say(family: str) -> None:
    module = module_of(family)
    for kind in module.KINDS:
        mesh = make(family, kind, 7).mesh
        for point in (module.SADDLE, module.BAR, mirror(module.BAR)):
            assert distance_to_surface(mesh, point) < 0.06, (kind, point)


def distance_to_surface(mesh: trimesh.Trimesh, point: tuple[float, float, float]) -> float:
    """Distance to the nearest of a grid of points on every triangle."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21)))
    weights = np.column_stack([1 - u, u * (1 - v), u * v])
    points = np.einsum("gk,fkx->fgx", weights, mesh.triangles).reshape(-1, 3)
    return float(np.linalg.norm(points - np.array(point), axis=1).min())
