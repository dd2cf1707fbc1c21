"""The ground of one street: its random parameters.

The carriageway extends ``half_width`` from the centre line. It is followed by a kerb, which drops at
driveways and side streets, the sidewalk, and terrain; hills close the horizon. All of it follows the road's
path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.attributes import BY_NAME
from scene.ground.extent import (
    FOOTWAYS,
    GROUND_END,
    HALF_WIDTHS,
    KERB_HEIGHT,
    KERB_HEIGHTS,
    KERB_WIDTH,
    STRIP,
    STRIP_END,
    stations,
)
from scene.ground.junction import Junction
from scene.ground.land import land_height
from scene.ground.markings import ARROWS, WORDS, Legend
from scene.ground.path import STRAIGHT, Path, height_at, to_world
from scene.ground.verge import NO_SIDES, Side, sample_side
from scene.look.surfaces import (
    ROAD_TONE,
    ROADS,
    SIDEWALK_TONE,
    SIDEWALKS,
    TERRAINS,
    Coat,
    Color,
    asphalt_beside,
    grey,
    sample_coat,
)
from scene.streams import child

KERB_STONE = (0.21, 0.205, 0.195)
"""Linear colour of kerb stones, before weather and dirt."""
TRAMS, LITTERED, PUDDLED = 0.05, 0.3, 0.12
"""Shares of roads with tram tracks, with fallen leaves and with puddles."""


class Ground(NamedTuple):
    """The parameters of a street's ground; places in metres along the road."""

    half_width: float  # of the carriageway, m
    footway: float  # width of each sidewalk, m
    road: Coat
    sidewalk: Coat
    terrain: Coat
    kerb: Color
    strip: float  # factor on the brightness of the sidewalk along the kerb
    lane_shade: float  # difference in brightness of the lanes
    dash: tuple[float, float]  # length and gap of dashes on the centre line, metres
    centre: str  # "dashed", "double", "one side", "hatched" or "none"
    edge_lines: int  # 0 none, 1 one line, 2 double line along each kerb
    edge_yellow: bool
    crosswalks: tuple[float, ...]
    crossing: str  # "zebra" or "studs"
    give_way: bool  # teeth rather than stop lines before crossings
    drive: float  # side (1 left, -1 right) of the traffic that drives forward
    parking: tuple[str, str]  # right and left: "none", "boxes" or "ticks"
    cycle_lane: str  # "none", "line", "green" or "red"
    legends: tuple[Legend, ...]
    boxes: tuple[tuple[float, float], ...]  # box junctions, start and end
    side_streets: tuple[tuple[float, float], ...]  # place and side
    driveways: tuple[tuple[float, float], ...]  # place and side
    patches: int  # repairs
    covers: int  # manholes; 0 also removes gratings
    hills: float  # m
    seed: int  # seed of wear and shades
    wear: float = BY_NAME["road_wear"].default  # age of the road, 0 .. 1
    dust: float = 0.0  # share of dust in the colour along kerbs, 0 .. 1
    leaves: int = 0  # number of fallen leaves, on the road and on sidewalks
    puddles: int = 0
    kerb_height: float = KERB_HEIGHT  # of the sidewalks and the land above the road, m
    rails: float = 0.0  # middle of tram tracks from the centre line, m; 0: none
    sides: tuple[Side, Side] = NO_SIDES  # strips along the sidewalks, right and left
    path: Path = STRAIGHT
    junction: Junction | None = None

    @property
    def shaped(self) -> bool:
        """Whether the road bends, slopes or has a junction, so that open land surrounds it."""
        return not self.path.straight or self.junction is not None

    @property
    def outer(self) -> float:
        """Outer edge of the sidewalks, metres from the centre line."""
        return self.half_width + self.footway

    def side(self, side: float) -> Side:
        """The strips along the sidewalk of one side, 1 left and -1 right."""
        return self.sides[int(side > 0)]

    def rear(self, side: float) -> float:
        """Outer edge of the paving on one side, metres from the centre line."""
        return max(self.outer, self.side(side).rear)


def ground_height(ground: Ground, y: float, x: float = 0.0) -> float:
    """Height of the ground ``y`` metres from the centre line, ``x`` metres along it."""
    return float(ground_heights(ground, np.array([x]), np.array([y]))[0])


