"""The JSON files of COCO: things with boxes and masks, panoptic segments, and classes with masks.

Category ids of things and segments are the labelIds of Cityscapes. Masks are run-length encoded, since
polygons are not exact. Source: cocodataset.org, "Data format".
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

from common.labels.classes import CLASSES, OWN
from scene.dataset.formats.about import About
from scene.dataset.formats.labels import Labels
from scene.dataset.formats.segments import PER_CLASS, is_thing

SUPERCATEGORIES = (
    *("flat", "flat", "construction", "construction", "construction"),
    *("object", "object", "object", "nature", "nature", "sky", "human", "human"),
    *("vehicle",) * 6,
)
"""Supercategory of each train id, as published with Cityscapes."""
OWN_SUPERCATEGORY = "object"
"""Supercategory of a user's own class."""


def categories(labels: Labels, things_only: bool = False) -> list[dict[str, Any]]:
    """The classes of streets, with the labelIds of Cityscapes as ids."""
    rows = zip(
        labels.rendered, (*CLASSES, OWN), (*SUPERCATEGORIES, OWN_SUPERCATEGORY), strict=False
    )
    return [
        {
            "id": row.file_id,
            "name": name,
            "supercategory": category,
            "isthing": int(is_thing(train_id)),
            "color": list(row.colour),
        }
        for train_id, (name, row, category) in enumerate(rows)
        if is_thing(train_id) or not things_only
    ]


def _images(about: About, file_name: str, by_stem: bool = False) -> Iterator[dict[str, Any]]:
    for number, record in enumerate(about.records(), start=1):
        name = file_name.format(split=about.split, stem=record["stem"])
        width, height = about.size
        image_id = record["stem"] if by_stem else number
        yield {"id": image_id, "width": width, "height": height, "file_name": name}


def instances(about: About, file_name: str) -> Iterator[str]:
    """COCO's object detection: a box, an area and a mask for every thing in every image.

    Args:
        about: the dataset.
        file_name: the image's name in the JSON file, with {split} and {stem}.
    """
    return json_lines(
        {
            "images": _images(about, file_name),
            "annotations": _masks(about, "segments", PER_CLASS),
            "categories": categories(about.labels, things_only=True),
        }
    )


def semantic(about: About, file_name: str) -> Iterator[str]:
    """COCO's stuff segmentation: a mask of each class in every image, also of things.

    The categories are the classes of the dataset's labels, with their ids in label images.

    Args:
        about: the dataset.
        file_name: the image's name in the JSON file, with {split} and {stem}.
    """
    labels = about.labels
    rows = [
        {"id": category, "name": name, "isthing": int(k in labels.things), "color": colour}
        for k, (category, name, colour) in enumerate(
            zip(labels.category_ids, labels.names, labels.colours.tolist(), strict=False)
        )
    ]
    return json_lines(
        {
            "images": _images(about, file_name),
            "annotations": _masks(about, "classes", 0),
            "categories": rows,
        }
    )


def _masks(about: About, kind: str, least: int) -> Iterator[dict[str, Any]]:
    """The annotations of the records' ``segments`` or ``classes`` with ids of ``least`` or more."""
    number = 0
    width, height = about.size
    for image, record in enumerate(about.records(), start=1):
        for segment in record[kind]:
            if segment["id"] < least:
                continue
            number += 1
            yield {
                "id": number,
                "image_id": image,
                "category_id": segment["category_id"],
                "bbox": segment["bbox"],
                "area": segment["area"],
                "iscrowd": 0,
                "segmentation": {"size": [height, width], "counts": segment["rle"]},
            }


def panoptic_segment(segment: dict[str, Any]) -> dict[str, Any]:
    """A segment in the panoptic format."""
    keys = ("id", "category_id", "area", "bbox")
    return {**{key: segment[key] for key in keys}, "iscrowd": 0}


def panoptic(
    about: About, file_name: str = "{stem}.png", segments: str = "{stem}.png", by_stem: bool = False
) -> Iterator[str]:
    """COCO's panoptic segmentation, which Cityscapes' ``createPanopticImgs`` writes, too.

    Args:
        about: the dataset.
        file_name: the image's name in the JSON file, with {stem}.
        segments: the name of its segment image, with {stem}.
        by_stem: whether image ids are stems; otherwise they are 1, 2, 3 ...
    """
    annotations = (
        {
            "image_id": record["stem"] if by_stem else number,
            "file_name": segments.format(stem=record["stem"]),
            "segments_info": [panoptic_segment(s) for s in record["segments"]],
        }
        for number, record in enumerate(about.records(), start=1)
    )
    return json_lines(
        {
            "images": _images(about, file_name, by_stem),
            "annotations": annotations,
            "categories": categories(about.labels),
        }
    )


def json_lines(members: dict[str, Iterable[Any]]) -> Iterator[str]:
    """Yield a JSON object of lists, one item per line, without holding the lists in memory."""
    yield "{"
    for position, (name, items) in enumerate(members.items()):
        yield f"{',' if position else ''}\n{json.dumps(name)}: ["
        for number, item in enumerate(items):
            yield f"{',' if number else ''}\n{json.dumps(item, allow_nan=False)}"
        yield "]"
    yield "\n}\n"
