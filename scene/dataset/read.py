"""Read an exported dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.files import check_folder, read_json
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
"""The largest number of images; more is taken for a typing error."""
WORK = ".export"
"""Folder inside an unfinished dataset."""


COLOURED = ("image", "panoptic", "color", "normals")
"""Kinds of images with three channels."""
DEEP = ("instance_ids", "depth", "disparity")
"""Kinds of images with 16 bits per pixel."""


class Described(NamedTuple):
    """An exported dataset: its folder, and its ``dataset.json``."""

    folder: Path
    description: dict[str, Any]
    layout: Layout
    split: str
    stems: tuple[str, ...]  # of all images, in order
    size: tuple[int, int]  # width, height in pixels
    labels: Labels  # the classes of label images
    rows: dict[str, parquet.Place] | None = None  # places of packed images by stem
    framing: tuple[float, float] | None = None  # shares of shots: retaken, without a street

    def path(self, kind: str, name: str) -> Path:
        """The file of one kind of the image ``name``."""
        return self.folder / self.layout.paths(self.split, name)[kind]

    def array(self, kind: str, name: str) -> np.ndarray:
        """Read one kind of array of the image ``name``.

        Raises:
            ValueError, OSError: its file is damaged, missing, or has another size or kind of pixels; the
                message names it.
        """
        if self.rows is None:
            where, pixels = f"{self.path(kind, name)}", read_png(self.path(kind, name))
        elif name in self.rows:
            where = f"{self.folder}: {kind} of {name}"
            place = self.rows[name]
            pixels = decode(parquet.image_bytes(place, kind), f"{place.shard}: {kind} of {name}")
        else:
            raise ValueError(f"{self.folder}: no row of image {name} in data/")
        (height, width), channels = pixels.shape[:2], pixels.shape[2:]
        if (width, height) != self.size:
            expected = "x".join(map(str, self.size))
            raise ValueError(f"{where} is {width}x{height}, not {expected}")
        dtype, expected_channels = (
            np.dtype("u2" if kind in DEEP else "u1"),
            (3,) if kind in COLOURED else (),
        )
        if kind == "label_ids":
            dtype, expected_channels = self.labels.values.dtype, self.labels.values.shape[1:]
        if (pixels.dtype, channels) != (dtype, expected_channels):
            channel_count, expected_count = (
                (*shape, 1)[0] for shape in (channels, expected_channels)
            )
            raise ValueError(
                f"{where} is {pixels.dtype} with {channel_count} channels, not {dtype} with {expected_count}"
            )
        return pixels


def describe(folder: Path) -> Described:
    """Open an exported dataset.

    Raises:
        ValueError: the folder has no dataset, or its ``dataset.json`` was changed.
    """
    check_folder(folder, "one from sdr-jax render")
    path = folder / DESCRIPTION
    if not path.is_file():
        unfinished = (folder / WORK).exists()
        why = (
            "an unfinished export; run the command that started it to resume" if unfinished else ""
        )
        raise ValueError(f"{folder}: {why or f'not a dataset, since it has no {DESCRIPTION}'}")
    description = read_json(path)
    try:
        images, shots = int(description["images"]), int(description["shots"])
        size = (int(description["render"]["width"]), int(description["render"]["height"]))
        is_valid = description["format"] in FORMATS and description["split"] in SPLITS
        most = images <= MOST_IMAGES and size[0] * size[1] <= MAX_PIXELS
        if not is_valid or not most or min(images, shots, *size) < 1:
            raise ValueError("format, split, images, shots or size")
        if -(-images // shots) != len(description["streets"]):
            raise ValueError("images, shots or streets, whose numbers do not agree")
        dataset_layout = layout(description["format"])
        classes = labels_of(description, dataset_layout.published)
        framing_shares = [
            float(description[key])
            for key in ("shots_retaken", "shots_refused")
            if key in description
        ]
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{path} does not describe a dataset: {error}") from None
    stems = tuple(stem(k // shots, k % shots) for k in range(images))
    dataset_layout.check()
    rows = parquet.places(folder, description["split"]) if dataset_layout.pack is not None else None
    framing = (
        (framing_shares[0], framing_shares[1]) if len(framing_shares) == 2 else None
    )  # older datasets lack it
    return Described(
        folder,
        description,
        dataset_layout,
        description["split"],
        stems,
        size,
        classes,
        rows,
        framing,
    )


def labels(dataset: Described, name: str) -> np.ndarray:
    """Read classes u8[h, w] of one image, as indices of ``dataset.labels``.

    Raises:
        ValueError, OSError: the file is damaged or missing (the message names it), or the format has no
        labels.
    """
    if "panoptic" in dataset.layout.files:
        ids = ids_of(dataset.array("panoptic", name))
        return dataset.labels.of_engine[TRAIN_OF_LABEL[label_ids(ids)]]
    if "label_ids" not in dataset.layout.files:
        raise ValueError(
            f"{dataset.folder}: the format {dataset.description['format']} does not label every pixel"
        )
    classes = dataset.labels.classes_of(dataset.array("label_ids", name))
    if (classes == ILLEGAL).any():
        raise ValueError(f"{dataset.folder}: the label image of {name} has a value of no class")
    return classes


def images_and_classes(
    dataset: Described, outlines: Sequence[Outline] = ()
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield images u8[h, w, 3] and classes u8[h, w] of an exported dataset; raises as `labels`.

    The outlines of a target are drawn with the dataset's depth, in labels of the engine's classes.
    """
    if outlines:
        if dataset.description.get("target") is not None:
            raise ValueError(
                f"{dataset.folder} has the labels of a target, but outlines are drawn around the engine's "
                "classes; export it without --target"
            )
        if "depth" not in dataset.layout.files:
            raise ValueError(
                f"{dataset.folder} has no depth, which outlines need; export it with --format cityscapes or "
                "coco"
            )
    for name in dataset.stems:
        label = labels(dataset, name)
        if outlines:
            depth = dataset.array("depth", name) / np.float32(DEPTH_PER_METRE)
            label = label.take(sources(label, depth, outlines))
        yield dataset.array("image", name), label
