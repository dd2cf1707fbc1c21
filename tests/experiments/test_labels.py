"""The curve over labelled images: what each net sees, and how many labels renders are worth, by hand."""

import math
from functools import partial

import numpy as np
import pytest

from experiments.config.jobs import defaults_of
from experiments.evaluation.job import rendered_of
from experiments.studies.labels import FORM, counts_of
from experiments.tables.stats import equivalent_labels, reached
from experiments.targets.base import Target
from scene.proposal import Mixture, describe, streets_named
from seg.data import LabelledImages
from seg.mixing import TrainingSet

from .conftest import Counted, never

defaults = partial(defaults_of, "labels")


@pytest.mark.parametrize(("value", "labels"), [
    (30.0, 14), (25.0, 7 * math.sqrt(2)), (32.5, 14 * math.sqrt(2)), (10.0, 7), (99.0, 28),
])  # fmt: skip
def test_where_a_curve_reaches_a_value(value, labels):
    assert reached((7, 14, 28), (20.0, 30.0, 35.0), value) == pytest.approx(labels)
    assert reached((7, 14, 28), (20.0, 18.0, 22.0), 21.0) == pytest.approx(14 * 2**0.75)  # at last


def report(alone, mixed):
    """Scores of two seeds each: by number of labels, alone and plus renders."""
    rows = [
        {"labels": n, "renders": name, "nets": [{"miou": v + d, "class_iou": []} for d in (-1, 1)]}
        for name, by_count in (("none", alone), ("default", mixed))
        for n, v in by_count.items()
    ]
    about = {"note": "some", "scored_at": "8x8", "test_images": 1, "seeds": 2, "reward_images": 28}
    about |= {"net": "lite0", "few_share": 0.5, "rendered_images": 6, "learnt_from": None}
    return FORM.derive({**about, "target": "camvid", "real": True, "rows": rows})


def test_labels_that_renders_are_worth_by_hand():
    derived = report({7: 20, 14: 30, 28: 35}, {0: 25, 14: 34, 28: 36})
    alone, mixed = derived["worth"]
    assert alone["labels"] == pytest.approx(7 * math.sqrt(2)) and alone["bound"] == ""
    assert mixed["labels"] == pytest.approx(14 * 2**0.8) and mixed["beside"] == 14
    assert alone["ci95"] == pytest.approx([alone["labels"]] * 2)  # seeds differ alike in all rows
    by_place = {(row["labels"], row["renders"]): row for row in derived["rows"]}
    assert by_place[14, "default"]["renders_add"]["mean"] == pytest.approx(4)
    assert (
        by_place[0, "default"]["renders_add"] is None
        and by_place[14, "none"]["renders_add"] is None
    )
    assert by_place[14, "default"]["of_all"] == pytest.approx(100 * 34 / 35)
    text = FORM.text(derived)
    assert "Renders alone (default streets) are as good as 10 labelled images" in text
    assert "| 14 | default streets | 34.0 |" in text and "+4.0" in text
    beyond = report({7: 20, 14: 30}, {0: 5, 14: 40})
    assert beyond["rows"][0]["of_all"] is None  # of the 28 labels that there are, no net has all
    ends = [(end["labels"], end["bound"]) for end in beyond["worth"]]
    assert ends == [(7, "at most"), (14, "at least")]
    assert [end["ci95"] for end in beyond["worth"]] == [[None, 7], [14, None]]
    assert "at least 14 labelled images alone (95 % interval at least 14)" in FORM.text(beyond)


def test_what_streets_gain_over_random_ones_beside_the_same_labels():
    derived = report({7: 20, 14: 30}, {0: 25, 14: 34})
    nets = [{"miou": v, "class_iou": []} for v in (30.0, 33.0)]
    random = {"labels": 14, "renders": "random", "nets": nets}
    by = {
        (row["labels"], row["renders"]): row["over_random"]
        for row in FORM.derive({**derived, "rows": [*derived["rows"], random]})["rows"]
    }
    assert by[14, "default"]["mean"] == pytest.approx((33 - 30 + 35 - 33) / 2)
    assert by[0, "default"] is by[14, "random"] is by[14, "none"] is None


def test_the_interval_is_where_the_paired_t_test_holds_by_hand():
    # Nets on N = 7 2^x labels alone come to 20 + 10 x. The others' two seeds lie sqrt(2) below and above
    # their mean, so that differences have the standard deviation 2, and their interval the half width
    # t(0.975, 1) 2 / sqrt(2) = 12.706 sqrt(2) at every x: 1.797 on either side of the value, as an x.
    alone = np.array([[20.0, 20.0], [30, 30], [40, 40], [50, 50]])
    counts, half = (7, 14, 28, 56), 12.7062 * math.sqrt(2)
    value, (low, high) = equivalent_labels(
        counts, alone, np.array([38 - math.sqrt(2), 38 + math.sqrt(2)])
    )
    assert value == pytest.approx(7 * 2**1.8)
    assert (low, high) == (pytest.approx(7 * 2 ** (1.8 - half / 10), rel=1e-5), None)
    _, (low, high) = equivalent_labels(
        counts, alone, np.array([31 - math.sqrt(2), 31 + math.sqrt(2)])
    )
    assert (low, high) == (None, pytest.approx(7 * 2 ** (1.1 + half / 10), rel=1e-5))
    assert equivalent_labels(counts, alone, np.array([20.0, 50.0]))[1] == [None, None]
    assert equivalent_labels(counts, alone[:, :1], np.array([30.0])) == (
        pytest.approx(14),
        None,
    )  # one seed
    # Where labels alone go down again, the interval spans all that is not excluded.
    bent = np.array([[20.0, 20.0], [30, 30], [26, 26], [36, 36]])
    value, ends = equivalent_labels(counts, bent, np.array([28.0, 28.0]))
    assert value == pytest.approx(7 * 2**0.8)
    assert ends == [pytest.approx(7 * 2**0.8), pytest.approx(28 * 2**0.2)]


