"""Cityscapes in its public layout: leftImg8bit/ and gtFine/, one folder per split and city.

Source: Cordts et al., "The Cityscapes dataset for semantic urban scene understanding" (2016).
"""

from pathlib import Path

from seg.classes import CITYSCAPES_19
from seg.data.labelled import Entry, LabelledImages, load, subset
from seg.errors import DataError

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
) -> LabelledImages:
    """Read a split as ids of `CITYSCAPES_19`: `list_cityscapes`, `subset` and `load` in one.

    The paper's reward set is 500 images of the training split.
    """
    return load(subset(list_cityscapes(root, split), limit, seed), CITYSCAPES_19, size)
