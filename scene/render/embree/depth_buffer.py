"""Find the face of every sample with a depth buffer, on a CPU much cheaper than casting a ray for each.

Triangles are tested in the camera's frame, by the sign of the volumes that a ray spans with their edges (2D
homogeneous coordinates; Olano and Greer 1997). So no triangle is clipped, neighbours share their edges
without a gap, and the result is that of a ray: the face, the position in it, and the distance.

Near objects are drawn first. For every tile of samples, the distance of the farthest face in it is tracked,
so that instances and faces behind all of it are skipped early.
"""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from scene.compiled import njit
from scene.render.address import float_pointer, int_pointer
from scene.render.buffers import Hits, Rays
from scene.render.geometry import SKY_INSTANCE, Geometry
from scene.render.protocol import RenderSettings, pixel_rays
from scene.render.shade import MISS
from scene.street.camera import Camera, camera_axes

f32 = np.float32
NEAR = 1e-3
"""Distance in front of the camera from which corners are projected, metres."""
SLACK = 1e-2
"""Samples by which the box of a face is widened, more than rounding errors."""
NARROW = 4
"""Columns up to which all samples of a face's box are tested; in wider boxes, rows are bounded first."""
TINY = 1e-300
"""Avoids division by zero for edges along a row."""
EARLY, LATE = 0.999, 0.001
"""Added to the samples where a row enters and leaves a face, before both are rounded down."""

TILE = 8
"""Samples along each side of a tile."""
REFRESH = 12_000
"""Number of faces after which the tiles are updated."""
FARTHEST = f32(1e9)
"""Closeness above all others."""
BEHIND = 1.001
"""Factor by which a whole tile must be nearer than a face to hide it: more than rounding errors."""


def nearest(geometry: Geometry, camera: Camera, settings: RenderSettings, rays: Rays) -> Hits:
    """The nearest face along every ray of a shot."""
    axes = camera_axes(camera)
    rotation = axes @ geometry.pose[:, :, :3]
    shift = (geometry.pose[:, :, 3] - camera.position) @ axes.T
    x, y = pixel_rays(settings, settings.samples, camera.offset)
    n = len(rays.along)
    closeness = np.zeros(n, f32)  # 1 / depth along the optical axis
    hits = Hits(
        np.full(n, MISS, np.int32), np.zeros(n, np.int32), *(np.zeros(n, f32) for _ in range(3))
    )
    _draw(
        _in_view(geometry, rotation, shift, x, y), geometry.tables, geometry.boxes, rotation,
        shift, x, y, closeness, hits,
    )  # fmt: skip
    _finish(closeness, rays.along, hits.distance, hits.u, hits.v)
    return hits


