"""Class tables and the maps between them."""

import numpy as np
import pytest

from common.labels.target_file import SHIPPED, parse_target, shipped
from seg import classes
from seg.classes import (
    CAMVID_11,
    CITYSCAPES_19,
    IGNORE_LABEL,
    LABELMEFACADE_6,
    SYNTHIA_13,
    SYNTHIA_16,
)

from .conftest import refuses

TABLES = tuple(map(classes.class_table, SHIPPED))
TO_CAMVID = {
    "road": "road", "sidewalk": "sidewalk", "building": "building", "wall": "building",
    "fence": "fence", "pole": "pole", "traffic light": "sign", "traffic sign": "sign",
    "vegetation": "tree", "terrain": "tree", "sky": "sky", "person": "pedestrian",
    "rider": "bicyclist", "car": "car", "truck": "car", "bus": "car", "train": None,
    "motorcycle": "bicyclist", "bicycle": "bicyclist",
}  # fmt: skip
TO_FACADE = {
    "road": "road", "sidewalk": "sidewalk", "building": "building", "wall": "building",
    "fence": "building", "vegetation": "vegetation", "terrain": "vegetation", "sky": "sky",
    "car": "car", "truck": "car", "bus": "car",
    **dict.fromkeys(("pole", "traffic light", "traffic sign", "person", "rider", "train")),
    **dict.fromkeys(("motorcycle", "bicycle")),
}  # fmt: skip


def test_sizes_labels_subsets_and_names_by_hand():
    for table, pairs in ((CAMVID_11, TO_CAMVID), (LABELMEFACADE_6, TO_FACADE)):
        assert set(pairs) == set(CITYSCAPES_19.classes)
        for city, name in pairs.items():
            mapped = table.from_train_id[CITYSCAPES_19.classes.index(city)]
            assert mapped == (IGNORE_LABEL if name is None else table.classes.index(name))
    np.testing.assert_array_equal(CITYSCAPES_19.from_train_id[:19], np.arange(19))
    for table, count in ((CITYSCAPES_19, 19), (CAMVID_11, 11), (LABELMEFACADE_6, 6)):
        assert len(table.classes) == len(set(table.classes)) == count
        assert table.colors.shape == (count, 3) and len(np.unique(table.colors, axis=0)) == count
    names = CITYSCAPES_19.classes
    assert (len(SYNTHIA_16), len(SYNTHIA_13)) == (16, 13)
    assert {names[k] for k in set(range(19)) - set(SYNTHIA_16)} == {"terrain", "truck", "train"}
    assert {names[k] for k in set(SYNTHIA_16) - set(SYNTHIA_13)} == {"wall", "fence", "pole"}
    assert classes.class_table("camvid") is CAMVID_11
    refuses(
        r"unknown class table 'kitty'; known.*camvid, camvid-32, cityscapes, .*labelmefacade",
        classes.class_table,
        "kitty",
    )


def test_a_table_is_found_by_its_text_which_names_outlines_only_where_there_are_some():
    text = "images: '{name}'\nlabels: '{name}'\nclasses: {a: {ids: [1], renders: [sky]}, b: {ids: [2]}}"
    target = parse_target(text, "t.yaml")
    assert classes.table_text(target) == (
        '{"images":"{name}","labels":"{name}","classes":{"a":{"ids":[1],"colours":[],"names":[],'
        '"renders":["sky"]},"b":{"ids":[2],"colours":[],"names":[],"renders":[]}},"format":"ids",'
        '"void":[],"splits":{},"group":null,"fit":"pad","rest":null,"unlabelled":"refuse",'
        '"name":"t","source":"t.yaml"}'
    )
    outlined = classes.table_text(parse_target(f"{text}\noutlines: {{a: 3 %}}", "t.yaml"))
    assert '"outlines":{"a":0.03}' in outlined
    assert classes.class_table(outlined).outlines == (((10,), 0.03),)
    assert classes.class_table(classes.table_text(target)).outlines == ()
    assert CAMVID_11.outlines == (((8, 9), 0.04),)
    assert classes.table_text(shipped("camvid")) == "camvid"


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_every_class_that_is_rendered_is_reached_and_the_rest_is_void(table):
    reached = table.from_train_id
    rendered = {k for k, is_rendered in enumerate(shipped(table.name).rendered) if is_rendered}
    assert set(reached.tolist()) == {*rendered, IGNORE_LABEL}
    assert (reached[19:] == IGNORE_LABEL).all()
    with pytest.raises(ValueError, match="read-only"):
        reached[0] = 3
