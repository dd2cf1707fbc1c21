"""Fence panels centred on y = 0: posts, rails, and an infill that one can see through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, box, merge, quad, shade, triangles, tube, vary

KINDS: tuple[str, ...] = (
    "railings", "pickets", "chain link", "guard rail", "boards", "pedestrian guard", "rails",
)  # fmt: skip


class FenceParams(NamedTuple):
    """A panel: posts at even spacing, horizontal rails, and one sort of infill."""

    length: float  # along x, m
    height: float  # m
    posts: int
    post_width: float  # m
    rails: tuple[float, ...]  # height of each rail, as a share of ``height``
    rail_size: float  # height of a rail's section, m
    infill: str  # "none", "bars", "pickets", "boards", "mesh" or "beam"
    pitch: float  # spacing of the infill's pieces, m
    gauge: float  # width of the infill's pieces, m
    color: Color
    material: str
    seed: int  # unevenness of boards and pickets


def sample_fence(rng: np.random.Generator, kind: str) -> FenceParams:
    """Draw a panel of one of ``KINDS``."""
    paints = ((0.02, 0.02, 0.022), (0.02, 0.06, 0.035), (0.05, 0.06, 0.08))
    iron = vary(rng, paints[rng.integers(len(paints))], 0.3)
    steel = vary(rng, (0.30, 0.31, 0.32), 0.25)
    woods = ((0.20, 0.12, 0.06), (0.14, 0.10, 0.07), (0.26, 0.19, 0.12))
    wood = vary(rng, woods[rng.integers(len(woods))], 0.25)
    railings = FenceParams(
        length=float(rng.uniform(3.2, 3.8)), height=float(rng.uniform(1.1, 1.8)), posts=2,
        post_width=0.07, rails=(0.1, 0.9), rail_size=0.04, infill="bars",
        pitch=float(rng.uniform(0.15, 0.19)), gauge=0.028, color=iron, material="paint",
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    timber = railings._replace(
        posts=3, post_width=0.1, rail_size=0.08, color=wood, material="wood", rails=(0.25, 0.75)
    )
    match kind:
        case "railings":
            return railings
        case "pickets":
            white = vary(rng, (0.6, 0.6, 0.57))
            return timber._replace(
                height=float(rng.uniform(0.9, 1.3)), infill="pickets", gauge=0.09,
                color=white if rng.random() < 0.5 else wood, material="paint",
            )  # fmt: skip
        case "chain link":
            return railings._replace(
                height=float(rng.uniform(1.6, 2.3)), posts=2, rails=(0.97,), infill="mesh",
                pitch=0.3, gauge=0.02, color=vary(rng, (0.2, 0.24, 0.21), 0.3), material="metal",
            )  # fmt: skip
        case "guard rail":
            return railings._replace(
                height=float(rng.uniform(0.7, 0.85)), rails=(), infill="beam", gauge=0.31,
                posts=3, post_width=0.12, color=steel, material="metal",
            )  # fmt: skip
        case "boards":
            return timber._replace(
                height=float(rng.uniform(1.5, 2.0)), infill="boards", gauge=0.16, pitch=0.185
            )
        case "pedestrian guard":
            return railings._replace(
                height=float(rng.uniform(1.0, 1.15)), rails=(0.14, 0.78, 0.97), rail_size=0.05,
                pitch=float(rng.uniform(0.17, 0.2)), gauge=0.025, color=steel, material="metal",
            )  # fmt: skip
        case "rails":
            return timber._replace(
                height=float(rng.uniform(1.0, 1.4)), infill="none", rails=(0.3, 0.6, 0.9),
                rail_size=0.12,
            )  # fmt: skip
    raise ValueError(f"unknown kind of fence {kind!r}; known: {', '.join(KINDS)}")


def _stations(params: FenceParams) -> np.ndarray:
    """Where along x the pieces of infill stand, evenly between the ends."""
    count = max(2, round(params.length / params.pitch))
    return (np.arange(count) + 0.5) / count * params.length - params.length / 2


def _bars(params: FenceParams) -> list[Asset]:
    """Upright bars between the lowest and the highest rail; iron spikes over a single top rail."""
    low, high = params.rails[0] * params.height, params.rails[-1] * params.height
    top = params.height if len(params.rails) == 2 else high
    return [
        tube((x, 0, low), (x, 0, top), params.gauge / 2, params.color, params.material,
             sides=3, caps=False)
        for x in _stations(params)
    ]  # fmt: skip


def _planks(params: FenceParams, point: float, y: float) -> list[Asset]:
    """Upright planks with tops raised by ``point`` in the middle; every plank its own tone."""
    rng = np.random.default_rng(params.seed)
    half, foot = params.gauge / 2, 0.05
    planks = []
    for x in _stations(params):
        top = params.height - point - abs(rng.normal(0, 0.015))
        corners = [(x - half, y, foot), (x + half, y, foot), (x + half, y, top), (x - half, y, top)]
        tip = [[(x - half, y, top), (x + half, y, top), (x, y, top + point)]]
        plank = merge(
            quad(corners, params.color, params.material),
            *((triangles(np.array(tip), params.color, params.material),) if point else ()),
        )
        planks.append(shade(plank, np.full(len(plank.color), rng.uniform(0.75, 1.2))))
    return planks


def _mesh(params: FenceParams) -> list[Asset]:
    """Wires both ways across the panel at 45 degrees, cut off at its edges, as thin ribbons."""
    height = params.height * params.rails[-1]
    half, gauge = params.length / 2, np.array([0, 0, params.gauge])
    wires = []
    for start in np.arange(-half - height + params.pitch, half, params.pitch):
        low_x, high_x = max(start, -half), min(start + height, half)
        a, b = np.array([low_x, 0, low_x - start]), np.array([high_x, 0, high_x - start])
        for mirror in ([1, 1, 1], [-1, 1, 1]):
            wires += [[a * mirror, b * mirror, b * mirror + gauge]]
            wires += [[a * mirror, b * mirror + gauge, a * mirror + gauge]]
    return [triangles(np.array(wires), params.color, params.material)]


def _beam(params: FenceParams) -> list[Asset]:
    """A corrugated steel band in front of the posts."""
    level = params.height - params.gauge * np.array([1, 0.82, 0.6, 0.5, 0.4, 0.18, 0])
    y = -params.post_width / 2 - np.array([0.01, 0.08, 0.08, 0.02, 0.08, 0.08, 0.01])
    half = params.length / 2
    return [
        quad([(-half, y[i], level[i]), (half, y[i], level[i]),
              (half, y[i + 1], level[i + 1]), (-half, y[i + 1], level[i + 1])],
             params.color, params.material)
        for i in range(len(level) - 1)
    ]  # fmt: skip


def fence(params: FenceParams) -> Asset:
    """Build the panel."""
    p = params
    reach = (p.length - p.post_width) / 2
    posts = [
        box((p.post_width, p.post_width, p.height), (x, 0, 0), p.color, p.material)
        for x in np.linspace(-reach, reach, p.posts)
    ]
    thin = min(0.04, p.post_width / 2)
    rails = [
        box((p.length, thin, p.rail_size), (0, 0, share * p.height - p.rail_size / 2), p.color,
            p.material)
        for share in p.rails
    ]  # fmt: skip
    infill: list[Asset] = []
    match p.infill:
        case "bars":
            infill = _bars(p)
        case "pickets":
            infill = _planks(p, 0.07, -thin)
        case "boards":
            infill = _planks(p, 0.0, -thin)
        case "mesh":
            infill = _mesh(p)
        case "beam":
            infill = _beam(p)
    return merge(*posts, *rails, *infill)
