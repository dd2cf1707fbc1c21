"""Panoptic segments: one id per pixel, and the label, area and box of each id.

Ids follow Cityscapes: ``labelId * 1000 + k`` for the k-th object of a class with instances (person to
bicycle, and a user's own), ``labelId`` for all pixels of any other class together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.labels.classes import OWN as OWN_ROW
from scene.classes import LABEL_IDS, OWN, VOID, TrainId
from scene.compiled import njit

FIRST_THING = int(TrainId.PERSON)
"""Train ids from here on are things, which have instances."""
PER_CLASS = 1000
"""The largest number of objects of one class in one image."""

LABEL_OF_TRAIN = np.zeros(256, np.uint8)
"""u8[256]: train id -> Cityscapes labelId, 0 (unlabelled) for ignored pixels."""
LABEL_OF_TRAIN[: OWN + 1] = [*LABEL_IDS, OWN_ROW.file_id]
TRAIN_OF_LABEL = np.full(256, VOID, np.uint8)
"""u8[256]: Cityscapes labelId -> train id, VOID for classes that are not evaluated."""
TRAIN_OF_LABEL[LABEL_OF_TRAIN[: OWN + 1]] = np.arange(OWN + 1)
for _table in (LABEL_OF_TRAIN, TRAIN_OF_LABEL):
    _table.setflags(write=False)


class Segment(NamedTuple):
    """The pixels of one id."""

    id: int
    label_id: int
    area: int  # pixels
    box: tuple[int, int, int, int]  # left, top, width, height in pixels


def is_thing(train_id: int) -> bool:
    """Whether the class has instances."""
    return FIRST_THING <= train_id <= OWN


def panoptic_ids(label: np.ndarray, instance: np.ndarray) -> np.ndarray:
    """Segment ids i32[h, w] from train ids u8[h, w] and instances u16[h, w] of a street.

    Objects of a class are numbered from 0 in the order of the street's instances.

    Raises:
        ValueError: a class has more objects than ids.
    """
    ids = LABEL_OF_TRAIN[label].astype(np.int32)
    things = (label >= FIRST_THING) & (label <= OWN)
    thing_instances = instance[things]
    class_at = np.full(int(thing_instances.max(initial=0)) + 1, VOID, np.uint8)
    class_at[thing_instances] = label[things]
    visible = np.flatnonzero(class_at != VOID)
    class_of = class_at[visible]
    number = np.zeros(len(visible), np.int32)
    for train_id in np.unique(class_of):
        members = class_of == train_id
        if members.sum() > PER_CLASS:
            raise ValueError(f"more than {PER_CLASS} objects of train id {train_id} in one image")
        number[members] = np.arange(members.sum())
    id_at = np.zeros(len(class_at), np.int32)
    id_at[visible] = LABEL_OF_TRAIN[class_of].astype(np.int32) * PER_CLASS + number
    ids[things] = id_at[thing_instances]
    return ids


def label_ids(ids: np.ndarray) -> np.ndarray:
    """Cityscapes labelIds u8[h, w] of segment ids."""
    return np.where(ids < PER_CLASS, ids, ids // PER_CLASS).astype(np.uint8)


def segments(ids: np.ndarray) -> list[Segment]:
    """All segments of an image in the order of their ids; unlabelled pixels (0) have none."""
    areas = np.bincount(ids.ravel())  # ids are small, so this is far cheaper than sorting
    values = np.flatnonzero(areas)
    rank = np.zeros(len(areas), np.int32)
    rank[values] = np.arange(len(values))
    rows = []
    for value, box in zip(values, _boxes(rank[ids], len(values)).tolist(), strict=True):
        if value == 0:
            continue
        label = int(value) if value < PER_CLASS else int(value) // PER_CLASS
        rows.append(Segment(int(value), label, int(areas[value]), tuple(box)))
    return rows


@njit(cache=True)
def _boxes(rank: np.ndarray, count: int) -> np.ndarray:
    """Left, top, width and height i32[count, 4] of the pixels of each rank; all ranks occur."""
    height, width = rank.shape
    boxes = np.empty((count, 4), np.int32)
    boxes[:, 0], boxes[:, 1], boxes[:, 2:] = width, height, 0
    for row in range(height):
        for column in range(width):
            box = boxes[rank[row, column]]
            box[0], box[2] = min(box[0], column), max(box[2], column + 1)
            box[1], box[3] = min(box[1], row), max(box[3], row + 1)
    boxes[:, 2:] -= boxes[:, :2]
    return boxes
