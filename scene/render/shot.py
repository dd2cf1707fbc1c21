"""One shot, from sample rays to a developed frame: what all renderers do alike.

A renderer finds which face each sample sees, how far away, and what light reaches it there; the rest is
here, so that two renderers differ in visibility only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from scene.geometry import SKY_INSTANCE, Geometry
from scene.render import shade
from scene.render.protocol import Frame, RenderSettings, camera_axes, label_sample, pixel_rays
from scene.sensor import develop
from scene.sky import sky_arrays
from scene.street import Camera, Street


class Rays(NamedTuple):
    """One ray per sample, row by row from the top left."""

    origin: np.ndarray  # f32[3]
    directions: np.ndarray  # f32[n, 3] unit
    along: np.ndarray  # f32[n] distance -> depth along the optical axis
    columns: int
    rows: int
    spacing: float  # between neighbours, radians at the image's centre


class Visible(NamedTuple):
    """What each sample sees."""

    faces: np.ndarray  # i32[n], shade.MISS for the sky
    distance: np.ndarray  # f32[n] metres along the ray; anything for the sky
    normals: np.ndarray  # f32[n, 3] of the face, turned towards the viewer; up for the sky
    points: np.ndarray  # f32[n, 3] where the ray meets the face; its origin for the sky


def sample_rays(camera: Camera, settings: RenderSettings) -> Rays:
    """The rays of a shot: ``samples`` x ``samples`` evenly over every pixel."""
    x, y = pixel_rays(settings, settings.samples)
    directions = np.empty((len(y) * len(x), 3), np.float32)
    along = np.empty(len(directions), np.float32)
    _fill_rays(x, y, camera_axes(camera), directions, along)
    origin = np.asarray(camera.position, np.float32)
    return Rays(origin, directions, along, len(x), len(y), float(x[1] - x[0]))


@njit(cache=True)
def _fill_rays(
    x: np.ndarray, y: np.ndarray, axes: np.ndarray, directions: np.ndarray, along: np.ndarray
) -> None:
    for row in range(y.shape[0]):
        for column in range(x.shape[0]):
            i = row * x.shape[0] + column
            shrink = 1 / math.sqrt(x[column] ** 2 + y[row] ** 2 + 1)
            along[i] = shrink
            for k in range(3):
                directions[i, k] = shrink * (
                    x[column] * axes[0, k] + y[row] * axes[1, k] + axes[2, k]
                )


def visible(rays: Rays, geometry: Geometry, faces: np.ndarray, distance: np.ndarray) -> Visible:
    """Complete ``faces`` i32[n] and ``distance`` f32[n] with normals and points."""
    normals = np.zeros_like(rays.directions)
    normals[:, 2] = 1.0
    shade.facing_normals(faces, rays.directions, geometry.normal, normals)
    reach = np.where(faces != shade.MISS, distance, 0)[:, None]
    return Visible(faces, distance, normals, rays.origin + reach * rays.directions)


def sunward(seen: Visible, geometry: Geometry, sun_direction: np.ndarray) -> np.ndarray:
    """Normals f32[n, 3] on the side from which the sun is looked for.

    That is the viewer's side, but the sun's own for leaves, which it shines through.
    """
    leafy = (shade.material_rows()[:, 2] > 0)[geometry.material[seen.faces]]
    behind = leafy & (seen.faces != shade.MISS) & (seen.normals @ sun_direction < 0)
    return np.where(behind[:, None], -seen.normals, seen.normals)


def expose(
    street: Street,
    shot: int,
    geometry: Geometry,
    rays: Rays,
    seen: Visible,
    lit: np.ndarray,
    opened: np.ndarray,
    settings: RenderSettings,
) -> Frame:
    """Shade, average and develop the samples, and pick label, instance and depth of every pixel.

    Args:
        street: gives the light, and with ``shot`` the seed of the sensor's noise.
        shot: which of the street's cameras.
        geometry: the street's faces.
        rays: the samples.
        seen: what they see.
        lit: f32[n], 1 where the sun is seen, 0 in shadow.
        opened: f32[n], share of the sky that is seen.
        settings: size and quality.
    """
    sky = street.sky
    radiance = shade.shade(
        seen.faces, seen.distance, rays.directions, rays.origin, seen.normals, lit, opened,
        np.float32(rays.spacing), settings.textures,
        geometry.color, geometry.material, geometry.instance,
        shade.material_rows(), shade.texture_levels(),
        sky.ambient, np.float32(sky.haze), sky_arrays(sky),
    )  # fmt: skip
    image = radiance.reshape(rays.rows, rays.columns, 3)
    if settings.samples > 1:
        # Tones are compressed before averaging, so that bright sky does not eat thin poles.
        image = cv2.resize(
            np.minimum(image, 2.0), (settings.width, settings.height), interpolation=cv2.INTER_AREA
        )
    rng = np.random.default_rng([street.seed, shot])

    k = label_sample(settings.samples)
    pick = np.s_[k :: settings.samples, k :: settings.samples]
    found = seen.faces.reshape(rays.rows, rays.columns)[pick]
    instance = np.where(found == shade.MISS, SKY_INSTANCE, geometry.instance[found])
    depth = np.where(seen.faces != shade.MISS, seen.distance * rays.along, 0)
    return Frame(
        develop(image, settings.response, rng),
        geometry.train_id[instance],
        instance.astype(np.uint16),
        depth.reshape(rays.rows, rays.columns)[pick].astype(np.float32),
    )
