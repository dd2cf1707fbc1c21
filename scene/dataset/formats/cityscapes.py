"""The layout of Cityscapes, with what it offers for depth and cameras, and three folders of our own.

``leftImg8bit``, ``gtFine``, ``disparity`` and ``camera`` as published; the panoptic files in ``gtFine`` are
those that Cityscapes' own ``createPanopticImgs`` would make. Ours are ``depth``, ``normals`` and
``annotations/instances_<split>.json``, which has boxes and masks in COCO's format.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from scene.dataset.formats import coco

CITY = "scenex"

FILES = {
    "image": f"leftImg8bit/{{split}}/{CITY}/{{stem}}_leftImg8bit.png",
    "label_ids": f"gtFine/{{split}}/{CITY}/{{stem}}_gtFine_labelIds.png",
    "train_ids": f"gtFine/{{split}}/{CITY}/{{stem}}_gtFine_labelTrainIds.png",
    "instance_ids": f"gtFine/{{split}}/{CITY}/{{stem}}_gtFine_instanceIds.png",
    "color": f"gtFine/{{split}}/{CITY}/{{stem}}_gtFine_color.png",
    "panoptic": "gtFine/cityscapes_panoptic_{split}/{stem}_gtFine_panoptic.png",
    "depth": f"depth/{{split}}/{CITY}/{{stem}}_depth.png",
    "disparity": f"disparity/{{split}}/{CITY}/{{stem}}_disparity.png",
    "normals": f"normals/{{split}}/{CITY}/{{stem}}_normals.png",
    "camera": f"camera/{{split}}/{CITY}/{{stem}}_camera.json",
}
"""Kind -> path in the dataset."""


def summaries(split: str) -> dict[str, str]:
    """Name -> path of the files about all images."""
    return {
        "instances": f"annotations/instances_{split}.json",
        "panoptic": f"gtFine/cityscapes_panoptic_{split}.json",
    }


def summary_text(
    name: str, split: str, records: coco.Records, size: tuple[int, int]
) -> Iterator[str]:
    """One of the ``summaries``, in pieces; ``size`` is (width, height) in pixels."""
    if name == "instances":
        image = FILES["image"]
        return coco.json_lines(
            coco.instances(records, size, lambda stem: image.format(split=split, stem=stem))
        )
    return coco.json_lines(
        {
            "images": _images(records, size),
            "annotations": _annotations(records),
            "categories": coco.categories(),
        }
    )


def _images(records: coco.Records, size: tuple[int, int]) -> Iterator[dict[str, Any]]:
    for record in records():
        # The doubled name is that of Cityscapes' own script, and what its readers take apart.
        name = f"{record['stem']}_gtFine_leftImg8bit.png"
        yield {"id": record["stem"], "width": size[0], "height": size[1], "file_name": name}


def _annotations(records: coco.Records) -> Iterator[dict[str, Any]]:
    for record in records():
        yield {
            "image_id": record["stem"],
            "file_name": f"{record['stem']}_gtFine_panoptic.png",
            "segments_info": [coco.panoptic_segment(s) for s in record["segments"]],
        }
