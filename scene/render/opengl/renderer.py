"""Rasterisation with OpenGL: the renderer that uses a GPU if there is one.

OpenGL finds the face of every sample, and draws the street from the sun for shadows; shading is shared with
the other renderers. On machines without a GPU, Mesa's software rasteriser is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from scene.compiled import njit
from scene.render import shade
from scene.render.buffers import Hits, Light, Rays, Visible
from scene.render.embree.api import device
from scene.render.embree.renderer import scene_bvh
from scene.render.framing import framed
from scene.render.geometry import World, build, world
from scene.render.opengl.shadow_maps import cast_shadows, pose_of
from scene.render.protocol import (
    Frame,
    Lap,
    RendererError,
    RenderSettings,
    no_lap,
    seen_through,
    through_middles,
)
from scene.render.shot import (
    Surroundings,
    expose,
    sample_rays,
    sky_segments,
    spread,
    surroundings,
    visible,
)
from scene.street.camera import Camera, camera_axes
from scene.street.street import Street

if TYPE_CHECKING:
    from scene.render.opengl.raster import Rasterizer

T = TypeVar("T")

NEAR = 0.05
"""Metres from the camera to the near plane."""
STEPS = (0.1, 0.25, 0.6, 1.3, 2.5, 4.5)
"""Distances in metres from a surface at which occluders of the sky are searched."""


class OpenGLRenderer:
    """Renders streets with OpenGL; all instances of a process share one context."""

    name = "opengl"

    def __init__(self) -> None:
        """Open the context, once per process.

        Raises:
            RendererError: EGL, a driver, pyrender or Embree is missing.
        """
        device()  # frames and ambient occlusion need Embree
        _on_gl_thread(_rasterizer)

    def render(
        self,
        street: Street,
        settings: RenderSettings,
        lap: Lap = no_lap,
        shots: Sequence[int] | None = None,
    ) -> list[Frame]:
        """Render one frame per camera of the street; see ``protocol.Renderer``.

        Raises:
            ValueError: settings are out of range.
            RendererError: OpenGL failed; its resources are freed.
        """
        settings, *_ = [seen_through(camera, settings) for camera in street.cameras]
        return _on_gl_thread(lambda: _render(street, settings, lap, shots))


@cache
def _gl_thread() -> ThreadPoolExecutor:
    """The thread of the context; callers may come from any thread (JAX callbacks do)."""
    return ThreadPoolExecutor(1, thread_name_prefix="opengl")


def _on_gl_thread(work: Callable[[], T]) -> T:
    return _gl_thread().submit(work).result()


@cache
def _rasterizer() -> Rasterizer:
    try:
        from scene.render.opengl.raster import Rasterizer

        return Rasterizer()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RendererError(
            f"the opengl renderer cannot start ({reason}); it needs pyrender and EGL with a driver "
            "(Debian: apt-get install libegl1 libgl1-mesa-dri), or use --renderer embree"
        ) from error


def _release() -> None:
    """Free the context; the next render opens a new one."""
    if _rasterizer.cache_info().currsize:
        try:
            _rasterizer().delete()
        finally:
            _rasterizer.cache_clear()


def _render(
    street: Street, settings: RenderSettings, lap: Lap, shots: Sequence[int] | None
) -> list[Frame]:
    geometry = build(street)
    merged = world(geometry)
    street = framed(street, geometry, scene_bvh(geometry), settings, shots)
    around = surroundings(street, geometry, settings)
    lap("build")
    rasterizer = _rasterizer()
    try:
        rasterizer.load(
            merged.vertices, np.arange(len(merged.vertices), dtype=np.int32).reshape(-1, 3)
        )
        lap("bvh")
        look = partial(_look, rasterizer, around, merged)
        frames = []
        for shot in range(len(street.cameras)) if shots is None else shots:
            camera = street.cameras[shot]
            through = seen_through(camera, settings)
            pixels = through_middles(through)
            drawing, view = look(camera, through)
            pixel_view = view if pixels == through else look(camera, pixels)[1]
            light = _light(rasterizer, around, merged, camera, drawing, view, through)
            lap("rays")
            frames.append(expose(around, shot, view, light, pixel_view, through))
            lap("shade")
        return frames
    except BaseException:
        _release()
        raise


def _look(
    rasterizer: Rasterizer,
    around: Surroundings,
    merged: World,
    camera: Camera,
    settings: RenderSettings,
) -> tuple[np.ndarray, Visible]:
    """Draw a shot: face ids and depths, and the geometry of its spots."""
    rays = sample_rays(camera, settings)
    face_image = rasterizer.draw(*_view(camera, settings), rays.columns, rays.rows)
    return face_image, visible(around, rays, _hits(face_image, rays, merged), settings)


def _hits(face_image: np.ndarray, rays: Rays, merged: World) -> Hits:
    """Convert the drawing of OpenGL to the hits of the other renderers."""
    n = rays.rows * rays.columns
    hits = Hits(
        np.empty(n, np.int32), np.empty(n, np.int32), *(np.empty(n, np.float32) for _ in range(3))
    )
    _read(face_image.reshape(n, 2), rays, merged, hits)
    return hits


@njit(cache=True, fastmath=True)
def _read(face_image: np.ndarray, rays: Rays, merged: World, hits: Hits) -> None:
    """Faces, distances and positions in the faces from an image of face ids and depths."""
    origin, directions, along = rays.origin, rays.directions, rays.along
    vertices, instances, faces = merged.vertices, merged.instance, merged.face
    face, instance, distance, u, v = hits.face, hits.instance, hits.distance, hits.u, hits.v
    for i in range(face.shape[0]):
        number = int(face_image[i, 0])
        if number < 0:
            face[i], instance[i] = shade.MISS, 0
            distance[i] = u[i] = v[i] = 0
            continue
        face[i], instance[i] = faces[number], instances[number]
        distance[i] = face_image[i, 1] / along[i]
        # Barycentric coordinates of the point, from dot products with the two edges.
        bb = bc = cc = pb = pc = np.float32(0)
        for k in range(3):
            a = vertices[3 * number, k]
            edge_b, edge_c = vertices[3 * number + 1, k] - a, vertices[3 * number + 2, k] - a
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
    face_image: np.ndarray,
    view: Visible,
    settings: RenderSettings,
) -> Light:
    """Sun and sky light at each spot, from images instead of rays."""
    rays, lit = view.rays, np.ones(len(view.points), np.float32)
    if settings.shadows:
        face_ids = face_image[..., 0].ravel().astype(np.int32)
        towards = around.street.sky.sun_direction
        cast_shadows(rasterizer, merged, view, face_ids, towards, lit)
    opened = np.ones(len(view.points), np.float32)
    if settings.occlusion:
        segments = sky_segments(view, around, settings)
        free = segments.needed.astype(np.float32)
        axes = camera_axes(camera).astype(np.float32)
        _open_on_screen(
            rays.origin, np.float32(rays.spacing), (0.5 + camera.offset[0]) * rays.columns,
            0.5 * rays.rows + camera.offset[1] * rays.columns, segments.starts,
            segments.directions, segments.needed, axes, face_image, free,
        )  # fmt: skip
        opened = spread(free, view, settings)
    return Light(lit, opened)


def _view(camera: Camera, settings: RenderSettings) -> tuple[np.ndarray, np.ndarray]:
    """Pose and projection of a shot; the far plane is at infinity."""
    axes = camera_axes(camera) * [[1], [1], [-1]]
    half = math.tan(math.radians(settings.fov) / 2)
    projection = np.zeros((4, 4))
    projection[0, 0] = 1 / half
    projection[1, 1] = settings.width / (settings.height * half)
    projection[0, 2] = -2 * camera.offset[0]
    projection[1, 2] = 2 * camera.offset[1] * settings.width / settings.height
    projection[2, 2:] = -1, -2 * NEAR
    projection[3, 2] = -1
    return pose_of(axes, np.asarray(camera.position)), projection


@njit(cache=True, fastmath=True)
def _open_on_screen(
    origin: np.ndarray,
    spacing: np.float32,
    middle_column: float,
    middle_row: float,
    starts: np.ndarray,
    directions: np.ndarray,
    needed: np.ndarray,
    axes: np.ndarray,
    face_image: np.ndarray,
    free: np.ndarray,
) -> None:
    """Set ``free`` to 0 where a few steps along a sky ray pass behind a visible surface."""
    rows, columns = face_image.shape[0], face_image.shape[1]
    for j in range(needed.shape[0]):
        if not needed[j]:
            continue
        away = np.float32(0)
        for k in range(3):
            away += (starts[j, k] - origin[k]) ** 2
        start = 0.004 * math.sqrt(away)
        for reach in STEPS:
            x, y, z = np.float32(0), np.float32(0), np.float32(0)
            for k in range(3):
                place = starts[j, k] - origin[k] + (start + reach) * directions[j, k]
                x += place * axes[0, k]
                y += place * axes[1, k]
                z += place * axes[2, k]
            if z < NEAR:
                break
            column = math.floor(x / (z * spacing) + middle_column)
            row = math.floor(middle_row - y / (z * spacing))
            if column < 0 or column >= columns or row < 0 or row >= rows:
                break
            behind = z - face_image[row, column, 1]
            # What is much nearer is in front of it, not above it.
            if face_image[row, column, 0] >= 0 and 0.002 * z < behind < 0.3 + reach:
                free[j] = 0.0
                break
