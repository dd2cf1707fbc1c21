"""CVAT's "Segmentation mask 1.1": coloured masks with ``labelmap.txt`` in a zip file, to upload to a task.

Source: docs.cvat.ai, "Segmentation mask". Images of the task and masks must have the same names.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Sequence

import numpy as np

from scene.dataset.formats.png import encode
from seg.classes import colorize
from seg.model import LabelClass, label_classes

Colors = Sequence[tuple[int, int, int]]
BACKGROUND = "background"
"""CVAT's name for pixels without a label, which are black."""


def colors_of(classes: Sequence[LabelClass]) -> Colors:
    """RGB of each class: its own if all differ and none is black, otherwise PASCAL VOC's."""
    colors = [row.color for row in classes]
    if len(set(colors)) < len(colors) or (0, 0, 0) in colors:
        colors = [row.color for row in label_classes([row.name for row in classes])]
    return colors


def names_of(classes: Sequence[LabelClass]) -> list[str]:
    """Names for a label map, without colons, which separate its fields."""
    return [" ".join(row.name.replace(":", " ").split()) for row in classes]


def label_map(classes: Sequence[LabelClass]) -> str:
    """``labelmap.txt``: on each line a name, its colour, and two empty fields."""
    names, colors = names_of(classes), colors_of(classes)
    rows = [*zip(names, colors, strict=True)]
    if BACKGROUND not in names:
        rows.insert(0, (BACKGROUND, (0, 0, 0)))
    lines = [f"{name}:{','.join(map(str, color))}::" for name, color in rows]
    return "\n".join(["# label:color_rgb:parts:actions", *lines, ""])


def constructor(classes: Sequence[LabelClass]) -> str:
    """The labels of a task for CVAT's field "Raw": a list of names and colours in JSON."""
    colors = ("#" + bytes(color).hex() for color in colors_of(classes))
    rows = zip(names_of(classes), colors, strict=True)
    return json.dumps([{"name": n, "color": c, "attributes": []} for n, c in rows], indent=1) + "\n"


def archive(images: Iterable[tuple[str, np.ndarray]], classes: Sequence[LabelClass]) -> bytes:
    """Build the zip file.

    Args:
        images: name without suffix, and u8[h, w] indices of ``classes``, 255 for none; each class of an
            image becomes one object.
        classes: classes of the labels.
    """
    colors = colors_of(classes)
    object_colors = [row.color for row in label_classes([""] * len(classes))]
    data, names = io.BytesIO(), []
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:

        def add(name: str, content: bytes | str) -> None:
            file.writestr(zipfile.ZipInfo(name), content)  # with a fixed time, for the same bytes

        add("labelmap.txt", label_map(classes))
        for name, labels in images:
            names.append(name)
            add(f"SegmentationClass/{name}.png", encode(colorize(labels, colors)))
            present = np.unique(labels[labels < len(classes)])
            object_of = np.full(256, 255, np.uint8)
            object_of[present] = np.arange(len(present))
            instances = colorize(object_of[labels], object_colors)
            add(f"SegmentationObject/{name}.png", encode(instances))
        add("ImageSets/Segmentation/default.txt", "".join(f"{name}\n" for name in names))
    return data.getvalue()
