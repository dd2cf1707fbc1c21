"""The course of a road: curvature and slope along it, and conversion from road to world coordinates.

Road coordinates are x metres along the centre line and y metres left of it. At x = 0 the road is at the
world's origin and height and runs along the world's x axis; on a straight road both coordinates agree.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.compiled import njit

Array = np.ndarray
Knots = tuple[tuple[float, float], ...]
"""Metres along the road, and the value there; linear between knots, constant beyond the ends."""

FROM, TO, STEP = -80.0, 700.0, 0.5
"""Range and step of the integration of the centre line, metres along the road."""
EASE = 10.0
"""Metres over which the curvature of a bend grows and falls."""
LEAST_TURN, MOST_TURN = math.radians(20), math.radians(90)
"""Range of the angle of a bend."""
FIRST, LAST = -30.0, 95.0
"""Range of the start of a bend, metres along the road."""
LEVEL_FROM, KNOT = 260.0, 45.0
"""Where slopes end, and the distance between their knots, metres along the road."""
CREST = 0.0013
"""Largest change of the slope per metre: crests and dips have a radius of 770 m."""
CALM, LEVEL = 34.0, 20.0
"""Metres to both sides of a junction in which the road is straight, and level."""


class Path(NamedTuple):
    """The course of a road; without knots it is straight and level."""

    bends: Knots = ()  # curvature, 1/m, left positive
    slopes: Knots = ()  # rise over run

    @property
    def straight(self) -> bool:
        """Whether road and world coordinates agree."""
        return not self.bends and not self.slopes


STRAIGHT = Path()


class Course(NamedTuple):
    """An integrated path in steps, f64[n] each."""

    x: Array  # metres along the road
    east: Array  # the centre line in the world, metres
    north: Array
    heading: Array  # radians, left positive
    height: Array  # metres


@lru_cache(maxsize=64)
def course(path: Path) -> Course:
    """Integrate a path from the origin in both directions."""
    x = np.arange(FROM, TO + STEP / 2, STEP)
    origin = int(np.argmin(np.abs(x)))
    curvature, slope = _values(path.bends, x), _values(path.slopes, x)
    heading = _summed((curvature[1:] + curvature[:-1]) / 2, origin)
    # Second order: the heading at the middle of a step differs from the mean of its ends.
    middle = (heading[1:] + heading[:-1]) / 2 - STEP / 8 * np.diff(curvature)
    return Course(
        x,
        _summed(np.cos(middle), origin),
        _summed(np.sin(middle), origin),
        heading,
        _summed((slope[1:] + slope[:-1]) / 2, origin),
    )


def _values(knots: Knots, x: Array) -> Array:
    if not knots:
        return np.zeros_like(x)
    at, value = np.array(knots).T
    return np.interp(x, at, value)


def _summed(rate: Array, origin: int) -> Array:
    """The integral of a rate over each step, 0 at the origin."""
    total = np.concatenate([[0.0], np.cumsum(rate) * STEP])
    return total - total[origin]


def heading_at(path: Path, x: float | Array) -> Array:
    """Direction of the road, radians left of the world's x axis."""
    return np.interp(x, course(path).x, course(path).heading)


def height_at(path: Path, x: float | Array) -> Array:
    """Height of the carriageway, metres."""
    return np.interp(x, course(path).x, course(path).height)


def slope_at(path: Path, x: float | Array) -> Array:
    """Rise over run of the road."""
    return _values(path.slopes, np.asarray(x, float))


def road_axes(path: Path, x: float) -> Array:
    """Rows: the directions ahead, left and up of a car on the road in the world, f64[3, 3]."""
    heading, rise = float(heading_at(path, x)), math.atan(float(slope_at(path, x)))
    ahead = math.cos(rise) * math.cos(heading), math.cos(rise) * math.sin(heading), math.sin(rise)
    left = -math.sin(heading), math.cos(heading), 0.0
    return np.stack([ahead, left, np.cross(ahead, left)])


def to_world(path: Path, x: float | Array, y: float | Array) -> Array:
    """World points f64[..., 2] of road coordinates, which broadcast together."""
    line = course(path)
    heading = np.interp(x, line.x, line.heading)
    east = np.interp(x, line.x, line.east) - y * np.sin(heading)
    north = np.interp(x, line.x, line.north) + y * np.cos(heading)
    return np.stack([east, north], axis=-1)


class Place(NamedTuple):
    """One place of a road in the world."""

    east: float  # metres
    north: float
    heading: float  # of the road, radians left of the world's x axis
    height: float  # of the carriageway, metres


def place_at(path: Path, x: float, y: float = 0.0) -> Place:
    """Equals ``to_world``, ``heading_at`` and ``height_at`` for one place to the bit, but is faster."""
    table = _table(path)
    k = min(max(int((x - FROM) / STEP), 0), len(table) - 2)
    east, north, heading, height = table[k] if x < TO else table[k + 1]
    if FROM < x < TO:
        on = x - (FROM + k * STEP)
        next_east, next_north, next_heading, next_height = table[k + 1]
        east += (next_east - east) / STEP * on
        north += (next_north - north) / STEP * on
        heading += (next_heading - heading) / STEP * on
        height += (next_height - height) / STEP * on
    if y:
        east, north = east - y * float(np.sin(heading)), north + y * float(np.cos(heading))
    return Place(east, north, heading, height)


@lru_cache(maxsize=64)
def _table(path: Path) -> list[list[float]]:
    """East, north, heading and height of each step."""
    return np.stack(course(path)[1:], axis=1).tolist()


