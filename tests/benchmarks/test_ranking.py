"""Ranks, losses and evaluations needed, by hand."""

import numpy as np
import pytest

from benchmarks.ranking import behind, mean_ranks, needed, plot

VALUES = {
    ("random_search", "p"): np.asarray([[1.0, 3.0], [4.0, 4.0]]),
    ("ours", "p"): np.asarray([[3.0, 5.0], [4.0, 4.0]]),
    ("tpe", "p"): np.asarray([[0.0, 2.0], [6.0, 8.0]]),
}
COURSE = {
    ("random_search", "p"): {10: 2.0, 20: 4.0},
    ("ours", "p"): {10: 4.0, 20: 4.0},
    ("tpe", "p"): {10: 5.0, 15: 3.0, 20: 7.0},
}


def test_ranks_are_means_over_columns_and_equals_share_theirs() -> None:
    # First column: ours 4, random 2, tpe 1; second: tpe 7, the others 4 each.
    assert mean_ranks(VALUES) == {"ours": 1.75, "tpe": 2.0, "random_search": 2.25}


def test_differences_to_the_best_rival_are_paired() -> None:
    first, second = behind(VALUES, "ours", (50, 100))
    assert (first["best rival"], first["difference"], first["se"]) == ("random_search", 2.0, 0.0)
    assert first["in se"] is None  # no spread to measure by
    assert (second["best rival"], second["difference"]) == ("tpe", -3.0)
    assert second["in se"] == pytest.approx(-3.0)
    assert behind(VALUES, "nobody", (50, 100)) == []


def test_evaluations_needed_count_from_where_the_value_stays() -> None:
    rows = {row["method"]: row["p"] for row in needed(COURSE, VALUES, (10, 20))}
    assert rows == {"random_search": 20, "ours": 10, "tpe": 20}


def test_the_plot_is_a_picture(tmp_path) -> None:
    plot(COURSE, str(tmp_path / "search.png"), "ours")
    assert (tmp_path / "search.png").read_bytes().startswith(b"\x89PNG")
