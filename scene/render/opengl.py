"""Rasterisation with OpenGL: the renderer that uses a GPU where there is one.

OpenGL finds which face every sample sees, and draws the street from the sun for its shadows; shading is
shared with the other renderers. On machines without a GPU, Mesa's software rasteriser does the drawing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numba import njit

from scene.geometry import World, build, world
from scene.render import shade
from scene.render.protocol import (
    Frame,
    Lap,
    RendererError,
    RenderSettings,
    camera_axes,
    check_settings,
    no_lap,
)
from scene.render.shot import (
    Hits,
    Light,
    Rays,
    Segments,
    Surroundings,
    Visible,
    expose,
    sample_rays,
    sky_segments,
    spread,
    sun_segments,
    surroundings,
    visible,
)
from scene.street import Camera, Street

if TYPE_CHECKING:
    from scene.render.raster import Rasterizer

T = TypeVar("T")

NEAR = 0.05
"""Metres from the camera to the near plane."""
CASCADES = (12.0, 45.0, 250.0)
"""Depths, metres, at which one shadow map hands over to the next, coarser one; sunlit beyond."""
REACH = 5.0
"""Metres within which a surface takes sky light away, as in the embree renderer."""
STEPS = (0.1, 0.25, 0.6, 1.3, 2.5, 4.5)
"""Metres from a surface at which something that hides the sky from it is looked for."""


class OpenGLRenderer:
    """Renders streets with OpenGL; all instances of a process share one context."""

    name = "opengl"

    def __init__(self) -> None:
        """Open the context, once per process.

        Raises:
            RendererError: no EGL, no driver or no pyrender on this machine.
        """
        _on_gl_thread(_rasterizer)

    def render(self, street: Street, settings: RenderSettings, lap: Lap = no_lap) -> list[Frame]:
        """One frame per camera of the street; see ``protocol.Renderer``.

        Raises:
            ValueError: settings out of range.
            RendererError: OpenGL failed; its resources have been freed.
        """
        check_settings(settings)
        return _on_gl_thread(lambda: _render(street, settings, lap))


@cache
def _gl_thread() -> ThreadPoolExecutor:
    """A context belongs to one thread, and callers may come from any (JAX callbacks do)."""
    return ThreadPoolExecutor(1, thread_name_prefix="opengl")


def _on_gl_thread(work: Callable[[], T]) -> T:
    return _gl_thread().submit(work).result()


@cache
def _rasterizer() -> Rasterizer:
    try:
        from scene.render.raster import Rasterizer

        return Rasterizer()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RendererError(
            f"the opengl renderer cannot start ({reason}); it needs pyrender and EGL with a driver "
            "(Debian: apt-get install libegl1 libgl1-mesa-dri), or use --renderer embree"
        ) from error


def _release() -> None:
    """Free the context; the next render opens another."""
    if _rasterizer.cache_info().currsize:
        try:
            _rasterizer().delete()
        finally:
            _rasterizer.cache_clear()


def _render(street: Street, settings: RenderSettings, lap: Lap) -> list[Frame]:
    geometry = build(street)
    merged = world(geometry)
    around = surroundings(street, geometry, settings)
    lap("build")
    rasterizer = _rasterizer()
    try:
        rasterizer.load(
            merged.vertices, np.arange(len(merged.vertices), dtype=np.int32).reshape(-1, 3)
        )
        lap("bvh")
        frames = []
        for shot, camera in enumerate(street.cameras):
            rays = sample_rays(camera, settings)
            picture = rasterizer.draw(*_view(camera, settings), rays.columns, rays.rows)
            seen = visible(rays, geometry, _hits(picture, rays, merged))
            light = _light(rasterizer, around, merged, camera, rays, picture, seen, settings)
            lap("rays")
            frames.append(expose(around, shot, rays, seen, light, settings))
            lap("shade")
        return frames
    except BaseException:
        _release()
        raise


def _hits(picture: np.ndarray, rays: Rays, merged: World) -> Hits:
    """What OpenGL drew, as the other renderers say it."""
    n = rays.rows * rays.columns
    hits = Hits(
        np.empty(n, np.int32), np.empty(n, np.int32), *(np.empty(n, np.float32) for _ in range(3))
    )
    _read(
        picture.reshape(n, 2), rays.origin, rays.directions, rays.along,
        merged.vertices, merged.instance, merged.face, *hits,
    )  # fmt: skip
    return hits


@njit(cache=True, fastmath=True)
def _read(
    picture: np.ndarray,
    origin: np.ndarray,
    directions: np.ndarray,
    along: np.ndarray,
    vertices: np.ndarray,
    instances: np.ndarray,
    faces: np.ndarray,
    face: np.ndarray,
    instance: np.ndarray,
    distance: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> None:
    """Faces, distances and places within the faces from a picture of face numbers and depths."""
    for i in range(face.shape[0]):
        drawn = int(picture[i, 0])
        if drawn < 0:
            face[i], instance[i] = shade.MISS, 0
            distance[i] = u[i] = v[i] = 0
            continue
        face[i], instance[i] = faces[drawn], instances[drawn]
        distance[i] = picture[i, 1] / along[i]
        # Barycentric coordinates of the point, from dot products with the two edges.
        bb = bc = cc = pb = pc = np.float32(0)
        for k in range(3):
            a = vertices[3 * drawn, k]
            edge_b, edge_c = vertices[3 * drawn + 1, k] - a, vertices[3 * drawn + 2, k] - a
            p = origin[k] + distance[i] * directions[i, k] - a
            bb += edge_b * edge_b
            bc += edge_b * edge_c
            cc += edge_c * edge_c
            pb += p * edge_b
            pc += p * edge_c
        area = bb * cc - bc * bc
        scale = 1 / area if area > 1e-20 else np.float32(0)
        u[i] = min(max((cc * pb - bc * pc) * scale, 0.0), 1.0)
        v[i] = min(max((bb * pc - bc * pb) * scale, 0.0), 1.0 - u[i])


def _light(
    rasterizer: Rasterizer,
    around: Surroundings,
    merged: World,
    camera: Camera,
    rays: Rays,
    picture: np.ndarray,
    seen: Visible,
    settings: RenderSettings,
) -> Light:
    """Sun and sky at each sample, from pictures instead of rays."""
    lit = np.ones(len(seen.points), np.float32)
    if settings.shadows:
        drawn = picture[..., 0].ravel().astype(np.int32)
        segments = sun_segments(seen, around)
        _cast_shadows(rasterizer, merged, rays, seen, drawn, segments, lit)
    opened = np.ones(len(seen.points), np.float32)
    if settings.occlusion:
        segments = sky_segments(seen, rays)
        free = np.ones(len(segments.wanted), np.float32)
        axes = camera_axes(camera).astype(np.float32)
        _open_on_screen(
            rays.origin, np.float32(rays.spacing), seen.hits.distance, segments.starts,
            segments.directions, segments.wanted, axes, picture, free,
        )  # fmt: skip
        opened = spread(free, seen, rays)
    return Light(lit, opened)


def _view(camera: Camera, settings: RenderSettings) -> tuple[np.ndarray, np.ndarray]:
    """Pose and projection of a shot; the far plane is at infinity."""
    axes = camera_axes(camera) * [[1], [1], [-1]]
    half = math.tan(math.radians(settings.fov) / 2)
    projection = np.zeros((4, 4))
    projection[0, 0] = 1 / half
    projection[1, 1] = settings.width / (settings.height * half)
    projection[2, 2:] = -1, -2 * NEAR
    projection[3, 2] = -1
    return _pose(axes, np.asarray(camera.position)), projection


def _pose(axes: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Pose f64[4, 4] of a camera at ``place`` whose right, up and backward axes are rows of ``axes``."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes.T, place
    return pose


@njit(cache=True, fastmath=True)
def _open_on_screen(
    origin: np.ndarray,
    spacing: np.float32,
    distance: np.ndarray,
    starts: np.ndarray,
    directions: np.ndarray,
    wanted: np.ndarray,
    axes: np.ndarray,
    picture: np.ndarray,
    free: np.ndarray,
) -> None:
    """Set ``free`` to 0 where a few steps along a ray into the open pass behind something seen."""
    rows, columns = picture.shape[0], picture.shape[1]
    width = (columns + 1) // 2
    for j in range(wanted.shape[0]):
        if not wanted[j]:
            continue
        # The ground is always there, in view or not.
        if directions[j, 2] < 0 and 0.02 < starts[j, 2] < -REACH * directions[j, 2]:
            free[j] = 0.0
            continue
        start = 0.004 * distance[2 * (j // width) * columns + 2 * (j % width)]
        for reach in STEPS:
            x, y, z = np.float32(0), np.float32(0), np.float32(0)
            for k in range(3):
                place = starts[j, k] - origin[k] + (start + reach) * directions[j, k]
                x += place * axes[0, k]
                y += place * axes[1, k]
                z += place * axes[2, k]
            if z < NEAR:
                break
            column = math.floor(x / (z * spacing) + 0.5 * columns)
            row = math.floor(0.5 * rows - y / (z * spacing))
            if column < 0 or column >= columns or row < 0 or row >= rows:
                break
            behind = z - picture[row, column, 1]
            # What is much nearer stands in front rather than over it.
            if picture[row, column, 0] >= 0 and 0.002 * z < behind < 0.3 + reach:
                free[j] = 0.0
                break


def _cast_shadows(
    rasterizer: Rasterizer,
    merged: World,
    rays: Rays,
    seen: Visible,
    drawn: np.ndarray,
    segments: Segments,
    lit: np.ndarray,
) -> None:
    """Set ``lit`` f32[n] to the share of sunlight that reaches each sample.

    The street is drawn from the sun once for each range of depths, just wide enough for what the
    camera sees there.
    """
    towards = segments.directions[0].astype(np.float64)
    across = np.cross(np.eye(3)[np.abs(towards).argmin()], towards)
    axes = np.stack([across, np.cross(towards, across), towards])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    top = float((merged.vertices @ axes[2].astype(np.float32)).max()) + 1.0
    size = int(np.clip(2 ** math.ceil(math.log2(1.5 * rays.columns)), 256, 2048))
    cascade = np.empty(len(lit), np.int8)
    local = np.empty((len(lit), 3), np.float32)
    outwards = (segments.starts - seen.points) / shade.OFFSET
    depth = seen.hits.distance * rays.along
    bounds = _seen_by_the_sun(
        depth, segments.wanted, seen.points, axes.astype(np.float32), CASCADES, cascade, local
    )
    for k in np.unique(cascade[cascade >= 0]):
        low, high = bounds[k, 0] - 0.05, bounds[k, 1] + 0.05
        centre, half, reach = (low + high) / 2, (high - low) / 2, top - low[2] + 1.0
        place = np.array([centre[0], centre[1], top]) @ axes
        projection = np.diag([1 / half[0], 1 / half[1], -2 / reach, 1.0])
        projection[2, 3] = -1.0
        picture = rasterizer.draw(_pose(axes, place), projection, size, size)
        _compare(
            k, cascade, drawn, local, outwards, axes.astype(np.float32),
            low, high, np.float32(top), picture, lit,
        )  # fmt: skip


@njit(cache=True)
def _seen_by_the_sun(
    depth: np.ndarray,
    wanted: np.ndarray,
    points: np.ndarray,
    axes: np.ndarray,
    edges: tuple[float, ...],
    cascade: np.ndarray,
    local: np.ndarray,
) -> np.ndarray:
    """Each sample's range of depths (-1: none) and place in the sun's frame; bounds f32[k, 2, 3]."""
    bounds = np.empty((len(edges), 2, 3), np.float32)
    bounds[:, 0], bounds[:, 1] = 1e9, -1e9
    for i in range(cascade.shape[0]):
        cascade[i] = -1
        if not wanted[i]:
            continue
        for k in range(len(edges)):
            if depth[i] < edges[k]:
                cascade[i] = k
                break
        if cascade[i] < 0:
            continue
        for a in range(3):
            value = np.float32(0)
            for b in range(3):
                value += axes[a, b] * points[i, b]
            local[i, a] = value
            bounds[cascade[i], 0, a] = min(bounds[cascade[i], 0, a], value)
            bounds[cascade[i], 1, a] = max(bounds[cascade[i], 1, a], value)
    return bounds


@njit(cache=True)
def _compare(
    which: int,
    cascade: np.ndarray,
    faces: np.ndarray,
    local: np.ndarray,
    normals: np.ndarray,
    axes: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    top: np.float32,
    picture: np.ndarray,
    lit: np.ndarray,
) -> None:
    """Compare samples with the four nearest texels of the sun's picture and blend between them."""
    size = picture.shape[0]
    texel_x, texel_y = (high[0] - low[0]) / size, (high[1] - low[1]) / size
    # Start a little off the surface, so that it does not shade itself.
    offset = 1.5 * max(texel_x, texel_y) + 0.01
    for i in range(faces.shape[0]):
        if cascade[i] != which:
            continue
        place = np.empty(3, np.float32)
        for a in range(3):
            place[a] = local[i, a]
            for b in range(3):
                place[a] += offset * axes[a, b] * normals[i, b]
        column = (place[0] - low[0]) / texel_x - 0.5
        row = (high[1] - place[1]) / texel_y - 0.5
        depth = top - place[2] - 0.005
        c0, r0 = math.floor(column), math.floor(row)
        share = 0.0
        for r, weight_r in ((r0, 1 - (row - r0)), (r0 + 1, row - r0)):
            for c, weight_c in ((c0, 1 - (column - c0)), (c0 + 1, column - c0)):
                face, blocker = picture[min(max(r, 0), size - 1), min(max(c, 0), size - 1)]
                if face < 0 or face == faces[i] or blocker >= depth:
                    share += weight_r * weight_c
        lit[i] = share
