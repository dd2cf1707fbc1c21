"""Verify one image of a dataset by comparing its labels with each other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from common.files import read_bytes, read_json
from common.pictures import MOST_BYTES
from scene.classes import VOID, TrainId
from scene.dataset.formats import rle
from scene.dataset.formats.labels import ILLEGAL, Labels
from scene.dataset.formats.planes import ids_of, label_planes, normals_of
from scene.dataset.formats.segments import (
    PER_CLASS,
    TRAIN_OF_LABEL,
    Segment,
    is_thing,
    label_ids,
    segments,
)
from scene.dataset.formats.yolo import area
from scene.dataset.read import Described

ROUNDING = 0.02
"""Tolerance of the length of a normal, which is stored in bytes."""


def load(dataset: Described, name: str) -> tuple[dict[str, np.ndarray], list[str]]:
    """Read all arrays of one image; also returns the faults of files that cannot be read."""
    planes: dict[str, np.ndarray] = {}
    faults: list[str] = []
    for kind in dataset.layout.files:
        path = dataset.path(kind, name)
        try:
            if kind == "camera":
                _check_camera(path)
                continue
            if kind == "objects":
                planes[kind] = _areas(path, dataset)
                continue
            planes[kind] = dataset.array(kind, name)
        except FileNotFoundError:
            faults.append(f"{path} is missing")
        except (OSError, ValueError) as error:
            faults.append(str(error))
    return planes, faults


def _check_camera(path: Path) -> None:
    """Raise ValueError if the camera file lacks a field."""
    camera = read_json(path)
    for part, names in (
        ("extrinsic", "x y z yaw pitch roll baseline"),
        ("intrinsic", "fx fy u0 v0"),
    ):
        for name in names.split():
            try:
                value = camera[part][name]
            except (LookupError, TypeError):
                value = None
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{path}: {part}.{name} must be a number, not {value!r}")


def _areas(path: Path, dataset: Described) -> np.ndarray:
    """Pixels f64[classes] inside the outlines of objects in a file.

    Raises:
        ValueError: a line is not an outline of an object; the message names file and line.
    """
    things, areas = dataset.labels.things, np.zeros(len(dataset.labels.names))
    for number, line in enumerate(
        read_bytes(path, MOST_BYTES).decode("ascii", "replace").split("\n")
    ):
        if not line:
            continue
        try:
            thing, *shares = line.split(" ")
            corners = np.array(shares, float).reshape(-1, 2)
            if not thing.isdecimal() or int(thing) >= len(things) or len(corners) < 3:
                raise ValueError
            if not ((corners >= 0) & (corners <= 1)).all():
                raise ValueError
        except ValueError:
            raise ValueError(
                f"{path}, line {number + 1}: expected a class below {len(things)}, then x and y of "
                "three corners or more, all in [0, 1]"
            ) from None
        areas[things[int(thing)]] += abs(area(corners * dataset.size))
    return areas


def verify(planes: dict[str, np.ndarray], entries: dict[str, Any], labels: Labels) -> Iterator[str]:
    """Yield every disagreement in one image.

    Args:
        planes: its readable arrays by kind.
        entries: its entries in the summary files: ``panoptic``, the segments, ``instances``, the annotations
            of things, and ``semantic``, those of classes.
        labels: the classes of label images.
    """
    if "panoptic" not in planes:
        if "label_ids" in planes:
            strange = np.count_nonzero(labels.classes_of(planes["label_ids"]) == ILLEGAL)
            if strange:
                yield f"label_ids: {strange} pixels have a value of no class"
        return
    ids = ids_of(planes["panoptic"])
    yield from _illegal(ids, labels.rendered)
    label = label_ids(ids)
    train = TRAIN_OF_LABEL[label]
    derived = {"instance_ids": ids, **label_planes(train, labels)}
    for kind, expected in derived.items():
        if kind in planes:
            wrong = planes[kind] != expected
            if wrong.any():
                yield f"{kind}: {np.count_nonzero(wrong)} values differ from the panoptic segments"
    if "panoptic" in entries:
        yield from _segments(ids, entries["panoptic"])
    if "instances" in entries:
        yield from _masks(
            ids, [s for s in segments(ids) if s.id >= PER_CLASS], entries["instances"]
        )
    if "semantic" in entries:
        numbers = np.where(
            derived["train_ids"] == VOID, 0, derived["train_ids"].astype(np.int32) + 1
        )
        class_segments = [
            s._replace(label_id=labels.category_ids[s.id - 1]) for s in segments(numbers)
        ]
        yield from _masks(numbers, class_segments, entries["semantic"])
    sky = train == TrainId.SKY
    for kind in ("depth", "disparity", "normals"):
        if kind in planes and not labels.outlines:  # outlines change what is sky
            empty = ~planes[kind].any(axis=2) if planes[kind].ndim == 3 else planes[kind] == 0
            wrong = empty != sky
            if wrong.any():
                yield f"{kind}: {np.count_nonzero(wrong)} pixels disagree on what is sky"
    if "normals" in planes:
        length = np.linalg.norm(normals_of(planes["normals"]), axis=2)
        solid = planes["normals"].any(axis=2) if labels.outlines else ~sky
        wrong = solid & (np.abs(length - 1) > ROUNDING)
        if wrong.any():
            yield f"normals: {np.count_nonzero(wrong)} do not have length 1"


def _illegal(ids: np.ndarray, names: tuple[str, ...]) -> Iterator[str]:
    for value in np.unique(ids).tolist():
        label = value if value < PER_CLASS else value // PER_CLASS
        train_id = int(TRAIN_OF_LABEL[label]) if label < len(TRAIN_OF_LABEL) else 255
        if value == 0:
            continue
        if train_id >= len(names):
            yield f"panoptic: segment {value} belongs to no class"
        elif is_thing(train_id) != (value >= PER_CLASS):
            yield f"panoptic: segment {value} is not a valid id for the class {names[train_id]}"


def _segments(ids: np.ndarray, entries: list[dict[str, Any]]) -> Iterator[str]:
    """Compare segments of the image with the listed ones: ids, classes, areas, boxes."""
    actual = {s.id: (s.label_id, s.area, list(s.box)) for s in segments(ids)}
    stated = {s.get("id"): (s.get("category_id"), s.get("area"), s.get("bbox")) for s in entries}
    for name in sorted(actual.keys() | stated.keys(), key=str):
        if name not in stated:
            yield f"segment {name} is in the image but not in the list"
        elif name not in actual:
            yield f"segment {name} is in the list but not in the image"
        elif actual[name] != stated[name]:
            yield f"segment {name} has (class, area, box) {actual[name]}, but the list has {stated[name]}"
    if len(stated) != len(entries):
        yield f"the list has {len(entries)} segments, but {len(stated)} different ids"


def _masks(
    ids: np.ndarray, expected: list[Segment], annotations: list[dict[str, Any]]
) -> Iterator[str]:
    """Compare segments with their annotations: every mask must be one whole segment with its box."""
    left = {s.id: s for s in expected}
    for annotation in annotations:
        where = f"annotation {annotation.get('id')}"
        try:
            mask = rle.mask(rle.decode(annotation["segmentation"]["counts"]), *ids.shape)
            stated = (annotation["category_id"], annotation["area"], annotation["bbox"])
        except (LookupError, TypeError, ValueError) as error:
            yield f"{where} cannot be read: {error}"
            continue
        inside = np.unique(ids[mask])
        segment = left.pop(int(inside[0]), None) if len(inside) == 1 else None
        if segment is None or segment.area != mask.sum():
            yield f"{where}: its mask is not one object"
        elif stated != (segment.label_id, segment.area, list(segment.box)):
            yield f"{where}: class, area or box {stated} do not match its mask"
    for segment in left.values():
        yield f"segment {segment.id} has no annotation"
