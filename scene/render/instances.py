"""The objects of a street as arrays for renderers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.classes import TrainId
from scene.street.street import Street

AssetKey = tuple[str, int | str, str]
"""Family, index or name, and level of detail, see ``geometry.asset_shape``."""
CLOSE = 10.0
"""Distance in metres from a camera within which greenery has single leaves."""


class Instances(NamedTuple):
    """Assets and their poses; row k is instance ``FIRST_INSTANCE + k``."""

    assets: tuple[AssetKey, ...]  # each once
    asset: np.ndarray  # i64[n] index into them
    train_id: np.ndarray  # u8[n]
    pose: np.ndarray  # f32[n, 3, 4] asset frame -> world


def instances(street: Street) -> Instances:
    """The placements of a street."""
    placements = street.placements
    index: dict[AssetKey, int] = {}
    views = _seen_from(street)
    asset = [
        index.setdefault((p.family, p.asset, where), len(index))
        for p, where in zip(placements, views, strict=True)
    ]
    pose = np.array([p.pose for p in placements], np.float32).reshape(-1, 4, 4)[:, :3]
    train_id = np.array([p.train_id for p in placements], np.uint8)
    return Instances(tuple(index), np.array(asset, np.int64), train_id, pose)


def _seen_from(street: Street) -> list[str]:
    """Level of detail of each placement: ``near`` or ``far`` for greenery, else empty."""
    eyes = [c for camera in street.cameras for c in (camera, *camera.further)]
    places = np.array([c.position[:2] for c in eyes]).reshape(-1, 1, 2)
    views = ["far" if p.far else "" for p in street.placements]
    green = [k for k, p in enumerate(street.placements) if p.train_id == TrainId.VEGETATION]
    if green and len(eyes):
        feet = np.array([street.placements[k].pose[:2, 3] for k in green])
        near = (((feet - places) ** 2).sum(axis=2) < CLOSE**2).any(axis=0)
        for k in np.array(green)[near].tolist():
            views[k] = "near"
    return views
