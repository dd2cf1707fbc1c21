"""A street: assets placed on lines along a straight road, a sky, and the camera's path.

Pure in (params, seed). Every family stands on its own line on both sides of the road, at the distance
and spacing its attributes say. Lines may interpenetrate and are never moved apart: finding attributes
that keep them apart is the search problem. Source: section 3 of the paper.

World frame: x along the road (the driving direction), y left, z up, metres; the road's centre line is
the x axis at z = 0.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import AssetPool, pick
from scene.assets.rider import MOUNT
from scene.attributes import StreetParams
from scene.classes import TrainId
from scene.ground.ground import Ground, ground_height, sample_ground
from scene.sky.sky import Sky, sample_sky
from scene.street.background import background

LINE_START, LINE_END = -15.0, 150.0
"""Where every line of objects begins and ends, metres along the road."""
DRIVE = 60.0
"""Metres of road over which the camera takes its shots."""
JITTER = 0.25
"""Objects leave their slot's middle by up to this share of the interval."""
SEARCH = 15.0
"""Metres by which a shot may be moved on to a place where nothing blocks the lens."""
VIEW = 4.0
"""Metres of view that should be free."""
SPARE = 0.3
"""Metres that things should be away from it."""
FAR = 35.0
"""Metres from every camera beyond which trees have fewer, larger leaves and twigs."""
RUNS = ("fence", "wall")
"""Families of which one asset is a panel; a slot holds a run of up to three."""
RUN, OVERLAP = 0.8, 0.98
"""Share of an interval that a run may fill; shift from panel to panel in lengths of one."""
OWN_POST = 0.1
"""A user's own sign that reaches this low, metres, has a post of its own."""
FIRST_INSTANCE = 4
"""Instances 1-3 are road, sidewalk and terrain (see ``ground.py``); 0 is the sky."""
BACKGROUND = 7
"""Stream of random numbers that the background is drawn from."""


class Placement(NamedTuple):
    """One asset standing in the street."""

    family: str
    asset: int | str  # index of the asset in its family, or the path of a user's own
    train_id: int
    instance: int
    pose: np.ndarray  # f64[4, 4] asset frame -> world
    far: bool = False  # no camera comes near: fewer, larger leaves will do


