"""Rays in tests, all on the thread that asks.

The wheel's own classes start a device of Embree for each mesh, with threads; once they are gone, one of
the threads may go on spinning, and slow down all that the process does after.
"""

import numpy as np
import trimesh

from scene.render.embree.api import MeshBVH, SceneBVH, query_arguments
from scene.render.embree.renderer import _by_tiles, _probe


def free(bvh, starts, directions, wanted, columns, reach=np.inf):
    """Which rays meet nothing: f32[n], 1 if so, 0 if not, -1 where not wanted."""
    rows = len(wanted) // columns
    order = _by_tiles(np.asarray(wanted, np.uint8), columns, rows, 4, 2)
    found = np.full(len(wanted), -1, np.float32)
    _probe(
        bvh.scene, query_arguments(coherent=False), np.asarray(starts, np.float32),
        np.asarray(directions, np.float32), order, np.float32(reach), found,
    )  # fmt: skip
    return found


def hits(mesh: trimesh.Trimesh, starts: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Which rays meet the mesh: bool[n] of f[n, 3] each, or of one direction for all."""
    mesh_bvh = MeshBVH(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    bvh = SceneBVH([mesh_bvh], [1], np.eye(3, 4, dtype=np.float32)[None])
    return free(bvh, starts, directions, np.ones(len(starts)), len(starts)) == 0


def first_face(mesh: trimesh.Trimesh, start: tuple, direction: tuple) -> int:
    """The face that a ray meets first (Moeller and Trumbore 1997)."""
    corner = mesh.triangles[:, 0]
    one, two = mesh.triangles[:, 1] - corner, mesh.triangles[:, 2] - corner
    across = np.cross(direction, two)
    size = (one * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        out = start - corner
        u = (out * across).sum(axis=1) / size
        v = (np.cross(out, one) @ np.asarray(direction)) / size
        distance = (two * np.cross(out, one)).sum(axis=1) / size
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    assert met.any(), "the ray misses the mesh"
    return int(np.where(met, distance, np.inf).argmin())
