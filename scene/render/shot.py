"""One shot, from sample rays to a developed frame: the part that all renderers share.

A renderer finds the face that each sample hits, its distance, and the light there. The rest is here, so that
renderers differ in visibility only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import carray

from scene.classes import VOID
from scene.compiled import njit
from scene.ground.land import road_height
from scene.render import shade, visibility
from scene.render.address import float_pointer
from scene.render.buffers import Hits, Light, Rays, Segments, Visible
from scene.render.contact import darken, standing_boxes
from scene.render.geometry import ROW, Geometry
from scene.render.protocol import Frame, RenderSettings, pixel_rays, through_middles
from scene.render.road import on_road
from scene.render.sensor import camera_of_street, develop, set_to
from scene.render.spots import group
from scene.sky.sky import panorama
from scene.streams import stream
from scene.street.camera import Camera, camera_axes
from scene.street.street import Street

BRIGHTEST = 4.0
"""Radiance at which samples are clipped, so that bright sky does not swallow thin poles."""
SKY_STEP = 2
"""Distance between sky rays in pixels, along each axis."""
UNBOUNDED = 1e9
"""Radiance above all others."""


class Surroundings(NamedTuple):
    """The common data of all shots of a street."""

    street: Street
    geometry: Geometry
    panorama: np.ndarray  # f32[rows, columns, 3]
    boxes: np.ndarray  # f32[n, 16] boxes that darken the ground, see ``standing_boxes``


def surroundings(street: Street, geometry: Geometry, settings: RenderSettings) -> Surroundings:
    """Paint the sky of a street, at about the resolution of the image."""
    wide = settings.width * settings.samples * 360 / settings.fov
    columns = int(2 ** np.clip(round(math.log2(wide / 2)), 8, 10))
    sky_image = panorama(street.sky, columns)
    return Surroundings(street, geometry, sky_image, standing_boxes(geometry))


def sample_rays(camera: Camera, settings: RenderSettings) -> Rays:
    """The rays of a shot: ``samples`` x ``samples`` evenly over every pixel."""
    x, y = pixel_rays(settings, settings.samples, camera.offset)
    directions = np.empty((len(y) * len(x), 3), np.float32)
    along = np.empty(len(directions), np.float32)
    _fill_rays(x, y, camera_axes(camera), directions, along)
    origin = np.asarray(camera.position, np.float32)
    return Rays(origin, directions, along, len(x), len(y), float(x[1] - x[0]))


@njit(cache=True, fastmath=True, error_model="numpy")
def _fill_rays(
    x: np.ndarray, y: np.ndarray, axes: np.ndarray, directions: np.ndarray, along: np.ndarray
) -> None:
    columns = x.shape[0]
    shrink = np.empty(columns)
    a0, a1, a2 = axes[0, 0], axes[0, 1], axes[0, 2]
    for row in range(y.shape[0]):
        base = row * columns
        b0 = y[row] * axes[1, 0] + axes[2, 0]
        b1 = y[row] * axes[1, 1] + axes[2, 1]
        b2 = y[row] * axes[1, 2] + axes[2, 2]
        for column in range(columns):
            shrink[column] = 1 / math.sqrt(x[column] ** 2 + y[row] ** 2 + 1)
        for column in range(columns):
            along[base + column] = shrink[column]
        for column in range(columns):
            directions[base + column, 0] = shrink[column] * (x[column] * a0 + b0)
            directions[base + column, 1] = shrink[column] * (x[column] * a1 + b1)
            directions[base + column, 2] = shrink[column] * (x[column] * a2 + b2)


def visible(around: Surroundings, rays: Rays, hits: Hits, settings: RenderSettings) -> Visible:
    """Group the samples of each pixel into spots, and compute their geometry."""
    surfaces, pose = around.geometry.surfaces, around.geometry.pose
    spots = group(hits, rays.directions, surfaces, pose, rays.columns, settings.samples)
    n = len(spots.sample)
    flat, smooth, points = (np.empty((n, 3), np.float32) for _ in range(3))
    view = Visible(rays, hits, spots, flat, smooth, points, np.empty(n, np.int8))
    visibility.look(view, surfaces, pose, shade.material_rows(), around.street.sky.sun_direction)
    return view


def sky_grid(settings: RenderSettings) -> tuple[int, int]:
    """Columns and rows of the pixels with a sky ray."""
    return -(-settings.width // SKY_STEP), -(-settings.height // SKY_STEP)


def sky_segments(view: Visible, around: Surroundings, settings: RenderSettings) -> Segments:
    """A sky ray for every ``SKY_STEP``-th pixel along each axis, see ``spread``."""
    path = around.street.ground.path
    if path.slopes:  # rays onto the street are found as if it were level
        pixels = view.spots.first[:-1].reshape(settings.height, settings.width)
        begin = pixels[::SKY_STEP, ::SKY_STEP].ravel()
        below = road_height(path, view.points[begin])
        view = view._replace(points=view.points.copy())
        view.points[begin, 2] -= below
    width, height = sky_grid(settings)
    starts, directions = (np.empty((height * width, 3), np.float32) for _ in range(2))
    segments = Segments(starts, directions, np.empty(height * width, np.uint8))
    visibility.sky_rays(view, settings.width, SKY_STEP, height, width, segments)
    if path.slopes:
        starts[:, 2] += below
    return segments


def spread(free: np.ndarray, view: Visible, settings: RenderSettings) -> np.ndarray:
    """Share f32[m] of visible sky from ``free`` f32, 1 for each unblocked ray of ``sky_segments``."""
    opened = np.empty(len(view.points), np.float32)
    visibility.spread_open(free, view, settings.height, settings.width, SKY_STEP, opened)
    return opened


def radiance(
    around: Surroundings, view: Visible, light: Light, settings: RenderSettings
) -> np.ndarray:
    """Linear radiance f32[h, w, 3] of every pixel."""
    sky, geometry, hits, spots = around.street.sky, around.geometry, view.hits, view.spots
    brightest = BRIGHTEST if settings.samples > 1 else UNBOUNDED
    places, flat = on_road(
        geometry, around.street.ground.path, hits.instance[spots.sample],
        hits.face[spots.sample], view.points, view.flat,
    )  # fmt: skip
    if settings.occlusion:
        opened = darken(
            light.opened, view.points, hits.instance[spots.sample], geometry.train_id, around.boxes,
            view.rays.origin,
        )  # fmt: skip
        light = light._replace(opened=opened)
    if sky.lamps:
        light = light._replace(glow=np.zeros(len(view.points), np.float32))
        shade.lamplight(view.points, view.smooth, lamps(around), np.float32(sky.lamps), light.glow)
    share = spots.share / np.float32(settings.samples**2)
    image = shade.shade(
        view._replace(spots=spots._replace(share=share), points=places, flat=flat), light,
        np.float32(view.rays.spacing * settings.samples), np.float32(brightest), settings.textures,
        geometry.surfaces, shade.material_rows(), shade.texture_levels(), sky.single,
        sky.ambient, around.panorama,
    )  # fmt: skip
    return image.reshape(settings.height, settings.width, 3)


def lamps(around: Surroundings) -> np.ndarray:
    """Positions f32[n, 3] of the lights of a street: the centres of its lamp heads."""
    geometry, places = around.geometry, [np.zeros((0, 3))]
    for placement in around.street.placements:
        if placement.family != "lamp":
            continue
        shape = geometry.shapes[geometry.shape[placement.instance]]
        head = shape.faces[shape.material == shade.LAMP]
        if len(head):
            ends = shape.vertices[head].reshape(-1, 3)
            middle = (ends.min(axis=0) + ends.max(axis=0)) / 2
            places.append(placement.pose[:3, :3] @ middle[:, None] + placement.pose[:3, 3:])
    return np.concatenate([place.reshape(-1, 3) for place in places]).astype(np.float32)


def expose(
    around: Surroundings,
    shot: int,
    view: Visible,
    light: Light,
    pixel_view: Visible,
    settings: RenderSettings,
) -> Frame:
    """Shade, average and develop the samples, and select label, instance, depth and normal of every pixel.

    Args:
        around: the street, with the seed of the camera's noise.
        shot: index of the camera.
        view: hits and spots of the samples.
        light: light at the spots.
        pixel_view: the same for the pixel centres, with the samples of ``through_middles``.
        settings: size and quality.
    """
    street = around.street
    image = radiance(around, view, light, settings)
    camera = street.cameras[shot]
    usual = camera_of_street(settings.response, stream(street.seed, "camera"))
    response = set_to(usual, camera.exposure, camera.warmth)
    image = develop(image, response, stream(street.seed, "noise", shot))

    rays, hits, samples = pixel_view.rays, pixel_view.hits, through_middles(settings).samples
    pick = np.s_[samples // 2 :: samples, samples // 2 :: samples]

    def pixels(values: np.ndarray) -> np.ndarray:
        return values.reshape(rays.rows, rays.columns, *values.shape[1:])[pick]

    instance = pixels(hits.instance).astype(np.uint16)
    axes = camera_axes(camera).astype(np.float32)
    axes[2] *= -1
    normal = np.empty((*instance.shape, 3), np.float32)
    _turn(pixel_view.smooth, pixel_view.spots.first, instance, axes, normal)
    return Frame(
        image=image,
        label=labelled(around.geometry, instance, pixels(hits.face)),
        instance=instance,
        depth=pixels(hits.distance) * pixels(rays.along),  # a miss has distance 0
        normal=normal,
        camera=camera,
    )


def labelled(geometry: Geometry, instance: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Train ids u8[h, w] of instances and their faces, both [h, w]; VOID for ignored faces."""
    label = geometry.train_id[instance]
    _ignore(geometry.surfaces, instance, face, label)
    return label


@njit(cache=True)
def _ignore(
    surfaces: np.ndarray, instance: np.ndarray, face: np.ndarray, label: np.ndarray
) -> None:
    """Set pixels u8[h, w] of ignored faces to VOID."""
    for row in range(label.shape[0]):
        for column in range(label.shape[1]):
            f, j = face[row, column], instance[row, column]
            if j > 0:
                kind = carray(float_pointer(surfaces[j]), (f + 1, ROW))[f, 15]
                if kind != math.floor(kind):
                    label[row, column] = VOID


@njit(cache=True, fastmath=True)
def _turn(
    world: np.ndarray, first: np.ndarray, instance: np.ndarray, axes: np.ndarray, out: np.ndarray
) -> None:
    """Normals of the first spot of each pixel in the camera's frame; 0 for the sky."""
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            hit = instance[row, column] != 0
            i = first[row * out.shape[1] + column]
            for k in range(3):
                value = np.float32(0)
                for a in range(3):
                    value += axes[k, a] * world[i, a]
                out[row, column, k] = value if hit else 0
