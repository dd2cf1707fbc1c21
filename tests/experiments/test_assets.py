"""Assets and images: which pools and streets each net sees, pairs, and what is refused."""

from functools import partial

import numpy as np
import pytest

from common.errors import UserError
from experiments.config import read_attributes
from experiments.config.jobs import defaults_of
from experiments.studies.assets import FORM
from experiments.tables.stats import paired_gain
from scene.proposal import default_proposal, random_proposal

from .conftest import Counted, formula

defaults = partial(defaults_of, "assets")


@pytest.fixture
def assets(reported):
    """Studies on tiny CamVid, half the assets costing a little; returns report, page and calls."""

    def less(recipe, source, seed, truth, *_):
        costs = 0 if recipe.pool.fraction == 1 else 1 + seed % 2
        return formula(recipe, source, 10 * seed + 20 - costs, truth)

    def start(*flags):
        scores = Counted(less)
        return *reported("assets", *flags, evaluate=scores), [task[:3] for task in scores.calls]

    return start


def test_a_study_leaves_its_figures(assets):
    report, text, calls = assets()
    config = defaults("camvid", "smoke")
    assert len(calls) == 2 * 2 * config.seeds
    for recipe, proposal, _ in calls:
        assert recipe.pool == config.pool._replace(fraction=recipe.pool.fraction)
        assert recipe.fidelity.shots == config.final.shots
        np.testing.assert_array_equal(np.stack(proposal), np.stack(default_proposal(0.15)))
    # Pairs share streets and seeds, and differ in nothing but the assets.
    for images in config.images:
        of = [(seed, recipe) for recipe, _, seed in calls if recipe.fidelity.images == images]
        full, half = ([o for o in of if o[1].pool.fraction == share] for share in (1, 0.5))
        assert [seed for seed, _ in full] == [seed for seed, _ in half] == [0, 1]
        assert full[0][1].fidelity == half[0][1].fidelity
    places = [(r["images"], r["streets"], r["fraction"]) for r in report["rows"]]
    assert places == [(2, 1, 1.0), (2, 1, 0.5), (4, 2, 1.0), (4, 2, 0.5)]
    full, half = ([net["miou"] for net in row["nets"]] for row in report["rows"][:2])
    gain, interval = paired_gain(full, half)
    assert report["rows"][0]["more_assets"] is None and gain > 0
    assert report["rows"][1]["more_assets"] == {"mean": gain, "ci95": interval}
    assert "| 4 | 2 | 50 % |" in text and "default streets" in text
    # Nets that failed are told and left out.
    report["rows"][1]["nets"] = [None, None]
    derived = FORM.derive(report)
    assert derived["rows"][1]["mean"] is None and "because their training failed: 2." in FORM.text(
        derived
    )
    assert FORM.figures["assets.png"](derived).startswith(b"\x89PNG")


def test_streets_are_drawn_from_what_is_asked_for(assets, out, learnt_file):
    flags = ("--attributes", "learnt", "--learnt", str(learnt_file), "--images", "4")
    report, text, calls = assets(*flags, "--fractions", "1")
    assert len(calls) == 2 and calls[0][1].centre.max() == pytest.approx(0.9)
    assert len(report["rows"]) == 1 and report["rows"][0]["more_assets"] is None
    assert f"optimised streets from {learnt_file}" in text
    with pytest.raises(UserError, match=f"{learnt_file} holds attributes of --space scenex, not"):
        read_attributes("--learnt", learnt_file, "extended")
    out.rename(out.with_name("learnt"))
    *_, calls = assets("--attributes", "random")
    np.testing.assert_array_equal(np.stack(calls[0][1]), np.stack(random_proposal()))
