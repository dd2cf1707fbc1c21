"""Contact shadows: where wheels, feet and posts meet the ground, and below vehicles.

Sky rays are few, and their mean over 8 x 8 pixels (see ``visibility``) is wider than the dark strip below a
car. Objects on the ground are therefore also approximated by boxes, for which a short formula gives the
hidden share of the sky.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from scene.classes import TrainId
from scene.compiled import njit
from scene.render.geometry import AssetKey, Geometry, asset_shape
from scene.render.visibility import DARKEST

FOOT = 0.1
"""Height in metres below which a shape touches the ground."""
CELL = 0.05
"""Cell size in metres of the raster that separates feet."""
LARGEST = 6.0
"""Metres; larger objects such as houses darken the ground so far that rays suffice."""
UNDERSIDE, LEAST = 0.7, 2.0
"""Height in metres below which level faces are a vehicle's underside, and its least area in square metres."""
TALL = 1.5
"""Largest height that counts, metres."""
REACH = 0.6
"""Metres from a box within which it darkens the ground."""
FAR, TILE = 40.0, 1.0
"""Metres around the camera within which boxes count, and sides of the tiles that list them."""
GROUND = (TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN)

f32 = np.float32
ZERO, HALF, ONE = f32(0), f32(0.5), f32(1)


@lru_cache(maxsize=2048)
def boxes(key: AssetKey) -> np.ndarray:
    """Boxes f32[n, 6] with which an asset darkens the ground, metres in its own frame.

    Centre x and y, half length and width, height of the underside (0: it touches the ground) and of the top.
    """
    shape = asset_shape(*key)
    vertices, faces = shape.vertices, shape.faces
    (left, back, _), (right, front, high) = shape.box[0], shape.box[-1]
    result: list[tuple[float, ...]] = []
    top = min(float(high), TALL)
    if high < 2 * FOOT:  # a tile
        return np.zeros((0, 6), np.float32)
    columns, rows = (int(side / CELL) + 2 for side in (right - left, front - back))
    if max(columns, rows) * CELL < 4 * LARGEST:
        touched = np.zeros((rows, columns), np.uint8)
        _mark(vertices, faces, left, back, touched)
        for x, y, wide, deep, _ in cv2.connectedComponentsWithStats(touched)[2][1:].tolist():
            long, across = CELL * wide / 2, CELL * deep / 2
            if max(long, across) < LARGEST / 2:
                result.append(
                    (left + CELL * x + long, back + CELL * y + across, long, across, 0.0, top)
                )
    corners = vertices[faces]
    heights = corners[..., 2]
    level = (heights.max(axis=1) < UNDERSIDE) & (heights.min(axis=1) > FOOT)
    level &= np.abs(shape.normal[:, 2]) > 0.8
    sides = corners[level, 1:, :2] - corners[level, :1, :2]
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    if area.sum() > LEAST:
        low, end = (
            corners[level].reshape(-1, 3).min(axis=0),
            corners[level].reshape(-1, 3).max(axis=0),
        )
        under = float((area * heights[level].mean(axis=1)).sum() / area.sum())
        result.append((*(low + end)[:2] / 2, *(end - low)[:2] / 2, under, top))
    return np.array(result, np.float32).reshape(-1, 6)


@njit(cache=True)
def _mark(
    vertices: np.ndarray, faces: np.ndarray, left: float, back: float, touched: np.ndarray
) -> None:
    """Set cells with part of a face below ``FOOT`` to 1."""
    for f in range(len(faces)):
        low_x, low_y, high_x, high_y = 1e9, 1e9, -1e9, -1e9
        for k in range(3):
            a, b = vertices[faces[f, k]], vertices[faces[f, (k + 1) % 3]]
            if a[2] < FOOT:
                low_x, high_x = min(low_x, a[0]), max(high_x, a[0])
                low_y, high_y = min(low_y, a[1]), max(high_y, a[1])
            if (a[2] < FOOT) != (b[2] < FOOT):
                t = (FOOT - a[2]) / (b[2] - a[2])
                x, y = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
        if low_x <= high_x:
            for row in range(int((low_y - back) / CELL), int((high_y - back) / CELL) + 1):
                for column in range(int((low_x - left) / CELL), int((high_x - left) / CELL) + 1):
                    touched[row, column] = 1


def standing_boxes(geometry: Geometry) -> np.ndarray:
    """Boxes f32[n, 16] of all objects of a street.

    World -> frame of the box with its centre at the origin (3 rows of 4); half length and width, underside
    and top, see ``boxes``.
    """
    asset_boxes = [boxes(key) for key in geometry.assets]
    skip = len(geometry.shapes) - len(asset_boxes)
    shape = geometry.shape[1 + skip :] - skip
    many = np.array([len(rows) for rows in asset_boxes], np.int64)[shape]
    if not many.sum():
        return np.zeros((0, 16), np.float32)
    box = np.concatenate([asset_boxes[k] for k in shape])
    pose = np.repeat(geometry.pose[1 + skip :], many, axis=0)
    turn = pose[:, :, :3].transpose(0, 2, 1)
    move = -np.einsum("nij,nj->ni", turn, pose[:, :, 3])
    move[:, :2] -= box[:, :2]
    rows = np.concatenate([turn, move[..., None]], axis=2).reshape(-1, 12)
    return np.concatenate([rows, box[:, 2:]], axis=1).astype(np.float32)


