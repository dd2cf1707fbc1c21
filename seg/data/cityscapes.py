"""Cityscapes in its public layout: leftImg8bit/ and gtFine/, one folder per split and city.

Source: Cordts et al., "The Cityscapes dataset for semantic urban scene understanding" (2016).
"""

from pathlib import Path

from seg.classes import CITYSCAPES_19
from seg.data.errors import DataError
from seg.data.realset import Entry, RealSet, load, subset

_IMAGE_END, _LABEL_END = "_leftImg8bit.png", "_gtFine_labelIds.png"


def list_cityscapes(root: str | Path, split: str) -> tuple[Entry, ...]:
    """List the labelled images of a split without reading them.

    Args:
        root: folder that holds leftImg8bit/<split>/<city>/ and gtFine/<split>/<city>/.
        split: "train", "val" or "test", or another that exists there.

    Returns:
        Entries sorted by city and name; the sequence is the city.

    Raises:
        DataError: a folder or split is missing, an image has no label, or there are no images.
    """
    root = Path(root)
    if not root.is_dir():
        raise DataError(
            f"{root}: no such folder; expected Cityscapes, with leftImg8bit/ and gtFine/"
        )
    for part in ("leftImg8bit", "gtFine"):
        if not (root / part).is_dir():
            raise DataError(f"{root / part}: no such folder; expected {part}/<split>/<city>/*.png")
        if not (root / part / split).is_dir():
            splits = sorted(path.name for path in (root / part).iterdir() if path.is_dir())
            raise DataError(
                f"{root / part}: no split {split!r}; splits there: {', '.join(splits) or 'none'}"
            )
    entries = []
    for image in sorted((root / "leftImg8bit" / split).glob(f"*/*{_IMAGE_END}")):
        city, name = image.parent.name, image.name.removesuffix(_IMAGE_END)
        label = root / "gtFine" / split / city / f"{name}{_LABEL_END}"
        if not label.is_file():
            raise DataError(f"{image}: image without label; expected {label}")
        entries.append(Entry(name, city, image, label))
    if not entries:
        raise DataError(
            f"{root / 'leftImg8bit' / split}: zero images; expected <city>/*{_IMAGE_END}"
        )
    return tuple(entries)


def read_cityscapes(
    root: str | Path,
    split: str,
    size: tuple[int, int] | None = None,
    limit: int | None = None,
    seed: int = 0,
) -> RealSet:
    """Read a split of Cityscapes, or of a data set written in its layout.

    Args:
        root: see `list_cityscapes`.
        split: see `list_cityscapes`.
        size: (height, width) in pixels to resize to; None keeps the size on disk.
        limit: keep a random subset of this many images (the paper: 500 of the training set).
        seed: of that subset.

    Returns:
        Images and labels, as ids of `CITYSCAPES_19`.

    Raises:
        DataError: the data are not as they should be.
        ValueError: size or limit is not positive.
    """
    return load(subset(list_cityscapes(root, split), limit, seed), CITYSCAPES_19, size)
