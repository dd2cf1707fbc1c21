"""Data sets of two folders with the same file names in both: GTA5, SYNTHIA and KITTI.

All three speak of Cityscapes' 19 classes: the first two as training sets that others have rendered, the
third as a target.
"""

from pathlib import Path
from typing import NamedTuple

from seg.classes import CITYSCAPES_19, GTA5_19, SYNTHIA_19, ClassTable
from seg.data.images import read_label, read_packed_label
from seg.data.labelled import Entry, LabelledImages, LabelReader, load, subset
from seg.errors import DataError


class Layout(NamedTuple):
    """Where a data set keeps its files, and what stands in them."""

    name: str
    images: str  # folder of photographs or renders
    labels: str  # folder of label files of the same names
    table: ClassTable
    read: LabelReader


LAYOUTS: dict[str, Layout] = {
    "gta5": Layout("GTA5", "images", "labels", GTA5_19, read_label),
    "synthia": Layout("SYNTHIA RAND-CITYSCAPES", "RGB", "GT/LABELS", SYNTHIA_19, read_packed_label),
    "kitti": Layout(
        "KITTI semantics", "training/image_2", "training/semantic", CITYSCAPES_19, read_label
    ),
}
"""Sources: Richter et al. (2016), Ros et al. (2016), Alhaija et al. (2018)."""


def list_folders(root: str | Path, layout: str) -> tuple[Entry, ...]:
    """List the labelled images of a data set without reading them.

    Args:
        root: folder that holds the folders of images and labels.
        layout: one of `LAYOUTS`.

    Returns:
        Entries sorted by name, all of one sequence, since names do not tell drives apart.

    Raises:
        DataError: a folder is missing, an image has no label, or there are no images.
        ValueError: unknown layout.
    """
    if layout not in LAYOUTS:
        raise ValueError(f"unknown layout {layout!r}; known: {', '.join(LAYOUTS)}")
    where = LAYOUTS[layout]
    root = Path(root)
    for part in (where.images, where.labels):
        if not (root / part).is_dir():
            raise DataError(
                f"{root / part}: no such folder; expected {where.name}, "
                f"with {where.images}/ and {where.labels}/"
            )
    entries = []
    for image in sorted((root / where.images).glob("*.png")):
        label = root / where.labels / image.name
        if not label.is_file():
            raise DataError(f"{image}: image without label; expected {label}")
        entries.append(Entry(image.stem, layout, image, label))
    if not entries:
        raise DataError(f"{root / where.images}: zero images; expected *.png")
    return tuple(entries)


def read_folders(
    root: str | Path,
    layout: str,
    size: tuple[int, int] | None = None,
    limit: int | None = None,
    seed: int = 0,
) -> LabelledImages:
    """Read a data set as ids of `CITYSCAPES_19`: `list_folders`, `subset` and `load` in one."""
    entries = subset(list_folders(root, layout), limit, seed)
    return load(entries, LAYOUTS[layout].table, size, LAYOUTS[layout].read)
