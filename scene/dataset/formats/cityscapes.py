"""The panoptic file of Cityscapes in the form of its ``createPanopticImgs``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from scene.dataset.formats import coco
from scene.dataset.formats.about import About


def panoptic(about: About) -> Iterator[str]:
    """All segments of every image."""
    return coco.json_lines(
        {
            "images": _images(about),
            "annotations": _annotations(about),
            "categories": coco.categories(about.labels),
        }
    )


def _images(about: About) -> Iterator[dict[str, Any]]:
    for record in about.records():
        # The doubled name is that of Cityscapes' script, which its readers expect.
        name = f"{record['stem']}_gtFine_leftImg8bit.png"
        width, height = about.size
        yield {"id": record["stem"], "width": width, "height": height, "file_name": name}


def _annotations(about: About) -> Iterator[dict[str, Any]]:
    for record in about.records():
        yield {
            "image_id": record["stem"],
            "file_name": f"{record['stem']}_gtFine_panoptic.png",
            "segments_info": [coco.panoptic_segment(s) for s in record["segments"]],
        }
