"""The catalogue, repeatable and open-ended, and the pools that streets draw from."""

import json
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scene.assets import car, catalogue
from scene.assets.__main__ import main
from scene.assets.catalogue import AssetPool, asset, bounds, check_pool, draw_asset, in_season, kind
from scene.assets.families import FAMILIES
from scene.assets.library import LibraryError
from scene.assets.likeness import closest, describe
from scene.assets.own_class import OwnClass
from scene.attributes import default_unit, street_params
from scene.classes import CLASS_NAMES
from scene.mesh.solids import box
from scene.render.geometry import asset_shape
from scene.street.street import sample_street
from tests.scene.conftest import refused, street

DEFAULT_STREET = street_params(default_unit())

MIN_COUNTS = {"person": 200, "car": 195, "building": 106, "truck": 39, "traffic sign": 40, "bus": 28,
          "rider": 30}  # fmt: skip
"""The paper's counts."""


def draw_refs(pool, family, draws=200):
    rng = np.random.default_rng(0)
    return [draw_asset(pool, family, rng) for _ in range(draws)]


@pytest.fixture
def folder(shelf):
    """A folder of two own cars."""
    shelf("car/a.stl", trimesh.creation.box((4.0, 1.8, 1.5)))
    return shelf("car/b.stl", trimesh.creation.box((4.5, 1.8, 1.5)))


def test_trees_have_leaves_by_share_and_other_assets_stay():
    rng = np.random.default_rng(0)
    pool = AssetPool(5, 40)
    for share in (0.0, 0.25, 1.0):
        refs = [
            in_season("tree", int(ref), share, pool, rng.random())
            for ref in rng.integers(5, 45, 400)
        ]
        bare = np.mean(["bare" in catalogue.kind("tree", ref) for ref in refs])
        assert abs(bare - share) < 0.07 and {*refs} <= {*range(5, 45)}
    assert in_season("car", 7, 1.0, pool, 0.5) == 7 and in_season("tree", 7, None, pool, 0.5) == 7
    assert in_season("tree", "mine.glb", 0.0, pool, 0.5) == "mine.glb"
    assert in_season("tree", 4, 0.0, AssetPool(4, 1), 0.5) == 4  # "bare broad", the only one


def test_every_class_with_a_shape_has_a_family_and_a_tone_brightens_its_assets():
    shaped = {CLASS_NAMES[row.train_id] for row in FAMILIES.values()}
    assert shaped == set(CLASS_NAMES) - {"sky"}  # tiles of the ground are shapes, too
    assert catalogue.families_of("vegetation") == ("tree", "bush")
    assert catalogue.families_of("lamp") == ("lamp",)
    for name, rows in catalogue.surfaces().items():
        assert len(set(rows)) == len(rows) >= (14 if name == "sky" else 7) and all(rows)
    for family in ("tree", "person"):
        expected = np.minimum(FAMILIES[family].tone * asset(family, 3).color, 1)
        np.testing.assert_allclose(asset_shape(family, 3).color, expected, rtol=1e-6)


def test_a_street_counts_the_assets_of_a_family_once():
    catalogue._built_in.cache_clear()
    street(seed=3, pool=AssetPool())
    cache = catalogue._built_in.cache_info()
    assert cache.misses <= len(FAMILIES) < cache.hits


@pytest.mark.parametrize("family", FAMILIES)
def test_no_two_assets_of_a_family_are_alike_and_any_index_gives_one_of_its_kind(family):
    far = 1_000_003
    assert kind(family, far) == FAMILIES[family].kind_cycle[far % len(FAMILIES[family].kind_cycle)]
    low, high = bounds(family, far)
    assert (low < high).all() and np.isfinite([low, high]).all()
    row = FAMILIES[family]
    assert 4 <= len(set(row.kinds)) == len(row.kinds) <= row.count >= MIN_COUNTS.get(family, 8)
    ((apart, *_),) = closest([describe(asset(family, index)) for index in range(row.count)], 1)
    assert apart > 0.05  # copies are 0 apart, the same shape in two greys 0.1


def test_the_first_cars_are_one_of_each_kind_and_of_all_most_are_hatchbacks():
    kinds = FAMILIES["car"].kinds
    assert tuple(kind("car", index) for index in range(len(kinds))) == kinds
    count = Counter(kind("car", index) for index in range(10 * len(FAMILIES["car"].kind_cycle)))
    assert set(count) == set(kinds) and count.most_common(1) == [("hatchback", 50)]
    assert count["tuk-tuk"] == count["pickup"] == 10


def test_likeness_by_hand():
    cube = box((1, 1, 1), (0, 0, 0), (0.25, 0.25, 0.25))
    white = cube._replace(color=np.ones_like(cube.color))
    large = box((2, 2, 2), (5, 0, 0), (0.25, 0.25, 0.25))
    [(near, *pair), (far, *_)] = closest([describe(a) for a in (cube, white, large)], 2)
    assert near == pytest.approx(3 * (1 - 0.5)) and pair == [0, 1]  # three channels
    assert far == pytest.approx(3 * np.log(2))  # three sides; its position does not count


