"""Pedestrians and riders: sizes, ground, colours, determinism, fit on their machines."""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene.asset import Asset
from scene.assets import bicycle, motorcycle, person, rider
from scene.assets._human import FOREARM, HAND, UPPER_ARM, bend
from scene.materials import MATERIALS


class Limits(NamedTuple):
    """What is plausible for a family: metres along x, y, z, and triangles."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    triangles: int


FAMILIES: dict[ModuleType, Limits] = {
    person: Limits((0.15, 0.25, 0.98), (1.4, 0.95, 1.96), 400),
    rider: Limits((0.4, 0.4, 1.1), (1.3, 1.1, 1.95), 400),
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
@settings(max_examples=12)
@given(seed=SEEDS)
def test_plausible(module: ModuleType, kind: str, seed: int) -> None:
    asset, limits = build(module, kind, seed), FAMILIES[module]
    low, high = asset.mesh.bounds
    faces = len(asset.mesh.faces)

    assert np.isfinite(asset.mesh.vertices).all()
    assert (high - low >= limits.low).all() and (high - low <= limits.high).all(), high - low
    if module is not rider:
        assert abs(low[2]) < 0.02
    assert abs(low[1] + high[1]) < 0.1

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


@pytest.mark.parametrize("kind", rider.KINDS)
@given(seed=SEEDS)
def test_riders_reach_saddle_bar_and_feet_of_their_machine(kind: str, seed: int) -> None:
    machine = {"bicycle": bicycle, "motorcycle": motorcycle}[rider.MOUNT[kind]]
    vertices = build(rider, kind, seed).mesh.vertices

    def nearest(point: tuple[float, float, float]) -> float:
        return float(np.linalg.norm(vertices - np.array(point), axis=1).min())

    assert nearest(machine.SADDLE) < 0.16
    feet = machine.pedals() if machine is bicycle else (machine.FOOT, mirror(machine.FOOT))
    for point in (machine.BAR, mirror(machine.BAR), *feet):
        assert nearest(point) < 0.12


def mirror(point: tuple[float, float, float]) -> tuple[float, float, float]:
    return point[0], -point[1], point[2]


@pytest.mark.parametrize("kind", rider.KINDS)
@given(seed=SEEDS)
def test_riders_arms_are_not_stretched(kind: str, seed: int) -> None:
    params = rider.sample_rider(np.random.default_rng(seed), kind)
    vertices = rider.rider(params).mesh.vertices
    machine = {"bicycle": bicycle, "motorcycle": motorcycle}[params.mount]
    hand = np.array(machine.BAR)
    shoulders = vertices[vertices[:, 2] > hand[2] + 0.1]
    reach = np.linalg.norm(shoulders - hand, axis=1).min()
    assert reach < (UPPER_ARM + FOREARM + HAND) * params.height


def test_people_walk_on_two_legs() -> None:
    asset = build(person, "walking", 8)
    shins = asset.mesh.vertices[asset.mesh.vertices[:, 2] < 0.3]
    left, right = shins[shins[:, 1] > 0], shins[shins[:, 1] < 0]
    assert len(left) and len(right)
    assert abs(left[:, 0].mean() - right[:, 0].mean()) > 0.1


def test_bend_is_a_right_angle_for_three_four_five() -> None:
    joint = bend(np.zeros(3), np.array([5.0, 0, 0]), 3.0, 4.0, (0, 0, 1))
    np.testing.assert_allclose(joint, [1.8, 0, 2.4])
    straight = bend(np.zeros(3), np.array([8.0, 0, 0]), 3.0, 1.0, (0, 0, 1))
    np.testing.assert_allclose(straight, [6.0, 0, 0])


@given(
    seed=SEEDS,
    upper=st.floats(0.2, 0.5),
    lower=st.floats(0.2, 0.5),
    towards=st.tuples(st.floats(0.1, 1), st.floats(-1, 1), st.floats(0.1, 1)),
)
def test_bend_keeps_bone_lengths(
    seed: int, upper: float, lower: float, towards: tuple[float, float, float]
) -> None:
    direction = np.random.default_rng(seed).normal(size=3)
    distance = 0.5 * (abs(upper - lower) + upper + lower)
    end = distance * direction / np.linalg.norm(direction)
    joint = bend(np.zeros(3), end, upper, lower, towards)
    np.testing.assert_allclose(np.linalg.norm(joint), upper, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(end - joint), lower, rtol=1e-6)
