"""The layout of COCO: pictures in flat folders, and what is in them in two JSON files.

``images/``, ``panoptic/``, ``depth/`` and ``normals/`` hold one PNG per image, ``camera/`` one JSON.
``annotations/instances.json`` has boxes and masks of all things, ``annotations/panoptic.json`` all segments
of COCO's panoptic format. Category ids are the labelIds of Cityscapes. Masks are run-length text, since
polygons could not be exact. Source: cocodataset.org, "Data format".
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from scene.classes import CLASS_NAMES, COLORS, LABEL_IDS
from scene.dataset.formats.segments import is_thing

Records = Callable[[], Iterable[dict[str, Any]]]
"""Begins anew with every call: what ``export`` keeps about each image, in order."""

FILES = {
    "image": "images/{stem}.png",
    "panoptic": "panoptic/{stem}.png",
    "depth": "depth/{stem}.png",
    "normals": "normals/{stem}.png",
    "camera": "camera/{stem}.json",
}
"""Kind -> path in the dataset."""

SUPERCATEGORIES = (
    *("flat", "flat", "construction", "construction", "construction"),
    *("object", "object", "object", "nature", "nature", "sky", "human", "human"),
    *("vehicle",) * 6,
)
"""Category of each train id, as published with Cityscapes."""


def summaries(split: str) -> dict[str, str]:
    """Name -> path of the files about all images."""
    return {"instances": "annotations/instances.json", "panoptic": "annotations/panoptic.json"}


def summary_text(name: str, split: str, records: Records, size: tuple[int, int]) -> Iterator[str]:
    """One of the ``summaries``, in pieces; ``size`` is (width, height) in pixels."""
    if name == "instances":
        return json_lines(instances(records, size, lambda stem: f"{stem}.png"))
    return json_lines(panoptic(records, size))


def categories(things_only: bool = False) -> list[dict[str, Any]]:
    """The classes, with the labelIds of Cityscapes for ids."""
    return [
        {
            "id": int(LABEL_IDS[train_id]),
            "name": name,
            "supercategory": SUPERCATEGORIES[train_id],
            "isthing": int(is_thing(train_id)),
            "color": COLORS[train_id].tolist(),
        }
        for train_id, name in enumerate(CLASS_NAMES)
        if is_thing(train_id) or not things_only
    ]


def _images(
    records: Records, size: tuple[int, int], file_name: Callable[[str], str]
) -> Iterator[dict[str, Any]]:
    for number, record in enumerate(records(), start=1):
        name = file_name(record["stem"])
        yield {"id": number, "width": size[0], "height": size[1], "file_name": name}


def instances(
    records: Records, size: tuple[int, int], file_name: Callable[[str], str]
) -> dict[str, Iterable[Any]]:
    """COCO's object detection: a box, an area and a mask for every thing in every image.

    Args:
        records: what is known of every image.
        size: width and height in pixels.
        file_name: the image's name in the JSON file from its stem.
    """

    def annotations() -> Iterator[dict[str, Any]]:
        number = 0
        for image, record in enumerate(records(), start=1):
            for segment in record["segments"]:
                if "rle" not in segment:
                    continue
                number += 1
                yield {
                    "id": number,
                    "image_id": image,
                    "category_id": segment["category_id"],
                    "bbox": segment["bbox"],
                    "area": segment["area"],
                    "iscrowd": 0,
                    "segmentation": {"size": [size[1], size[0]], "counts": segment["rle"]},
                }

    return {
        "images": _images(records, size, file_name),
        "annotations": annotations(),
        "categories": categories(things_only=True),
    }


def panoptic_segment(segment: dict[str, Any]) -> dict[str, Any]:
    """A segment as the panoptic format wants it."""
    keys = ("id", "category_id", "area", "bbox")
    return {**{key: segment[key] for key in keys}, "iscrowd": 0}


def panoptic(records: Records, size: tuple[int, int]) -> dict[str, Iterable[Any]]:
    """COCO's panoptic segmentation."""
    annotations = (
        {
            "image_id": number,
            "file_name": f"{record['stem']}.png",
            "segments_info": [panoptic_segment(s) for s in record["segments"]],
        }
        for number, record in enumerate(records(), start=1)
    )
    return {
        "images": _images(records, size, lambda stem: f"{stem}.png"),
        "annotations": annotations,
        "categories": categories(),
    }


def json_lines(members: dict[str, Iterable[Any]]) -> Iterator[str]:
    """A JSON object of lists, one item a line, without holding the lists in memory."""
    yield "{"
    for position, (name, items) in enumerate(members.items()):
        yield f"{',' if position else ''}\n{json.dumps(name)}: ["
        for number, item in enumerate(items):
            yield f"{',' if number else ''}\n{json.dumps(item, allow_nan=False)}"
        yield "]"
    yield "\n}\n"
