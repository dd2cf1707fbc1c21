"""Road and rail vehicles and two-wheelers: sizes, ground, colours, determinism, parts."""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from scene.asset import Asset
from scene.assets import bicycle, bus, car, motorcycle, train, truck
from scene.materials import MATERIALS


class Limits(NamedTuple):
    """What is plausible for a family: metres along x, y, z, and triangles."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    triangles: int


FAMILIES: dict[ModuleType, Limits] = {
    car: Limits((3.2, 1.7, 1.2), (5.8, 2.6, 2.7), 4200),
    bus: Limits((6.5, 2.2, 2.5), (19.2, 3.1, 4.6), 4000),
    truck: Limits((5.5, 2.2, 2.4), (17.5, 3.1, 4.4), 4000),
    train: Limits((10, 2.2, 3.2), (22.5, 3.1, 5.4), 4000),
    bicycle: Limits((1.5, 0.4, 0.9), (2.0, 0.75, 1.15), 2000),
    motorcycle: Limits((1.6, 0.6, 1.1), (2.6, 1.0, 1.55), 2800),
}
CASES = [
    pytest.param(module, kind, id=f"{module.__name__.rsplit('.', 1)[1]}-{kind}")
    for module in FAMILIES
    for kind in module.KINDS
]
SEEDS = st.integers(0, 2**32 - 1)


def name_of(module: ModuleType) -> str:
    return module.__name__.rsplit(".", 1)[1]


def build(module: ModuleType, kind: str, seed: int) -> Asset:
    params = getattr(module, f"sample_{name_of(module)}")(np.random.default_rng(seed), kind)
    return getattr(module, name_of(module))(params)


def areas(asset: Asset) -> np.ndarray:
    corner = asset.mesh.vertices[asset.mesh.faces]
    edges = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.linalg.norm(edges, axis=1) / 2


@pytest.mark.parametrize("module", FAMILIES, ids=name_of)
def test_at_least_four_kinds(module: ModuleType) -> None:
    assert len(set(module.KINDS)) == len(module.KINDS) >= 4


@pytest.mark.parametrize(("module", "kind"), CASES)
@settings(max_examples=6)
@given(seed=SEEDS)
def test_plausible(module: ModuleType, kind: str, seed: int) -> None:
    asset, limits = build(module, kind, seed), FAMILIES[module]
    low, high = asset.mesh.bounds
    faces = len(asset.mesh.faces)

    assert np.isfinite(asset.mesh.vertices).all()
    assert (high - low >= limits.low).all() and (high - low <= limits.high).all(), high - low
    assert abs(low[2]) < 0.02
    if module is train:
        assert 0 <= low[1] < 0.1
    else:
        assert abs(low[1] + high[1]) < 0.1
    assert abs(low[0] + high[0]) < 0.2

    assert faces <= limits.triangles
    assert asset.color.shape == (faces, 3) and asset.color.dtype == np.float32
    assert asset.material.shape == (faces,) and asset.material.dtype == np.uint8
    assert asset.color.min() >= 0 and asset.color.max() <= 0.85
    assert asset.material.max() < len(MATERIALS)
    assert (areas(asset) < 1e-8).sum() <= 4


@pytest.mark.parametrize(("module", "kind"), CASES)
def test_same_params_same_mesh_and_other_seeds_differ(module: ModuleType, kind: str) -> None:
    first, again, other = (build(module, kind, seed) for seed in (1, 1, 2))

    def digest(asset: Asset) -> tuple[str, bytes, bytes]:
        return asset.mesh.identifier_hash, asset.color.tobytes(), asset.material.tobytes()

    assert first.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
    assert digest(first) == digest(again)
    assert first.mesh.vertices.tobytes() != other.mesh.vertices.tobytes()
    assert digest(first)[1:] != digest(other)[1:]


@pytest.mark.parametrize("module", FAMILIES, ids=name_of)
def test_global_randomness_is_neither_read_nor_moved(module: ModuleType) -> None:
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    build(module, module.KINDS[0], 0)
    assert (np.random.get_state()[1] == state).all()  # noqa: NPY002


@pytest.mark.parametrize("kind", bicycle.KINDS)
def test_a_bicycle_stands_on_two_separate_wheels(kind: str) -> None:
    asset = build(bicycle, kind, 3)
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


@pytest.mark.parametrize("module", [car, bus, truck], ids=name_of)
def test_vehicles_have_glass_tyres_and_lamps_at_both_ends(module: ModuleType) -> None:
    names = [material.name for material in MATERIALS]
    for kind in module.KINDS:
        asset = build(module, kind, 5)
        middle = asset.mesh.triangles_center
        for ahead in (True, False):
            end = (middle[:, 0] > 0) == ahead
            assert {names[i] for i in asset.material[end]} >= {"rubber", "lamp"}
        assert (asset.material == names.index("glass")).any()


def mirror(point: tuple[float, float, float]) -> tuple[float, float, float]:
    return point[0], -point[1], point[2]


@pytest.mark.parametrize("kind", ["bicycle", "motorcycle"])
def test_machines_have_their_saddle_and_bar_where_they_say(kind: str) -> None:
    module = {"bicycle": bicycle, "motorcycle": motorcycle}[kind]
    for style in module.KINDS:
        mesh = build(module, style, 7).mesh
        for point in (module.SADDLE, module.BAR, mirror(module.BAR)):
            assert distance_to_surface(mesh, point) < 0.06, (style, point)


def distance_to_surface(mesh: trimesh.Trimesh, point: tuple[float, float, float]) -> float:
    """Distance to the nearest of a grid of points on every triangle."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21)))
    weights = np.column_stack([1 - u, u * (1 - v), u * v])
    points = np.einsum("gk,fkx->fgx", weights, mesh.triangles).reshape(-1, 3)
    return float(np.linalg.norm(points - np.array(point), axis=1).min())
