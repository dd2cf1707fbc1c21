"""The arrays that pass between the stages of a shot: rays, what they hit, spots, and their light."""

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
    """Where each sample's ray ends."""

    face: np.ndarray  # i32[n] of the instance's shape, shade.MISS for the sky
    instance: np.ndarray  # i32[n], 0 for the sky
    distance: np.ndarray  # f32[n] metres along the ray; anything for the sky
    u: np.ndarray  # f32[n] share of the face's second corner; anything for the sky
    v: np.ndarray  # f32[n] share of its third


class Spots(NamedTuple):
    """Which samples are shaded as one; a pixel's first spot has the sample in or next to its middle."""

    first: np.ndarray  # i32[pixels + 1]: spots first[p] to first[p + 1] are those of pixel p
    sample: np.ndarray  # i32[m] the sample by which it is seen
    share: np.ndarray  # f32[m] how many samples it stands for
    directions: np.ndarray  # f32[m, 3] unit, from the camera to the middle of them
    distance: np.ndarray  # f32[m] metres; anything for the sky
    owner: np.ndarray  # i32[n] each sample's spot


class Visible(NamedTuple):
    """What the rays of a shot see, and what each spot is."""

    rays: Rays  # one per sample
    hits: Hits  # of the samples
    spots: Spots
    flat: np.ndarray  # f32[m, 3] normal of the face, turned towards the viewer; up for the sky
    smooth: np.ndarray  # f32[m, 3] the same for the curved surface the face stands for
    points: np.ndarray  # f32[m, 3] where it is; the rays' origin for the sky
    side: (
        np.ndarray
    )  # i8[m] of the face, on which a ray to the sun begins: 1 ours, -1 the other, 0 no ray


class Segments(NamedTuple):
    """Rays of which only matters whether anything is in their way."""

    starts: np.ndarray  # f32[n, 3]
    directions: np.ndarray  # f32[n, 3]
    wanted: np.ndarray  # u8[n], 0: the answer is not needed


class Light(NamedTuple):
    """What light reaches each spot."""

    lit: np.ndarray  # f32[m], 1 where the sun is seen, 0 in shadow
    opened: np.ndarray  # f32[m], share of the sky that is seen
    glow: np.ndarray = np.zeros(
        0, np.float32
    )  # f32[m] from lamps, see `shade.lamplight`; empty by day
