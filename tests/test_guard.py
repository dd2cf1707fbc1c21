"""Pictures and rewards are those that were recorded, on the machine that recorded them; see `tests.guard`."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.guard import STAGES, differences, digest, streets


def test_digest_tells_arrays_and_their_types_apart():
    one = np.arange(6.0)
    assert digest((one, 1)) == digest((one.copy(), 1))
    others = [one.astype(np.float32), one.reshape(2, 3), one + 1e-12]
    assert len({digest((each, 1)) for each in [one, *others]}) == 4
    assert digest(([1], 2)) != digest(([1, 2],))


def test_differences_name_the_list():
    lines = differences({"a": ["1", "2"], "b": [0.5]}, {"a": ["1", "3"], "b": [0.5]})
    assert lines == ["a: 1 of 2 differ"]


def test_stages_are_told_apart(monkeypatch):
    """A change of the sensor's noise is a change of images and of nothing before them."""
    from scene.render import shot
    from tests import guard

    monkeypatch.setattr(guard, "STREETS", 2)
    before = streets()
    plain = shot.develop
    monkeypatch.setattr(shot, "develop", lambda image, *rest: 255 - plain(image, *rest))
    changed = {line.split(",")[0] for line in differences(before, streets())}
    assert changed == {"image"}
    assert {name.split(",")[0] for name in before} == set(STAGES)


@pytest.mark.slow
def test_streets_and_rewards_are_as_recorded():
    root = Path(__file__).parents[1]
    # As the record is made: compiled as users have it.
    environment = {**os.environ, "XLA_FLAGS": ""}
    run = subprocess.run(
        [sys.executable, "-m", "tests.guard"],
        cwd=root, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    if run.returncode == 2:
        pytest.skip(run.stdout.strip())
    assert run.returncode == 0, run.stdout + run.stderr
