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

from scene.geometry import Geometry, build
from scene.render import shade
from scene.render.protocol import (
    Frame,
    RendererError,
    RenderSettings,
    camera_axes,
    check_settings,
)
from scene.render.shot import Rays, Visible, expose, sample_rays, sunward, visible
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

    def render(self, street: Street, settings: RenderSettings) -> list[Frame]:
        """One frame per camera of the street; see ``protocol.Renderer``.

        Raises:
            ValueError: settings out of range.
            RendererError: OpenGL failed; its resources have been freed.
        """
        check_settings(settings)
        return _on_gl_thread(lambda: _render(street, settings))


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


def _render(street: Street, settings: RenderSettings) -> list[Frame]:
    geometry = build(street)
    rasterizer = _rasterizer()
    try:
        rasterizer.load(geometry.vertices, geometry.faces)
        return [
            _shoot(rasterizer, geometry, street, camera, shot, settings)
            for shot, camera in enumerate(street.cameras)
        ]
    except BaseException:
        _release()
        raise


def _shoot(
    rasterizer: Rasterizer,
    geometry: Geometry,
    street: Street,
    camera: Camera,
    shot: int,
    settings: RenderSettings,
) -> Frame:
    rays = sample_rays(camera, settings)
    picture = rasterizer.draw(*_view(camera, settings), rays.columns, rays.rows)
    depth = picture[..., 1].ravel()
    seen = visible(rays, geometry, picture[..., 0].ravel().astype(np.int32), depth / rays.along)
    lit = np.ones(len(depth), np.float32)
    if settings.shadows:
        _cast_shadows(rasterizer, geometry, rays, seen, street.sky.sun_direction, lit)
    opened = np.ones(len(depth), np.float32)
    if settings.occlusion:
        outwards = np.empty_like(rays.directions)
        shade.occlusion_directions(seen.normals, rays.columns, outwards)
        raw = np.ones(len(depth), np.float32)
        axes = camera_axes(camera).astype(np.float32)
        _open_on_screen(rays, seen, outwards, axes, picture, np.float32(rays.spacing), raw)
        shade.smooth_open(
            raw, seen.faces, seen.normals, seen.distance, rays.rows, rays.columns, opened
        )
        opened = 0.15 + 0.85 * opened
    return expose(street, shot, geometry, rays, seen, lit, opened, settings)


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
    rays: Rays,
    seen: Visible,
    outwards: np.ndarray,
    axes: np.ndarray,
    picture: np.ndarray,
    spacing: np.float32,
    opened: np.ndarray,
) -> None:
    """Set ``opened`` to 0 where a few steps along ``outwards`` pass behind something seen."""
    columns, rows = rays.columns, rays.rows
    for i in range(seen.faces.shape[0]):
        if seen.faces[i] < 0:
            continue
        # The ground is always there, in view or not.
        if outwards[i, 2] < 0 and 0 < seen.points[i, 2] < -REACH * outwards[i, 2]:
            opened[i] = 0.0
            continue
        start = 0.01 + 0.004 * seen.distance[i]
        for reach in STEPS:
            x, y, z = np.float32(0), np.float32(0), np.float32(0)
            for k in range(3):
                place = (
                    seen.points[i, k]
                    - rays.origin[k]
                    + start * seen.normals[i, k]
                    + reach * outwards[i, k]
                )
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
                opened[i] = 0.0
                break


def _cast_shadows(
    rasterizer: Rasterizer,
    geometry: Geometry,
    rays: Rays,
    seen: Visible,
    sun_direction: np.ndarray,
    lit: np.ndarray,
) -> None:
    """Set ``lit`` f32[n] to the share of sunlight that reaches each sample.

    The street is drawn from the sun once for each range of depths, just wide enough for what the
    camera sees there.
    """
    towards = sun_direction.astype(np.float64)
    across = np.cross(np.eye(3)[np.abs(towards).argmin()], towards)
    axes = np.stack([across, np.cross(towards, across), towards])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    top = float((geometry.vertices @ axes[2].astype(np.float32)).max()) + 1.0
    size = int(np.clip(2 ** math.ceil(math.log2(1.5 * rays.columns)), 256, 2048))
    cascade = np.empty(len(lit), np.int8)
    local = np.empty((len(lit), 3), np.float32)
    normals = sunward(seen, geometry, sun_direction)
    bounds = _seen_by_the_sun(rays, seen, axes.astype(np.float32), CASCADES, cascade, local)
    for k in np.unique(cascade[cascade >= 0]):
        low, high = bounds[k, 0] - 0.05, bounds[k, 1] + 0.05
        centre, half, reach = (low + high) / 2, (high - low) / 2, top - low[2] + 1.0
        place = np.array([centre[0], centre[1], top]) @ axes
        projection = np.diag([1 / half[0], 1 / half[1], -2 / reach, 1.0])
        projection[2, 3] = -1.0
        picture = rasterizer.draw(_pose(axes, place), projection, size, size)
        _compare(
            k, cascade, seen.faces, local, normals, axes.astype(np.float32),
            low, high, np.float32(top), picture, lit,
        )  # fmt: skip


@njit(cache=True)
def _seen_by_the_sun(
    rays: Rays,
    seen: Visible,
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
        if seen.faces[i] < 0:
            continue
        depth = seen.distance[i] * rays.along[i]
        for k in range(len(edges)):
            if depth < edges[k]:
                cascade[i] = k
                break
        if cascade[i] < 0:
            continue
        for a in range(3):
            value = np.float32(0)
            for b in range(3):
                value += axes[a, b] * seen.points[i, b]
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
