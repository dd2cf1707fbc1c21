"""Parquet files for the library ``datasets`` of Hugging Face: images and their classes in rows.

Images are first written one by one into the folder that exists during an export, so that a kill loses at most
a street; `pack` then packs them into shards.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from common.files import write
from scene.dataset.formats.about import About
from scene.dataset.formats.card import SPLIT, card

PACKAGES = ("pyarrow",)
FILES = {"image": ".export/images/{stem}.png", "label_ids": ".export/labels/{stem}.png"}
"""Kind of image -> its file until all are packed."""
COLUMNS = {"image": "image", "label_ids": "label"}
"""Kind of image -> column."""
SHARD = 250_000_000
"""The most bytes of images in a shard, which is assembled in memory."""
GROUP = 100
"""Number of rows read at once."""


def shards(folder: Path, split: str) -> list[Path]:
    """The files of an exported dataset in order."""
    return sorted((folder / "data").glob(f"{SPLIT[split]}-*-of-*.parquet"))


def features(about: About) -> dict[str, Any]:
    """The columns in the terms of ``datasets``; old and new versions read `Sequence`."""
    names = {"feature": {"names": list(about.labels.names), "_type": "ClassLabel"}}
    return {
        "image": {"_type": "Image"},
        "label": {"_type": "Image"},
        "classes": {**names, "_type": "Sequence"},
    }


def parquet_card(about: About) -> Iterator[str]:
    """Yield the card with the paths of the rows."""
    split = SPLIT[about.split]
    return card(
        about,
        "configs:\n- config_name: default\n  data_files:\n"
        f"  - split: {split}\n    path: data/{split}-*\n",
    )


def pack(folder: Path, about: About) -> None:
    """Pack all images into shards; a second call writes the same."""
    import pyarrow
    from pyarrow import parquet

    image_bytes = pyarrow.struct({"bytes": pyarrow.binary(), "path": pyarrow.string()})
    schema = pyarrow.schema(
        {**dict.fromkeys(COLUMNS.values(), image_bytes), "classes": pyarrow.list_(pyarrow.int64())},
        {"huggingface": json.dumps({"info": {"features": features(about)}})},
    )
    split, starts, room = SPLIT[about.split], [0], SHARD
    sizes = [sum(record["bytes"]) for record in about.records()]
    for k, size in enumerate(sizes):
        room -= size
        if room < 0 and k > starts[-1]:
            starts.append(k)
            room = SHARD - size
    (folder / "data").mkdir(exist_ok=True)
    records = iter(about.records())
    for k, (start, end) in enumerate(zip(starts, [*starts[1:], len(sizes)], strict=True)):
        buffer = io.BytesIO()
        with parquet.ParquetWriter(buffer, schema) as writer:
            for first in range(start, end, GROUP):
                rows = [
                    _row(folder, next(records), about)
                    for _ in range(first, min(first + GROUP, end))
                ]
                writer.write_table(pyarrow.Table.from_pylist(rows, schema))
        name = f"{split}-{k:05d}-of-{len(starts):05d}.parquet"
        write(folder / "data" / name, buffer.getvalue(), folder / ".export" / "parts" / name)


def _row(folder: Path, record: dict[str, Any], about: About) -> dict[str, Any]:
    stem = record["stem"]
    row: dict[str, Any] = {
        column: {
            "bytes": (folder / FILES[kind].format(stem=stem)).read_bytes(),
            "path": f"{stem}.png",
        }
        for kind, column in COLUMNS.items()
    }
    classes = {int(about.labels.of_engine[k]) for k, n in enumerate(record["pixels"]) if n}
    return {**row, "classes": sorted(k for k in classes if k < len(about.labels.names))}


class Place(NamedTuple):
    """The place of a row."""

    shard: Path
    group: int
    row: int


def places(folder: Path, split: str) -> dict[str, Place]:
    """Stem -> place of every image.

    Raises:
        ValueError, OSError: a shard is damaged or has other columns; the message names it.
    """
    from pyarrow import parquet

    places_by_stem: dict[str, Place] = {}
    for shard in shards(folder, split):
        try:
            with parquet.ParquetFile(shard) as file:
                for group in range(file.num_row_groups):
                    names = file.read_row_group(group, ["image.path"])["image"].to_pylist()
                    for row, name in enumerate(names):
                        places_by_stem[str(name["path"]).removesuffix(".png")] = Place(
                            shard, group, row
                        )
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise ValueError(f"{shard} cannot be read: {' '.join(str(error).split())}") from None
    return places_by_stem


def image_bytes(place: Place, kind: str) -> bytes:
    """The bytes of one PNG file in a shard.

    Raises:
        ValueError, OSError: the shard is damaged; the message names it.
    """
    try:
        table = _group(place.shard, place.shard.stat().st_mtime_ns, place.group)
        content = table[COLUMNS[kind]][place.row].as_py()["bytes"]
        if not isinstance(content, bytes):
            raise TypeError("no image")
        return content
    except (OSError, ValueError, LookupError, TypeError) as error:
        why = " ".join(str(error).split())
        raise ValueError(f"{place.shard} cannot be read: {why}") from None


@lru_cache(maxsize=1)
def _group(shard: Path, changed: int, group: int) -> Any:
    from pyarrow import parquet

    with parquet.ParquetFile(shard) as file:
        return file.read_row_group(group, list(COLUMNS.values()))
