"""Recorded rewards, fed back through the same job, end in the recorded answers (`tests.guard_searches`)."""

import json

import pytest

from experiments.evaluation.job import Result, rendered_of
from scene.proposal import moments
from seg.data import LabelledImages
from tests.guard_files import as_recorded
from tests.guard_searches import FLAGS, RECORD, mark, summed_up

from .conftest import study

CLOSE = 1e-3
"""Processors and compilers round differently; a baseline of another decay moves a mark by 0.7."""


@pytest.fixture
def recorded():
    return json.loads(RECORD.read_text())


class Recorded:
    """Stands for nets: what one of this seed, trained on these streets, scored when it was recorded."""

    def __init__(self, record):
        self.known = {}
        for *_, seed, place, reward in record["rewards"] + record["nets"]:
            self.known.setdefault(seed, []).append((place, reward))

    def __call__(self, recipe, source, seed, truth, keeps=None):
        own = None if isinstance(source, LabelledImages) else mark(*moments(rendered_of(source)))
        fitting = {
            reward for place, reward in self.known.get(seed, ())
            if own == place or (None not in (own, place) and abs(own - place) < CLOSE)
        }  # fmt: skip
        assert len(fitting) == 1, f"a net of seed {seed} on streets {own} was not recorded"
        (reward,) = fitting
        classes = [reward] * len(recipe.classes.classes)
        return Result(reward, classes, 0.5, 1.5)


def test_recorded_rewards_end_in_the_recorded_answers(recorded, scored_by, out):
    scored_by(Recorded(recorded))
    assert study("searches", *FLAGS, "--out", str(out)) == 0
    as_recorded("searches", out)
    found = summed_up(out)
    for name, wanted in recorded.items():
        assert len(found[name]) == len(wanted)
        for ours, theirs in zip(found[name], wanted, strict=True):
            assert ours == close(theirs)


def close(value):
    """The same, with floats that compare as nearly equal."""
    if isinstance(value, float):
        return pytest.approx(value, abs=CLOSE)
    if isinstance(value, list):
        return [close(each) for each in value]
    if isinstance(value, dict):
        return {name: close(each) for name, each in value.items()}
    return value