def darken(
    opened: np.ndarray,
    points: np.ndarray,
    instance: np.ndarray,
    train_id: np.ndarray,
    standing: np.ndarray,
    origin: np.ndarray,
) -> np.ndarray:
    """Share f32[m] of visible sky; for spots on the ground, at most what boxes leave.

    Args:
        opened: f32[m] share of visible sky by rays.
        points: f32[m, 3] in the world, metres.
        instance: i32[m].
        train_id: u8[instances].
        standing: see ``standing_boxes``.
        origin: f32[3] of the camera.
    """
    out = opened.copy()
    _darken(out, points, instance, np.isin(train_id, GROUND), standing, origin)
    return out


@njit(cache=True, fastmath=True, error_model="numpy")
def _darken(
    opened: np.ndarray,
    points: np.ndarray,
    instance: np.ndarray,
    ground: np.ndarray,
    standing: np.ndarray,
    origin: np.ndarray,
) -> None:
    side = int(2 * FAR / TILE)
    west, south = origin[0] - f32(FAR), origin[1] - f32(FAR)
    head = np.full((side, side), -1, np.int32)
    box, following = np.empty(1024, np.int32), np.empty(1024, np.int32)
    count = 0
    for n in range(len(standing)):
        b = standing[n]
        # The centre in the world: the frame is rotated and, for some buses, reflected.
        x = -(b[0] * b[3] + b[4] * b[7] + b[8] * b[11])
        y = -(b[1] * b[3] + b[5] * b[7] + b[9] * b[11])
        long, wide = b[12] + f32(REACH), b[13] + f32(REACH)
        reach_x, reach_y = abs(b[0]) * long + abs(b[4]) * wide, abs(b[1]) * long + abs(b[5]) * wide
        for row in range(
            max(math.floor((y - reach_y - south) / f32(TILE)), 0),
            min(math.floor((y + reach_y - south) / f32(TILE)) + 1, side),
        ):
            for column in range(
                max(math.floor((x - reach_x - west) / f32(TILE)), 0),
                min(math.floor((x + reach_x - west) / f32(TILE)) + 1, side),
            ):
                if count == len(box):
                    box = np.concatenate((box, np.empty_like(box)))
                    following = np.concatenate((following, np.empty_like(following)))
                box[count], following[count] = n, head[row, column]
                head[row, column] = count
                count += 1
    for i in range(len(points)):
        if not ground[instance[i]]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        column, row = (x - west) / f32(TILE), (y - south) / f32(TILE)
        if (column < ZERO) | (row < ZERO) | (column >= side) | (row >= side):
            continue
        k = head[int(row), int(column)]
        left = ONE
        while k >= 0:
            b = standing[box[k]]
            u = abs(b[0] * x + b[1] * y + b[2] * z + b[3])
            v = abs(b[4] * x + b[5] * y + b[6] * z + b[7])
            w = b[8] * x + b[9] * y + b[10] * z + b[11]
            if abs(w) < f32(0.3):
                left *= ONE - _hidden(u, v, b[12], b[13], b[14], b[15])
            k = following[k]
        if left < ONE:
            opened[i] = min(opened[i], f32(DARKEST) + f32(1 - DARKEST) * left)


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def _hidden(
    u: np.float32,
    v: np.float32,
    long: np.float32,
    wide: np.float32,
    under: np.float32,
    top: np.float32,
) -> np.float32:
    """Share of the sky's light that a box hides from a place ``u``, ``v`` from its centre.

    The view factor of a strip is (sin a + sin b) / 2 with the angles to its two edges; that of a rectangle is
    nearly the product of two. From the side, a box reaches up to its top.
    """
    off_u, off_v = max(u - long, ZERO), max(v - wide, ZERO)
    off = off_u * off_u + off_v * off_v
    if off >= f32(REACH * REACH):
        return ZERO
    along = _strip(u, long, under * under + off_v * off_v, top)
    across = _strip(v, wide, under * under + off_u * off_u, top)
    return along * across * (ONE - off * f32(1 / REACH**2))


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def _strip(u: np.float32, half: np.float32, away: np.float32, top: np.float32) -> np.float32:
    """View factor of a strip ``u`` from its centre, the square root of ``away`` from its plane."""
    far, near = half + u, half - u
    high = away if near > ZERO else top * top
    least = f32(1e-6)
    return HALF * (
        far / f32(math.sqrt(far * far + away + least))
        + near / f32(math.sqrt(near * near + high + least))
    )
