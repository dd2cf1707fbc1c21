"""The images are those of this ``ENGINE``; if they differ, raise it in ``scene/version.py``.

Then write the golden figures again, in the root of the repository:

    python -m tests.scene.test_version
"""

import json
from itertools import product
from pathlib import Path

import numpy as np

from scene import RenderSettings, render_dataset
from scene.proposal import default_proposal, draw, random_proposal
from scene.version import ENGINE

GOLDEN = Path(__file__).parent / "golden.json"
SETTINGS = RenderSettings(128, 64, samples=2)
STREETS, SEED = 4, 11
CELL = 16
"""Pixels along each side of the cells whose mean colours are compared."""
MOST = {"cells": 0.5, "shares": 0.002}
"""Largest differences between machines: levels of a cell's mean colour, share of the pixels of a class."""


def figures() -> dict[str, object]:
    """Statistics of images and labels of a few streets."""
    result: dict[str, object] = {"engine": ENGINE}
    for name, proposal in (("random", random_proposal()), ("default", default_proposal())):
        units = draw(proposal, SEED, STREETS)
        images, labels = render_dataset(units, SEED, shots=1, settings=SETTINGS)
        cells = images.reshape(STREETS, 64 // CELL, CELL, 128 // CELL, CELL, 3).mean(axis=(2, 4))
        shares = [np.bincount(label.ravel(), minlength=256)[:19] / label.size for label in labels]
        result[name] = {
            "cells": np.round(cells, 2).reshape(STREETS, -1).tolist(),
            "shares": np.round(shares, 5).tolist(),
        }
    return result


def test_pictures_are_those_of_this_engine():
    current, golden = figures(), json.loads(GOLDEN.read_text())
    cure = "raise ENGINE in scene/version.py, then python -m tests.scene.test_version"
    for name, (key, most) in product(("random", "default"), MOST.items()):
        away = np.abs(np.array(current[name][key]) - golden[name][key]).max(axis=1)
        assert away.max() <= most, f"{name} {key} of street {away.argmax()}: {away.max()}; {cure}"
    assert golden["engine"] == ENGINE, "golden figures of another engine: " + cure


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(figures()) + "\n")