@pytest.mark.parametrize("labels", [12, 100])
@pytest.mark.parametrize("seeds", [3, 5, 10])
def test_the_interval_covers_what_renders_are_worth_as_often_as_it_says(seeds, labels):
    """By a bootstrap over seeds it did in 72 to 90 %."""
    counts, curve = (7, 14, 27, 67, 133, 266), np.array([37.6, 39.6, 41.4, 43.5, 44.2, 45.0])
    rng, covered, runs = np.random.default_rng(seeds), 0, 1000
    truth = np.interp(np.log(labels), np.log(counts), curve)
    for _ in range(runs):
        seed = 0.6 * rng.normal(size=seeds)  # what a seed's nets have in common
        alone = curve[:, None] + seed + rng.normal(size=(len(counts), seeds))
        low, high = equivalent_labels(counts, alone, truth + seed + rng.normal(size=seeds))[1]
        covered += (low is None or low <= labels) and (high is None or labels <= high)
    assert 0.935 <= covered / runs <= 0.99  # gaps in the set count as covered


def test_a_seed_with_a_net_that_failed_is_left_out_of_what_renders_are_worth():
    derived = report({7: 20, 14: 30, 28: 35}, {0: 25, 14: 34})
    replaced = derived["worth"]
    for row in derived["rows"]:  # a third seed, far off, whose nets failed now and then
        row["nets"] = [*row["nets"], {"miou": 99.0 + row["labels"], "class_iou": []}]
    derived["rows"][-1]["nets"][2] = None
    for entry in derived["rows"]:
        if entry["labels"] == 28:
            entry["nets"][2] = None
    assert FORM.derive(derived)["worth"] == replaced


def test_nets_that_failed_are_left_out():
    derived = report({7: 20, 14: 30, 28: 35}, {0: 25, 14: 34})
    for row in derived["rows"]:
        if row["labels"] == 14 and row["renders"] == "none":
            row["nets"] = [None, None]
    again = FORM.derive(derived)
    assert [entry["labels"] for entry in again["worth"]] == [None, None]
    assert "because their training failed: 2." in FORM.text(
        again
    ) and "as good as" not in FORM.text(again)
    assert FORM.figures["labels.png"](again).startswith(b"\x89PNG")


@pytest.mark.parametrize(("images", "counts"), [
    (266, (0, 7, 14, 27, 67, 133, 266)), (20, (0, 2, 5, 7, 10, 14, 20)), (4, (0, 1, 2, 4)),
])  # fmt: skip
def test_numbers_are_what_the_data_allow(images, counts):
    names = tuple(map(str, range(images)))
    target = Target("camvid", True, "camvid", "", names, names, (), never)
    assert counts_of(defaults("camvid", "quick"), target) == counts


def test_renders_may_be_half_random_and_half_by_eye(reported):
    scores = Counted()
    _, words = reported("labels", "--renders", "random", "mixed", evaluate=scores)
    renders = [rendered_of(source) for _, source, _, _ in scores.calls]
    mixed = streets_named("mixed", "scenex")
    assert (
        sum(
            isinstance(streets, Mixture) and describe(streets) == describe(mixed)
            for streets in renders
        )
        == 6
    )
    assert "| 0 | half random, half default streets |" in words


def test_every_net_sees_its_labels_and_pairs_share_them(reported):
    scores = Counted()
    derived, _ = reported("labels", evaluate=scores)
    calls = [(source, seed) for _, source, seed, _ in scores.calls]
    mixed = {(len(s.parts[1].images), seed): s for s, seed in calls if isinstance(s, TrainingSet)}
    alone = {(len(s.images), seed): s for s, seed in calls if isinstance(s, LabelledImages)}
    assert set(mixed) == set(alone) == {(2, 0), (2, 1), (4, 0), (4, 1)} and len(calls) == 2 + 4 + 4
    for place, few in alone.items():
        np.testing.assert_array_equal(mixed[place].parts[1].images, few.images)
    rows = [(row["labels"], row["renders"]) for row in derived["rows"]]
    assert rows == [(0, "default"), *((n, r) for n in (2, 4) for r in ("none", "default"))]
    assert derived["learnt_from"] is None and derived["few_share"] is None
    assert all(images.shares == (0.75, 0.25) for images in mixed.values())  # as `fit` takes so few
