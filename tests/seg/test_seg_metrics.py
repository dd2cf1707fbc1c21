"""Confusion matrix, IoU, and the rule for absent classes."""

import numpy as np
import pytest
from hypothesis import given

from seg.metrics import absent_classes, confusion_matrix, iou, mean_iou

from .conftest import SEEDS, refuses

CLASSES = 4


def test_by_hand_absent_classes_are_left_out_even_when_predicted():
    labels = np.array([[0, 0, 0, 1], [1, 2, 255, 255]], np.uint8)
    guesses = np.array([[0, 0, 1, 1], [0, 1, 2, 0]], np.uint8)
    confusion = confusion_matrix(labels, guesses, 3)
    np.testing.assert_array_equal(confusion, [[2, 1, 0], [1, 1, 0], [0, 1, 0]])
    assert confusion.dtype == np.int64
    np.testing.assert_allclose(iou(confusion), [2 / 4, 1 / 4, 0])
    assert mean_iou(confusion) == pytest.approx(0.25)
    confusion = confusion_matrix(np.array([0, 0, 1]), np.array([0, 2, 1]), CLASSES)
    np.testing.assert_allclose(iou(confusion), [0.5, 1, np.nan, np.nan])
    assert mean_iou(confusion) == pytest.approx(0.75)
    assert absent_classes(confusion, ("a", "b", "c", "d")) == ("c", "d")
    never_predicted = confusion_matrix(np.array([0, 1]), np.array([0, 0]), 2)
    assert mean_iou(never_predicted) == pytest.approx((0.5 + 0) / 2)


@given(SEEDS)
def test_cells_count_pixels_whatever_the_classes_are_called(seed):
    rng = np.random.default_rng(seed)
    labels, guesses = rng.integers(0, CLASSES, (2, 3, 5, 6), dtype=np.uint8)
    labels[rng.random(labels.shape) < 0.2] = 255
    order = rng.permutation(CLASSES).astype(np.uint8)
    renamed = np.where(labels == 255, 255, order[labels % CLASSES]).astype(np.uint8)
    confusion = confusion_matrix(labels, guesses, CLASSES)
    after = confusion_matrix(renamed, order[guesses], CLASSES)
    np.testing.assert_array_equal(after[np.ix_(order, order)], confusion)
    assert mean_iou(after) == pytest.approx(mean_iou(confusion))
    for (row, column), cell in np.ndenumerate(confusion):
        assert cell == ((labels == row) & (guesses == column)).sum()


@pytest.mark.parametrize(("labels", "guesses", "message"), [
    ([0, 4], [0, 0], r"labels must be in 0\.\.3 .*found 0\.\.4"),
    ([0, 1], [0, 255], r"predictions must be in 0\.\.3"),
    ([0, -1], [0, 0], r"labels must be in 0\.\.3"),
])  # fmt: skip
def test_ids_outside_the_classes_and_shapes_that_disagree(labels, guesses, message):
    refuses(message, confusion_matrix, np.array(labels), np.array(guesses), CLASSES)
    with pytest.raises((TypeError, ValueError)):  # TypeError: from the shape check of the tests
        confusion_matrix(np.zeros((2, 2), int), np.zeros((2, 3), int), CLASSES)


def test_the_mean_over_some_classes_or_over_none():
    confusion = np.array([[4, 0, 0], [2, 2, 0], [0, 1, 0]])
    first, second, third = iou(confusion)
    assert mean_iou(confusion, (0, 1)) == pytest.approx((first + second) / 2)
    assert mean_iou(confusion, (2,)) == third == 0
    nothing = confusion_matrix(np.full((2, 2), 255, np.uint8), np.zeros((2, 2), np.uint8), 3)
    assert not nothing.any()
    refuses("has no labelled pixel", mean_iou, nothing)
    refuses("no labelled pixel of the classes 0", mean_iou, np.array([[0, 0], [0, 3]]), (0,))
