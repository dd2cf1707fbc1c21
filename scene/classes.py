"""The 19 Cityscapes classes: train ids, file ids and colours, as published with Cityscapes."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

VOID = 255
"""Train id of pixels that count for nothing."""


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


CLASS_NAMES: tuple[str, ...] = tuple(c.name.lower().replace("_", " ") for c in TrainId)

LABEL_IDS = np.array(
    [7, 8, 11, 12, 13, 17, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 31, 32, 33], np.uint8
)
"""u8[19]: the value of each train id in ``*_gtFine_labelIds.png``."""

COLORS = np.array([
    [128, 64, 128], [244, 35, 232], [70, 70, 70], [102, 102, 156], [190, 153, 153], [153, 153, 153],
    [250, 170, 30], [220, 220, 0], [107, 142, 35], [152, 251, 152], [70, 130, 180], [220, 20, 60],
    [255, 0, 0], [0, 0, 142], [0, 0, 70], [0, 60, 100], [0, 80, 100], [0, 0, 230], [119, 11, 32],
], np.uint8)  # fmt: skip
"""u8[19, 3]: the published colour (sRGB) of each train id."""


def colorize(label: np.ndarray) -> np.ndarray:
    """Label image u8[..., h, w] of train ids as u8[..., h, w, 3] colours; void is black."""
    table = np.zeros((256, 3), np.uint8)
    table[: len(COLORS)] = COLORS
    return table[label]
