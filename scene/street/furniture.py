"""Street furniture: islands, bollards, shelters, stalls, scaffolds, gardens, and a user's own objects."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from scene.assets import catalogue
from scene.assets.bollard import BEACONS, POSTS
from scene.assets.catalogue import draw_asset
from scene.assets.own_class import FAMILY, OwnClass
from scene.assets.person import STANDING
from scene.assets.shelter import SHELTERS, STALLS
from scene.ground.extent import KERB_WIDTH
from scene.names import OWN_EVERY
from scene.street.instances import footprint
from scene.street.open_side import HEDGES, LOW_WALLS
from scene.street.parked import clear, kept_free
from scene.street.plot import LINE_END, LINE_START, TOUCHING, Plot, draw_kind
from scene.street.rows import facing_road, run

END = 120.0
"""End of street furniture in metres along the road."""
ISLANDS = ("slab island", "setts island", "narrow island", "block island")
GARDEN_FENCES = ("pickets", "spear railings", "boards", "bow top", "rails", "trellis", "wires")
KERB_RAILINGS = ("pedestrian guard", "bow top", "cross rails", "guard rail", "bollard and chain")
BACK_FENCES = ("spear railings", "palisade", "chain link", "heras", "boards", "barrier boards",
               "pedestrian guard")  # fmt: skip
BOUNDARIES = (("bush", HEDGES, 0.4), ("wall", LOW_WALLS, 0.3), ("fence", GARDEN_FENCES, 0.3))
"""Enclosures of a front garden: family, kinds, probability."""
PLANTS, OVERHANG = ("flowers", "box balls", "grass", "hedge", "round"), 0.3
"""Plants on verges, and metres by which they may be wider than the verge."""
TRIES = 24
"""Number of places to try for each object of a user's own class."""


def islands(plot: Plot, share: float, rng: np.random.Generator) -> None:
    """Traffic islands in the middle of the road with a beacon at each end, at crossings and elsewhere."""
    ground = plot.ground
    places = [x + s * 5.0 for x in ground.crosswalks for s in (-1, 1)]
    for x in [*places, *rng.uniform(8, END, 2).tolist()]:
        island = draw_kind(plot.street.pool, "paving", ISLANDS, rng)
        beacon = draw_kind(plot.street.pool, "bollard", BEACONS, rng)
        is_present, both = rng.random() < share, rng.random() < 0.6
        if not is_present or ground.half_width < 4.3 or not clear([*ground.boxes], x - 3, x + 3):
            continue
        if not plot.put("paving", island, x, 0.0, 0.0) or beacon is None:
            continue
        # Beacons stand on the island.
        reach = float(catalogue.bounds("paving", island or 0)[1, 0]) - 0.55
        for end in (-1, 1) if both else (-1,):
            plot.place("bollard", beacon, x + end * reach, 0.0, 0.0, lift=0.13)


