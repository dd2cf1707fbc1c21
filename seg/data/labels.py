"""Reads label files of every format as ids of the target's classes."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from common.errors import UserError, counted
from common.files import composed, parse_json
from common.labels.target_file import MOST_CLASSES, Format, TargetFile
from common.pictures import MOST_PIXELS, label_ids
from seg.classes import IGNORE_LABEL
from seg.data.coco import FARTHEST, draw_regions
from seg.data.images import decode, read_file, read_image
from seg.errors import DataError

WITHOUT_AREA = ("point", "points", "line", "linestrip")
"""Types of LabelMe's shapes that have no area, so that no pixel gets their label."""
_UNKNOWN = MOST_CLASSES
"""The id of a value that no class names; no class has this id."""


class Values(NamedTuple):
    """The contents of a label file."""

    codes: np.ndarray
    """i[h, w]: ids, colours as 24-bit numbers, or places in `names` from 1, 0 for no polygon, -1: ignored."""
    names: tuple[str, ...] = ()


class LabelReader:
    """Reads the label files of one target.

    Args:
        target: names their format and their values.
    """

    def __init__(self, target: TargetFile) -> None:
        self._target = target
        self._class_of: dict[Any, int] = dict.fromkeys(target.void, IGNORE_LABEL)
        for k, target_class in enumerate(target.classes.values()):
            self._class_of |= dict.fromkeys(getattr(target_class, target.kind), k)
        names = target.class_names
        self._rest = _UNKNOWN if target.rest is None else names.index(target.rest)
        self._table = np.zeros(0, np.uint8)  # polygons have one for each file
        if target.kind != "names":
            self._table = np.full(1 << (16 if target.kind == "ids" else 24), self._rest, np.uint8)
            for value, k in self._class_of.items():
                self._table[_code(value) if isinstance(value, tuple) else value] = k

    def __call__(self, path: Path, image: Path | None = None) -> UInt8[np.ndarray, "_h _w"]:
        """Read the label of an image as ids of the target's classes, `IGNORE_LABEL` for ignored pixels.

        Args:
            path: the label file.
            image: the image, for a file that holds the labels of many.

        Raises:
            DataError: it is missing, broken, of another format, or has a value that no class names.
        """
        label, unknown = self.read(path, image)
        if unknown:
            raise self.error([(path, unknown)])
        return label

    def read(
        self, path: Path, image: Path | None = None
    ) -> tuple[UInt8[np.ndarray, "_h _w"], Counter[str]]:
        """Read the label of an image; values that no class names are ignored, and their pixels are counted.

        Raises:
            DataError: the file is missing, broken or of another format.
        """
        if self._target.format == "coco-json":
            codes, names = draw_regions(path, image)
        else:
            codes, names = FORMATS[self._target.format or "ids"](path)
        if self._target.kind == "names":
            bare = IGNORE_LABEL if self._target.rest is None else self._rest
            ids = [bare, *(self._of_name(name) for name in names), IGNORE_LABEL]
            label = np.array(ids, np.uint8)[codes]
        elif codes.size and (codes.min() < 0 or codes.max() >= len(self._table)):
            inside = (codes >= 0) & (codes < len(self._table))
            label = np.where(inside, self._table[np.where(inside, codes, 0)], np.uint8(self._rest))
        else:
            label = self._table[codes]
        unknown_mask = label == _UNKNOWN
        unknown: Counter[str] = Counter()
        if unknown_mask.any():
            label = np.where(unknown_mask, np.uint8(IGNORE_LABEL), label)
            values, counts = np.unique(codes[unknown_mask], return_counts=True)
            for value, count in zip(values.tolist(), counts.tolist(), strict=True):
                unknown[self._shown(value, names)] = count
        return label, unknown

    def _of_name(self, name: str) -> int:
        # Cityscapes calls a crowd of cars "cargroup".
        single = name.removesuffix("group")
        return self._class_of.get(name, self._class_of.get(single, self._rest))

    def _shown(self, code: int, names: Sequence[str]) -> str:
        if self._target.kind == "names":
            return repr(names[code - 1])
        return str(code if self._target.kind == "ids" else _colour(code))

    def error(self, unknown: Sequence[tuple[Path, Counter[str]]]) -> DataError:
        """The error for values that no class names.

        Args:
            unknown: the label file of each image that has some, with their pixels.
        """
        pixels: Counter[str] = Counter()
        for _, counts in unknown:
            pixels += counts
        images: Counter[str] = Counter(value for _, counts in unknown for value in counts)
        most = pixels.most_common(3)
        shown = ", ".join(
            f"{value} ({counted(count, 'pixel')} in {counted(images[value], 'image')})"
            for value, count in most
        )
        more = f" and {len(pixels) - 3} more" if len(pixels) > 3 else ""
        what = {"ids": "id", "colours": "colour", "names": "name"}[self._target.kind]
        first = next(path for path, counts in unknown if most[0][0] in counts)
        return DataError(
            f"{first}: no class of {self._target.source} has the label {what} {shown}{more}; "
            "add each to a class or to 'void'"
        )


def _code(rgb: Any) -> Any:
    """Turn colours [... 3] into one number each, i32[...]."""
    return np.asarray(rgb, np.int32) @ np.array((1 << 16, 1 << 8, 1), np.int32)


def _colour(code: int) -> tuple[int, int, int]:
    return code >> 16, code >> 8 & 255, code & 255


def read_ids(path: Path) -> Values:
    """Read ids in one channel: grey of 1 to 16 bits, or a palette."""
    try:
        return Values(label_ids(read_file(path)))
    except UserError as error:
        why = error if str(path) in str(error) else f"{path}: {error}"
        raise DataError(str(why)) from error


