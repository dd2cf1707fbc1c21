"""What holds for every asset family: sound arrays, real sizes, and results that only depend on the seed."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings

from scene.assets import signpost
from scene.assets.families import FAMILIES
from scene.assets.parts.draw import SameAs, keep, perhaps, plus, sample_fields, times
from scene.look.materials import MATERIALS
from tests.scene.conftest import SEEDS, kinds, make, solid


class Limits(NamedTuple):
    """Plausible bounds of a family's assets, metres."""

    low: tuple[float, float, float]  # corners of the box around all assets
    high: tuple[float, float, float]
    triangles: int  # upper bound
    least: tuple[float, float, float] = (0, 0, 0)  # smallest size along x, y, z
    middle: tuple[float, float] = (99, 99)  # twice the largest offset of the middle along x and y


LIMITS: dict[str, Limits] = {
    "building": Limits((-7.7, -1.25, 0), (7.7, 12.6, 26), 2500),
    "tree": Limits((-8, -8, 0), (8, 8, 15.2), 7500),
    "bush": Limits((-2.6, -1.4, 0), (2.6, 1.4, 2.6), 2500),
    "wall": Limits((-2, -0.15, 0), (2, 0.6, 3.2), 1900),
    "fence": Limits((-2, -0.2, 0), (2, 0.2, 2.5), 1150),
    "lamp": Limits((-0.5, -3, 0), (0.5, 3, 9.5), 900),
    "signpost": Limits((-0.35, -2.3, 0), (0.4, 0.6, signpost.MAX_HEIGHT), 700),
    "traffic light": Limits((-0.55, -0.7, 1.4), (0, 0.7, 4), 600),
    "traffic sign": Limits((-0.15, -1.1, 1.2), (0, 1.1, 3.1), 320),
    "car": Limits((-3, -1.35, 0), (3, 1.35, 2.7), 4600, (2.5, 1.25, 1.2), (0.2, 0.1)),
    "bus": Limits((-9.7, -1.6, 0), (9.7, 1.6, 4.6), 4000, (6.5, 2.2, 2.5), (0.2, 0.1)),
    "truck": Limits((-8.85, -1.6, 0), (8.85, 1.6, 4.4), 4000, (5.5, 2.2, 2.4), (0.2, 0.1)),
    "train": Limits((-11.35, 0, 0), (11.35, 3.2, 5.4), 4000, (10, 2.2, 3.2), (0.2, 3.2)),
    "bicycle": Limits((-1.1, -0.43, 0), (1.1, 0.43, 1.15), 2000, (1.5, 0.4, 0.9), (0.2, 0.1)),
    "motorcycle": Limits((-1.4, -0.55, 0), (1.4, 0.55, 1.55), 2800, (1.6, 0.6, 1.1), (0.2, 0.1)),
    "person": Limits((-2.1, -1, 0), (2.1, 1, 2.45), 3600, (0.15, 0.25, 0.93), (99, 0.35)),
    "company": Limits((-1, -1, 0), (2.2, 1, 2.2), 4500, (0.5, 0.4, 1), (99, 1)),
    "slab": Limits((-1.25, -2.6, 0), (1.25, 2.6, 0.02), 30),
    "land": Limits((-4, -4, 0), (4, 4, 0.2), 800),
    "paving": Limits((-3.5, -1.4, 0), (3.5, 1.4, 0.2), 120),
    "bollard": Limits((-0.35, -0.25, 0), (0.35, 0.25, 1.3), 400, (0.05, 0.05, 0.6), (0.01, 0.01)),
    "shelter": Limits((-2.8, -1.1, 0), (2.8, 2.3, 3.3), 800, (2, 1, 2)),
    "scaffold": Limits((-6.2, -0.9, 0), (6.2, 1.4, 9.3), 1500, (5, 0.9, 5)),
    "rider": Limits((-1.3, -0.8, 0), (1.3, 0.8, 2.3), 3000, (0.4, 0.4, 1.1), (99, 0.35)),
}
DARK = ("car", "bus", "truck", "train", "bicycle", "motorcycle", "person", "rider",
        "company")  # fmt: skip
"""Families whose colours are darker than paint on a wall."""


@pytest.mark.parametrize(("family", "kind"), kinds(LIMITS))
@settings(max_examples=6)
@given(seed=SEEDS)
def test_a_sound_asset_of_its_size(family, kind, seed):
    asset, limits = make(family, kind, seed), LIMITS[family]
    faces = len(asset.mesh.faces)
    assert 0 < faces <= limits.triangles
    assert asset.color.shape == (faces, 3) and asset.color.dtype == np.float32
    assert asset.material.shape == (faces,) and asset.material.dtype == np.uint8
    assert asset.material.max() < len(MATERIALS) and np.isfinite(asset.mesh.vertices).all()
    assert 0 <= asset.color.min() and asset.color.max() <= (0.9 if family in DARK else 1)
    low, high = asset.mesh.bounds
    assert (low >= np.array(limits.low) - 0.02).all() and (high <= limits.high).all(), (low, high)
    assert (high - low >= limits.least).all(), high - low
    assert (np.abs(low + high)[:2] < limits.middle).all()
    if family not in ("traffic light", "traffic sign", "rider"):  # lifted by a post or a machine
        assert low[2] == pytest.approx(0, abs=0.02 if family in DARK else 1e-9)
    if family in DARK:
        assert (solid(asset.mesh).area_faces < 1e-10).sum() <= 4


def form_and_paint(asset):
    form = asset.mesh.vertices.tobytes() + asset.mesh.faces.tobytes()
    return form, asset.color.tobytes() + asset.material.tobytes()


@pytest.mark.parametrize("family", FAMILIES)
def test_at_least_four_kinds_that_differ_and_no_other(family):
    names, state = FAMILIES[family].kinds, np.random.get_state()[1].copy()  # noqa: NPY002
    assert len(set(names)) == len(names) >= 4 and family in LIMITS
    assert len({form_and_paint(make(family, kind, 0)) for kind in names}) == len(names)
    assert (np.random.get_state()[1] == state).all()  # noqa: NPY002
    with pytest.raises(ValueError, match=f"unknown kind of {family} 'marble'; known: {names[0]}"):
        make(family, "marble", 0)


@pytest.mark.parametrize(("family", "kind"), kinds(FAMILIES))
def test_a_seed_reproduces_the_bytes_and_other_seeds_differ(family, kind):
    first, again = (
        [form_and_paint(make(family, kind, seed)) for seed in range(4)] for _ in range(2)
    )
    forms, paints = (len(set(parts)) for parts in zip(*first, strict=True))
    assert first == again and paints == 4
    assert forms >= (3 if family == "signpost" else 4)  # posts come in few sizes


class Row(NamedTuple):
    """A kind in a table."""

    size: tuple[float, float] = (2.0, 3.0)
    count: int = 5
    color: str = "red"
    second: str = "blue"


def test_rules_see_the_kind_and_a_field_may_copy_another():
    rng = np.random.default_rng(0)
    row = sample_fields(rng, Row(), size=(keep, times(2, 2)), count=plus(1, 2), second=SameAs("color"),
                color=perhaps(1, "green", keep))  # fmt: skip
    assert row == Row((2.0, 6.0), 6, "green", "green")
    other = sample_fields(
        rng, Row(), color=perhaps(0, "green", keep), second=perhaps(0, "green", "grey")
    )
    assert other == Row(second="grey")
