"""``dataset.json``: everything that decided a dataset, and what came out of it."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from scene.attributes import NAMES
from scene.classes import CLASS_NAMES
from scene.proposal import Proposal

PACKAGES = (
    *("sdr-jax", "numpy", "numba", "scipy", "opencv-python-headless", "trimesh"),
    *("embreex", "pyrender"),
)
ENCODINGS = {
    "depth": "u16, centimetres along the optical axis, 0 for the sky",
    "normals": "u8 RGB, 127.5 (n + 1); camera frame: x right, y up, z towards the camera; black: sky",
    "panoptic": "segment id = R + 256 G + 256^2 B; labelId * 1000 + k for things, else labelId",
}


def plain(value: Any) -> Any:
    """A value as JSON would hold it: named tuples become objects, arrays lists, paths text."""
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: plain(inner) for name, inner in value._asdict().items()}
    if isinstance(value, dict):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value


def attribute_entry(proposal: Proposal) -> dict[str, dict[str, float]]:
    """Centre and width of every attribute's interval, unit values."""
    rows = zip(NAMES, proposal.centre, proposal.width, strict=True)
    return {n: {"centre": _shortest(c), "width": _shortest(w)} for n, c, w in rows}


def street_entries(units: np.ndarray) -> list[list[float]]:
    """The attributes of every street, as short numbers that are read back to the same f32."""
    return [[_shortest(value) for value in unit] for unit in units]


def _shortest(value: np.float32) -> float:
    return float(str(np.float32(value)))


def difference(ours: Any, theirs: Any, name: str = "") -> tuple[str, Any, Any] | None:
    """Name and both values of the first setting that differs."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in [*ours, *(key for key in theirs if key not in ours)]:
            inner = f"{name}.{key}" if name else key
            found = difference(ours.get(key), theirs.get(key), inner)
            if found is not None:
                return found
        return None
    return None if ours == theirs else (name, ours, theirs)


def outcome(streets: Iterable[dict[str, Any]], pixels: int) -> dict[str, Any]:
    """What came out: shares of classes, in how many images, mean colour, and what was placed.

    Args:
        streets: the records of all streets.
        pixels: of one image.
    """
    count, images = np.zeros(len(CLASS_NAMES), np.int64), 0
    containing, rgb = np.zeros(len(CLASS_NAMES), np.int64), np.zeros(3, np.int64)
    placed: Counter[str] = Counter()
    for street in streets:
        placed.update(street["placed"])
        for record in street["images"]:
            count += record["pixels"]
            containing += np.array(record["pixels"]) > 0
            rgb += record["rgb"]
            images += 1
    total = pixels * images
    return {
        "class_frequency": _by_class(np.round(count / total, 9)),
        "images_with_class": _by_class(containing),
        "mean_rgb": np.round(rgb / total, 3).tolist(),
        "placed": {name: placed[name] for name in CLASS_NAMES if name in placed},
    }


def _by_class(values: np.ndarray) -> dict[str, Any]:
    return dict(zip(CLASS_NAMES, values.tolist(), strict=True))


def versions() -> dict[str, str]:
    """Versions of what decides the bytes."""

    def found() -> Iterator[tuple[str, str]]:
        yield "python", platform.python_version()
        for package in PACKAGES:
            try:
                yield package, version(package)
            except PackageNotFoundError:
                yield package, "not installed"

    return dict(found())
