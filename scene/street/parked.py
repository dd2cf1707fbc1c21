"""Parked vehicles: rows along the kerb or half on the sidewalk, slanted and nose-in rows, car parks."""

from __future__ import annotations

import math

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import draw_asset
from scene.assets.slab import BAY
from scene.ground.extent import KERB_WIDTH
from scene.ground.ground import Ground
from scene.street.background import BEHIND
from scene.street.instances import footprint, length
from scene.street.plot import LINE_END, LINE_START, Plot, draw_family, draw_kind

PARKED = {"car": 0.93, "truck": 0.045, "motorcycle": 0.02, "bus": 0.005}
"""Families of vehicles along a kerb."""
AGAINST = 0.12
"""Share of cars along the kerb that face against the traffic."""
FREE = 0.12
"""Share of free places in a row."""
LONGEST = 9.0
"""Largest length of parked vehicles, metres."""
PASSAGE = 2.9
"""Width of carriageway that a row leaves free on its side of the centre line, metres."""
STYLES = {
    "kerb": 0.6,
    "half on": 0.14,
    "slanted": 0.3,
    "nose in": 0.25,
    "bays": 0.3,
    "car park": 0.6,
}
"""Relative frequencies of the styles of rows, if there is room."""


def kept_free(ground: Ground, side: float) -> list[tuple[float, float]]:
    """Stretches of a side where vehicles must not stop: start and end, metres along the road."""
    mouths = [(x - 5.5, x + 5.5) for x, s in ground.side_streets if s == side]
    drives = [(x - 2.2, x + 2.2) for x, s in ground.driveways if s == side]
    return [*mouths, *drives, *((x - 4.5, x + 4.5) for x in ground.crosswalks), *ground.boxes]


def clear(places: list[tuple[float, float]], low: float, high: float) -> bool:
    """Whether none of ``places`` overlaps ``low`` .. ``high``."""
    return all(high < a or low > b for a, b in places)


def parked_row(plot: Plot, side: float, is_open: bool, rng: np.random.Generator) -> bool:
    """Fill one roadside; returns whether the row narrows the lane next to it."""
    half = plot.ground.half_width
    beyond = (BEHIND if is_open else plot.street.params.building_position - 0.8) - half
    fits = {
        "kerb": True,
        "half on": plot.ground.footway > 1.6,
        "slanted": half > PASSAGE + 4.8,
        "nose in": half > PASSAGE + 5.2,
        "bays": beyond > BAY[1] + 1.0,
        "car park": is_open and beyond > plot.ground.footway + 3.2 * BAY[1],
    }
    shares = np.array([STYLES[style] * fits[style] for style in STYLES])
    style = str(rng.choice(list(STYLES), p=shares / shares.sum()))
    also = rng.random() < 0.5
    if style == "car park":
        _car_park(plot, side, rng)
    elif style == "bays":
        _across(plot, side, half + KERB_WIDTH + BAY[1], math.pi / 2, True, rng)
    elif style in ("slanted", "nose in"):
        angle = math.radians(rng.uniform(30, 60)) if style == "slanted" else math.pi / 2
        _across(plot, side, half - 0.25, angle, False, rng)
        return True
    if style in ("kerb", "half on") or (style == "car park" and also):
        _along(plot, side, style == "half on", rng)
        return True
    return False


def _along(plot: Plot, side: float, half_on: bool, rng: np.random.Generator) -> None:
    """Park cars one behind the other, bumper to bumper, with some free places."""
    ground, pool = plot.ground, plot.street.pool
    forward = 0.0 if side == plot.street.drive else math.pi
    closed = kept_free(ground, side)
    x = LINE_START + float(rng.uniform(0, 6))
    while x < LINE_END:
        family = draw_family(PARKED, rng)
        ref = draw_asset(pool, family, rng)
        gap, wobble, drift = rng.uniform(0.6, 2.0), 0.02 * rng.normal(), 0.07 * rng.normal()
        turned, free = rng.random() < AGAINST, rng.random() < FREE
        if free or ref is None or (long := length(family, ref)) > LONGEST:
            x += 5.3
            continue
        if family == "motorcycle":
            x = _huddle(plot, side, x, rng)
            continue
        width = 2 * footprint((family, ref))[3]
        middle = ground.half_width - (0.15 if half_on else 0.2 + width / 2) + float(drift)
        yaw = forward + math.pi * turned + float(wobble)
        stands = clear(closed, x, x + long) and plot.put(
            family, ref, x + long / 2, side * middle, yaw
        )
        x += long + float(gap) if stands else 0.7


