"""Which images a ranking puts first, and the summary of the scores of networks trained on them."""

import numpy as np
import pytest

from benchmarks import next_labels
from benchmarks.next_labels import (
    HELD_OUT,
    RANKINGS,
    first_choices,
    fitted,
    k_centre,
    main,
    pooled,
    ranked,
    read_split,
    summary,
    summary_first,
)
from seg.data import LabelledImages
from seg.recipes import with_steps

CERTAIN, LARGE, SMALL = 0, 1, 2


def test_doubt_comes_first_and_where_classes_are_balanced_that_about_rare_ones(monkeypatch):
    scores = np.zeros((3, 4, 4, 3), np.float32)
    scores[..., 0] = 30  # all pixels are of class 0,
    scores[SMALL, 0, 0] = [0, 30, 29]  # but one, of rare ones; the net wavers between these
    scores[LARGE, :2, :2, 1] = 10  # here it wavers a little about four
    scores[LARGE, :2, :2, 0] = 12
    monkeypatch.setattr(next_labels, "_scores", lambda split, net: iter(scores))
    rng = np.random.default_rng(0)
    rankings = ranked(None, None, rng, [CERTAIN, LARGE, SMALL])
    assert tuple(rankings) == RANKINGS and sorted(rankings["random"]) == [0, 1, 2]
    assert rankings["margin"] == [LARGE, SMALL, CERTAIN] and rankings["entropy"][-1] == CERTAIN
    assert rankings["balanced"] == [SMALL, LARGE, CERTAIN] and rankings["spread"][0] == LARGE
    assert SMALL not in ranked(None, None, rng, [CERTAIN, LARGE])["margin"]


def test_a_network_ranks_the_pool_and_is_tested(camvid, monkeypatch):
    monkeypatch.setattr(next_labels, "SETTINGS", with_steps(next_labels.SETTINGS, 1))
    split = read_split(camvid)
    pool = list(range(len(split.pool.images)))
    network = fitted(split, pool, seed=0)
    rankings = ranked(split, network, np.random.default_rng(0), pool)
    assert all(sorted(ranking) == pool for ranking in rankings.values())
    assert 0 <= next_labels.tested(network, split.test, split.classes, next_labels.SETTINGS) <= 100


def test_gains_are_in_pairs():
    rows = [
        {"seed": seed, "ranking": name, HELD_OUT: 30.0 + seed + gain}
        for seed in (0, 4)
        for name, gain in zip(("none", *RANKINGS), (-1, 0, 1, 2, 3, 4), strict=True)
    ]
    none, random, _, margin, *_ = summary(rows)
    assert (none["14 more by"], random[HELD_OUT], random["over random"]) == ("none", "32.0", "")
    assert (margin[HELD_OUT], margin["over random"]) == ("34.0", "+2.00 (+2.00 to +2.00)")
    assert none["over random"] == "-1.00 (-1.00 to -1.00)"


def test_k_centre_takes_the_image_that_is_farthest_from_all_before_it():
    line = np.array([[0.0], [1.5], [5.0], [9.0], [10.0]])
    assert k_centre(line, 4, start=1) == [1, 4, 2, 0]  # 8.5, 3.5 and 1.5 away from those before
    maps = tuple(np.ones((5, 2, 3, 2), np.float16) * line[:, None, None] for _ in range(2))
    vectors = pooled(maps)
    assert vectors.shape == (5, 4) and np.allclose(vectors, line / line.std())
    maps[0][:, 0] += 1  # all images alike: their order does not change
    assert k_centre(pooled(maps), 4, start=1) == [1, 4, 2, 0]


def test_first_images_are_chosen_by_seed_and_without_views():
    rng = np.random.default_rng(0)
    count, views = 12, 2
    maps = (rng.random((views * count, 2, 2, 3)).astype(np.float16),)
    names, groups = tuple(f"{k:02}" for k in range(count)), ("a", "b", "c") * 4
    pool = LabelledImages(np.zeros((count, 8, 8, 3), np.uint8), None, names, groups, maps)
    by_seed = [first_choices(pool, 6, seed) for seed in range(5)]
    assert all(
        len({*chosen}) == 6 and max(chosen) < count for f in by_seed for chosen in f.values()
    )
    assert len({tuple(choices["k-centre"]) for choices in by_seed}) > 1
    for choices in by_seed:
        assert sorted(groups[k] for k in choices["spread"]) == ["a", "a", "b", "b", "c", "c"]


def test_choices_of_first_images_are_compared_in_pairs():
    rows = [
        {"seed": seed, "labels": 7, "renders": renders, "choice": name, "mIoU": 30.0 + seed + gain}
        for seed in (0, 4)
        for renders in (0, 300)
        for name, gain in (("spread", 0), ("k-centre", 2 if renders else -1))
    ]
    alone, mixed = summary_first(rows)
    assert alone == {
        "labels": 7, "renders": 0, "spread": "32.0", "k-centre": "31.0", "gain": "-1.00 (-1.00 to -1.00)",
    }  # fmt: skip
    assert mixed["renders"] == 300 and mixed["gain"] == "+2.00 (+2.00 to +2.00)"


@pytest.mark.parametrize("first", [[], ["--first", "2"]])
def test_a_wrong_folder_is_one_line_and_exit_code_2(tmp_path, capsys, first):
    assert main([str(tmp_path / "none"), *first]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "none") in line