class Camera(NamedTuple):
    """A pinhole camera; ``yaw`` right positive, ``pitch`` down positive, radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float


class Street(NamedTuple):
    """Everything a renderer needs, and nothing about how it renders."""

    placements: tuple[Placement, ...]
    cameras: tuple[Camera, ...]
    sky: Sky
    ground: Ground
    seed: int


class Line(NamedTuple):
    """One line of objects: the attributes that place it and the families that stand on it."""

    name: str
    mix: tuple[tuple[str, float], ...]  # (family, share)
    facing: str  # "road", "lane", "either", "camera" or "any"; see _yaw


LINES: tuple[Line, ...] = (
    Line("building", (("building", 0.96), ("train", 0.04)), "road"),
    Line("fence", (("fence", 0.6), ("wall", 0.4)), "road"),
    Line("tree", (("tree", 0.7), ("bush", 0.3)), "any"),
    Line("bicycle", (("bicycle", 0.7), ("motorcycle", 0.3)), "either"),
    Line("person", (("person", 0.75), ("rider", 0.25)), "either"),
    Line("pole", (("lamp", 0.4), ("traffic sign", 0.35), ("traffic light", 0.25)), "camera"),
    Line("car", (("car", 0.9), ("bus", 0.05), ("truck", 0.05)), "lane"),
)


def sample_street(
    params: StreetParams, seed: int, shots: int, pool: AssetPool | None = None
) -> Street:
    """One street with ``shots`` camera poses along it; the same arguments give the same street."""
    pool = pool or AssetPool()
    rng = np.random.default_rng(seed)
    sky = sample_sky(
        rng,
        intensity=params.illumination_intensity,
        elevation=params.illumination_angle_x,
        azimuth=params.illumination_angle_y,
        share=pool.fraction,
    )
    camera_side = -1.0 if rng.random() < params.camera_position_probability else 1.0
    ground = sample_ground(rng, pool.fraction, camera_side)
    placements: list[Placement] = []
    for line in LINES:
        # A line draws from a generator of its own, so moving one line leaves the others as they are.
        line_rng = np.random.default_rng(rng.integers(2**32))
        for side in (1.0, -1.0):
            _fill(placements, line, side, camera_side, params, ground, pool, line_rng)
    # Before the background, which is too far away to be in the way.
    cameras = _camera_path(params, ground, camera_side, shots, placements, rng)
    far_rng = np.random.default_rng([seed, BACKGROUND])
    for stand in background(params, far_rng):
        ref = pick(pool, stand.family, far_rng)
        _place(placements, stand.family, ref, _pose(ground, stand.x, stand.y, stand.yaw))
    return Street(tuple(placements), cameras, sky, ground, seed)


def _fill(
    placements: list[Placement],
    line: Line,
    side: float,
    camera_side: float,
    params: StreetParams,
    ground: Ground,
    pool: AssetPool,
    rng: np.random.Generator,
) -> None:
    """Fill one line on one side of the road, slot by slot."""
    distance = getattr(params, f"{line.name}_position")
    interval = getattr(params, f"{line.name}_interval")
    probability = getattr(params, f"{line.name}_probability", 1.0)
    families = [family for family, _ in line.mix]
    shares = list(accumulate(share for _, share in line.mix))
    start = LINE_START + rng.uniform(0, interval)
    for slot in range(math.ceil((LINE_END - start) / interval)):
        x = start + (slot + rng.uniform(-JITTER, JITTER)) * interval
        family = families[bisect_right(shares, rng.random() * shares[-1])]
        index = pick(pool, family, rng)
        other = int(rng.integers(2**31))
        yaw = _yaw(line.facing, family, side, side == camera_side, rng)
        filled = rng.random() < probability
        # Facades of neighbours that overlap would lie in one plane; a step back keeps their edges
        # clean. It is no round number, since walls have relief in whole centimetres.
        y = side * (distance + (0.0437 * (slot % 3) if line.facing == "road" else 0.0))
        if not filled or index is None:
            continue
        for shift in _panels(family, index, interval):
            pose = _pose(ground, x + shift, y, yaw)
            for part, part_index in _parts(family, index, other, pool):
                _place(placements, part, part_index, pose)


def _panels(family: str, ref: int | str, interval: float) -> list[float]:
    """Where along the road the copies of an object stand, from its place: fences and walls run on."""
    if family not in RUNS:
        return [0.0]
    low, high = catalogue.bounds(family, ref)
    length = OVERLAP * float(high[0] - low[0])
    count = int(np.clip(RUN * interval / length, 1, 3))
    return [(k - (count - 1) / 2) * length for k in range(count)]


def _place(
    placements: list[Placement], family: str, ref: int | str | None, pose: np.ndarray
) -> None:
    """Add one asset, if the pool has one, under the next free instance id."""
    if ref is None:
        return
    train_id = int(catalogue.FAMILIES[family].train_id)
    x, y = pose[0, 3], abs(pose[1, 3])
    far = train_id == TrainId.VEGETATION and (x > DRIVE + SEARCH + FAR or y > FAR)
    placements.append(
        Placement(family, ref, train_id, FIRST_INSTANCE + len(placements), pose, bool(far))
    )


def _parts(
    family: str, ref: int | str, seed: int, pool: AssetPool
) -> list[tuple[str, int | str | None]]:
    """The assets that make up one object: a rider's machine and a sign's post have their own class."""
    if family not in ("rider", "traffic sign", "traffic light"):
        return [(family, ref)]
    rng = np.random.default_rng(seed)
    if family == "rider":
        kinds = catalogue.FAMILIES["rider"].kinds
        # A user's own rider says not what it rides.
        kind = ref if isinstance(ref, int) else int(rng.integers(len(kinds)))
        mount = MOUNT[kinds[kind % len(kinds)]]
        return [(family, ref), (mount, pick(pool, mount, rng))]
    if isinstance(ref, str) and catalogue.bounds(family, ref)[0, 2] < OWN_POST:
        return [(family, ref)]
    return [(family, ref), ("signpost", pick(pool, "signpost", rng))]


def _yaw(
    facing: str, family: str, side: float, camera_side: bool, rng: np.random.Generator
) -> float:
    """The heading of an object, radians left of the driving direction.

    ``road``: the front looks at the road. ``lane``: with the traffic of its side. ``either``: along
    the road one way or the other, give or take. ``camera``: lamps reach over the road, signs look
    at the traffic. ``any``: anything.
    """
    turned, wobble, free = rng.random(), rng.normal(), rng.uniform(-math.pi, math.pi)
    if facing == "road" or family == "lamp":
        return 0.0 if side > 0 else math.pi
    if facing == "lane":
        return (0.0 if camera_side else math.pi) + 0.02 * wobble
    if facing == "either":
        return free if turned > 0.85 else (math.pi if turned > 0.45 else 0.0) + 0.15 * wobble
    if facing == "camera":
        return 0.1 * wobble
    return free


def _pose(ground: Ground, x: float, y: float, yaw: float) -> np.ndarray:
    """Pose of an object that stands on the ground at (x, y)."""
    c, s = math.cos(yaw), math.sin(yaw)
    z = ground_height(ground, y)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def forward(camera: Camera) -> np.ndarray:
    """Unit vector f64[3] along the camera's optical axis."""
    c = math.cos(camera.pitch)
    return np.array([c * math.cos(camera.yaw), -c * math.sin(camera.yaw), -math.sin(camera.pitch)])


