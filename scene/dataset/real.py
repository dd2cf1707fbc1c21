"""Real images beside which a dataset is measured, read only to be counted.

CamVid in the SegNet layout (11 classes) or any folder in the layout of Cityscapes (19 classes).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from scene.classes import CLASS_NAMES, VOID
from scene.dataset.formats.segments import TRAIN_OF_LABEL
from scene.dataset.read import DESCRIPTION, pictures

CAMVID = (
    *("sky", "building", "pole", "road", "sidewalk", "tree", "sign", "fence", "car"),
    *("pedestrian", "bicyclist"),
)
"""The 11 classes of CamVid as the literature counts them."""
_CAMVID_OF_NAME = {
    **{"road": "road", "sidewalk": "sidewalk", "building": "building", "wall": "building"},
    **{"fence": "fence", "pole": "pole", "traffic light": "sign", "traffic sign": "sign"},
    **{"vegetation": "tree", "terrain": "tree", "sky": "sky", "person": "pedestrian"},
    **{"rider": "bicyclist", "motorcycle": "bicyclist", "bicycle": "bicyclist"},
    **{"car": "car", "truck": "car", "bus": "car"},
}
CAMVID_OF_TRAIN = np.full(256, VOID, np.uint8)
"""u8[256]: train id -> CamVid's class; trains are void there."""
for _train_id, _name in enumerate(CLASS_NAMES):
    if _name in _CAMVID_OF_NAME:
        CAMVID_OF_TRAIN[_train_id] = CAMVID.index(_CAMVID_OF_NAME[_name])


class Pictures(NamedTuple):
    """Images u8[h, w, 3] with labels u8[h, w], and what the labels mean; ``VOID`` means nothing."""

    classes: tuple[str, ...]
    pairs: Iterator[tuple[np.ndarray, np.ndarray]]


def open_pictures(folder: Path, prefixes: tuple[str, ...] = ()) -> Pictures:
    """The images of an exported dataset, of CamVid or of a folder like Cityscapes.

    Args:
        folder: where they are.
        prefixes: of real images, take those whose file name begins with one of these; all by default.

    Raises:
        ValueError: none of these, with what was looked for; when read, a damaged file, by name.
    """
    if (folder / DESCRIPTION).is_file():
        return Pictures(CLASS_NAMES, pictures(folder))
    if (folder / "train").is_dir() and (folder / "trainannot").is_dir():
        images = sorted(p for p in (folder / "train").iterdir() if p.suffix in (".jpg", ".png"))
        labels = [folder / "trainannot" / f"{path.stem}.png" for path in images]
        legal = np.full(256, VOID, np.uint8)
        legal[: len(CAMVID)] = np.arange(len(CAMVID))
        classes: tuple[str, ...] = CAMVID
    elif (folder / "leftImg8bit").is_dir():
        images = sorted((folder / "leftImg8bit").glob("*/*/*_leftImg8bit.png"))
        labels = [_cityscapes_label(folder, path) for path in images]
        legal, classes = TRAIN_OF_LABEL, CLASS_NAMES
    else:
        raise ValueError(
            f"{folder}: expected {DESCRIPTION}, train/ with trainannot/ (CamVid), or leftImg8bit/"
        )
    chosen = [
        pair
        for pair in zip(images, labels, strict=True)
        if not prefixes or pair[0].name.startswith(prefixes)
    ]
    if not chosen:
        raise ValueError(
            f"{folder}: no images" + (f" called {', '.join(prefixes)}" * bool(prefixes))
        )
    return Pictures(classes, _read(chosen, legal))


def _cityscapes_label(folder: Path, image: Path) -> Path:
    name = image.name.replace("_leftImg8bit.png", "_gtFine_labelIds.png")
    return folder / "gtFine" / image.parent.parent.name / image.parent.name / name


def _read(
    files: list[tuple[Path, Path]], table: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for image_path, label_path in files:
        image = _decode(image_path, cv2.IMREAD_COLOR)[..., ::-1]
        label = table[_decode(label_path, cv2.IMREAD_GRAYSCALE)]
        if image.shape[:2] != label.shape:
            raise ValueError(f"{label_path} and {image_path} differ in size")
        yield image, label


def _decode(path: Path, flags: int) -> np.ndarray:
    found = cv2.imdecode(np.frombuffer(path.read_bytes() or b"-", np.uint8), flags)
    if found is None:
        raise ValueError(f"{path} cannot be decoded")
    return found
