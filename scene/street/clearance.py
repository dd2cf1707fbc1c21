"""Keep objects apart: rectangles on the ground, and whether another one fits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.compiled import njit


class Rectangle(NamedTuple):
    """The footprint of one object in world metres; a row of the arrays below."""

    x: float  # centre
    y: float
    cos: float  # direction of its x axis
    sin: float
    long: float  # half its sides along its x and its y axis
    wide: float


class Rectangles:
    """A growing set of rectangles."""

    def __init__(self) -> None:
        """Make an empty set."""
        self._count = 0
        self._rows = np.zeros((128, 6))

    def add(self, box: Rectangle) -> None:
        """Add one rectangle."""
        self._room(1)
        self._rows[self._count] = box
        self._count += 1

    def extend(self, rows: np.ndarray) -> None:
        """Add f64[n, 6]."""
        self._room(len(rows))
        self._rows[self._count : self._count + len(rows)] = rows
        self._count += len(rows)

    def meet(self, box: Rectangle, spare: float) -> bool:
        """Whether a rectangle is nearer than ``spare`` metres to ``box``."""
        return _meet(self._rows, self._count, *box, spare)

    def admit(self, tries: np.ndarray, spare: float) -> np.ndarray:
        """Add, for each candidate in turn, its first try with room.

        Args:
            tries: f64[candidates, tries, 6].
            spare: least distance in metres of a candidate from all earlier rectangles.

        Returns:
            The index of the added try of each candidate, i64[candidates]; -1 for none.
        """
        self._room(len(tries))
        added, self._count = _admit(self._rows, self._count, tries, spare)
        return added

    def _room(self, more: int) -> None:
        if self._count + more > len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros((len(self._rows) + more, 6))])


@njit(cache=True)
def _apart(one: np.ndarray, other: np.ndarray, spare: float) -> bool:
    """Whether two rectangles f64[6] are ``spare`` metres apart along one of their four axes."""
    x, y = other[0] - one[0], other[1] - one[1]
    cos = abs(other[2] * one[2] + other[3] * one[3])
    sin = abs(other[2] * one[3] - other[3] * one[2])
    return (
        abs(x * one[2] + y * one[3]) >= one[4] + other[4] * cos + other[5] * sin + spare
        or abs(y * one[2] - x * one[3]) >= one[5] + other[4] * sin + other[5] * cos + spare
        or abs(x * other[2] + y * other[3]) >= other[4] + one[4] * cos + one[5] * sin + spare
        or abs(y * other[2] - x * other[3]) >= other[5] + one[4] * sin + one[5] * cos + spare
    )


@njit(cache=True)
def _first_met(rows: np.ndarray, count: int, box: np.ndarray, spare: float) -> int:
    """The first of ``count`` rectangles f64[n, 6] nearer than ``spare`` to another one; -1 for none."""
    reach = box[4] + box[5] + 2 * max(spare, 0.0)
    for k in range(count):
        far = rows[k, 4] + rows[k, 5] + reach
        if abs(rows[k, 0] - box[0]) > far or abs(rows[k, 1] - box[1]) > far:
            continue
        if not _apart(box, rows[k], spare):
            return k
    return -1


@njit(cache=True)
def _meet(
    rows: np.ndarray,
    count: int,
    x: float,
    y: float,
    cos: float,
    sin: float,
    long: float,
    wide: float,
    spare: float,
) -> bool:
    return _first_met(rows, count, np.array([x, y, cos, sin, long, wide]), spare) >= 0


@njit(cache=True)
def _admit(rows: np.ndarray, count: int, tries: np.ndarray, spare: float) -> tuple[np.ndarray, int]:
    added = np.full(len(tries), -1)
    for k in range(len(tries)):
        for t in range(tries.shape[1]):
            if _first_met(rows, count, tries[k, t], spare) < 0:
                rows[count] = tries[k, t]
                count += 1
                added[k] = t
                break
    return added, count


@njit(cache=True)
def pairs(rows: np.ndarray, deep: float) -> np.ndarray:
    """Pairs i64[pairs, 2] of rectangles f64[n, 6] that overlap by more than ``deep`` metres on every axis."""
    overlaps = [(0, 0)]
    for k in range(1, len(rows)):
        for j in range(k):
            far = rows[k, 4] + rows[k, 5] + rows[j, 4] + rows[j, 5]
            if abs(rows[k, 0] - rows[j, 0]) > far or abs(rows[k, 1] - rows[j, 1]) > far:
                continue
            if not _apart(rows[k], rows[j], -deep):
                overlaps.append((j, k))
    return np.array(overlaps)[1:]


@njit(cache=True)
def touched(path: np.ndarray, rows: np.ndarray, spare: float) -> np.ndarray:
    """First and last index i64[n, 2] of places f64[m, 2] within ``spare`` of rectangles f64[n, 6], or -1."""
    ends = np.full((len(rows), 2), -1)
    for k in range(len(rows)):
        reach = rows[k, 4] + rows[k, 5] + spare
        for m in range(len(path)):
            x, y = path[m, 0] - rows[k, 0], path[m, 1] - rows[k, 1]
            if abs(x) > reach or abs(y) > reach:
                continue
            u = abs(x * rows[k, 2] + y * rows[k, 3])
            v = abs(y * rows[k, 2] - x * rows[k, 3])
            if u < rows[k, 4] + spare and v < rows[k, 5] + spare:
                ends[k, 0] = m if ends[k, 0] < 0 else ends[k, 0]
                ends[k, 1] = m
    return ends
