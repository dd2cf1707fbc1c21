"""CamVid in the SegNet distribution: 480x360, 11 classes, split lists or split folders.

Source: Brostow, Fauqueur, Cipolla, "Semantic object classes in video" (2009), as copied by the
SegNet tutorial.
"""

from pathlib import Path

from seg.classes import CAMVID_11
from seg.data.labelled import Entry, LabelledImages, load, subset
from seg.errors import DataError
from shell.files import leads_out

_SUFFIXES = (".png", ".jpg", ".jpeg")


def _splits(root: Path) -> list[str]:
    listed = {path.stem for path in root.glob("*.txt")}
    folders = {path.name.removesuffix("annot") for path in root.glob("*annot") if path.is_dir()}
    return sorted(listed | folders)


def _existing(path: Path) -> Path | None:
    """The path itself, or the same name with the extension it has on this disk."""
    for candidate in (path, *(path.with_suffix(suffix) for suffix in _SUFFIXES)):
        if candidate.is_file():
            return candidate
    return None


def _entry(image: Path, label: Path) -> Entry:
    image_path, label_path = _existing(image), _existing(label)
    if image_path is None:
        raise DataError(f"{image}: no such image, neither as .png nor as .jpg")
    if label_path is None:
        raise DataError(f"{image_path}: image without label; expected {label}")
    return Entry(image_path.stem, image_path.stem.split("_")[0], image_path, label_path)


def _from_list(root: Path, listing: Path) -> list[Entry]:
    try:
        lines = listing.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{listing}: not a readable text file ({error})") from error
    entries = []
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if not fields:
            continue
        if len(fields) != 2:
            raise DataError(f"{listing}, line {number}: expected 'image label', found {line!r}")
        # The public lists name /SegNet/CamVid/train/...; what follows is relative to the root.
        names = [field.rpartition("CamVid/")[2].lstrip("/") for field in fields]
        for name in names:
            if leads_out(root, name):
                raise DataError(f"{listing}, line {number}: {name} leads out of {root}")
        image, label = (root / name for name in names)
        entries.append(_entry(image, label))
    return entries


def list_camvid(root: str | Path, split: str) -> tuple[Entry, ...]:
    """List the labelled images of a split without reading them.

    Args:
        root: folder with train.txt and the folders it names, or just with train/ and trainannot/.
        split: "train", "val" or "test", or another that exists there.

    Returns:
        Entries in the order of the list (or of the file names); the sequence is the part of the
        name before the first underscore.

    Raises:
        DataError: root or split is missing, an image has no label, or there are no images.
    """
    root = Path(root)
    if not root.is_dir():
        raise DataError(f"{root}: no such folder; expected CamVid with train.txt or train/ in it")
    listing, folder, labels = root / f"{split}.txt", root / split, root / f"{split}annot"
    if listing.is_file():
        source, entries = listing, _from_list(root, listing)
    elif folder.is_dir() and labels.is_dir():
        images = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
        source = folder
        entries = [_entry(image, labels / f"{image.stem}.png") for image in images]
    else:
        raise DataError(
            f"{root}: no split {split!r}; expected {split}.txt, or {split}/ and {split}annot/. "
            f"Splits there: {', '.join(_splits(root)) or 'none'}"
        )
    if not entries:
        raise DataError(f"{source}: zero images in split {split!r}; expected at least one")
    return tuple(entries)


def read_camvid(
    root: str | Path,
    split: str,
    size: tuple[int, int] | None = None,
    limit: int | None = None,
    seed: int = 0,
) -> LabelledImages:
    """Read a split of CamVid as ids of `CAMVID_11`: `list_camvid`, `subset` and `load` in one."""
    return load(subset(list_camvid(root, split), limit, seed), CAMVID_11, size)
