import math
from collections import Counter

import numpy as np
import pytest

from scene.render.contact import REACH, boxes, darken, standing_boxes
from scene.render.geometry import build
from scene.render.visibility import DARKEST
from tests.scene.conftest import street

ROAD, CAR = 0, 13
"""Train ids."""


def share_below(places, box):
    """Share of visible sky at points f64[n, 2] of the ground around one box at the origin."""
    points = np.column_stack([places, np.zeros(len(places))]).astype(np.float32)
    row = np.array([[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *box]], np.float32)
    ones, ids = np.ones(len(points), np.float32), np.array([10, ROAD, CAR], np.uint8)
    shares = darken(ones, points, np.ones(len(points), int), ids, row, np.zeros(3, np.float32))
    return (shares - DARKEST) / (1 - DARKEST)


def test_below_a_long_plate_the_sky_is_what_two_strips_leave():
    long, half, under = 500.0, 0.9, 0.25
    for v in (0.0, 0.5, 0.8):
        left, right = half - v, half + v
        hidden = (left / math.hypot(left, under) + right / math.hypot(right, under)) / 2
        (shares,) = share_below(np.array([[0.0, v]]), (long, half, under, 1.5))
        assert shares == pytest.approx(1 - hidden, abs=1e-4)


def test_it_grows_lighter_outwards_and_ends():
    away = np.linspace(0, 1 + REACH, 40)
    shares = share_below(np.column_stack([away, 0 * away]), (1.0, 0.4, 0.2, 1.5))
    assert (np.diff(shares) > -1e-6).all() and shares[0] < 0.2 and shares[-1] == pytest.approx(1)


def test_only_the_ground_near_the_foot_is_darkened():
    row = np.array([[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 1, 0.2, 1.5]], np.float32)
    points = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 2]], np.float32)
    ids, instance = np.array([10, ROAD, CAR], np.uint8), np.array([1, 2, 1])
    shares = darken(np.ones(3, np.float32), points, instance, ids, row, np.zeros(3, np.float32))
    assert shares[0] < 0.2 and (shares[1:] == 1).all()


@pytest.mark.parametrize("family, feet, under", [("car", 4, 1), ("lamp", 1, 0), ("building", 0, 0)])
def test_assets_touch_the_ground_where_they_should(family, feet, under):
    """The most frequent numbers of ten assets."""
    asset_boxes = [boxes((family, k, "")) for k in range(10)]
    numbers = Counter(((rows[:, 4] == 0).sum(), (rows[:, 4] > 0).sum()) for rows in asset_boxes)
    assert numbers.most_common(1)[0][0] == (feet, under)


def test_boxes_stand_where_their_instances_do():
    geometry = build(street())
    rows = standing_boxes(geometry)
    world = np.stack([np.vstack([r[:12].reshape(3, 4), [0, 0, 0, 1]]) for r in rows.astype(float)])
    middles = np.linalg.inv(world)[:, :2, 3]
    feet = geometry.pose[4:, :2, 3]
    nearest = np.linalg.norm(middles[:, None] - feet, axis=2).min(axis=1)
    assert len(rows) > 50 and np.quantile(nearest, 0.9) < 3
