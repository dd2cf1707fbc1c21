"""Rectangles on the ground: whether there is room between them."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scene.street.room import Rectangle, Rectangles, footprint

places, turns, halves = st.floats(-6, 6), st.floats(-math.pi, math.pi), st.floats(0.1, 3)
rectangles = st.builds(
    lambda x, y, turn, long, wide: Rectangle(x, y, math.cos(turn), math.sin(turn), long, wide),
    places, places, turns, halves, halves,
)  # fmt: skip


def points_of(box: Rectangle) -> np.ndarray:
    """Places f64[n, 2] all over a rectangle."""
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
    pose = np.array([[0.0, -1, 0, 7], [1, 0, 0, 8], [0, 0, 1, 0], [0, 0, 0, 1]])
    tree, car = footprint([("tree", 0)], pose), footprint([("car", 0)], pose)
    assert max(tree.long, tree.wide) <= 0.3 and np.hypot(tree.x - 7, tree.y - 8) < 0.1
    assert car.long > 1.5 > car.wide > 0.6 and (car.cos, car.sin) == (0.0, 1.0)
