"""Class tables: names, colours, and the maps from other labels to a table's ids.

A table's ids are 0 .. len(classes) - 1; `IGNORE_LABEL` marks void. Every array of labels inside the
package holds table ids. Renderers write Cityscapes train ids; `from_train_id` maps those.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, UInt8

IGNORE_LABEL = 255


@dataclass(frozen=True, eq=False)
class ClassTable:
    """One set of classes to segment, and how labels from elsewhere map onto it.

    Attributes:
        name: what `class_table` knows it by.
        classes: class names, in the order of the ids.
        colors: u8[classes, 3], RGB for pictures.
        from_train_id: u8[256], Cityscapes train id -> id of this table, `IGNORE_LABEL` for void.
        from_file: u8[256], value in a label file of this data set -> id of this table.
        legal: bool[256], the values that may stand in a label file of this data set.
    """

    name: str
    classes: tuple[str, ...]
    colors: UInt8[np.ndarray, "classes 3"]
    from_train_id: UInt8[np.ndarray, "256"]
    from_file: UInt8[np.ndarray, "256"]
    legal: Bool[np.ndarray, "256"]


def _lut(pairs: dict[int, int]) -> np.ndarray:
    lut = np.full(256, IGNORE_LABEL, np.uint8)
    for value, index in pairs.items():
        lut[value] = index
    lut.flags.writeable = False
    return lut


def _legal(highest_value: int) -> np.ndarray:
    legal = np.arange(256) <= highest_value
    legal.flags.writeable = False
    return legal


def _table(
    name: str,
    colors: dict[str, tuple[int, int, int]],
    from_train_id: dict[int, int],
    from_file: dict[int, int],
    highest_value: int,
) -> ClassTable:
    palette = np.array(list(colors.values()), np.uint8)
    palette.flags.writeable = False
    luts = _lut(from_train_id), _lut(from_file)
    return ClassTable(name, tuple(colors), palette, *luts, _legal(highest_value))


CITYSCAPES_19 = _table(
    "cityscapes",
    {
        "road": (128, 64, 128),
        "sidewalk": (244, 35, 232),
        "building": (70, 70, 70),
        "wall": (102, 102, 156),
        "fence": (190, 153, 153),
        "pole": (153, 153, 153),
        "traffic light": (250, 170, 30),
        "traffic sign": (220, 220, 0),
        "vegetation": (107, 142, 35),
        "terrain": (152, 251, 152),
        "sky": (70, 130, 180),
        "person": (220, 20, 60),
        "rider": (255, 0, 0),
        "car": (0, 0, 142),
        "truck": (0, 0, 70),
        "bus": (0, 60, 100),
        "train": (0, 80, 100),
        "motorcycle": (0, 0, 230),
        "bicycle": (119, 11, 32),
    },
    from_train_id={index: index for index in range(19)},
    # labelIds -> train ids, from the data set's own labels.py.
    from_file={
        value: index
        for index, value in enumerate(
            (7, 8, 11, 12, 13, 17, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 31, 32, 33)
        )
    },
    highest_value=33,
)

# Label files of the computer game hold Cityscapes' labelIds; 34 is the licence plate. Source: Richter et al.,
# "Playing for data: ground truth from computer games" (2016).
GTA5_19 = replace(CITYSCAPES_19, name="gta5", legal=_legal(34))

# Ids of RAND-CITYSCAPES; parking slots, road works and lane markings (13, 14, 22) become void. Source:
# Ros et al., "The SYNTHIA dataset" (2016), and the mapping used since Zou et al. (2018).
SYNTHIA_19 = replace(
    CITYSCAPES_19,
    name="synthia",
    from_file=_lut(
        {
            value: index
            for index, value in enumerate(
                (3, 4, 2, 21, 5, 7, 15, 9, 6, 16, 1, 10, 17, 8, 18, 19, 20, 12, 11)
            )
        }
    ),
    legal=_legal(22),
)

SYNTHIA_16 = tuple(
    k for k in range(19) if CITYSCAPES_19.classes[k] not in ("terrain", "truck", "train")
)
SYNTHIA_13 = tuple(
    k for k in SYNTHIA_16 if CITYSCAPES_19.classes[k] not in ("wall", "fence", "pole")
)
"""Cityscapes ids of the 16 and 13 classes over which nets trained on SYNTHIA are compared."""

_SKY, _BUILDING, _POLE, _ROAD, _SIDEWALK, _TREE, _SIGN, _FENCE, _CAR, _PEDESTRIAN, _BICYCLIST = (
    range(11)
)

CAMVID_11 = _table(
    "camvid",
    {
        "sky": (128, 128, 128),
        "building": (128, 0, 0),
        "pole": (192, 192, 128),
        "road": (128, 64, 128),
        "sidewalk": (60, 40, 222),
        "tree": (128, 128, 0),
        "sign": (192, 128, 128),
        "fence": (64, 64, 128),
        "car": (64, 0, 128),
        "pedestrian": (64, 64, 0),
        "bicyclist": (0, 128, 192),
    },
    # Train (16) has no counterpart and becomes void.
    from_train_id={
        0: _ROAD,
        1: _SIDEWALK,
        2: _BUILDING,
        3: _BUILDING,
        4: _FENCE,
        5: _POLE,
        6: _SIGN,
        7: _SIGN,
        8: _TREE,
        9: _TREE,
        10: _SKY,
        11: _PEDESTRIAN,
        12: _BICYCLIST,
        13: _CAR,
        14: _CAR,
        15: _CAR,
        17: _BICYCLIST,
        18: _BICYCLIST,
    },
    from_file={value: value for value in range(11)},
    highest_value=11,
)

_FACADE = {
    "building": ("building", "wall", "fence"),
    "car": ("car", "truck", "bus"),
    "sidewalk": ("sidewalk",),
    "road": ("road",),
    "sky": ("sky",),
    "vegetation": ("vegetation", "terrain"),
}
"""Class of LabelMeFacade -> those of Cityscapes that it holds; all others are void there."""

LABELMEFACADE_6 = _table(
    "labelmefacade",
    {
        "building": (128, 0, 0),
        "car": (128, 0, 128),
        "sidewalk": (128, 128, 128),
        "road": (128, 64, 0),
        "sky": (0, 128, 128),
        "vegetation": (0, 128, 0),
    },
    from_train_id={
        CITYSCAPES_19.classes.index(name): k
        for k, names in enumerate(_FACADE.values())
        for name in names
    },
    # Its files hold colours; a value is the place of a pixel's colour in `seg.data.labelmefacade.COLORS`,
    # where building, door and window are the first three and void is the last.
    from_file={0: 0, 1: 0, 2: 0, 3: 1, 4: 2, 5: 3, 6: 4, 7: 5},
    highest_value=8,
)
"""The classes that LabelMeFacade and renders both have.

It has two more, door and window. Renders have no label for them: to the engine they are parts of buildings,
so they are building here, too.
"""

_TABLES = {table.name: table for table in (CITYSCAPES_19, CAMVID_11, LABELMEFACADE_6)}


def class_table(name: str) -> ClassTable:
    """Look a class table up by name, "cityscapes", "camvid" or "labelmefacade".

    Raises:
        ValueError: no table has that name; the message lists those that exist.
    """
    if name not in _TABLES:
        raise ValueError(
            f"unknown class table {name!r}; known tables: {', '.join(sorted(_TABLES))}"
        )
    return _TABLES[name]
