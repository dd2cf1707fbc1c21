"""Pages of single assets, surfaces and skies, each in an empty street of its own."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import AssetPool, families_of, kind, own_assets
from scene.assets.families import FAMILIES
from scene.classes import CLASS_NAMES
from scene.ground.ground import Ground, ground_height, plain, sample_ground
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS, sample_coat
from scene.preview.layout import Studio, captioned, grid, stack
from scene.render.sensor import CameraResponse
from scene.sky.sky import Sky, sample_sky
from scene.sky.weather import SKIES
from scene.streams import seeded
from scene.street.camera import Camera, camera_axes
from scene.street.instances import FIRST_INSTANCE, Placement
from scene.street.street import Street

SUN_AZIMUTH = math.radians(-110)
"""From behind the viewer's shoulder."""
SUNS = (38.0, 12.0, 4.0, 70.0)
"""Elevations (degrees) at which skies are searched; some weathers need a low sun."""
TRIES = 400
"""Number of seeds that are searched for a sky."""
RESPONSE = CameraResponse(noise=0.0, variation=0.0)
"""The same camera response for all assets."""
FINE = "clear"
"""The weather in which assets are shown."""
PLACE = 20.0
"""Metres along the road where assets stand."""
EYE = 0.35
"""The least height of the viewer, metres."""
FILL = 0.88
"""Share of the image that an asset fills."""


VIEWPOINTS = {
    "road": Camera((0.0, -2.2, 1.5), 0.0, math.radians(14)),
    "sidewalk": Camera((0.0, 6.5, 1.6), 0.0, math.radians(20)),
    "terrain": Camera((0.0, 10.0, 1.7), math.radians(-55), math.radians(14)),
    "sky": Camera((0.0, 0.0, 1.5), 0.0, math.radians(-16)),
}
"""Cameras that show surfaces."""


def bare(road: int = 0, sidewalk: int = 0, terrain: int = 0) -> Ground:
    """An unpainted ground with the surfaces in these rows of their tables."""
    rng = seeded(0)
    return plain(sample_ground(rng))._replace(
        half_width=5.0,
        footway=3.0,
        road=sample_coat(rng, ROADS[road : road + 1]),
        sidewalk=sample_coat(rng, SIDEWALKS[sidewalk : sidewalk + 1]),
        terrain=sample_coat(rng, TERRAINS[terrain : terrain + 1]),
    )


@cache
def named_sky(name: str) -> Sky:
    """The first sky with the weather ``name``.

    Raises:
        ValueError: unknown name.
    """
    if name not in [row.name for row in SKIES]:
        raise ValueError(f"unknown weather {name!r}")
    for elevation in SUNS:
        for seed in range(TRIES):
            rng = seeded(seed)
            sky = sample_sky(
                rng, intensity=1.0, elevation=math.radians(elevation), azimuth=SUN_AZIMUTH
            )
            if sky.weather == name:
                return sky
    raise ValueError(f"no sky with weather {name!r} was drawn")


def asset_street(family: str, ref: int | str, aspect: float, fov: float) -> Street:
    """An empty street with one asset that fills an image of ``aspect`` (w / h).

    Args:
        family: of the asset.
        ref: index, or name of an own asset.
        aspect: width over height of the image.
        fov: horizontal field of view, degrees.
    """
    row, ground = FAMILIES[family], bare()
    stage = row.stage
    pose = np.eye(4)
    pose[:3, 3] = PLACE, stage.y, ground_height(ground, stage.y)
    parts = [(family, ref)]
    if isinstance(ref, int) and row.mounted_on:
        parts.append((row.base(kind(family, ref)), ref))
    placements = tuple(
        Placement(name, part, catalogue.train_id(name, part), FIRST_INSTANCE + k, pose)
        for k, (name, part) in enumerate(parts)
    )
    framed_parts = parts[:1] if row.front == "back" else parts  # a sign itself, not its post
    boxes = np.stack([catalogue.bounds(*part) for part in framed_parts])
    low, high = boxes[:, 0].min(axis=0) + pose[:3, 3], boxes[:, 1].max(axis=0) + pose[:3, 3]
    camera = fit(low, high, stage.azimuth, stage.elevation, aspect, fov)
    return Street(placements, (camera,), named_sky(FINE), ground, seed=0)


