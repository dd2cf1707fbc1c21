"""``dataset.json``: everything that decided a dataset, and what came out of it."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterable
from typing import Any

import llvmlite.binding
import numpy as np

from scene.classes import CLASS_NAMES
from scene.version import MAKERS
from shell import files

PACKAGES = ("sdr-jax", *MAKERS, "scipy", "trimesh", "pyrender")
ENCODINGS = {
    "depth": "u16, centimetres along the optical axis, 0 for the sky",
    "normals": "u8 RGB, 127.5 (n + 1); camera frame: x right, y up, z towards the camera; black: sky",
    "panoptic": "segment id = R + 256 G + 256^2 B; labelId * 1000 + k for things, else labelId",
}


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
    """Versions of all that has a part in the bytes, and the processor that shading is compiled for."""
    cpu = llvmlite.binding.get_host_cpu_name()
    return {"python": platform.python_version(), "processor": cpu, **files.versions(PACKAGES)}
