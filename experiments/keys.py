"""Names for what decides a figure: what has the same name need not be worked out again."""

from __future__ import annotations

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import scene
import seg


def digest(value: Any) -> str:
    """Sha256 of a plain value as canonical JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def folder_digest(*roots: Path, pattern: str = "*") -> str:
    """Sha256 of the names and bytes of all files below some folders that match."""
    found = hashlib.sha256()
    for root in roots:
        for path in sorted(p for p in root.rglob(pattern) if p.is_file()):
            found.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return found.hexdigest()


@lru_cache(maxsize=1)
def engine() -> str:
    """A name for the sources that decide the figures: what another engine scored is not ours."""
    roots = (Path(package.__path__[0]) for package in (scene, seg))
    return folder_digest(*roots, pattern="*.py")[:16]


def evaluation_key(config: str, units: np.ndarray, seed: int) -> str:
    """The key of one evaluation.

    Args:
        config: hash of all that decides the reward, but for the two below.
        units: f32[streets, attributes].
        seed: of the streets and of the net.
    """
    values = np.ascontiguousarray(units, np.float32)
    attributes = [list(values.shape), hashlib.sha256(values.tobytes()).hexdigest()]
    return digest({"config": config, "units": attributes, "seed": int(seed)})
