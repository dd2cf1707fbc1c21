"""The arrays that the stages of a shot exchange: rays, hits, spots, and light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Rays(NamedTuple):
    """One ray per sample, row by row from the top left."""

    origin: np.ndarray  # f32[3]
    directions: np.ndarray  # f32[n, 3] unit
    along: np.ndarray  # f32[n] distance -> depth along the optical axis
    columns: int
    rows: int
    spacing: float  # between neighbours, radians at the image's centre


class Hits(NamedTuple):
    """Where the ray of each sample ends."""

    face: np.ndarray  # i32[n] of the instance's shape, shade.MISS for the sky
    instance: np.ndarray  # i32[n], 0 for the sky
    distance: np.ndarray  # f32[n] metres along the ray; 0 for the sky
    u: np.ndarray  # f32[n] weight of the face's second corner; undefined for the sky
    v: np.ndarray  # f32[n] weight of the third


class Spots(NamedTuple):
    """Groups of samples that are shaded as one; the first of a pixel has the sample nearest to its centre."""

    first: np.ndarray  # i32[pixels + 1]: spots first[p] to first[p + 1] are those of pixel p
    sample: np.ndarray  # i32[m] the sample that represents it
    share: np.ndarray  # f32[m] number of its samples
    directions: np.ndarray  # f32[m, 3] unit, from the camera to their mean
    distance: np.ndarray  # f32[m] metres; 0 for the sky
    owner: np.ndarray  # i32[n] each sample's spot


class Visible(NamedTuple):
    """What the rays of a shot hit, and the geometry of each spot."""

    rays: Rays  # one per sample
    hits: Hits  # of the samples
    spots: Spots
    flat: np.ndarray  # f32[m, 3] normal of the face, turned towards the viewer; up for the sky
    smooth: np.ndarray  # f32[m, 3] the same for the curved surface that the face approximates
    points: np.ndarray  # f32[m, 3] position; the rays' origin for the sky
    side: np.ndarray  # i8[m] face side where a sun ray starts: 1 viewer's, -1 other, 0 no ray


class Segments(NamedTuple):
    """Rays for which only occlusion matters."""

    starts: np.ndarray  # f32[n, 3]
    directions: np.ndarray  # f32[n, 3]
    needed: np.ndarray  # u8[n], 0: not needed


class Light(NamedTuple):
    """The light that reaches each spot."""

    lit: np.ndarray  # f32[m], 1 in the sun, 0 in shadow
    opened: np.ndarray  # f32[m], share of the sky that is visible
    glow: np.ndarray = np.zeros(0, np.float32)  # f32[m] lamplight, see `shade`; empty by day