def read_first_channel(path: Path) -> Values:
    """Read ids in the first of three 16-bit channels, as in SYNTHIA; the second has instances."""
    channels = decode(path, read_file(path), cv2.IMREAD_UNCHANGED)
    if channels.ndim != 3 or channels.dtype != np.uint16:
        count = 1 if channels.ndim == 2 else channels.shape[2]
        raise DataError(
            f"{path}: {count} channel(s) of {8 * channels.itemsize} bits; expected three of 16, "
            "with class ids in the first (GT/LABELS of SYNTHIA, not GT/COLOR)"
        )
    return Values(channels[..., 2])  # OpenCV reverses the channels


def read_colours(path: Path) -> Values:
    """Read exact colours; other colours come from a file saved as JPEG or resized with smoothing."""
    return Values(_code(read_image(path)))


def read_labelme(path: Path) -> Values:
    """Draw polygons and rectangles of LabelMe in order, later ones above; the rest is ignored.

    Shapes without an area are left out.
    """
    content = _table_at(path, _json(path), "")
    polygons = []
    for k, item in enumerate(_list_at(path, content, "shapes")):
        where = f"shapes[{k}]"
        shape = _table_at(path, item, where)
        kind = shape.get("shape_type") or "polygon"
        if kind in WITHOUT_AREA:
            continue
        points = _points(path, shape.get("points"), f"{where}.points")
        if kind == "rectangle" and len(points) == 2:
            (left, top), (right, bottom) = points
            points = [(left, top), (right, top), (right, bottom), (left, bottom)]
        elif kind != "polygon" and not (kind == "rectangle" and len(points) == 4):
            raise DataError(
                f"{path}: {where}.shape_type is {kind!r} of {len(points)} points; expected polygon, or "
                "rectangle of two or four points"
            )
        polygons.append((_name(path, shape, where), points))
    size = _size(path, content, "imageHeight", "imageWidth")
    return _draw(size, polygons)


def count_without_area(path: Path) -> int:
    """Count the shapes of LabelMe that `read_labelme` leaves out of a file that it can read."""
    return sum(shape.get("shape_type") in WITHOUT_AREA for shape in _json(path)["shapes"])


def read_cityscapes_polygons(path: Path) -> Values:
    """Draw polygons of Cityscapes (``*_polygons.json``) in order, later ones above, without deleted ones."""
    content = _table_at(path, _json(path), "")
    polygons = []
    for k, item in enumerate(_list_at(path, content, "objects")):
        region = _table_at(path, item, f"objects[{k}]")
        if not region.get("deleted"):
            points = _points(path, region.get("polygon"), f"objects[{k}].polygon")
            polygons.append((_name(path, region, f"objects[{k}]"), points))
    return _draw(_size(path, content, "imgHeight", "imgWidth"), polygons)


FORMATS: dict[Format, Callable[[Path], Values]] = {
    "ids": read_ids,
    "ids-first-channel": read_first_channel,
    "colours": read_colours,
    "labelme-json": read_labelme,
    "cityscapes-json": read_cityscapes_polygons,
}
"""The formats of files with the label of one image, each with its reader."""


def _json(path: Path) -> Any:
    try:
        return parse_json(read_file(path))
    except ValueError as error:
        if isinstance(error, UserError):
            raise
        raise DataError(f"{path}: not valid JSON ({error})") from None


def _table_at(path: Path, value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise DataError(f"{path}: {where or 'the file'} must be a JSON object")
    return value


def _list_at(path: Path, table: dict[str, Any], name: str) -> list[Any]:
    if not isinstance(table.get(name), list):
        raise DataError(f"{path}: {name} must be a list")
    return table[name]


def _name(path: Path, table: dict[str, Any], where: str) -> str:
    if not isinstance(table.get("label"), str):
        raise DataError(f"{path}: {where}.label must be text")
    return composed(table["label"])


def _points(path: Path, value: Any, where: str) -> list[tuple[float, float]]:
    points: list[Any] = value if isinstance(value, list) else [None]
    for point in points:
        is_pair = isinstance(point, list) and len(point) == 2
        if not is_pair or not all(type(v) in (int, float) and abs(v) <= FARTHEST for v in point):
            raise DataError(f"{path}: {where} must be a list of points [x, y] in or near the image")
    return [(float(x), float(y)) for x, y in points]


def _size(path: Path, table: dict[str, Any], *names: str) -> tuple[int, int]:
    height, width = (table.get(name) for name in names)
    for name, value in zip(names, (height, width), strict=True):
        if type(value) is not int or value < 1:
            raise DataError(f"{path}: {name} must be a positive whole number, not {value!r}")
    assert height is not None and width is not None
    if height * width > MOST_PIXELS:
        raise DataError(f"{path}: {width}x{height} is more than {MOST_PIXELS:,} pixels")
    return height, width


def _draw(
    size: tuple[int, int], polygons: Sequence[tuple[str, list[tuple[float, float]]]]
) -> Values:
    """Draw polygons in order, as numbers of their names from 1, as the tools of both formats do."""
    names = tuple(dict.fromkeys(name for name, _ in polygons))
    canvas = Image.new("I", (size[1], size[0]))
    pen = ImageDraw.Draw(canvas)
    for name, points in polygons:
        if len(points) > 2:
            pen.polygon(points, fill=1 + names.index(name), outline=1 + names.index(name))
    return Values(np.asarray(canvas), names)
