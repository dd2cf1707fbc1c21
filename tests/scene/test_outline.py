"""Labels as annotators draw them: closed gaps, dropped twigs, and unchanged pixels."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.files import read_json, write_json
from common.labels.classes import Outline
from common.labels.target_file import parse_target, shipped
from scene import AssetPool, RenderSettings, export_dataset, render_dataset, render_street, stream
from scene.check import findings
from scene.classes import TrainId
from scene.dataset.export import read_dataset
from scene.dataset.read import describe
from scene.outline import LEAST, outlined, sources
from scene.proposal import default_proposal, draw

ROAD, TREE, SKY, CAR, POLE, FENCE = (
    int(TrainId[name]) for name in ("ROAD", "VEGETATION", "SKY", "CAR", "POLE", "FENCE")
)
WIDTH, HEIGHT = 200, 120
RULE = (Outline((TREE,), 0.025),)
"""A kernel of 5 pixels."""
METRES = {ROAD: 30.0, TREE: 10.0, SKY: 0.0, CAR: 5.0, POLE: 5.0, FENCE: 20.0}


def depth_of(label):
    return np.vectorize(METRES.get)(label).astype(np.float32)


def drawn(label, outlines=RULE, depth=None):
    label = np.asarray(label, np.uint8)
    return label.take(sources(label, depth_of(label) if depth is None else depth, outlines))


@pytest.fixture
def crown():
    """A tree of 30x20 pixels in front of the sky."""
    label = np.full((HEIGHT, WIDTH), SKY, np.uint8)
    label[20:40, 30:60] = TREE
    return label


@pytest.mark.parametrize("behind", [SKY, ROAD, FENCE, POLE])
def test_a_hole_is_filled_where_the_sky_shows_through_it(crown, behind):
    filled = crown.copy()
    crown[28:31, 40:43] = behind
    np.testing.assert_array_equal(drawn(crown), filled if behind == SKY else crown)
    for name in ("camvid", "cityscapes", "idd-lite", "labelmefacade"):
        outlined_crown = drawn(crown, shipped(name).engine_outlines)
        np.testing.assert_array_equal(outlined_crown, filled if behind == SKY else crown)


def test_a_hole_wider_than_the_kernel_stays(crown):
    crown[25:35, 40:50] = SKY
    outlined_crown = drawn(crown)
    assert (outlined_crown[26:34, 41:49] == SKY).all() and (
        outlined_crown != crown
    ).sum() <= 12  # corners of an ellipse


def test_a_hole_at_the_image_border_is_filled_as_it_goes_on_beyond():
    label = np.full((HEIGHT, WIDTH), TREE, np.uint8)
    label[:10, 50:53] = SKY
    assert (drawn(label) == TREE).all()
    alone = np.full((HEIGHT, WIDTH), SKY, np.uint8)
    alone[:, 1] = TREE  # a trunk near the border
    np.testing.assert_array_equal(drawn(alone), alone)


def test_loose_twigs_go_to_the_deepest_neighbour(crown):
    expected = crown.copy()
    crown[5, 5:10] = TREE
    np.testing.assert_array_equal(drawn(crown), expected)
    crown[4:7, :12], expected[4:7, :12] = ROAD, ROAD  # sky is deeper than a road, a road than a car
    crown[5, 5:10] = TREE
    crown[6, 5:8], expected[6, 5:8] = CAR, CAR
    expected[5, 5:10] = ROAD
    np.testing.assert_array_equal(drawn(crown), expected)
    count = int(LEAST * WIDTH * HEIGHT) + 1  # of a part that is large enough to stay
    crown[50, 50 : 50 + count] = TREE
    assert (drawn(crown)[50, 50 : 50 + count] == TREE).all()


def test_the_first_of_two_outlines_closes_what_both_could():
    label = np.full((HEIGHT, WIDTH), SKY, np.uint8)
    label[20:40, 30:60:4] = TREE  # a fence of bars between the stripes of a tree
    label[20:40, 32:60:4] = FENCE
    for first, second in ((TREE, FENCE), (FENCE, TREE)):
        result = drawn(label, [Outline((k,), 0.025) for k in (first, second)])
        assert (result[24:36, 35:55:2] == first).all()
        np.testing.assert_array_equal(result[20:40, 34:56:2], label[20:40, 34:56:2])


def test_a_class_of_several_fills_with_the_nearest(crown):
    crown[20:40, 45:60] = FENCE
    expected = crown.copy()
    crown[30, 35], crown[30, 55] = SKY, SKY
    np.testing.assert_array_equal(drawn(crown, [Outline((TREE, FENCE), 0.025)]), expected)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.01, 0.03, 0.1]))
def test_only_classes_of_the_rule_grow_and_nothing_new_appears(seed, share):
    rng = np.random.default_rng(seed)
    small = rng.choice([*METRES, 255], (12, 20), p=[0.2, 0.4, 0.2, 0.05, 0.05, 0.05, 0.05])
    label = cv2.resize(small.astype(np.uint8), (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    noise = rng.random(label.shape) < 0.1
    label[noise] = rng.choice([TREE, SKY, ROAD], int(noise.sum()))
    depth = rng.uniform(1, 60, label.shape).astype(np.float32)
    depth[label == SKY] = 0
    before = label.copy(), depth.copy()
    source = sources(label, depth, [Outline((TREE,), share)])
    result = label.take(source)
    assert (label == before[0]).all() and (depth == before[1]).all()
    changed = result != label
    assert ((result == TREE) | (label == TREE))[changed].all()
    assert set(np.unique(result)) <= set(np.unique(label))
    assert (label[changed & (result == TREE)] == SKY).all()
    np.testing.assert_array_equal(sources(label, depth, ()).ravel(), np.arange(label.size))


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 2), (33, 47)])
def test_sizes_that_are_odd_or_smaller_than_the_kernel(size):
    rng = np.random.default_rng(0)
    label = rng.choice([TREE, SKY], size).astype(np.uint8)
    result = drawn(label, [Outline((k,), 0.1) for k in (TREE, CAR)])
    assert result.shape == size and set(np.unique(result)) <= {TREE, SKY}
    for only_class in (TREE, SKY):
        assert (drawn(np.full(size, only_class)) == only_class).all()


def test_labels_at_twice_the_size_are_outlined_alike():
    frame = render_street(UNITS[0], 0, 0, 1, SETTINGS, "embree", POOL)[0]

    def twice(pixels):
        return np.kron(pixels, np.ones((2, 2), pixels.dtype))

    small = frame.label.take(sources(frame.label, frame.depth, RULE))
    large = twice(frame.label).take(sources(twice(frame.label), twice(frame.depth), RULE))
    assert (twice(small) != large).mean() < 0.3 * (twice(frame.label) != large).mean()


# ---- renders, streams, exports

UNITS = draw(default_proposal(space="extended"), 0, 3)
SETTINGS = RenderSettings(120, 88)
POOL = AssetPool(size=6)
TARGET = """
images: "{name}"
labels: "{name}"
outlines: {tree: 3 %, bicycle: 2 %}
classes:
  road: {ids: [1], renders: [road, sidewalk]}
  tree: {ids: [2], renders: [vegetation, terrain]}
  bicycle: {ids: [3], renders: [bicycle, rider]}
  sky: {ids: [4], renders: [sky]}
