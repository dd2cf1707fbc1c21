"""How the cost of an image grows with triangles, with pixels, and with the shots of a street."""

from __future__ import annotations

import time
from unittest import mock

import numpy as np

from benchmarks.report import Row
from scene.assets.catalogue import AssetPool
from scene.dataset.render import street_of
from scene.proposal import default_proposal, draw
from scene.render import RenderSettings, renderer
from scene.render.geometry import Shape, asset_shape

FACTORS = (1, 4, 16)


def divided(shape: Shape, factor: int) -> Shape:
    """The same surface of ``factor`` (1, 4, 16, ...) times as many triangles."""
    if factor == 1:
        return shape
    a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
    p, q, r = (a + b) / 2, (b + c) / 2, (c + a) / 2
    corners = np.stack([a, p, r, p, b, q, r, q, c, p, q, r], axis=1).reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    surface = np.repeat(shape.surface, 4, axis=0)
    return divided(Shape.of(np.ascontiguousarray(corners), faces, surface), factor // 4)


def growth(rounds: int, settings: RenderSettings | None = None) -> list[Row]:
    """One row for each factor of each kind: processor time per image, and times that of factor 1."""
    settings = settings or RenderSettings(320, 160)
    rows: list[Row] = []
    for kind in ("triangles", "pixels", "shots"):
        base = None
        for factor in FACTORS:
            side = round(factor**0.5) if kind == "pixels" else 1
            sized = settings._replace(width=side * settings.width, height=side * settings.height)
            shots = factor if kind == "shots" else 1
            ms = _cost(sized, shots, factor if kind == "triangles" else 1, rounds)
            base = base or ms
            rows.append({"kind": kind, "factor": factor, "ms": ms, "times": ms / base})
    return rows


def _cost(settings: RenderSettings, shots: int, triangles: int, rounds: int) -> float:
    """Milliseconds of processor time per image, the least of some rounds."""
    engine = renderer("embree")
    street = street_of(draw(default_proposal(), 0, 1)[0], 0, 0, shots, AssetPool())
    fine: dict[tuple, Shape] = {}

    def shape(family: str, asset: int | str, far: bool = False) -> Shape:
        key = family, asset, far
        if key not in fine:
            fine[key] = divided(asset_shape(*key), triangles)
        return fine[key]

    from scene.render.embree.renderer import _asset_bvh

    spent = []
    with (
        mock.patch("scene.render.geometry.asset_shape", shape),
        mock.patch("scene.render.embree.renderer.asset_shape", shape),
    ):
        _asset_bvh.cache_clear()
        for _ in range(rounds + 1):
            started = time.process_time()
            engine.render(street, settings)
            spent.append(1000 * (time.process_time() - started) / shots)
    _asset_bvh.cache_clear()
    return min(spent[1:])
