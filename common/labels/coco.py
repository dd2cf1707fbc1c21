"""Reads COCO's annotations: one JSON file with the regions of many images.

Source: cocodataset.org, "Data format".
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec

from common.errors import UserError
from common.files import composed, plain_path, read_bytes
from common.labels.target_file import plain_words

Key = int | str
Side = Annotated[int, msgspec.Meta(ge=1)]


class CocoImage(msgspec.Struct, frozen=True):
    """An image of a file."""

    id: Key
    file_name: str
    width: Side
    height: Side


class Runs(NamedTuple):
    """A mask as lengths of runs down its columns, outside first."""

    size: tuple[int, int]  # (height, width)
    counts: list[int]


class _Runs(msgspec.Struct, frozen=True):
    size: tuple[int, int]
    counts: list[int] | str  # numbers, or COCO's text for them


Shape = list[list[float]] | Runs
"""Polygons [x, y, x, y, ...] that form one region together, or a mask."""


class _Annotation(msgspec.Struct, frozen=True):
    image_id: Key
    category_id: Key
    segmentation: msgspec.Raw = msgspec.Raw(b"null")  # parsed for the images that are read
    iscrowd: int | bool = 0


class _Category(msgspec.Struct, frozen=True):
    id: Key
    name: str


class _File(msgspec.Struct, frozen=True):
    images: list[CocoImage]
    annotations: list[_Annotation]
    categories: list[_Category]


class Region(NamedTuple):
    """A region of an image."""

    name: str  # of its category
    shape: Shape
    crowd: bool  # whether it is a group of objects that nobody separated
    where: str  # its place in the file, for errors


class CocoFile:
    """The images of a file with their regions.

    Args:
        path: the file, for errors.
        data: its bytes.

    Raises:
        UserError: it is no JSON, has no annotations as COCO has them, or names an image twice.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self._path = path
        content: _File = self._parsed(data, _File, "")
        self.images = content.images
        self.names = {category.id: composed(category.name) for category in content.categories}
        files = [plain_path(image.file_name) for image in content.images]
        self._refuse_repeats("file_name", files)
        self._refuse_repeats("id", [image.id for image in content.images])
        self._by_name: dict[str, list[CocoImage]] = {}
        for file, image in zip(files, content.images, strict=True):
            self._by_name.setdefault(file.rpartition("/")[2], []).append(image)
        self._of_image: dict[Key, list[tuple[int, _Annotation]]] = {}
        for k, annotation in enumerate(content.annotations):
            self._of_image.setdefault(annotation.image_id, []).append((k, annotation))

    def _refuse_repeats(self, field: str, keys: Sequence[Key]) -> None:
        first: dict[Key, int] = {}
        for k, key in enumerate(keys):
            if first.setdefault(key, k) != k:
                both = f"images[{first[key]}] and images[{k}]"
                raise UserError(f"{self._path}: {both} have the same {field}, {key}; remove one")

    def _parsed(self, data: bytes | msgspec.Raw, kind: Any, where: str) -> Any:
        try:
            return msgspec.json.decode(data, type=kind)
        except msgspec.ValidationError as error:
            why, _, inside = str(error).partition(" - at `$")
            field = f"{where}{inside.rstrip('`')}".lstrip(".")
            field = field or "no annotations of COCO"
            raise UserError(f"{self._path}: {field}: {plain_words(why)}") from None
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise UserError(f"{self._path}: not valid JSON ({error})") from None

    def image_of(self, path: Path) -> CocoImage | None:
        """The record of an image file; None if the file has none.

        The record's file_name is the end of the path, or a path on another machine whose last name is unique.
        """
        whole = f"/{composed(path.absolute().as_posix())}"
        named = self._by_name.get(composed(path.name), [])
        ends = [image for image in named if whole.endswith(f"/{plain_path(image.file_name)}")]
        if ends:
            return max(ends, key=lambda image: len(image.file_name))
        if len(named) == 1 and re.match(r"/|.*\.\./|\w+:", plain_path(named[0].file_name)):
            return named[0]
        return None

    def regions(self, image: CocoImage) -> Iterator[Region]:
        """The regions of an image in the order of the file.

        Raises:
            UserError: an annotation has no mask, or a category that the file lacks.
        """
        for k, annotation in self._of_image.get(image.id, ()):
            where = f"annotations[{k}]"
            if annotation.category_id not in self.names:
                raise UserError(
                    f"{self._path}: {where}.category_id {annotation.category_id!r} is not in categories"
                )
            place = f"{where}.segmentation"
            shape = self._parsed(annotation.segmentation, list[list[float]] | _Runs | None, place)
            if isinstance(shape, _Runs):
                numbers = shape.counts
                if isinstance(numbers, str):
                    try:
                        numbers = run_lengths(numbers)
                    except ValueError as error:
                        raise UserError(f"{self._path}: {place}: {error}") from None
                shape = Runs(shape.size, numbers)
            if not shape:
                raise UserError(
                    f"{self._path}: {where} has a box at most; expected a segmentation (polygons or a mask)"
                )
            name = self.names[annotation.category_id]
            yield Region(name, shape, bool(annotation.iscrowd), place)


def read_coco_file(path: Path) -> CocoFile:
    """Read a file, once as long as it does not change.

    Raises:
        UserError: it is wrong.
        OSError: it cannot be read.
    """
    state = path.stat()
    return _read(path, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=4)
def _read(path: Path, _size: int, _time: int) -> CocoFile:
    return CocoFile(path, read_bytes(path).removeprefix(codecs.BOM_UTF8))


def has_annotations(path: Path) -> bool:
    """Whether a JSON file has the tables of COCO's annotations.

    Raises:
        OSError: it cannot be read.
    """
    try:
        tables = msgspec.json.decode(read_bytes(path), type=dict[str, msgspec.Raw])
    except (msgspec.MsgspecError, UserError, UnicodeDecodeError, RecursionError):
        return False
    return {"images", "annotations"} <= tables.keys()


def run_lengths(text: str) -> list[int]:
    """The numbers in COCO's text: five bits a character; from the fourth on, differences to the last but one.

    Raises:
        ValueError: it is no such text.
    """
    counts: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 30:
            raise ValueError("its counts are not COCO's text for numbers")
        value |= (bits & 31) << shift
        shift += 5
        if not bits & 32:  # the last character of a number
            value -= (bits & 16) // 16 << shift
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value = shift = 0
    return counts