def bounds(placements: list[Placement]) -> np.ndarray:
    """World axis-aligned boxes f64[placements, 2, 3] (low, high corner)."""
    if not placements:
        return np.zeros((0, 2, 3))
    own = np.stack([catalogue.bounds(p.family, p.asset) for p in placements])
    poses = np.stack([p.pose for p in placements])
    centre, half = own.mean(axis=1), (own[:, 1] - own[:, 0]) / 2
    rotation = poses[:, :3, :3]
    middle = np.einsum("nij,nj->ni", rotation, centre) + poses[:, :3, 3]
    reach = np.einsum("nij,nj->ni", np.abs(rotation), half)
    return np.stack([middle - reach, middle + reach], axis=1)


def _camera_path(
    params: StreetParams,
    ground: Ground,
    side: float,
    shots: int,
    placements: list[Placement],
    rng: np.random.Generator,
) -> tuple[Camera, ...]:
    """Poses spread over ``DRIVE`` metres, each moved on until nothing blocks the lens."""
    boxes = bounds(placements)
    trees = np.array([p.train_id == TrainId.VEGETATION for p in placements], bool)
    centre = boxes.mean(axis=1, keepdims=True)
    # A crown is mostly air: only its middle counts as in the way.
    boxes[trees] = centre[trees] + 0.4 * (boxes[trees] - centre[trees])
    y = side * params.camera_position_x
    z = ground_height(ground, y) + params.camera_position_y
    cameras = []
    for shot in range(shots):
        steps = (shot + rng.random()) * DRIVE / shots + np.arange(0.0, SEARCH, 1.5)
        candidates = [
            Camera((float(x), y, z), params.camera_rotation_y, params.camera_rotation_x)
            for x in steps
        ]
        cameras.append(candidates[int(np.argmin(_blocked(candidates, boxes)))])
    return tuple(cameras)


def _blocked(cameras: list[Camera], boxes: np.ndarray) -> np.ndarray:
    """How much i64[cameras] of the first metres of each view lies inside boxes, with some to spare.

    Standing inside one counts more than any view into one. The cameras look the same way.
    """
    places = np.array([camera.position for camera in cameras])
    ahead = np.linspace(0, VIEW, 9)[:, None] * forward(cameras[0])
    points = places[:, None] + ahead
    low, high = boxes[:, 0] - SPARE, boxes[:, 1] + SPARE
    near = (high >= points.min(axis=(0, 1))) & (low <= points.max(axis=(0, 1)))
    low, high = low[near.all(axis=1)], high[near.all(axis=1)]
    inside = (points[:, :, None] > low) & (points[:, :, None] < high)
    hidden = inside.all(axis=3).any(axis=2)
    return hidden.sum(axis=1) + points.shape[1] * hidden[:, 0]
