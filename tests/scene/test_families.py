"""What every asset family keeps: four kinds that differ, and nothing left to chance but the seed."""

import numpy as np
import pytest

from scene.assets.families import FAMILIES
from tests.scene.asset_checks import kinds, make, module_of

NAMES = [family.replace(" ", "_") for family in FAMILIES]


def form(asset):
    return asset.mesh.vertices.tobytes() + asset.mesh.faces.tobytes()


def paint(asset):
    return asset.color.tobytes() + asset.material.tobytes()


@pytest.mark.parametrize("family", NAMES)
def test_at_least_four_kinds_that_differ(family):
    names = module_of(family).KINDS
    assert len(set(names)) == len(names) >= 4
    drawn = [make(family, kind, 0) for kind in names]
    assert len({(form(asset), paint(asset)) for asset in drawn}) == len(names)


@pytest.mark.parametrize(("family", "kind"), kinds(NAMES))
def test_same_seed_same_bytes_and_other_seeds_others(family, kind):
    drawn, again = ([make(family, kind, seed) for seed in range(4)] for _ in range(2))
    forms, paints = [form(asset) for asset in drawn], [paint(asset) for asset in drawn]
    assert forms == [form(asset) for asset in again]
    assert paints == [paint(asset) for asset in again]
    assert len(set(paints)) == 4
    assert len(set(forms)) >= (3 if family == "signpost" else 4)  # posts come in few sizes


@pytest.mark.parametrize("family", NAMES)
def test_an_unknown_kind_is_refused_by_name(family):
    with pytest.raises(ValueError, match=r"unknown kind of .*'marble'; known: "):
        make(family, "marble", 0)


@pytest.mark.parametrize("family", NAMES)
def test_global_randomness_is_neither_read_nor_moved(family):
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    make(family, module_of(family).KINDS[0], 0)
    assert (np.random.get_state()[1] == state).all()  # noqa: NPY002
