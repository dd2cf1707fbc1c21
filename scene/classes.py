"""The classes that the engine renders: train ids by name, and their names, file ids and colours as arrays."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from common.errors import UserError
from common.labels.classes import CLASSES, NAMES
from common.labels.classes import OWN as OWN_ROW
from common.labels.classes import VOID as VOID


class TrainId(IntEnum):
    """Cityscapes train ids 0-18."""

    ROAD = 0
    SIDEWALK = 1
    BUILDING = 2
    WALL = 3
    FENCE = 4
    POLE = 5
    TRAFFIC_LIGHT = 6
    TRAFFIC_SIGN = 7
    VEGETATION = 8
    TERRAIN = 9
    SKY = 10
    PERSON = 11
    RIDER = 12
    CAR = 13
    TRUCK = 14
    BUS = 15
    TRAIN = 16
    MOTORCYCLE = 17
    BICYCLE = 18


CLASS_NAMES: tuple[str, ...] = NAMES

OWN = len(CLASS_NAMES)
"""Train id of the user's own class, if there is one."""
LONGEST = 40
"""The largest number of characters of its name."""

LABEL_IDS = np.array([row.file_id for row in CLASSES], np.uint8)
"""u8[19]: the value of each train id in ``*_gtFine_labelIds.png``."""

COLORS = np.array([row.colour for row in CLASSES], np.uint8)
"""u8[19, 3]: the published colour (sRGB) of each train id."""


def colorize(label: np.ndarray) -> np.ndarray:
    """Colour a label image u8[..., h, w] of train ids, u8[..., h, w, 3]; ignored pixels are black."""
    table = np.zeros((256, 3), np.uint8)
    table[: len(COLORS)] = COLORS
    table[OWN] = OWN_ROW.colour
    return table[label]


def check_class_name(name: str) -> str:
    """Return the name of a user's own class if it is valid.

    Raises:
        UserError: it is empty, too long, has several lines, or is the name of another class.
    """
    if not name.strip() or name != " ".join(name.split()) or not name.isprintable():
        raise UserError(f"own class {name!r}: a name must be words, separated by single spaces")
    if len(name) > LONGEST:
        raise UserError(
            f"own class {name!r}: a name has at most {LONGEST} characters, not {len(name)}"
        )
    taken = (*CLASS_NAMES, "void")
    if name.replace("_", " ").lower() in taken:
        raise UserError(f"own class {name!r}: this class already exists; taken: {', '.join(taken)}")
    return name
