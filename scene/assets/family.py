"""The record of an asset family, ``FAMILY`` in its file: all that the engine needs to know about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from common.errors import hint
from scene.classes import TrainId
from scene.mesh.asset import Asset


class Size(NamedTuple):
    """Plausible sizes of a family's assets, metres; a file beyond them is in other units or on its side."""

    longest: tuple[float, float]  # longest side
    height: tuple[float, float]


class Stage(NamedTuple):
    """Where previews put an asset, in metres left of the centre line, and the viewpoint."""

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

    ``tone``: Each colour looks right by itself, but streets need a correction: in photographs people and
    cyclists are dark against the road, and poles hardly darker than their background. The factors bring the
    median tone of each class, relative to the road's, close to that of CamVid's 0016E5 and 0001TP (``python
    -m benchmarks.transfer --only tones``). Tree crowns, as annotators outline them, have the median tone of
    those in CamVid and LabelMeFacade.

    ``facing``: ``road`` faces the road, ``lane`` drives with the traffic on its side, ``either`` moves along
    the road in either direction, ``camera`` faces the traffic, ``any`` is turned at random.
    """

    name: str
    train_id: TrainId
    kinds: tuple[str, ...]  # index k has kind kind_cycle[k % len(kind_cycle)]
    sample: Callable[[np.random.Generator, str], Any]  # (rng, kind) -> params
    build: Callable[[Any], Asset]  # params -> asset, pure
    count: int  # assets that streets draw from by default; larger indices work, too
    size: Size  # accepted for a user's own assets
    tone: float  # factor on the albedo of built-in assets
    line: tuple[str, float] | None  # the line of a street it stands on, and its share of that line
    facing: str = "any"
    front: str = "ahead"  # its front in its own frame: "ahead" +x, "right" -y, "back" -x
    stage: Stage = FOOTWAY
    mounted_on: str | Mapping[str, str] = ""  # family of its post or machine, or that by kind
    in_rows: bool = False  # an asset is one panel of up to three in a row
    frequent: tuple[str, ...] = ()  # more common kinds, once for each additional turn in the cycle
    classes: tuple[tuple[str, TrainId], ...] = ()  # of kinds with another class than ``train_id``
    redrawn: tuple[int, ...] = ()  # indices drawn from a second seed, as the first gave a lookalike

    @property
    def kind_cycle(self) -> tuple[str, ...]:
        """Kinds in the order in which consecutive indices have them, cyclically."""
        return self.kinds + self.frequent

    def draw(self, rng: np.random.Generator, kind: str) -> Asset:
        """Draw an asset of one kind; raise ValueError with the known kinds for another."""
        if kind not in self.kinds:
            raise ValueError(f"unknown kind of {self.name} {kind!r}; {hint(kind, self.kinds)}")
        return self.build(self.sample(rng, kind))

    def base(self, kind: str) -> str:
        """Return the family that an asset of ``kind`` is mounted on; empty for none."""
        return self.mounted_on if isinstance(self.mounted_on, str) else self.mounted_on[kind]