@njit(cache=True)
def on_line(line: Course, x: float) -> Place:
    """``place_at`` for a place on the centre line, for compiled code."""
    on = min(max((x - FROM) / STEP, 0.0), len(line.x) - 1.0)
    k = min(int(on), len(line.x) - 2)
    on -= k
    return Place(
        line.east[k] + on * (line.east[k + 1] - line.east[k]),
        line.north[k] + on * (line.north[k + 1] - line.north[k]),
        line.heading[k] + on * (line.heading[k + 1] - line.heading[k]),
        line.height[k] + on * (line.height[k + 1] - line.height[k]),
    )


def nearest(
    path: Path, points: Array, first: float = FROM, last: float = TO
) -> tuple[Array, Array]:
    """The place on the centre line nearest to world points f64[n, 2]: x f64[n], and its distance f64[n].

    Only the road from ``first`` to ``last`` is searched.
    """
    line = course(path)
    part = np.flatnonzero((line.x >= first) & (line.x <= last))
    points = np.ascontiguousarray(points, np.float64)
    return _nearest(points, line, _values(path.bends, line.x), int(part[0]), int(part[-1]))


@njit(cache=True)
def _nearest(
    points: Array, line: Course, bend: Array, first: int, last: int
) -> tuple[Array, Array]:
    """See ``nearest``; searches steps ``first`` to ``last``, and ``bend`` is the curvature."""
    places, far = np.empty(len(points)), np.empty(len(points))
    for n in range(len(points)):
        least, best = np.inf, first
        for k in range(first, last + 1, 4):
            x, y = points[n, 0] - line.east[k], points[n, 1] - line.north[k]
            away = x * x + y * y
            if away < least:
                least, best = away, k
        # From the nearest step along the road to the foot of the perpendicular.
        x, y = points[n, 0] - line.east[best], points[n, 1] - line.north[best]
        c, s = math.cos(line.heading[best]), math.sin(line.heading[best])
        # On the inner side of a bend the same step along the road is shorter.
        on = (x * c + y * s) / max(1 - bend[best] * (y * c - x * s), 0.1)
        places[n] = line.x[best] + min(max(on, -2 * STEP), 2 * STEP)
        foot = on_line(line, places[n])
        far[n] = math.sqrt((points[n, 0] - foot.east) ** 2 + (points[n, 1] - foot.north) ** 2)
    return places, far


def folded(path: Path, x: Array, y: Array) -> Array:
    """Whether places (x, y) f64[n] are beyond the centre of a bend, so that other road is nearer."""
    _, away = nearest(path, to_world(path, x, y))
    return away < np.abs(y) - 1.0


def sample_path(
    rng: np.random.Generator, bend: float, gradient: float, calm: float | None = None
) -> Path:
    """Draw a course: a bend, perhaps a second one in the other direction, and slopes.

    Args:
        rng: consumed.
        bend: the sharpest curvature, 1/m.
        gradient: the steepest slope, rise over run.
        calm: place of a junction, which needs a straight and level road, metres along it.
    """
    draws = rng.uniform(size=16)
    bends = _bends(draws[:8], bend, calm) if bend > 0 else ()
    slopes = _slopes(draws[8:], gradient, calm) if gradient > 0 else ()
    return Path(bends, slopes)


def _bends(draws: Array, sharpest: float, calm: float | None) -> Knots:
    """Curvature of a bend and, by chance, of another one in the other direction."""
    sign = 1.0 if draws[0] < 0.5 else -1.0
    curvature = sharpest * (0.15 + 0.85 * float(draws[1]))
    turn = LEAST_TURN + (MOST_TURN - LEAST_TURN) * float(draws[2])
    begin = FIRST + (LAST - FIRST) * float(draws[3])
    arcs = [(begin, sign * curvature, turn)]
    if draws[4] < 0.4:
        back = curvature * (0.4 + 0.6 * float(draws[5]))
        begin += turn / curvature + EASE + 40 * float(draws[6])
        arcs.append((begin, -sign * back, turn * (0.4 + 0.6 * float(draws[7]))))
    knots: list[tuple[float, float]] = []
    late = 0.0
    for start, value, angle in arcs:
        # The length for this angle, with half the curvature on average over each ease.
        end = start + late + angle / abs(value) + EASE
        start += late
        if calm is not None and start < calm + CALM and end > calm - CALM:
            if calm - CALM - start > 3 * EASE:
                end = calm - CALM
            else:
                late += calm + CALM - start
                start, end = calm + CALM, end + calm + CALM - start
        knots += [(start, 0.0), (start + EASE, value), (end - EASE, value), (end, 0.0)]
    return tuple(knots)


def _slopes(draws: Array, steepest: float, calm: float | None) -> Knots:
    """One constant slope, or one that changes."""
    at = np.arange(-60.0, LEVEL_FROM - 20, KNOT)
    value = steepest * (2 * draws[1 : 1 + len(at)] - 1)
    if draws[0] < 0.5:
        value = np.sign(value[0]) * (0.5 * np.abs(value) + 0.5 * np.abs(value[0]))
    knots: list[tuple[float, float]] = []
    before = float(value[0])
    for x, slope in zip(at.tolist(), value.tolist(), strict=True):
        before = min(max(slope, before - CREST * KNOT), before + CREST * KNOT)
        most = before
        if calm is not None:
            room = CREST * max(abs(x - calm) - LEVEL, 0.0)
            most = min(max(before, -room), room)
        knots.append((x, most))
    if calm is not None:
        knots += [(calm - LEVEL, 0.0), (calm + LEVEL, 0.0)]
    return (*sorted(knots), (LEVEL_FROM, 0.0))