def _huddle(plot: Plot, side: float, x: float, rng: np.random.Generator) -> float:
    """Park motorcycles side by side in one place, tails to the kerb; returns the end of the place."""
    for _ in range(int(rng.integers(2, 6))):
        ref = draw_asset(plot.street.pool, "motorcycle", rng)
        yaw = -side * (math.pi / 2 + float(rng.normal(0, 0.12)))
        if clear(kept_free(plot.ground, side), x, x + 1):
            plot.put(
                "motorcycle", ref, x + 0.5, side * (plot.ground.half_width - 1.2), yaw, spare=0.05
            )
        x += 1.0
    return x + 0.8


def _across(
    plot: Plot, side: float, edge: float, angle: float, bays: bool, rng: np.random.Generator
) -> None:
    """Park side by side at ``angle`` to the road, noses or tails at ``edge`` metres from the centre line."""
    pool = plot.street.pool
    start = float(rng.uniform(LINE_START, 25)) if bays else LINE_START
    end = start + float(rng.uniform(25, 80)) if bays else LINE_END
    closed = kept_free(plot.ground, side)
    slab = draw_asset(pool, "slab", rng)
    heading = 1.0 if side == plot.street.drive else -1.0
    pitch = BAY[0] / math.sin(angle)
    for x in np.arange(start, end, pitch).tolist():
        ref = draw_asset(pool, "car", rng)
        is_taken, tail_in, wobble = rng.random() > FREE, rng.random() < 0.25, 0.03 * rng.normal()
        if ref is None or not clear(closed, x - pitch / 2, x + pitch / 2):
            continue
        if bays and not plot.lay(
            "slab", slab, x, side * (edge - BAY[1] / 2), side * math.pi / 2 - math.pi / 2
        ):
            continue
        low, high = catalogue.bounds("car", ref)[:, :2]
        if not is_taken or high[0] - low[0] > BAY[1]:
            continue
        size = (high - low) / 2
        reach = float(size[0] * math.sin(angle) + size[1] * math.cos(angle))
        yaw = math.atan2(side * math.sin(angle), heading * math.cos(angle))
        yaw += math.pi * tail_in + float(wobble)
        plot.put("car", ref, x, side * (edge - reach - 0.1), yaw)


def _car_park(plot: Plot, side: float, rng: np.random.Generator) -> None:
    """Rows of bays on both sides of an aisle, beyond the sidewalk of an open side."""
    pool = plot.street.pool
    near = plot.ground.outer + float(rng.uniform(0.6, 3.0))
    start = float(rng.uniform(-5, 40))
    places = int(rng.integers(8, 26))
    bay = draw_kind(pool, "slab", ("asphalt bay", "ticked bay", "boxed bay"), rng)
    aisle = draw_kind(pool, "slab", ("bare asphalt",), rng)
    full = float(rng.uniform(0.55, 0.95))
    depth = BAY[1]
    rows = [(near + depth / 2, bay, -1.0), (near + 1.5 * depth, aisle, 0.0),
            (near + 2.5 * depth, bay, 1.0)]  # fmt: skip
    for distance, tile, nose in rows:
        # In a bend, lines along the road are longer or shorter than the road.
        pitch = BAY[0] / (1 + distance * plot.street.params.bend / 1000)
        for x in start + pitch * np.arange(math.ceil(places * BAY[0] / pitch)):
            ref = draw_asset(pool, "car", rng)
            is_taken, tail_in, wobble = (
                rng.random() < full,
                rng.random() < 0.25,
                0.03 * rng.normal(),
            )
            has_tile = plot.lay(
                "slab", tile, float(x), side * distance, 0.0 if side * nose > 0 else math.pi
            )
            if has_tile and nose and is_taken and ref is not None:
                yaw = side * nose * math.pi / 2 + math.pi * tail_in + float(wobble)
                plot.put("car", ref, float(x), side * distance, yaw)
