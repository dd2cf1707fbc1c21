"""What stands in a street as arrays, as renderers want it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.street.street import Street

AssetKey = tuple[str, int | str, bool]
"""Family, index or name, and whether it stays far: see ``geometry.asset_shape``."""


class Instances(NamedTuple):
    """Assets where they stand; row k is instance ``FIRST_INSTANCE + k``."""

    assets: tuple[AssetKey, ...]  # each once
    asset: np.ndarray  # i64[n] index into them
    train_id: np.ndarray  # u8[n]
    pose: np.ndarray  # f32[n, 3, 4] asset frame -> world


def instances(street: Street) -> Instances:
    """The placements of a street."""
    placements = street.placements
    index: dict[AssetKey, int] = {}
    asset = [index.setdefault((p.family, p.asset, p.far), len(index)) for p in placements]
    pose = np.array([p.pose for p in placements], np.float32).reshape(-1, 4, 4)[:, :3]
    train_id = np.array([p.train_id for p in placements], np.uint8)
    return Instances(tuple(index), np.array(asset, np.int64), train_id, pose)
