"""Class tables and the maps between them."""

import numpy as np
import pytest

from seg.classes import CAMVID_11, CITYSCAPES_19, IGNORE_LABEL, class_table

TABLES = (CITYSCAPES_19, CAMVID_11)


@pytest.mark.parametrize(("table", "count"), [(CITYSCAPES_19, 19), (CAMVID_11, 11)])
def test_sizes(table, count):
    assert len(table.classes) == len(set(table.classes)) == count
    assert table.colors.shape == (count, 3)
    assert len(np.unique(table.colors, axis=0)) == count


@pytest.mark.parametrize(
    ("city", "camvid"),
    [
        ("road", "road"),
        ("sidewalk", "sidewalk"),
        ("building", "building"),
        ("wall", "building"),
        ("fence", "fence"),
        ("pole", "pole"),
        ("traffic light", "sign"),
        ("traffic sign", "sign"),
        ("vegetation", "tree"),
        ("terrain", "tree"),
        ("sky", "sky"),
        ("person", "pedestrian"),
        ("rider", "bicyclist"),
        ("car", "car"),
        ("truck", "car"),
        ("bus", "car"),
        ("train", None),
        ("motorcycle", "bicyclist"),
        ("bicycle", "bicyclist"),
    ],
)
def test_cityscapes_to_camvid(city, camvid):
    mapped = CAMVID_11.from_train_id[CITYSCAPES_19.classes.index(city)]
    assert mapped == (IGNORE_LABEL if camvid is None else CAMVID_11.classes.index(camvid))


def test_cityscapes_train_ids_are_its_own():
    np.testing.assert_array_equal(CITYSCAPES_19.from_train_id[:19], np.arange(19))


@pytest.mark.parametrize(
    ("value", "name"), [(7, "road"), (11, "building"), (26, "car"), (33, "bicycle"), (17, "pole")]
)
def test_cityscapes_files_hold_label_ids(value, name):
    assert CITYSCAPES_19.classes[CITYSCAPES_19.from_file[value]] == name


@pytest.mark.parametrize("value", [0, 1, 4, 9, 16, 29, 30])
def test_cityscapes_void_values(value):
    assert CITYSCAPES_19.legal[value]
    assert CITYSCAPES_19.from_file[value] == IGNORE_LABEL


def test_camvid_void_is_eleven():
    assert CAMVID_11.legal[11] and not CAMVID_11.legal[12]
    assert CAMVID_11.from_file[11] == IGNORE_LABEL


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
@pytest.mark.parametrize("source", ["from_train_id", "from_file"])
def test_every_class_is_reached_and_the_rest_is_void(table, source):
    reached = set(getattr(table, source).tolist())
    assert reached == {*range(len(table.classes)), IGNORE_LABEL}
    assert getattr(table, source)[IGNORE_LABEL] == IGNORE_LABEL


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_only_legal_values_mean_something(table):
    assert table.legal[table.from_file != IGNORE_LABEL].all()


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_tables_cannot_be_changed(table):
    with pytest.raises(ValueError, match="read-only"):
        table.from_file[0] = 3


def test_lookup():
    assert class_table("camvid") is CAMVID_11
    with pytest.raises(ValueError, match=r"unknown class table 'kitti'; known.*camvid, cityscapes"):
        class_table("kitti")
