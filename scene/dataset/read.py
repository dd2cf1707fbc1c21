"""Reads an exported dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.files import read_json
from common.labels.classes import Outline
from scene.dataset.formats import parquet
from scene.dataset.formats.about import stem
from scene.dataset.formats.labels import ILLEGAL, Labels, labels_of
from scene.dataset.formats.layout import FORMATS, SPLITS, Layout, layout
from scene.dataset.formats.planes import DEPTH_PER_METRE, ids_of
from scene.dataset.formats.png import decode, read_png
from scene.dataset.formats.segments import TRAIN_OF_LABEL, label_ids
from scene.outline import sources
from scene.render.protocol import MAX_PIXELS

DESCRIPTION = "dataset.json"
MOST_IMAGES = 10_000_000
"""The most images; a larger number is taken for a typing error."""
WORK = ".export"
"""Folder inside an unfinished dataset."""


COLOURED = ("image", "panoptic", "color", "normals")
"""Kinds of pictures with three channels."""
DEEP = ("instance_ids", "depth", "disparity")
"""Kinds of pictures with 16 bits per pixel."""


class Described(NamedTuple):
    """An exported dataset: its folder, and its ``dataset.json``."""

    folder: Path
    description: dict[str, Any]
    layout: Layout
    split: str
    stems: tuple[str, ...]  # of all images, in order
    size: tuple[int, int]  # width, height in pixels
    labels: Labels  # the classes of label pictures
    rows: dict[str, parquet.Place] | None = None  # places of packed pictures by stem
    framing: tuple[float, float] | None = None  # shares of retaken shots, and without a street

    def path(self, kind: str, name: str) -> Path:
        """The file of one kind of the image ``name``."""
        return self.folder / self.layout.paths(self.split, name)[kind]

    def picture(self, kind: str, name: str) -> np.ndarray:
        """Read one picture of the image ``name``.

        Raises:
            ValueError, OSError: it is damaged, missing, or of another size or kind of pixels; the message
                names it.
        """
        if self.rows is None:
            where, found = f"{self.path(kind, name)}", read_png(self.path(kind, name))
        elif name in self.rows:
            where = f"{self.folder}: {kind} of {name}"
            place = self.rows[name]
            found = decode(parquet.picture(place, kind), f"{place.shard}: {kind} of {name}")
        else:
            raise ValueError(f"{self.folder}: no row of image {name} in data/")
        (height, width), channels = found.shape[:2], found.shape[2:]
        if (width, height) != self.size:
            wanted = "x".join(map(str, self.size))
            raise ValueError(f"{where} is {width}x{height}, not {wanted}")
        dtype, right = np.dtype("u2" if kind in DEEP else "u1"), (3,) if kind in COLOURED else ()
        if kind == "label_ids":
            dtype, right = self.labels.values.dtype, self.labels.values.shape[1:]
        if (found.dtype, channels) != (dtype, right):
            ours, theirs = ((*shape, 1)[0] for shape in (channels, right))
            raise ValueError(
                f"{where} is {found.dtype} with {ours} channels, not {dtype} with {theirs}"
            )
        return found


def describe(folder: Path) -> Described:
    """Open an exported dataset.

    Raises:
        ValueError: the folder holds none, or its ``dataset.json`` was changed.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        unfinished = (folder / WORK).exists()
        why = "an unfinished export: the command that began it continues it" if unfinished else ""
        raise ValueError(f"{folder}: {why or f'not a dataset, it has no {DESCRIPTION}'}")
    found = read_json(path)
    try:
        images, shots = int(found["images"]), int(found["shots"])
        size = (int(found["render"]["width"]), int(found["render"]["height"]))
        sound = found["format"] in FORMATS and found["split"] in SPLITS
        most = images <= MOST_IMAGES and size[0] * size[1] <= MAX_PIXELS
        if not sound or not most or min(images, shots, *size) < 1:
            raise ValueError("format, split, images, shots or size")
        own = layout(found["format"])
        classes = labels_of(found, own.published)
        again = [float(found[key]) for key in ("shots_retaken", "shots_refused") if key in found]
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{path} does not describe a dataset: {error}") from None
    stems = tuple(stem(k // shots, k % shots) for k in range(images))
    own.check()
    rows = parquet.places(folder, found["split"]) if own.pack is not None else None
    framing = (again[0], again[1]) if len(again) == 2 else None  # older datasets lack it
    return Described(folder, found, own, found["split"], stems, size, classes, rows, framing)


def labels(dataset: Described, name: str) -> np.ndarray:
    """Read classes u8[h, w] of one image, as numbers of ``dataset.labels``.

    Raises:
        ValueError, OSError: the file is damaged or missing (the message names it), or the format has no
        labels.
    """
    if "panoptic" in dataset.layout.files:
        ids = ids_of(dataset.picture("panoptic", name))
        return dataset.labels.of_engine[TRAIN_OF_LABEL[label_ids(ids)]]
    if "label_ids" not in dataset.layout.files:
        raise ValueError(
            f"{dataset.folder}: the format {dataset.description['format']} has no label of every pixel"
        )
    found = dataset.labels.classes_of(dataset.picture("label_ids", name))
    if (found == ILLEGAL).any():
        raise ValueError(f"{dataset.folder}: labels of {name} hold a value that is of no class")
    return found


def pictures(
    dataset: Described, outlines: Sequence[Outline] = ()
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield images u8[h, w, 3] and classes u8[h, w] of an exported dataset; raises as `labels`.

    Outlines of a target are drawn with the dataset's depth.
    """
    for name in dataset.stems:
        label = labels(dataset, name)
        if outlines:
            depth = dataset.picture("depth", name) / np.float32(DEPTH_PER_METRE)
            label = label.take(sources(label, depth, outlines))
        yield dataset.picture("image", name), label
