"""Boundary IoU, by hand and by its properties."""

import numpy as np
from hypothesis import given

from seg.boundary import boundary_counts, boundary_iou, perimeters
from seg.metrics import confusion_matrix, iou

from .conftest import SEEDS


def square(top: int, left: int, side: int = 5) -> np.ndarray:
    labels = np.zeros((12, 12), np.uint8)
    labels[top : top + side, left : left + side] = 1
    return labels


def test_strips_of_two_squares_by_hand():
    # The diagonal is 17: strips are one pixel wide. That of the square is its ring of 16 pixels; moved by
    # a row, the rings share two columns of 3 or 4 pixels less the corners of one, and nothing else.
    counts = boundary_counts(square(3, 3), square(4, 3), 2)
    shared = 2 * 4  # left and right columns of rows 4 to 7
    assert counts[:, 1].tolist() == [shared, 16 + 16 - shared]
    # The background's strip: the border of the image (44) and the pixels around the square, which touch it
    # by a corner at most: 7 x 7 - 25 = 24.
    assert boundary_counts(square(3, 3), square(3, 3), 2).tolist() == [[68, 16], [68, 16]]


def test_sides_of_a_square_and_of_a_comb():
    whole = square(3, 3, side=4)
    comb = whole.copy()
    comb[3:7, [4, 6]] = 255  # two of four columns are ignored
    sides, areas = perimeters(np.stack([whole]), 2)
    assert sides.tolist() == [16, 16] and areas.tolist() == [144 - 16, 16]
    sides, areas = perimeters(np.stack([comb, whole]), 2)
    assert sides.tolist() == [16 + 16, 2 * 10 + 16] and areas.tolist()[1] == 8 + 16


def test_wide_strips_are_the_classes_themselves(monkeypatch):
    monkeypatch.setattr("seg.boundary.SHARE", 1.0)
    rng = np.random.default_rng(0)
    labels, predictions = rng.integers(0, 3, (2, 12, 16)).astype(np.uint8)
    counts, confusion = (
        boundary_counts(labels, predictions, 3),
        confusion_matrix(labels, predictions, 3),
    )
    np.testing.assert_allclose(boundary_iou(counts, confusion), iou(confusion))


def test_void_belongs_to_no_class():
    labels, predictions = square(3, 3), square(3, 3)
    labels[:, 5:] = 255
    predictions[:, 5:] = 2
    counts = boundary_counts(labels, predictions, 3)
    assert counts[0].tolist() == counts[1].tolist() and counts[:, 2].tolist() == [0, 0]
    assert np.isnan(boundary_iou(counts, confusion_matrix(labels, predictions, 3))[2])


@given(SEEDS)
def test_right_predictions_have_1_and_classes_can_change_their_names(seed):
    labels, predictions = np.random.default_rng(seed).integers(0, 3, (2, 9, 11)).astype(np.uint8)
    intersection, union = boundary_counts(labels, labels, 3)
    np.testing.assert_array_equal(intersection, union)
    swapped = np.array([2, 0, 1], np.uint8)
    np.testing.assert_array_equal(
        boundary_counts(swapped[labels], swapped[predictions], 3)[:, swapped],
        boundary_counts(labels, predictions, 3),
    )
