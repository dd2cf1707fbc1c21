"""People: walking and standing in groups, waiting at the kerb, crossing; cyclists in the lane."""

from __future__ import annotations

import math

import numpy as np

from scene.assets import company
from scene.assets.catalogue import draw_asset
from scene.assets.person import STANDING, WALKING
from scene.assets.rider import MOUNT
from scene.street.parked import kept_free
from scene.street.plot import TOUCHING, Plot, draw_kind

START, END = -6.0, 110.0
"""Range of people, metres along the road."""
STRETCH = 13.0
"""Metres of a sidewalk for one group."""
SIZES = (0.28, 0.38, 0.18, 0.1, 0.06)
"""Probabilities of groups of one to five people."""
ON_BICYCLES = tuple(name for name, mount in MOUNT.items() if mount == "bicycle")
DOGS = 0.2
"""Share of single walkers with a dog."""
CROWD = 0.02
"""Least distance in metres of people in a group."""


def groups(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Place people on one sidewalk; each stretch has a group with the probability ``share``."""
    ground = plot.ground
    for stretch in np.arange(START, END, STRETCH).tolist():
        if rng.random() >= share:
            continue
        x = stretch + float(rng.uniform(0, STRETCH))
        near, far = ground.half_width + 0.55, max(ground.outer - 0.35, ground.half_width + 0.6)
        y = side * float(rng.uniform(near, far))
        count = _count(rng)
        if rng.random() < 0.6:
            _walk(plot, x, y, math.pi * (rng.random() < 0.5), count, rng)
        else:
            _stand(plot, x, y, max(count, 2), rng)


def _count(rng: np.random.Generator) -> int:
    return 1 + int(rng.choice(len(SIZES), p=SIZES))


def _walk(plot: Plot, x: float, y: float, yaw: float, count: int, rng: np.random.Generator) -> None:
    """Place people two abreast, one pair behind the other, all in one direction."""
    pitch = float(rng.uniform(0.6, 0.8))
    yaw += float(rng.normal(0, 0.08))
    if rng.random() < DOGS and count == 1:
        ref = draw_kind(plot.street.pool, "company", company.WALKING, rng)
        plot.put("company", ref, x, y, yaw)
        return
    cos, sin = math.cos(yaw), math.sin(yaw)
    for k in range(count):
        back = -(k // 2) * rng.uniform(0.8, 1.2) + 0.15 * rng.normal()
        left = (k % 2 - 0.5 * (count > 1)) * pitch + 0.05 * rng.normal()
        _person(
            plot, x + back * cos - left * sin, y + back * sin + left * cos,
            yaw + 0.08 * rng.normal(), WALKING, rng,
        )  # fmt: skip


def _stand(plot: Plot, x: float, y: float, count: int, rng: np.random.Generator) -> None:
    """Place people in a ring, facing each other."""
    radius = float(rng.uniform(0.38, 0.5)) + 0.09 * count
    first = float(rng.uniform(-math.pi, math.pi))
    for k in range(count):
        around = first + 2 * math.pi * k / count + 0.15 * rng.normal()
        place = x + radius * math.cos(around), y + radius * math.sin(around)
        _person(plot, *place, around + math.pi + 0.25 * rng.normal(), STANDING, rng)


def _person(
    plot: Plot, x: float, y: float, yaw: float, kinds: tuple[str, ...], rng: np.random.Generator
) -> None:
    ref = draw_kind(plot.street.pool, "person", kinds, rng)
    plot.put("person", ref, float(x), float(y), float(yaw), spare=CROWD)


def benches(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Place people on benches that face the road, at the back of one sidewalk or on the green behind it."""
    ground = plot.ground
    for stretch in np.arange(START, END, 2 * STRETCH).tolist():
        if rng.random() >= share:
            continue
        x = stretch + float(rng.uniform(0, STRETCH))
        y = side * (ground.outer + float(rng.uniform(-0.5, 1.5)))
        for _ in range(int(rng.integers(1, 4))):
            ref = draw_kind(plot.street.pool, "company", company.SITTING, rng)
            plot.put("company", ref, x, y, -side * math.pi / 2, spare=TOUCHING)
            x += company.BENCH


def crossing(plot: Plot, share: float, rng: np.random.Generator) -> None:
    """Place people crossing the road, most at crossings, some elsewhere; some wait on both sides."""
    ground = plot.ground
    elsewhere = rng.uniform(6, END, 3).tolist()
    for k, place in enumerate([*ground.crosswalks, *elsewhere]):
        marked = k < len(ground.crosswalks)
        if rng.random() >= share * (1.0 if marked else 0.5):
            continue
        for _ in range(int(rng.integers(2, 8)) if marked else 1):
            x = place + float(rng.uniform(-1.3, 1.3))
            y = float(rng.uniform(-1, 1)) * (ground.half_width - 0.4)
            over = math.copysign(math.pi / 2, rng.random() - 0.5)
            _walk(plot, x, y, over, 1 + int(rng.random() < 0.3), rng)
        for side in (1.0, -1.0):
            for _ in range(int(rng.integers(0, 4)) if marked else 0):
                x = place + float(rng.uniform(-1.8, 1.8))
                y = side * (ground.half_width + float(rng.uniform(0.4, 1.2)))
                yaw = -side * math.pi / 2 + 0.3 * float(rng.normal())
                _person(plot, x, y, yaw, STANDING, rng)


def riders(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Place cyclists along one kerb with the traffic, alone or in groups, and sometimes one that crosses."""
    ground = plot.ground
    forward = 0.0 if side == plot.street.drive else math.pi
    for stretch in np.arange(START + 4, END, 2 * STRETCH).tolist():
        if rng.random() >= share:
            continue
        x = stretch + float(rng.uniform(0, 2 * STRETCH))
        if rng.random() < 0.2:
            turned = math.copysign(math.pi / 2, rng.random() - 0.5)
            y = float(rng.uniform(-1, 1)) * (ground.half_width - 1)
            _rider(plot, x, y, turned + 0.3 * float(rng.normal()), rng)
            continue
        lane = ground.half_width - float(rng.uniform(0.6, 1.3))
        for _ in range(_count(rng)):
            y = side * (lane - abs(0.25 * float(rng.normal())))
            # They pass parked cars.
            for shift in (0.0, -2.0):
                yaw = forward + 0.05 * float(rng.normal())
                if _rider(plot, x, y + side * shift, yaw, rng):
                    break
            x += float(rng.uniform(2.0, 4.5))


def _rider(plot: Plot, x: float, y: float, yaw: float, rng: np.random.Generator) -> bool:
    ref = draw_kind(plot.street.pool, "rider", ON_BICYCLES, rng)
    return plot.put("rider", ref, x, y, yaw, chance=rng.random())


def cycle_stands(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Place rows of bicycles, or motorcycles, side by side on the sidewalk or at the kerb."""
    ground = plot.ground
    for stretch in np.arange(0.0, END, 30.0).tolist():
        if rng.random() >= share:
            continue
        family = "bicycle" if rng.random() < 0.8 else "motorcycle"
        angle = float(rng.choice([math.pi / 2, math.pi / 2, 1.0]))
        inside = ground.footway > 2.2 and rng.random() < 0.7
        y = side * (ground.outer - 0.95 if inside else ground.half_width - 1.1)
        pitch = float(rng.uniform(0.62, 0.85)) * (1.0 if family == "bicycle" else 1.5)
        x = stretch + float(rng.uniform(0, 20))
        closed = kept_free(ground, side)
        for _ in range(int(rng.integers(4, 16))):
            ref = draw_asset(plot.street.pool, family, rng)
            yaw = side * (angle + math.pi * (rng.random() < 0.25)) + 0.06 * rng.normal()
            free = rng.random() < 0.15
            if not free and all(x < a or x > b for a, b in closed):
                plot.put(family, ref, x, y, float(yaw), spare=TOUCHING)
            x += pitch