"""


@pytest.fixture(scope="module")
def target():
    return parse_target(TARGET, "trees.yaml")


def test_datasets_are_exact_without_outlines_and_the_same_with_any_number_of_workers(
    target, tmp_path
):
    options = {"shots": 1, "settings": SETTINGS, "pool": POOL}
    exact = render_dataset(UNITS, 0, **options)
    one, two = (
        render_dataset(UNITS, 0, workers=k, outlines=target.engine_outlines, **options)
        for k in (1, 2)
    )
    frames = [render_street(u, 0, k, 1, SETTINGS, "embree", POOL)[0] for k, u in enumerate(UNITS)]
    np.testing.assert_array_equal(exact.labels, [frame.label for frame in frames])
    np.testing.assert_array_equal(exact.images, one.images)
    np.testing.assert_array_equal(one.labels, two.labels)
    by_hand = [outlined(frame, target.engine_outlines).label for frame in frames]
    np.testing.assert_array_equal(one.labels, by_hand)
    assert (one.labels != exact.labels).mean() > 0.005
    # An exported dataset is read with the same outlines, but for depth in steps of a centimetre.
    export_dataset(UNITS, 0, tmp_path / "exact", **options)
    np.testing.assert_array_equal(read_dataset(tmp_path / "exact").labels, exact.labels)
    read = read_dataset(tmp_path / "exact", target.engine_outlines)
    assert (read.labels != one.labels).mean() < 0.001
    export_dataset(UNITS, 0, tmp_path / "flat", format="folders", **options)
    export_dataset(UNITS, 0, tmp_path / "camvid", target="camvid", **options)
    for folder, lack in (
        ("flat", "no depth, which outlines need"),
        ("camvid", "the labels of a target"),
    ):
        with pytest.raises(ValueError, match=lack):
            read_dataset(tmp_path / folder, target.engine_outlines)


def test_exports_in_the_layout_of_cityscapes_are_exact_without_its_target(tmp_path):
    options = {"shots": 1, "settings": SETTINGS, "pool": POOL}
    frames = [render_street(u, 0, k, 1, SETTINGS, "embree", POOL)[0] for k, u in enumerate(UNITS)]
    labels = {}
    for outlines in ((), shipped("cityscapes").engine_outlines):
        folder = tmp_path / str(len(outlines))
        export_dataset(UNITS, 0, folder, target="cityscapes" if outlines else None, **options)
        labels[len(outlines)] = read_dataset(folder).labels
        expected = [outlined(frame, outlines).label for frame in frames]
        np.testing.assert_array_equal(labels[len(outlines)], expected)
    assert (labels[0] != labels[1]).mean() > 0.003


def test_exports_have_one_convention_in_all_their_labels(target, tmp_path):
    exact = parse_target(TARGET.replace("outlines: {tree: 3 %, bicycle: 2 %}\n", ""), "trees.yaml")
    options = {"shots": 1, "settings": SETTINGS, "pool": POOL}
    labels = {}
    for name, label_target in (("outlined", target), ("exact", exact), ("again", target)):
        export_dataset(
            UNITS, 0, tmp_path / name, target=label_target, workers=2 * (name == "again"), **options
        )
        labels[name] = read_dataset(tmp_path / name).labels
        assert not list(findings(tmp_path / name))
    np.testing.assert_array_equal(labels["outlined"], labels["again"])
    assert (labels["outlined"] != labels["exact"]).mean() > 0.005
    sampled = stream(default_proposal(space="extended"), 0, settings=SETTINGS, pool=POOL, images=3,
                     target=target)  # fmt: skip
    np.testing.assert_array_equal(labels["outlined"], [sample.label for sample in sampled])
    outlined_files, exact_files = (
        {p.relative_to(tmp_path / name): p.read_bytes() for p in (tmp_path / name).rglob("*.png")}
        for name in ("outlined", "exact")
    )
    for path, content in outlined_files.items():  # what is no label is as it was
        if any(word in path.name for word in ("leftImg8bit", "depth", "normals", "disparity")):
            assert content == exact_files[path]
    rows = read_json(tmp_path / "outlined" / "dataset.json")["target"]["classes"]
    assert [row.get("outline") for row in rows] == [None, 0.03, 0.02, None]
    assert "outline" not in str(read_json(tmp_path / "exact" / "dataset.json")["target"])
    path = tmp_path / "outlined" / "dataset.json"
    description = read_json(path)
    description["target"]["classes"][1]["outline"] = 3
    write_json(path, description)
    with pytest.raises(ValueError, match="the entry of the target is damaged: outlines"):
        describe(tmp_path / "outlined")
