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
"""CVAT's word for pixels without a label, which are black."""


def colors_of(classes: Sequence[LabelClass]) -> Colors:
    """RGB of each class: its own if all differ and none is black, otherwise PASCAL VOC's."""
    own = [each.color for each in classes]
    if len(set(own)) < len(own) or (0, 0, 0) in own:
        own = [each.color for each in label_classes([each.name for each in classes])]
    return own


def names_of(classes: Sequence[LabelClass]) -> list[str]:
    """Names for a label map, without colons, which divide its fields."""
    return [" ".join(each.name.replace(":", " ").split()) for each in classes]


def label_map(classes: Sequence[LabelClass]) -> str:
    """``labelmap.txt``: on each line a name, its colour, and two fields that stay empty."""
    names, colors = names_of(classes), colors_of(classes)
    rows = [*zip(names, colors, strict=True)]
    if BACKGROUND not in names:
        rows.insert(0, (BACKGROUND, (0, 0, 0)))
    lines = [f"{name}:{','.join(map(str, color))}::" for name, color in rows]
    return "\n".join(["# label:color_rgb:parts:actions", *lines, ""])


def constructor(classes: Sequence[LabelClass]) -> str:
    """The labels of a task for the field "Raw" of CVAT's form: a list of names and colours in JSON."""
    colors = ("#" + bytes(color).hex() for color in colors_of(classes))
    rows = zip(names_of(classes), colors, strict=True)
    return json.dumps([{"name": n, "color": c, "attributes": []} for n, c in rows], indent=1) + "\n"


def archive(images: Iterable[tuple[str, np.ndarray]], classes: Sequence[LabelClass]) -> bytes:
    """Make the zip file.

    Args:
        images: name without suffix, and u8[h, w] indices of ``classes``, 255 for none; each class of an
            image becomes one object.
        classes: classes of the labels.
    """
    colors = colors_of(classes)
    objects = [own.color for own in label_classes([""] * len(classes))]
    data, names = io.BytesIO(), []
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:

        def add(name: str, content: bytes | str) -> None:
            file.writestr(zipfile.ZipInfo(name), content)  # a fixed time fixes the bytes

        add("labelmap.txt", label_map(classes))
        for name, labels in images:
            names.append(name)
            add(f"SegmentationClass/{name}.png", encode(colorize(labels, colors)))
            there = np.unique(labels[labels < len(classes)])
            numbered = np.full(256, 255, np.uint8)
            numbered[there] = np.arange(len(there))
            instances = colorize(numbered[labels], objects)
            add(f"SegmentationObject/{name}.png", encode(instances))
        add("ImageSets/Segmentation/default.txt", "".join(f"{name}\n" for name in names))
    return data.getvalue()
