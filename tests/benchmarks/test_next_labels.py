"""Which images a ranking puts first, and what is made of the scores of nets that learnt from them."""

import numpy as np

from benchmarks import next_labels
from benchmarks.next_labels import HELD_OUT, RANKINGS, ranked, summary

CERTAIN, LARGE, SMALL = 0, 1, 2


def test_doubt_comes_first_and_where_classes_are_balanced_that_about_rare_ones(monkeypatch):
    scores = np.zeros((3, 4, 4, 3), np.float32)
    scores[..., 0] = 30  # all pixels are of class 0,
    scores[SMALL, 0, 0] = [0, 30, 29]  # but one, of rare ones; the net wavers between these
    scores[LARGE, :2, :2, 1] = 10  # here it wavers a little about four
    scores[LARGE, :2, :2, 0] = 12
    monkeypatch.setattr(next_labels, "_scores", lambda own, net: iter(scores))
    rng = np.random.default_rng(0)
    found = ranked(None, None, rng, [CERTAIN, LARGE, SMALL])
    assert tuple(found) == RANKINGS and sorted(found["random"]) == [0, 1, 2]
    assert found["margin"] == [LARGE, SMALL, CERTAIN] and found["entropy"][-1] == CERTAIN
    assert found["balanced"] == [SMALL, LARGE, CERTAIN] and found["spread"][0] == LARGE
    assert SMALL not in ranked(None, None, rng, [CERTAIN, LARGE])["margin"]


def test_gains_are_in_pairs():
    rows = [
        {"seed": seed, "ranking": name, HELD_OUT: 30.0 + seed + gain}
        for seed in (0, 4)
        for name, gain in zip(("none", *RANKINGS), (-1, 0, 1, 2, 3, 4), strict=True)
    ]
    none, random, _, margin, *_ = summary(rows)
    assert (none["14 more by"], random[HELD_OUT], random["over random"]) == ("none", "32.0", "")
    assert (margin[HELD_OUT], margin["over random"]) == ("34.0", "+2.0 (+2.0 to +2.0)")
    assert none["over random"] == "-1.0 (-1.0 to -1.0)"
