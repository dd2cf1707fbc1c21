"""What the engine knows about a family of assets, all in one place: its file's ``FAMILY``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from scene.classes import TrainId
from scene.mesh.asset import Asset


class Size(NamedTuple):
    """What a family's assets measure, metres; a file far from that is in other units, or lies on its side."""

    longest: tuple[float, float]  # longest side
    height: tuple[float, float]


class Stage(NamedTuple):
    """Where a family is shown: metres left of the centre line, and from where it is seen."""

    y: float
    azimuth: float  # degrees of the viewer, from the asset's front axis x, left positive
    elevation: float  # degrees above the asset


ROAD = Stage(-1.5, -38, 12)
FOOTWAY = Stage(6.5, -38, 8)
FRONTAGE = Stage(8.3, -62, 9)
SIGN = Stage(6.5, -155, 4)


@dataclass(frozen=True)
class Family:
    """One asset family.

    ``tone``: colours look right one by one; streets need more. On photographs people and cyclists are dark
    against the road, poles hardly darker than what is behind. The factors bring the median tone of each
    class, beside the road's, near that of CamVid's 0016E5 and 0001TP (``python -m benchmarks.transfer --only
    tones``). Crowns as annotators outline them have the median tone of those of CamVid and LabelMeFacade.

    ``facing``: ``road`` looks at the road, ``lane`` drives with the traffic of its side, ``either`` goes
    along the road one way or the other, ``camera`` looks at the traffic, ``any`` stands anyhow.
    """

    name: str
    train_id: TrainId
    kinds: tuple[str, ...]  # index k is of kind turns[k % len(turns)]
    sample: Callable[[np.random.Generator, str], Any]  # (rng, kind) -> params
    build: Callable[[Any], Asset]  # params -> asset, pure
    count: int  # assets that streets draw from by default; any larger index works, too
    size: Size  # that a user's own may have
    tone: float  # factor on the albedo; a user's own assets are left as they are
    line: tuple[str, float] | None  # on which line of a street, and its share there
    facing: str = "any"
    front: str = "ahead"  # where it looks in its own frame: "ahead" +x, "right" -y, "back" -x
    stage: Stage = FOOTWAY
    on: str | Mapping[str, str] = ""  # family of the post or machine it comes on, or that by kind
    runs: bool = False  # one asset is a panel; up to three stand in a row
    more: tuple[str, ...] = ()  # kinds that are met more often, each once for every time more
    classes: tuple[tuple[str, TrainId], ...] = ()  # of kinds whose class is not ``train_id``
    again: tuple[int, ...] = ()  # whose first draw looked like an earlier one: the second is taken

    @property
    def turns(self) -> tuple[str, ...]:
        """The kinds in the order in which indices take them, over and over."""
        return self.kinds + self.more

    def draw(self, rng: np.random.Generator, kind: str) -> Asset:
        """An asset of one of the kinds; raises ValueError naming them."""
        if kind not in self.kinds:
            known = ", ".join(self.kinds)
            raise ValueError(f"unknown kind of {self.name} {kind!r}; known: {known}")
        return self.build(self.sample(rng, kind))

    def base(self, kind: str) -> str:
        """The family of what an asset of a kind comes on; empty for nothing."""
        return self.on if isinstance(self.on, str) else self.on[kind]
