"""What the tests of asset families share: how to build one, and what any sound asset keeps to."""

from collections.abc import Iterable

import numpy as np
from hypothesis import strategies as st

from scene.assets.families import FAMILIES
from scene.look.materials import MATERIALS
from scene.mesh.asset import Asset
from tests.scene.rays import hits

seeds = st.integers(0, 2**32 - 1)


def kinds(families: Iterable[str]) -> list[tuple[str, str]]:
    """Every (family, kind)."""
    return [(family, kind) for family in families for kind in FAMILIES[family].kinds]


def make(family: str, kind: str, seed: int) -> Asset:
    return FAMILIES[family].draw(np.random.default_rng(seed), kind)


def check_sound(asset: Asset, triangles: int, brightest: float = 1.0) -> None:
    """Fails unless all arrays are in order and there are at most so many triangles."""
    faces = len(asset.mesh.faces)
    assert 0 < faces <= triangles
    assert asset.color.shape == (faces, 3) and asset.color.dtype == np.float32
    assert asset.material.shape == (faces,) and asset.material.dtype == np.uint8
    assert asset.material.max() < len(MATERIALS)
    assert 0 <= asset.color.min() and asset.color.max() <= brightest
    assert np.isfinite(asset.mesh.vertices).all()


def check_planes(asset: Asset) -> None:
    """Fails if an upright face lies within 3 cm before or behind another that faces the same way."""
    mesh = asset.mesh
    facing = mesh.triangles[np.abs(mesh.face_normals[:, 1]) > 0.999]
    corners, depth = facing[:, :, [0, 2]], facing[:, 0, 1]
    middle = corners.mean(axis=1)
    edge = np.roll(corners, -1, axis=1) - corners
    out = middle[:, None, None] - corners  # [points, triangles, corners, 2]
    side = edge[..., 0] * out[..., 1] - edge[..., 1] * out[..., 0]
    inside = (side > 1e-9).all(axis=-1) | (side < -1e-9).all(axis=-1)
    near = np.abs(depth[:, None] - depth) < 0.03
    assert (inside & near).sum() == len(facing)  # each lies in itself alone


def fill(asset: Asset, low: float, high: float) -> float:
    """Share of rays along y that hit the asset, within its width and the given heights."""
    (left, front, _), (right, _, _) = asset.mesh.bounds
    x, z = np.meshgrid(np.linspace(left, right, 101), np.linspace(low, high, 61))
    origins = np.column_stack([x.ravel(), np.full(x.size, front - 1), z.ravel()])
    return float(hits(asset.mesh, origins, np.array([[0.0, 1.0, 0.0]])).mean())


def mirror(point: tuple[float, float, float]) -> tuple[float, float, float]:
    """The point on the other side."""
    return point[0], -point[1], point[2]
