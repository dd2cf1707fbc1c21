"""Label Studio's tasks with brush predictions, and their labelling interface.

A brush mask encodes the RGBA bytes of the image, 0 or 255, as runs: 32 bits for their number, 5 for the size
of a value minus 1, four times 4 for the sizes of lengths minus 1; then for each run a bit 1, 2 bits that
choose a size, the length minus 1, and the value. Sources: labelstud.io, "Import pre-annotations" and
"BrushLabels"; the package rle-pack of thi.ng/umbrella for the runs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from urllib.parse import quote
from xml.sax.saxutils import quoteattr

import numpy as np

from experiments.app.prelabels.cvat import colors_of
from seg.model import LabelClass

SIZES = (3, 4, 8, 16)
"""Sizes of lengths of runs in bits."""
CHANNELS = 4
LABEL, IMAGE = "label", "image"
"""Names of the two parts of the interface."""


class Task(NamedTuple):
    """An image with its pre-labels."""

    file: str  # below the folder that Label Studio serves
    labels: np.ndarray  # u8[h, w], indices of classes
    score: float  # in [0, 1], lower for a less certain network


def runs(mask: np.ndarray) -> list[int]:
    """The bytes of a brush mask from bool[h, w]."""
    flat = mask.ravel()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1])
    lengths = CHANNELS * np.diff(np.append(starts, flat.size))
    most = 2 ** SIZES[-1]
    bits = [f"{CHANNELS * flat.size:032b}{7:05b}", *(f"{size - 1:04b}" for size in SIZES)]
    for on, length in zip(flat[starts].tolist(), lengths.tolist(), strict=True):
        value = "11111111" if on else "00000000"
        for part in (*[most] * (length // most), length % most):
            if part:
                size = next(
                    k for k, bits_of_length in enumerate(SIZES) if part <= 2**bits_of_length
                )
                bits.append(f"1{size:02b}{part - 1:0{SIZES[size]}b}{value}")
    text = "".join(bits)
    text += "0" * (-len(text) % 8)
    return [*int(text, 2).to_bytes(len(text) // 8, "big")]


def interface(classes: Sequence[LabelClass]) -> str:
    """The labelling interface, to paste under Settings, Labeling Interface, Code."""
    rows = zip((row.name for row in classes), colors_of(classes), strict=True)
    labels = [
        f"    <Label value={quoteattr(name)} background={quoteattr('#' + bytes(color).hex())}/>"
        for name, color in rows
    ]
    lines = [
        "<View>",
        f'  <Image name="{IMAGE}" value="${IMAGE}" zoom="true"/>',
        f'  <BrushLabels name="{LABEL}" toName="{IMAGE}">',
        *labels,
        "  </BrushLabels>",
        "</View>",
    ]
    return "\n".join(lines) + "\n"


def tasks(rows: Iterable[Task], classes: Sequence[LabelClass], model: str) -> Iterator[str]:
    """Yield the file of tasks in pieces; images are served as local files.

    Args:
        rows: the tasks, the first to label first.
        classes: classes of their labels.
        model: name of the model that made the labels.
    """
    yield "["
    for number, task in enumerate(rows):
        height, width = task.labels.shape
        result = [
            {
                "id": f"{number}-{index}",
                "type": "brushlabels",
                "from_name": LABEL,
                "to_name": IMAGE,
                "original_width": width,
                "original_height": height,
                "image_rotation": 0,
                "value": {
                    "format": "rle",
                    "rle": runs(task.labels == index),
                    "brushlabels": [classes[index].name],
                },
            }
            for index in np.unique(task.labels).tolist()
            if index < len(classes)
        ]
        prediction = {"model_version": model, "score": round(task.score, 6), "result": result}
        where = f"/data/local-files/?d={quote(task.file)}"
        yield ",\n" * (number > 0)
        yield json.dumps({"data": {IMAGE: where}, "predictions": [prediction]})
    yield "]\n"
