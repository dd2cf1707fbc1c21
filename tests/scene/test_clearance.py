"""Rectangles on the ground, and streets without overlaps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import AssetPool, default_unit, sample_street, street_params
from scene.attributes import SPACES
from scene.street.clearance import Rectangle, Rectangles, pairs
from scene.street.instances import footprint, standing

places, turns, halves = st.floats(-6, 6), st.floats(-math.pi, math.pi), st.floats(0.1, 3)
rectangles = st.builds(
    lambda x, y, turn, long, wide: Rectangle(x, y, math.cos(turn), math.sin(turn), long, wide),
    places, places, turns, halves, halves,
)  # fmt: skip


def points_of(box: Rectangle) -> np.ndarray:
    """Points f64[n, 2] all over a rectangle."""
    u, v = (half * np.linspace(-1, 1, 13) for half in (box.long, box.wide))
    u, v = (part.ravel() for part in np.meshgrid(u, v))
    return np.stack([box.x + u * box.cos - v * box.sin, box.y + u * box.sin + v * box.cos], axis=1)


def inside(box: Rectangle, points: np.ndarray) -> np.ndarray:
    away = points - (box.x, box.y)
    along, side = away @ (box.cos, box.sin), away @ (-box.sin, box.cos)
    return (np.abs(along) < box.long) & (np.abs(side) < box.wide)


@given(st.lists(rectangles, min_size=1, max_size=5), rectangles)
def test_what_overlaps_meets_and_what_meets_with_room_to_spare_is_near(others, box):
    standing = Rectangles()
    for other in others:
        standing.add(other)
    if any(inside(other, points_of(box)).any() for other in others):
        assert standing.meet(box, 0.0)
    apart = min(
        np.linalg.norm(points_of(box)[:, None] - points_of(other), axis=2).min() for other in others
    )
    if apart > 2 * 1.1:  # farther than the corner of the spare and the points' own distance
        assert not standing.meet(box, 1.0)


def test_spare_is_the_distance_between_sides_by_hand():
    standing = Rectangles()
    for k in range(200):  # more than there is room for at first
        standing.add(Rectangle(10.0 * k, 0.0, 1.0, 0.0, 2.0, 1.0))
    turned = Rectangle(1990.0, 3.0, 0.0, 1.0, 1.5, 1.0)  # half a metre above the last
    assert not standing.meet(turned, 0.49) and standing.meet(turned, 0.51)
    inside_out = Rectangle(1990.0, 0.9, 1.0, 0.0, 0.01, 0.01)  # a decimetre inside the last
    assert standing.meet(inside_out, -0.05) and not standing.meet(inside_out, -0.2)


def test_a_tree_takes_its_stem_and_a_car_all_of_it():
    (x, y, *tree), (_, _, *car) = footprint(("tree", 0)), footprint(("car", 0))
    assert max(tree) <= 0.3 and np.hypot(x, y) < 0.1
    assert car[0] > 1.5 > car[1] > 0.6


def test_candidates_take_their_first_try_with_room_and_make_it_hard_for_the_next():
    def row(x):
        return Rectangle(x, 0.0, 1.0, 0.0, 1.0, 1.0)

    standing = Rectangles()
    standing.add(row(0.0))
    tries = np.array([[row(x) for x in xs] for xs in ((1.0, 3.0), (4.0, 0.5), (5.5, 9.0))])
    assert standing.admit(tries, 0.25).tolist() == [1, -1, 0]
    assert standing.meet(row(7.0), 0.0) and not standing.meet(row(8.0), 0.0)


@given(st.lists(rectangles, min_size=2, max_size=8))
def test_pairs_are_those_that_meet(boxes):
    overlapping = {tuple(pair) for pair in pairs(np.array(boxes), 0.05).tolist()}
    for k, box in enumerate(boxes):
        for j in range(k):
            one = Rectangles()
            one.add(boxes[j])
            assert one.meet(box, -0.05) == ((j, k) in overlapping)


def meeting(unit, seed, overlap):
    sampled = sample_street(street_params(unit), seed, 1, AssetPool(overlap=overlap))
    first, rows = standing(sampled.placements)
    return len(first), len(pairs(rows, 0.05))


@pytest.mark.parametrize("space", SPACES)
def test_nothing_stands_in_anything_unless_it_may(space):
    rng = np.random.default_rng(0)
    units = [default_unit(space), *rng.random((9, len(SPACES[space])), np.float32)]
    apart, overlaps = np.array([meeting(unit, k, "avoid") for k, unit in enumerate(units)]).T
    assert (overlaps == 0).all() and apart.min() > 80
    allowed, overlaps = np.array([meeting(unit, k, "allow") for k, unit in enumerate(units)]).T
    assert (overlaps > 0).mean() > 0.7 and (allowed >= apart * 0.8).all()
    by_space = np.array([meeting(unit, k, "")[1] for k, unit in enumerate(units)])
    assert (by_space == (overlaps if space == "scenex" else 0)).all()
