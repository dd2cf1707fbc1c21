"""Means, t intervals, paired gains and Welch's test."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from experiments.tables.stats import bootstrap, crossed, holm, mean_ci95, paired_gain, stars, welch


def test_intervals_and_paired_gains_by_hand():
    # 1 2 3 4 5: s^2 = 2.5, s / sqrt(5) = sqrt(0.5); t(0.975, 4) = 2.7764 from a printed table.
    half = 2.7764 * math.sqrt(0.5)
    assert mean_ci95([1, 2, 3, 4, 5]) == (3, pytest.approx([3 - half, 3 + half], abs=1e-4))
    # Two values a and b: s / sqrt(2) = |a - b| / 2, t(0.975, 1) = 12.706.
    assert mean_ci95([10, 12])[1] == pytest.approx([11 - 12.706, 11 + 12.706], abs=1e-3)
    assert mean_ci95([7.0]) == (7.0, None)  # one value has none
    # The pairs differ by exactly 2, however far they lie apart from each other.
    assert paired_gain([12, 22, 32], [10, 20, 30]) == (2, [2, 2])
    assert paired_gain([7.0], [5.0]) == (2.0, None)
    with pytest.raises(ValueError, match="3 values cannot be paired with 2"):
        paired_gain([1, 2, 3], [1, 2])


@given(st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=12))
def test_the_interval_is_that_of_scipy_and_a_gain_that_of_the_differences(pairs):
    ours, theirs = np.transpose(pairs)
    mean, interval = mean_ci95(ours.tolist())
    wanted = stats.t.interval(0.95, len(ours) - 1, ours.mean(), stats.sem(ours))
    assert mean == pytest.approx(ours.mean(), abs=1e-9)
    if np.ptp(ours) > 1e-6:
        assert interval == pytest.approx(wanted, rel=1e-6, abs=1e-6)
    mean, interval = mean_ci95((ours - theirs).tolist())
    gain, gain_interval = paired_gain(ours.tolist(), theirs.tolist())
    assert [gain, *gain_interval] == pytest.approx([mean, *interval], abs=1e-9)


def test_intervals_over_searches_and_seeds_by_hand():
    # Mean squares 27 of searches, 39 of seeds, 1 of the rest: 65 / 9 is the mean's variance.
    mean, (low, high) = crossed([[0, 4, 8], [6, 12, 12], [3, 8, 10]])
    degrees = 65**2 / (27**2 / 2 + 39**2 / 2 + 1**2 / 4)
    assert mean == 7 and high - 7 == pytest.approx(7 - low)
    assert high - 7 == pytest.approx(stats.t.ppf(0.975, degrees) * math.sqrt(65 / 9))
    # Two searches alone: mean squares 54, 26 and 2, and the one degree of the 54 decides.
    mean, (low, high) = crossed([[0, 4, 8], [6, 12, 12]])
    assert high - mean == pytest.approx(12.7062 * math.sqrt(54 / 6), rel=1e-5)
    # Searches alike: what is left is the seeds' own variance. One search, or one seed: Student's t.
    assert crossed([[1, 2, 6], [1, 2, 6]])[1] == pytest.approx(mean_ci95([1, 2, 6])[1])
    assert crossed([[1, 2, 6]]) == crossed([[1], [2], [6]]) == mean_ci95([1, 2, 6])
    assert crossed([[5, 5], [5, 5]]) == (5, [5, 5]) and crossed([[5]]) == (5, None)


@pytest.mark.parametrize("spreads", [(1, 1, 1), (1.2, 0.4, 0.1), (0, 2, 0.5), (0, 0, 1)])
@pytest.mark.parametrize("shape", [(2, 10), (3, 3), (3, 5), (3, 10), (5, 3), (5, 5)])
def test_intervals_over_both_hold_the_truth_as_often_as_they_say(shape, spreads):
    searches, seeds = shape
    rng, covered, runs = np.random.default_rng(0), 0, 600
    for _ in range(runs):
        parts = (rng.normal(size=size) for size in ((searches, 1), (1, seeds), shape))
        low, high = crossed(sum(s * part for s, part in zip(spreads, parts, strict=True)))[1]
        covered += low <= 0 <= high
    assert covered >= 0.93 * runs - 12  # chance: two standard deviations


def test_welch_and_the_bootstrap_by_hand():
    # Means 2 and 7, variances 1 and 20 / 3: t = -5 / sqrt(1 / 3 + 5 / 3).
    result = welch([1, 2, 3], [4, 6, 8, 10])
    assert result.difference == pytest.approx(-5) and result.t == pytest.approx(-5 / math.sqrt(2))
    degrees = 2**2 / ((1 / 3) ** 2 / 2 + (5 / 3) ** 2 / 3)
    assert result.degrees == pytest.approx(degrees)
    assert result.p_value == pytest.approx(2 * stats.t.sf(5 / math.sqrt(2), degrees))
    assert 0.01 < result.p_value < 0.05 and stars(result.p_value) == "*"
    assert welch([3, 1, 2], [8, 4, 10, 6]).p_value == pytest.approx(result.p_value)
    assert stars(welch([1, 2, 3], [101, 102, 103]).p_value) == "**"
    assert stars(welch([1, 2, 3], [2, 3, 4]).p_value) == ""
    # 0.01 x 4; 0.02 x 3; 0.03 x 2 is less than the one before it; 0.9 x 1.
    assert holm([0.9, 0.02, 0.01, 0.03]) == pytest.approx([0.9, 0.06, 0.04, 0.06])
    assert holm([]) == [] and holm([0.6, 0.7]) == [1.0, 1.0]
    assert welch([1], [2, 3]) is None and welch([1, 1], [2, 2]) is None
    # Sets that hold 3 and 5: the statistic knows the counts, and so never varies.
    result = bootstrap((3, 5), lambda a, b: float(10 * len(a) + len(b) + (b.max() > 4)), 0)
    assert result == (35, [35, 35])
    assert bootstrap((3,), lambda a: math.nan, 0) == (None, None)