def ground_heights(ground: Ground, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights f64[n] of the ground at places ``x``, ``y`` f64[n] of the road, metres."""
    above = kerb_heights(ground, x, y)
    if not ground.shaped:
        return above
    open_land = np.abs(y) > STRIP
    if ground.junction:
        open_land &= ~ground.junction.near_arm(x, y)
    heights = above + height_at(ground.path, x)
    if open_land.any():
        points = to_world(ground.path, x[open_land], y[open_land])
        heights[open_land] = land_height(ground.path, points, ground.junction)
    return heights


def kerb_heights(ground: Ground, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights f64[n] above the carriageway: 0 between the kerbs, ``kerb_height`` beyond them."""
    above = np.where(np.abs(y) < ground.half_width, 0.0, ground.kerb_height)
    if ground.junction:
        above[ground.junction.paved(x, y)] = 0.0
    return above


def along(ground: Ground, step: float) -> np.ndarray:
    """Places along the road where cells of about ``step`` metres meet."""
    places = stations(step, STRIP_END if ground.shaped else GROUND_END)
    if ground.junction is None:
        return places
    at, reach = ground.junction.x, ground.junction.corner
    return np.unique(np.append(places, [at - reach, at + reach]))


def plain(ground: Ground) -> Ground:
    """The same surfaces without markings and details, and level to the horizon."""
    return ground._replace(
        centre="none", edge_lines=0, crosswalks=(), parking=("none", "none"), cycle_lane="none",
        legends=(), boxes=(), side_streets=(), driveways=(), patches=0, covers=0, hills=0.0,
        dust=0.0, leaves=0, puddles=0, rails=0.0, sides=NO_SIDES,
    )  # fmt: skip


def _places(
    rng: np.random.Generator, first: tuple[float, float], gap: tuple[float, float], end: float = 150
) -> list[float]:
    """Random places along the road: ranges of the first place and of the gaps, metres."""
    places, x = [], float(rng.uniform(*first))
    while x < end:
        places.append(x)
        x += float(rng.uniform(*gap))
    return places


def _either_side(rng: np.random.Generator, places: list[float]) -> tuple[tuple[float, float], ...]:
    return tuple((x, 1.0 if rng.random() < 0.5 else -1.0) for x in places)


def _legends(rng: np.random.Generator, lane: float, crosswalks: list[float]) -> list[Legend]:
    """Words and arrows in the lanes at ``lane`` metres on either side, clear of crossings."""
    marks = []
    for x in _places(rng, (6, 30), (14, 45), 110):
        heading = 1.0 if rng.random() < 0.65 else -1.0
        words = [" ".join(w) for w in WORDS]
        kind = str(rng.choice(words if rng.random() < 0.4 else list(ARROWS)))
        if all(abs(x + 2 * heading - c) > 8 for c in crosswalks):
            marks.append(Legend(kind, x, heading * lane, heading))
    return marks


def sample_ground(
    rng: np.random.Generator,
    share: float = 1.0,
    drive: float = 1.0,
    widths: tuple[float, float] = (1.0, 1.0),
    wear: float = BY_NAME["road_wear"].default,
    asphalt: float = BY_NAME["asphalt_sidewalk_share"].default,
) -> Ground:
    """Draw a ground: surfaces, markings, crossings every 40-90 m, repairs, driveways.

    Args:
        rng: consumed.
        share: share of each table of surfaces to draw from (for the half-asset study).
        drive: side, 1 left or -1 right, of the traffic that drives forward.
        widths: factors on the usual widths of carriageway and sidewalks.
        wear: age of the road, 0 new .. 1 worn out.
        asphalt: probability of asphalt sidewalks, as dark as the road.
    """
    half_width = float(rng.uniform(*HALF_WIDTHS)) * widths[0]
    crosswalks = _places(rng, (5, 60), (40, 90)) if rng.random() < 0.65 else []
    boxes = _places(rng, (15, 60), (200, 300)) if rng.random() < 0.12 else []
    side_streets = _places(rng, (12, 50), (35, 90)) if rng.random() < 0.6 else []
    driveways = _places(rng, (4, 25), (9, 40), 100) if rng.random() < 0.6 else []
    kerb_use = str(rng.choice(["none", "edge", "parking", "cycle"], p=[0.22, 0.4, 0.23, 0.15]))
    styles = rng.choice(["none", "boxes", "ticks"], 2, p=[0.2, 0.5, 0.3])
    stone = rng.uniform(0.5, 1.2)
    no_line = 0.04 + 0.2 * wear
    ground = Ground(
        half_width=half_width,
        footway=float(rng.uniform(*FOOTWAYS)) * widths[1],
        road=sample_coat(rng, ROADS, share, ROAD_TONE, wear),
        sidewalk=sample_coat(rng, SIDEWALKS, share, SIDEWALK_TONE),
        terrain=sample_coat(rng, TERRAINS, share),
        kerb=(KERB_STONE[0] * stone, KERB_STONE[1] * stone, KERB_STONE[2] * stone),
        strip=float(rng.choice([1.0, 0.85, 1.12])),
        lane_shade=float(rng.uniform(-0.12, 0.15)) if rng.random() < 0.4 else 0.0,
        dash=(float(rng.uniform(1.5, 4)), float(rng.uniform(2, 6))),
        centre=str(
            rng.choice(
                ["dashed", "double", "one side", "hatched", "none"],
                p=[0.78 - no_line, 0.1, 0.07, 0.05, no_line],
            )
        ),
        edge_lines=int(rng.integers(1, 3)) if kerb_use == "edge" else 0,
        edge_yellow=bool(rng.random() < 0.6),
        crosswalks=tuple(crosswalks),
        crossing="zebra" if rng.random() < 0.6 else "studs",
        give_way=bool(rng.random() < 0.25),
        drive=drive,
        parking=(str(styles[0]), str(styles[1])) if kerb_use == "parking" else ("none", "none"),
        cycle_lane=str(rng.choice(["line", "green", "red"])) if kerb_use == "cycle" else "none",
        legends=tuple(_legends(rng, 0.46 * half_width * drive, crosswalks + boxes))
        if rng.random() < 0.5
        else (),
        boxes=tuple((x, x + 9.0) for x in boxes),
        side_streets=_either_side(rng, side_streets),
        driveways=_either_side(rng, driveways),
        patches=int(rng.integers(0, 1 + round(25 * wear))),
        covers=int(rng.integers(2, 9)),
        hills=float(rng.uniform(4, 32)),
        seed=int(rng.integers(2**32)),
        wear=wear,
    )
    return _aged(ground, asphalt, child(rng))


def _aged(ground: Ground, asphalt: float, rng: np.random.Generator) -> Ground:
    """Add dust and kerbs, and by chance tram tracks, leaves, puddles and asphalt sidewalks."""
    tram, off = rng.random() < TRAMS, float(rng.uniform(1.4, 1.9))
    dust = float(rng.uniform(0, 0.8)) * ground.wear
    paved, stone = rng.random() < asphalt, float(rng.uniform(0.35, 1.0))
    footway_coat = asphalt_beside(rng, ground.road)
    if paved:  # kerb stones of an asphalt footway are only a little lighter
        tone = grey(footway_coat.color)
        red, green, blue = (stone * k + (1 - stone) * tone for k in ground.kerb)
        ground = ground._replace(sidewalk=footway_coat, kerb=(red, green, blue))
    wide = ground.half_width > off + 1.6 and ground.centre != "hatched"
    autumn, rain = rng.random(2) < (LITTERED, PUDDLED)
    ground = ground._replace(
        dust=dust,
        rails=off if tram and wide else 0.0,
        leaves=int(rng.integers(60, 500)) if autumn else 0,
        puddles=int(rng.integers(2, 9)) if rain else 0,
    )
    low, high = KERB_HEIGHTS
    return ground._replace(kerb_height=float(rng.triangular(low, KERB_HEIGHT, high)))


def with_sides(
    ground: Ground,
    share: float,
    fronts: tuple[float | None, float | None],
    rngs: tuple[np.random.Generator, np.random.Generator],
) -> Ground:
    """Add the strips along the sidewalks.

    Args:
        ground: the ground without them.
        share: probability of a verge on each side.
        fronts: distance of the house fronts right and left, metres from the centre line; None: open.
        rngs: streams of the two sides, consumed.
    """
    inner = ground.half_width + KERB_WIDTH
    right, left = (
        sample_side(rng, share, inner, ground.outer, front, ground.sidewalk)
        for front, rng in zip(fronts, rngs, strict=True)
    )
    return ground._replace(sides=(right, left))
