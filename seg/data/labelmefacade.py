"""LabelMeFacade: photographs of streets and facades by people on foot, labels in colours, split lists.

Source: Fröhlich, Rodner, Denzler, "A fast approach for pixelwise labeling of facade images" (2010), with
photographs of LabelMe: Russell et al., "LabelMe: a database and web-based tool for image annotation" (2008).
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from seg.classes import LABELMEFACADE_6, ClassTable
from seg.data.images import read_image
from seg.data.labelled import Entry, LabelledImages, load, subset
from seg.errors import DataError
from shell.files import leads_out

COLORS: tuple[tuple[int, int, int], ...] = (
    (128, 0, 0),  # building
    (128, 128, 0),  # door
    (0, 0, 128),  # window
    (128, 0, 128),  # car
    (128, 128, 128),  # pavement
    (128, 64, 0),  # road
    (0, 128, 128),  # sky
    (0, 128, 0),  # vegetation
    (0, 0, 0),  # various: void
)
"""RGB in a label file; the place of a colour is its value in `LABELMEFACADE_6`."""
ASPECT = 4 / 3
"""Width over height of most photographs; the others are cut to it."""


def _code(rgb: np.ndarray) -> np.ndarray:
    """One number for each colour, i32[...] of u8[... 3]."""
    return rgb.astype(np.int32) @ np.array((1 << 16, 1 << 8, 1), np.int32)


_CODES = _code(np.array(COLORS))
_ORDER = np.argsort(_CODES)


def read_colors(path: Path, table: ClassTable) -> UInt8[np.ndarray, "h w"]:
    """Read a label file of colours and map them to the ids of a table.

    No colour is near enough: the published files are exact, so others tell of a file that was saved as JPEG
    or resized with smoothing, in which borders would be wrong without a word.

    Args:
        path: PNG of three or four channels; transparency is not looked at.
        table: what the places of `COLORS` mean, such as `LABELMEFACADE_6`.

    Raises:
        DataError: the file is missing, broken, or holds another colour.
    """
    codes = _code(read_image(path))
    places = _ORDER[np.searchsorted(_CODES[_ORDER], codes).clip(max=len(COLORS) - 1)]
    wrong = np.unique(codes[_CODES[places] != codes])
    if len(wrong):
        found = [f"({c >> 16}, {c >> 8 & 255}, {c & 255})" for c in wrong[:3].tolist()]
        more = f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        raise DataError(
            f"{path}: colour {', '.join(found)}{more} lies outside the {table.name} table; "
            f"its colours are {', '.join(map(str, COLORS))}"
        )
    return table.from_file[places]


def _album(name: str) -> str:
    """What comes before the last number in a name; the whole name where there is no number."""
    return re.sub(r"\d+\D*$", "", name).rstrip("_") or name


def list_labelmefacade(root: str | Path, split: str) -> tuple[Entry, ...]:
    """List the labelled images of a split without reading them.

    Args:
        root: folder with train.txt and test.txt, a name a line, and images/NAME.jpg and labels/NAME.png.
        split: "train" or "test", or another list that exists there.

    Returns:
        Entries by album and name; the sequence is the album, which is what comes before the last number in
        the name: photographs of one album are of one place and day.

    Raises:
        DataError: root, list, an image or a label is missing, a name is listed twice or leads out of the
            folder, or there are no images.
    """
    root = Path(root)
    if not root.is_dir():
        raise DataError(
            f"{root}: no such folder; expected LabelMeFacade, with train.txt, images/ and labels/"
        )
    listing = root / f"{split}.txt"
    if not listing.is_file():
        there = ", ".join(sorted(path.stem for path in root.glob("*.txt")))
        raise DataError(
            f"{root}: no split {split!r}; expected {split}.txt. Splits there: {there or 'none'}"
        )
    try:
        lines = listing.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{listing}: not a readable text file ({error})") from error
    entries: dict[str, Entry] = {}
    for number, line in enumerate(lines, 1):
        name = line.strip()
        if not name:
            continue
        image, label = root / "images" / f"{name}.jpg", root / "labels" / f"{name}.png"
        where = f"{listing}, line {number}"
        if leads_out(root / "images", f"{name}.jpg"):
            raise DataError(f"{where}: {name} leads out of {root / 'images'}")
        if name in entries:
            raise DataError(f"{where}: {name} is listed twice; once is right")
        if not image.is_file():
            raise DataError(f"{where}: no image {image}")
        if not label.is_file():
            raise DataError(f"{image}: image without label; expected {label}")
        entries[name] = Entry(name, _album(name), image, label)
    if not entries:
        raise DataError(f"{listing}: zero images in split {split!r}; expected at least one")
    return tuple(sorted(entries.values(), key=lambda entry: (entry.sequence, entry.name)))


def load_labelmefacade(
    entries: tuple[Entry, ...],
    table: ClassTable = LABELMEFACADE_6,
    size: tuple[int, int] | None = None,
) -> LabelledImages:
    """Read images and labels, cut to 4:3 around their centre: `load` for this data set."""
    return load(entries, table, size, read_colors, ASPECT)


def read_labelmefacade(
    root: str | Path,
    split: str,
    size: tuple[int, int] | None = None,
    limit: int | None = None,
    seed: int = 0,
) -> LabelledImages:
    """Read a split as ids of `LABELMEFACADE_6`: `list_labelmefacade`, `subset` and the loading in one."""
    return load_labelmefacade(subset(list_labelmefacade(root, split), limit, seed), size=size)