def _in_view(
    geometry: Geometry, rotation: np.ndarray, shift: np.ndarray, x: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """Instances with a bounding sphere in view; nearest first, since they hide others."""
    middle = np.einsum("nij,nj->ni", rotation, geometry.balls[:, :3]) + shift
    radius = geometry.balls[:, 3]
    outside = middle[:, 2] < -radius
    for side, sign, axis in ((x[0], -1, 0), (x[-1], 1, 0), (y[-1], -1, 1), (y[0], 1, 1)):
        away = sign * (middle[:, axis] - side * middle[:, 2]) / math.hypot(1, side)
        outside |= away > radius
    outside[SKY_INSTANCE] = True
    in_view = np.flatnonzero(~outside)
    return in_view[np.argsort(middle[in_view, 2], kind="stable")]


@njit(cache=True, error_model="numpy")
def _draw(
    in_view: np.ndarray,
    tables: np.ndarray,
    boxes: np.ndarray,
    rotation: np.ndarray,
    shift: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    near: np.ndarray,
    hits: Hits,
) -> None:
    """Draw instances one after another, see ``nearest``; ``u`` and ``v`` are still multiplied by ``near``."""
    face, instance, u, v = hits.face, hits.instance, hits.u, hits.v
    columns, rows = x.shape[0], y.shape[0]
    per_column, per_row = (columns - 1) / (x[-1] - x[0]), (rows - 1) / (y[-1] - y[0])
    most = np.uint64(0)
    for c in range(in_view.shape[0]):
        most = max(most, tables[in_view[c], 3])
    place = np.empty((3, int(most)))  # of each corner, in the camera's frame
    screen = np.empty((2, int(most)), np.float32)  # its column and row
    box_place, box_screen = np.empty((3, 8)), np.empty((2, 8), np.float32)
    tiles = np.zeros(((rows + TILE - 1) // TILE, (columns + TILE - 1) // TILE), np.float32)
    strip = np.empty(tiles.shape[1] * TILE, np.float32)
    since = 0
    for c in range(in_view.shape[0]):
        i = in_view[c]
        if since > REFRESH:
            _farthest(near, columns, rows, strip, tiles)
            since = 0
        _project(
            boxes[i], rotation[i], shift[i], x[0], per_column, y[0], per_row, box_place, box_screen
        )  # fmt: skip
        if _hidden(box_place, box_screen, tiles, columns, rows):
            continue
        corners, triangles = int(tables[i, 3]), int(tables[i, 4])
        since += triangles
        vertices = carray(float_pointer(tables[i, 1]), (corners, 3))
        faces = carray(int_pointer(tables[i, 2]), (triangles, 3))
        _project(
            vertices, rotation[i], shift[i], x[0], per_column, y[0], per_row, place, screen
        )  # fmt: skip
        for f in range(triangles):
            p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
            pz, qz, rz = place[2, p], place[2, q], place[2, r]
            left, right, top, bottom = 0, columns - 1, 0, rows - 1
            first = min(pz, qz, rz)
            if first > NEAR:
                px, qx, rx = screen[0, p], screen[0, q], screen[0, r]
                low, high = min(px, qx, rx) - f32(SLACK), max(px, qx, rx) + f32(SLACK)
                if high < 0 or low > right:
                    continue
                left, right = int(max(low, f32(-1)) + f32(1)), int(min(high, f32(right)))
                if left > right:
                    continue
                py, qy, ry = screen[1, p], screen[1, q], screen[1, r]
                low, high = min(py, qy, ry) - f32(SLACK), max(py, qy, ry) + f32(SLACK)
                if high < 0 or low > bottom:
                    continue
                top, bottom = int(max(low, f32(-1)) + f32(1)), int(min(high, f32(bottom)))
                if top > bottom or _covered(tiles, first, left, right, top, bottom):
                    continue
            elif max(pz, qz, rz) <= NEAR:
                continue
            _fill(
                place, p, q, r, left, right, top, bottom, x, y, i, f,
                near, face, instance, u, v,
            )  # fmt: skip


@njit(cache=True, fastmath=True)
def _farthest(
    near: np.ndarray, columns: int, rows: int, strip: np.ndarray, tiles: np.ndarray
) -> None:
    """Set ``tiles`` to the closeness of the farthest face in each; ``strip`` is a work array."""
    for tile in range(tiles.shape[0]):
        strip[:] = FARTHEST
        for row in range(tile * TILE, min(tile * TILE + TILE, rows)):
            for column in range(columns):
                strip[column] = min(strip[column], near[row * columns + column])
        for t in range(tiles.shape[1]):
            least = strip[t * TILE]
            for k in range(1, TILE):
                least = min(least, strip[t * TILE + k])
            tiles[tile, t] = least


@njit(cache=True, inline="always")
def _covered(tiles: np.ndarray, first: float, left: int, right: int, top: int, bottom: int) -> bool:
    """Whether all samples of a box are nearer than depth ``first``."""
    for row in range(top // TILE, bottom // TILE + 1):
        for column in range(left // TILE, right // TILE + 1):
            if tiles[row, column] * first < BEHIND:
                return False
    return True


@njit(cache=True)
def _hidden(
    place: np.ndarray, screen: np.ndarray, tiles: np.ndarray, columns: int, rows: int
) -> bool:
    """Whether a box with these corners is out of view, or behind all that is drawn."""
    first, last = place[2].min(), place[2].max()
    if last <= NEAR:
        return True
    if first <= NEAR:
        return False
    low, high = screen[0].min() - f32(SLACK), screen[0].max() + f32(SLACK)
    if high < 0 or low > columns - 1:
        return True
    left, right = int(max(low, f32(0))), int(min(high, f32(columns - 1)))
    low, high = screen[1].min() - f32(SLACK), screen[1].max() + f32(SLACK)
    if high < 0 or low > rows - 1:
        return True
    top, bottom = int(max(low, f32(0))), int(min(high, f32(rows - 1)))
    return _covered(tiles, first, left, right, top, bottom)


@njit(cache=True, fastmath=True, error_model="numpy")
def _finish(
    near: np.ndarray, along: np.ndarray, distance: np.ndarray, u: np.ndarray, v: np.ndarray
) -> None:
    """Convert closeness to metres along each ray, and to weights of a face's corners; 0 for misses."""
    for i in range(near.shape[0]):
        hit = f32(1) if near[i] > f32(0) else f32(0)
        depth = hit / max(near[i], f32(1e-9))
        distance[i] = depth / along[i]
        u[i] *= depth
        v[i] *= depth


@njit(cache=True, fastmath=True, error_model="numpy")
def _project(
    vertices: np.ndarray,
    turn: np.ndarray,
    shift: np.ndarray,
    left: float,
    per_column: float,
    top: float,
    per_row: float,
    place: np.ndarray,
    screen: np.ndarray,
) -> None:
    """Project corners to the camera's frame and to samples, which are valid in front of the camera only."""
    m00, m01, m02, sx = turn[0, 0], turn[0, 1], turn[0, 2], shift[0]
    m10, m11, m12, sy = turn[1, 0], turn[1, 1], turn[1, 2], shift[1]
    m20, m21, m22, sz = turn[2, 0], turn[2, 1], turn[2, 2], shift[2]
    for k in range(vertices.shape[0]):
        a, b, c = vertices[k, 0], vertices[k, 1], vertices[k, 2]
        x = m00 * a + m01 * b + m02 * c + sx
        y = m10 * a + m11 * b + m12 * c + sy
        z = m20 * a + m21 * b + m22 * c + sz
        place[0, k], place[1, k], place[2, k] = x, y, z
        per_depth = 1 / max(z, NEAR)
        screen[0, k] = (x * per_depth - left) * per_column
        screen[1, k] = (y * per_depth - top) * per_row


@njit(cache=True, error_model="numpy", inline="always")
def _fill(
    place: np.ndarray,
    p: int,
    q: int,
    r: int,
    left: int,
    right: int,
    top: int,
    bottom: int,
    x: np.ndarray,
    y: np.ndarray,
    i: int,
    f: int,
    near: np.ndarray,
    face: np.ndarray,
    instance: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> None:
    """Test the samples of a box against one face, and store it where it is nearest.

    For a ray (x, y, 1), ``e`` = ``a x + b y + c`` are the volumes that it spans with the three edges of the
    face, all of one sign where it hits. Their shares are the weights of the corners; their sum over the
    volume of the corners is one over depth.
    """
    px, py, pz = place[0, p], place[1, p], place[2, p]
    qx, qy, qz = place[0, q], place[1, q], place[2, q]
    rx, ry, rz = place[0, r], place[1, r], place[2, r]
    a0, b0, c0 = qy * rz - qz * ry, qz * rx - qx * rz, qx * ry - qy * rx
    a1, b1, c1 = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
    a2, b2, c2 = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    volume = px * a0 + py * b0 + pz * c0
    if volume == 0:
        return
    side = math.copysign(1.0, volume)  # faces have two sides
    a0, b0, c0 = side * a0, side * b0, side * c0
    a1, b1, c1 = side * a1, side * b1, side * c1
    a2, b2, c2 = side * a2, side * b2, side * c2
    per_volume, slope = side / volume, a0 + a1 + a2
    columns = x.shape[0]
    if right - left < NARROW:
        for row in range(top, bottom + 1):
            base = row * columns
            k0, k1, k2 = b0 * y[row] + c0, b1 * y[row] + c1, b2 * y[row] + c2
            for column in range(left, right + 1):
                e0, e1, e2 = a0 * x[column] + k0, a1 * x[column] + k1, a2 * x[column] + k2
                if min(e0, e1, e2) < 0:
                    continue
                closeness = f32((e0 + e1 + e2) * per_volume)
                n = base + column
                if closeness > near[n]:
                    near[n], face[n], instance[n] = closeness, f, i
                    u[n], v[n] = e1 * per_volume, e2 * per_volume
        return
    first, per_column = x[0], (columns - 1) / (x[-1] - x[0])
    margin = LATE / per_column
    # Where an edge crosses a row, relative to its ``k``; it bounds the row on one side.
    g0, g1, g2 = -1 / (a0 + TINY), -1 / (a1 + TINY), -1 / (a2 + TINY)
    for row in range(top, bottom + 1):
        k0, k1, k2 = b0 * y[row] + c0, b1 * y[row] + c1, b2 * y[row] + c2
        low, high = x[left], x[right]
        if g0 < 0:
            low = max(low, k0 * g0)
        else:
            high = min(high, k0 * g0)
        if g1 < 0:
            low = max(low, k1 * g1)
        else:
            high = min(high, k1 * g1)
        if g2 < 0:
            low = max(low, k2 * g2)
        else:
            high = min(high, k2 * g2)
        if low > high + margin:
            continue
        start = int((low - first) * per_column + EARLY)
        end = int((high - first) * per_column + LATE)
        base, total = row * columns, k0 + k1 + k2
        for column in range(start, min(end, right) + 1):
            closeness = f32((slope * x[column] + total) * per_volume)
            if closeness > near[base + column]:
                e0, e1, e2 = a0 * x[column] + k0, a1 * x[column] + k1, a2 * x[column] + k2
                if e0 >= 0 and e1 >= 0 and e2 >= 0:
                    n = base + column
                    near[n], face[n], instance[n] = closeness, f, i
                    u[n], v[n] = e1 * per_volume, e2 * per_volume
