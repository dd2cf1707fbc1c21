"""The table of the engine's 19 classes: names, ids in label files and colours, as published with Cityscapes.

`scene` renders these classes; `seg` and the files of targets map them to others.
"""

from __future__ import annotations

from typing import NamedTuple

VOID = 255
"""Id of void pixels, which are ignored."""


class EngineClass(NamedTuple):
    """A class that the engine renders; its index in `CLASSES` is its train id."""

    name: str
    file_id: int  # in ``*_gtFine_labelIds.png``
    colour: tuple[int, int, int]  # sRGB


class Outline(NamedTuple):
    """How annotators draw a class: as a whole, with the holes through which the sky shows."""

    train_ids: tuple[int, ...]  # the engine's classes in it
    width: float  # of the widest holes that are closed, as a share of the image's width


CLASSES = (
    EngineClass("road", 7, (128, 64, 128)),
    EngineClass("sidewalk", 8, (244, 35, 232)),
    EngineClass("building", 11, (70, 70, 70)),
    EngineClass("wall", 12, (102, 102, 156)),
    EngineClass("fence", 13, (190, 153, 153)),
    EngineClass("pole", 17, (153, 153, 153)),
    EngineClass("traffic light", 19, (250, 170, 30)),
    EngineClass("traffic sign", 20, (220, 220, 0)),
    EngineClass("vegetation", 21, (107, 142, 35)),
    EngineClass("terrain", 22, (152, 251, 152)),
    EngineClass("sky", 23, (70, 130, 180)),
    EngineClass("person", 24, (220, 20, 60)),
    EngineClass("rider", 25, (255, 0, 0)),
    EngineClass("car", 26, (0, 0, 142)),
    EngineClass("truck", 27, (0, 0, 70)),
    EngineClass("bus", 28, (0, 60, 100)),
    EngineClass("train", 31, (0, 80, 100)),
    EngineClass("motorcycle", 32, (0, 0, 230)),
    EngineClass("bicycle", 33, (119, 11, 32)),
)
OWN = EngineClass("", 34, (0, 255, 255))
"""A user's own class, which comes after these; the user names it, and its id follows the published ones."""
NAMES: tuple[str, ...] = tuple(row.name for row in CLASSES)
