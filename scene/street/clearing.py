"""Clears a junction of objects of lines and background in its carriageways or its houses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scene.ground.extent import GROUND_START, STRIP_END
from scene.ground.ground import Ground
from scene.ground.junction import ARM_END
from scene.ground.path import nearest
from scene.street.instances import Stand, spans, world_corners

VEHICLES = ("car", "truck", "bus")
"""Families of the traffic."""
WALKING = frozenset({"person"})
"""Families that may stand between the kerbs of a junction."""
SOLID = frozenset({"building", "train", "fence", "wall"})
"""Families that may not reach over an arm."""
CLEAR = 1.5
"""Metres by which a house may be nearer to the road than its front before it is left out."""


def cleared(ground: Ground, stands: Sequence[Stand], houses: Sequence[Stand]) -> list[Stand]:
    """Leave out objects that would stand in a junction or in its houses.

    Args:
        ground: ground of the street.
        stands: objects of the lines and the background.
        houses: houses of the junction.
    """
    junction = ground.junction
    if junction is None or not stands:
        return list(stands)
    low, high = spans(ground.path, stands, junction.x)
    middle = (low + high) / 2
    families = [stand.family for stand in stands]
    solid, vehicle, house, walks = (
        np.array([family in kinds for family in families], bool)
        for kinds in (SOLID, VEHICLES, ("building",), WALKING)
    )
    first, last = (np.where(solid[:, None], end, middle) for end in (low, high))
    (x, y), away = (first + last).T / 2, np.abs(first + last).T / 2
    beside = np.isin(np.sign(y), junction.arms) & (away[1] <= ARM_END)
    reach = np.where(house, junction.outer + 0.3, junction.corner)
    across = (first[:, 0] < reach) & (last[:, 0] > -reach)
    inner = (away[0] < junction.corner) & (away[1] < junction.road_half_width + 0.4)
    paved = junction.paved(x + junction.x, y, 0.5)
    bad = beside & np.where(solid, across, np.where(inner, ~walks, paved))
    on_road = vehicle & (away[1] < junction.road_half_width)
    bad = np.where(on_road, away[0] < junction.half_width + 3.5, bad)
    # A crown may reach over a roof.
    for begin, end in zip(*spans(ground.path, houses, junction.x), strict=True):
        bad |= ((first < end) & (last > begin)).all(axis=1)
    return _whole(stands, bad)


def off_the_road(ground: Ground, stands: Sequence[Stand], front: float) -> list[Stand]:
    """Leave out houses that would reach across the road in a bend.

    Args:
        ground: ground of the street.
        stands: houses and other objects.
        front: metres from the centre line to the facades.
    """
    houses = [k for k, stand in enumerate(stands) if stand.family == "building"]
    bad = np.zeros(len(stands), bool)
    if ground.path.bends and houses:
        corners = world_corners(ground.path, [stands[k] for k in houses])
        _, away = nearest(ground.path, corners.reshape(-1, 2), GROUND_START, STRIP_END)
        bad[houses] = away.reshape(-1, 4).min(axis=1) < front - CLEAR
    return _whole(stands, bad)


def _whole(stands: Sequence[Stand], bad: np.ndarray) -> list[Stand]:
    """Leave out bad objects bool[n] with their parts."""
    found: list[Stand] = []
    stays = True
    for stand, leaves in zip(stands, bad.tolist(), strict=True):
        stays = stays if stand.part else not leaves
        if stays:
            found.append(stand)
    return found
