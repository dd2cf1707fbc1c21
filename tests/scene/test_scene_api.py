"""The names that ``import scene`` offers."""

from __future__ import annotations

import re

import numpy as np
import pytest

import scene


def test_every_public_name_is_there():
    for name in scene.__all__:
        assert getattr(scene, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = scene.nothing


def test_the_example_in_the_docstring_runs():
    lines = [line[4:] for line in scene.__doc__.splitlines() if re.match(r"    \S", line)]
    scope: dict = {}
    exec("\n".join(lines), scope)
    dataset = scope["dataset"]
    assert dataset.images.shape == (8, 120, 160, 3)
    assert dataset.labels.shape == (8, 120, 160)
    assert set(np.unique(dataset.labels)) <= set(range(19))
