"""What is kept for reports: colours, shares of classes, what nets saw."""

import numpy as np
import pytest

from experiments.app.report import pictures
from experiments.evaluation.predictions import MOST, file_of, load, picked, predictions_of, save
from seg.classes import CAMVID_11, CITYSCAPES_19, IGNORE_LABEL, colorize


def test_colours_are_the_tables():
    labels = np.array([[0, 1], [10, IGNORE_LABEL]], np.uint8)
    expected = [[(128, 64, 128), (244, 35, 232)], [(70, 130, 180), (0, 0, 0)]]
    np.testing.assert_array_equal(colorize(labels, CITYSCAPES_19.colors), expected)
    np.testing.assert_array_equal(colorize(labels, CAMVID_11.colors)[0, 0], (128, 128, 128))


def test_shares_and_mean_rows_by_hand():
    contents = pictures.shares(np.array([[[0, 0], [0, 1]], [[255, 255], [1, 1]]], np.uint8), 3)
    assert contents["pixels"] == [50, 50, 0]
    # Of two rows of pixels the middles lie at 25 and 75 %.
    assert contents["row"] == [pytest.approx(100 * (0.25 + 0.25 + 0.75) / 3, abs=0.01), 75, None]


def test_what_a_net_saw_is_left_whole_or_not_at_all(tmp_path):
    path = file_of(tmp_path, "0123456789abcdef, and more")
    assert load(path) is None
    predictions = np.array([[[0, 0]], [[1, 1]]], np.uint8)
    by_image = np.array([[[1, 0], [1, 0]], np.zeros((2, 2))], np.int64)  # the second is all void
    save(path, predictions_of(by_image))
    contents = load(path)
    assert contents.predictions is None
    np.testing.assert_array_equal(contents.confusion, by_image[0])
    save(path, predictions_of(by_image, predictions))
    contents = load(path)
    np.testing.assert_array_equal(contents.by_image, by_image)
    np.testing.assert_array_equal(contents.miou, [0.25, np.nan])  # IoU 1/2 and 0; all void
    np.testing.assert_array_equal(contents.predictions, predictions)
    path.write_bytes(path.read_bytes()[:-9])
    assert load(path) is None
    assert picked(5).tolist() == [0, 1, 2, 3, 4]
    many = picked(3 * MOST)
    assert len(many) == MOST and many[0] == 0 and many[-1] == 3 * MOST - 1


@pytest.mark.parametrize(("miou", "places"), [
    ([0.2, 0.9, 0.5, 0.4, 0.3], [1, 2, 3, 4, 0]),
    ([0.2, np.nan, 0.9], [2, 0]),
    ([0.4], [0]),
    ([np.nan, np.nan], []),
    (np.linspace(1, 0, 11), [0, 2, 4, 6, 8, 10]),
])  # fmt: skip
def test_images_are_shown_from_the_best_to_the_worst(miou, places):
    assert pictures.best_to_worst(np.array(miou, np.float32)) == places