def railings(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Long railings along the kerb, or fences along the back of the sidewalk."""
    ground = plot.ground
    for stretch in np.arange(LINE_START, LINE_END, 40.0).tolist():
        at_kerb, is_present = rng.random() < 0.5, rng.random() < share
        kinds = KERB_RAILINGS if at_kerb else BACK_FENCES
        ref = draw_kind(plot.street.pool, "fence", kinds, rng)
        start, length = stretch + float(rng.uniform(0, 15)), float(rng.uniform(12, 45))
        y = ground.half_width + 0.35 if at_kerb else ground.outer + 0.1
        if is_present:
            run(plot, "fence", ref, side * y, (start, start + length), kept_free(ground, side))


def bollards(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Rows of posts along the kerb."""
    ground = plot.ground
    for stretch in np.arange(LINE_START, END, 30.0).tolist():
        ref = draw_kind(plot.street.pool, "bollard", POSTS, rng)
        is_present, pitch = rng.random() < share, float(rng.uniform(1.3, 2.6))
        start, length = stretch + float(rng.uniform(0, 12)), float(rng.uniform(6, 28))
        for x in np.arange(start, start + length, pitch).tolist() if is_present else ():
            if clear(kept_free(ground, side), x, x):
                plot.put("bollard", ref, x, side * (ground.half_width + 0.4), 0.0, spare=0.05)


def shelters(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Bus shelters at the back of the sidewalk, with waiting people."""
    ground, pool = plot.ground, plot.street.pool
    for stretch in (2.0, 60.0):
        ref = draw_kind(pool, "shelter", SHELTERS, rng)
        is_present, waiting = rng.random() < share, int(rng.integers(0, 6))
        x = stretch + float(rng.uniform(0, 50))
        if not is_present or ref is None:
            continue
        (left, _, _), (right, deep, _) = catalogue.bounds("shelter", ref)
        y = max(ground.outer - float(deep) - 0.05, ground.half_width + 0.9)
        if not clear(kept_free(ground, side), x + float(left), x + float(right)):
            continue
        if plot.put("shelter", ref, x, side * y, facing_road(side), spare=0.0):
            for _ in range(waiting):
                person = draw_kind(pool, "person", STANDING, rng)
                place = (
                    x + float(rng.uniform(left, right)),
                    side * (y - float(rng.uniform(0.3, 0.6))),
                )
                yaw = -side * math.pi / 2 + 0.5 * float(rng.normal())
                plot.put("person", person, *place, yaw, spare=0.02)


def stalls(plot: Plot, side: float, share: float, is_open: bool, rng: np.random.Generator) -> None:
    """A row of market stalls or kiosks, on the sidewalk or behind it."""
    ground, pool = plot.ground, plot.street.pool
    is_present, x, count = rng.random() < share, float(rng.uniform(0, 70)), int(rng.integers(1, 9))
    room = (30.0 if is_open else plot.street.params.building_position - 0.8) - ground.outer
    y = ground.outer + 0.3 if room > 2.6 else max(ground.outer - 2.1, ground.half_width + 0.7)
    for _ in range(count if is_present else 0):
        ref = draw_kind(pool, "shelter", STALLS, rng)
        gap, customers = float(rng.uniform(0.3, 1.2)), int(rng.integers(0, 4))
        if ref is None:
            return
        (left, front, _), (right, _, _) = catalogue.bounds("shelter", ref)
        x -= float(left)
        clear_here = clear(kept_free(ground, side), x + float(left), x + float(right))
        if clear_here and plot.put("shelter", ref, x, side * y, facing_road(side), spare=0.0):
            for _ in range(customers):
                person = draw_kind(pool, "person", STANDING, rng)
                place = x + float(rng.uniform(left, right)), side * (y + float(front) - 0.35)
                plot.put(
                    "person",
                    person,
                    *place,
                    side * math.pi / 2 + 0.4 * float(rng.normal()),
                    spare=0.0,
                )
        x += float(right) + gap


def scaffolds(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Scaffolding in front of houses of the building line."""
    distance = plot.street.params.building_position
    for stretch in np.arange(0.0, END, 30.0).tolist():
        ref = draw_asset(plot.street.pool, "scaffold", rng)
        is_present, places = rng.random() < share, stretch + rng.uniform(0, 30, 6)
        if not is_present or ref is None:
            continue
        front = distance - float(catalogue.bounds("scaffold", ref)[1, 1])
        for x, away in product(places.tolist(), (0.1, 0.5, 0.9)):  # steps and sills protrude
            if all(plot.built(x + d, side * (distance + 3.0)) for d in (-3.0, 3.0)) and plot.put(
                "scaffold", ref, x, side * (front - away), facing_road(side), spare=TOUCHING
            ):
                break


def gardens(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Front gardens between sidewalk and houses: hedges, low walls or fences with gates, and bushes."""
    ground, pool = plot.ground, plot.street.pool
    edge, back = ground.outer + 0.25, plot.street.params.building_position - 0.7
    x, closed = LINE_START, kept_free(ground, side)
    while x < LINE_END:
        width, start = float(rng.uniform(7, 16)), x
        x += width
        if rng.random() >= share or back - edge < 0.9:
            continue
        choice = rng.choice(len(BOUNDARIES), p=[row[2] for row in BOUNDARIES])
        family, kinds, _ = BOUNDARIES[int(choice)]
        ref = draw_kind(pool, family, kinds, rng)
        gate = start + float(rng.uniform(0, width - 1.5))
        run(plot, family, ref, side * (edge + 0.3 * (family == "bush")), (start, x),
            [*closed, (gate, gate + 1.0)])  # fmt: skip
        for _ in range(int(rng.integers(0, 1 + int(0.8 * width)))):
            bush = draw_asset(pool, "bush", rng)
            y = float(rng.uniform(min(edge + 0.8, back), back))
            turn = float(rng.uniform(-math.pi, math.pi))
            plot.put(
                "bush", bush, start + float(rng.uniform(0, width)), side * y, turn, spare=TOUCHING
            )


def plantings(plot: Plot, side: float, share: float, rng: np.random.Generator) -> None:
    """Beds of flowers, shrubs and low hedges on a green verge, each with one kind of plant."""
    ground, end = plot.ground, LINE_START
    low, high = ground.side(side).verge
    while high > low and end < END:
        start, end = end, end + float(rng.uniform(5, 25))
        ref = draw_kind(plot.street.pool, "bush", PLANTS, rng)
        is_present, loose, across = rng.random() < share, float(rng.uniform(0.9, 1.5)), rng.random()
        if not is_present or ref is None:
            continue
        _, _, long, wide = footprint(("bush", ref))
        room = high - low - 2 * wide
        y = low + wide + max(room, 0.0) * across + min(room, 0.0) / 2
        for x in np.arange(start + long, end - long, 2 * long * loose).tolist():
            if room > -OVERHANG and clear(kept_free(ground, side), x - long, x + long):
                yaw = math.pi * int(rng.integers(2))
                plot.put("bush", ref, x, side * y, yaw, spare=TOUCHING)


def own_class(plot: Plot, user_class: OwnClass, rng: np.random.Generator) -> None:
    """Objects of a user's own class, one per ``OWN_EVERY`` metres if one of ``TRIES`` places has room.

    On the sidewalk they face any direction, on the carriageway the direction of traffic; they stay within it.
    """
    ground, half = plot.ground, plot.ground.half_width
    _, _, long, wide = footprint((FAMILY, user_class.file))
    for stretch in np.arange(LINE_START, LINE_END, OWN_EVERY).tolist():
        for along, across, turn, left in rng.random((TRIES, 4)).tolist():
            x, side = stretch + OWN_EVERY * along, 1.0 if left < 0.5 else -1.0
            yaw = math.pi * (2 * turn - 1)
            if user_class.place == "carriageway":
                yaw = 0.05 * yaw + (0.0 if side == plot.street.drive else math.pi)
            c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
            reach, end = s * long + c * wide, c * long + s * wide
            low, high = half + KERB_WIDTH + reach, ground.outer - reach
            if user_class.place == "carriageway":  # objects wider than a lane may cross the middle
                low, high = min(reach, half - reach), half - reach
            fits = low <= high and high >= 0 and clear(kept_free(ground, side), x - end, x + end)
            y = side * (low + across * (high - low))
            if fits and plot.put(FAMILY, user_class.file, x, y, yaw):
                break