def test_draws_cover_the_catalogue_or_half_of_it_and_a_lookalike_is_redrawn():
    assert set(draw_refs(AssetPool(), "bicycle", 2000)) == set(range(FAMILIES["bicycle"].count))
    half = set(draw_refs(AssetPool(fraction=0.5), "bicycle", 2000))
    assert half == set(range(FAMILIES["bicycle"].count // 2))
    rng = np.random.default_rng([zlib.crc32(b"car"), 175])
    first, taken = car.car(car.sample_car(rng, kind("car", 175))), asset("car", 175)
    assert FAMILIES["car"].redrawn == (175,) and not np.array_equal(first.color, taken.color)


def test_own_assets_are_drawn_with_the_built_in_ones_or_alone(folder):
    pool = AssetPool(0, 2, own=folder)
    first, second = catalogue.own_assets(pool, "car")
    refs = draw_refs(pool, "car")
    assert set(refs) == {0, 1, first, second}
    assert 0.3 < sum(isinstance(ref, str) for ref in refs) / len(refs) < 0.7
    changes = {"use": "own"}, {"use": "built-in"}, {"fraction": 0.5}
    sampled = [set(draw_refs(pool._replace(**change), "car")) for change in changes]
    assert sampled == [{first, second}, {0, 1}, {0, first}]
    assert (
        bounds("car", second)[1] == pytest.approx([2.25, 0.9, 1.5])
        and kind("car", first) == "a.stl"
    )
    pool = AssetPool(own=folder, use="own")
    assert set(draw_refs(pool, "person", 5)) == {None}
    refused(LibraryError, "does not exist", check_pool, pool._replace(own=f"{folder}/nowhere"))
    assert set(catalogue.missing_families(check_pool(pool))) == set(FAMILIES) - {"car"}
    assert catalogue.missing_families(AssetPool(own=folder)) == ()


def test_a_pool_may_have_paths_and_lists(folder, tmp_path):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "bin.glb")
    own_class = OwnClass("bin", tmp_path / "bin.glb")
    checked = check_pool(AssetPool(own=Path(folder), without=["bus"], own_class=own_class))
    assert (checked.own, checked.without) == (folder, ("bus",))
    assert checked.own_class.file == str(tmp_path / "bin.glb")


@pytest.mark.parametrize("pool", [AssetPool(), AssetPool(size=1), AssetPool(use="own")])
def test_a_draw_takes_one_number_even_from_an_empty_pool(pool, folder):
    rng = np.random.default_rng(7)
    draw_asset(pool._replace(own=folder), "person", rng)
    assert rng.random() == np.random.default_rng(7).random(2)[1]


@pytest.mark.parametrize(("call", "message"), [
    (lambda: check_pool(AssetPool(use="mine")), "use 'mine' is unknown; known: both, own, built-in"),
    (lambda: check_pool(AssetPool(fraction=0.0)), r"asset fraction must lie in \(0, 1\], not 0"),
    (lambda: check_pool(AssetPool(fraction=float("nan"))), "asset fraction .* not nan"),
    (lambda: check_pool(AssetPool(first=-1)), "the first asset must be 0 or more"),
    (lambda: check_pool(AssetPool(size=0)), "asset count must be 1 or more, not 0"),
    (lambda: check_pool(AssetPool(use="own")), "needs a folder"),
    (lambda: sample_street(DEFAULT_STREET, 0, 1, AssetPool(overlap="avoids")), "overlap 'avoids'"),
    (lambda: check_pool(AssetPool(without="car")), "without must be a list of families, not 'car'"),
    (lambda: asset("boat", 0), "unknown asset family 'boat'; known: "),
    (lambda: asset("car", -1), "asset index of car must be 0 or more, not -1"),
])  # fmt: skip
def test_assets_and_pools_out_of_range_are_refused_by_name(call, message):
    refused(ValueError, message, call)


def test_the_catalogue_and_the_closest_pairs_are_printed(printed, refusal):
    text, counts = printed(main), json.loads(printed(main, "--json"))
    assert all(name in text for name in (*CLASS_NAMES, *FAMILIES, "saloon"))
    assert list(counts) == list(CLASS_NAMES) and min(counts.values()) >= 8
    assert counts["car"] + counts["truck"] == 195 + FAMILIES["truck"].count
    assert counts["car"] == sum(catalogue.train_id("car", k) == 13 for k in range(195))
    assert counts["car"] < 195 and counts["vegetation"] == 24 + 16
    lines = printed(main, "--closest", "train", "--pairs", 2).splitlines()
    assert lines[0].startswith("train: 8 assets; ") and len(lines) == 3
    assert "no assets of class 'boat'; known: building" in refusal(main, "--closest", "boat")
    assert "--pairs must be 1 or more, not -3" in refusal(main, "--closest", "bus", "--pairs", -3)


def test_a_pickup_is_a_truck_as_in_cityscapes_and_other_cars_are_cars():
    for ref, name in enumerate(FAMILIES["car"].kind_cycle):
        assert catalogue.train_id("car", ref) == (14 if name == "pickup" else 13), name
    assert catalogue.train_id("car", "an own pickup.glb") == 13