def fit(
    low: np.ndarray, high: np.ndarray, azimuth: float, elevation: float, aspect: float, fov: float
) -> Camera:
    """The nearest camera that shows a whole box, looking at its centre.

    Args:
        low: lowest corner, metres.
        high: highest corner.
        azimuth: where the viewer stands, degrees from +x, left positive.
        elevation: degrees above the box's middle.
        aspect: width over height of the image.
        fov: horizontal field of view, degrees.
    """
    a, e = math.radians(azimuth), math.radians(elevation)
    out = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    middle = (low + high) / 2
    corners = np.array([[(low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)])
    half = math.tan(math.radians(fov) / 2) * FILL
    camera = Camera((0.0, 0.0, 0.0), math.pi - a, e)
    right, up, ahead = ((corners - middle) @ camera_axes(camera).T).T
    reach = np.maximum(np.abs(right) / half, np.abs(up) * aspect / half) - ahead
    x, y, z = middle + float(reach.max()) * out
    z = max(float(z), EYE)
    flat = math.hypot(x - middle[0], y - middle[1])
    return Camera((float(x), float(y), z), math.pi - a, math.atan2(z - middle[2], flat))


def surface_street(name: str, row: int) -> Street:
    """An empty street with the ``row``-th road, sidewalk, terrain or sky in view."""
    below = {
        "road": lambda: bare(road=row),
        "sidewalk": lambda: bare(sidewalk=row),
        "terrain": lambda: bare(terrain=row),
        "sky": bare,
    }[name]()
    above = named_sky(SKIES[row].name if name == "sky" else FINE)
    return Street((), (VIEWPOINTS[name],), above, below, seed=0)


def class_page(name: str, count: int, columns: int, studio: Studio) -> np.ndarray:
    """The first ``count`` assets of a class (or family), surfaces or skies, with kind and index.

    Raises:
        ValueError: no class or family of this name, or none of it in the pool.
    """
    settings = studio.settings._replace(response=RESPONSE)
    studio = studio._replace(settings=settings)
    surfaces = catalogue.surfaces().get(name)
    if surfaces:
        entries = [
            (f"{name}: {text}", surface_street(name, row))
            for row, text in enumerate(surfaces[:count])
        ]
    else:
        aspect = settings.width / settings.height
        entries = [
            (f"{family} {_number(ref)}: {kind(family, ref)}",
             asset_street(family, ref, aspect, settings.fov))
            for family, ref in _refs(name, count, studio.pool)
        ]  # fmt: skip
    if not entries:
        raise ValueError(f"the asset pool has no {name}")
    images = [captioned(studio.shoot(s), text) for text, s in entries]
    return grid(images, columns)


def all_classes(columns: int, studio: Studio) -> np.ndarray:
    """A page with one row per class in the pool."""
    rows = []
    for name in CLASS_NAMES:
        if name in catalogue.surfaces() or _refs(name, 1, studio.pool):
            rows.append(class_page(name, columns, columns, studio))
    return stack(rows)


def _refs(name: str, count: int, pool: AssetPool) -> list[tuple[str, int | str]]:
    """The first assets of a class, the user's own first, evenly from its families that have any."""
    present: dict[str, list[int | str]] = {}
    for family in families_of(name):
        refs: list[int | str] = list(own_assets(pool, family))
        if pool.use != "own":
            refs += range(pool.first, pool.first + count)
        if refs:
            present[family] = refs
    assets: list[tuple[str, int | str]] = []
    for k, (family, refs) in enumerate(present.items()):
        share = (count + len(present) - 1 - k) // len(present)
        assets += [(family, ref) for ref in refs[:share]]
    return assets


def _number(ref: int | str) -> str:
    return str(ref) if isinstance(ref, int) else "(own)"
