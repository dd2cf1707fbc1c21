"""Buildings: the facade in the plane y = 0 faces the road (-y), the body extends to y > 0.

The facade is a wall with real openings; a layer of frames is some centimetres behind it, and panes of
glass are between the two. Roof, chimneys, balconies, shop fronts and so on are added to it.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts import facade, ornament, roof
from scene.assets.parts.facade import Opening, Part, Patch, bays, upright
from scene.assets.parts.palette import WINDOW
from scene.assets.parts.styles import KINDS, BuildingParams, sample_building
from scene.classes import TrainId
from scene.mesh.asset import Asset
from scene.mesh.solids import box


def eaves(p: BuildingParams) -> float:
    """Return the height of the walls (metres)."""
    return p.ground + p.storeys * p.storey


def _floors(p: BuildingParams) -> list[float]:
    """Return the heights of the floors above the ground floor (metres)."""
    return [p.ground + p.storey * k for k in range(p.storeys)]


def _upper_openings(p: BuildingParams) -> list[list[Opening]]:
    """Return the openings of the upper storeys by column; balconies have glass doors."""
    low = p.storey * (1 - p.window[1]) * 0.55
    high = low + p.storey * p.window[1]
    glazed = p.ground_floor != "decks"
    columns = []
    for bay, span in enumerate(bays(p.width, p.bays, p.window[0])):
        foot = 0.1 if bay in p.balconies else low
        columns.append([Opening(*span, z + foot, z + high, glazed) for z in _floors(p)])
    return columns


def _ground_openings(p: BuildingParams) -> list[list[Opening]]:
    """Return the openings of the ground floor by column."""
    windows = bays(p.width, p.bays, p.window[0])
    top = 0.82 * p.ground
    match p.ground_floor:
        case "shop":
            row = [Opening(*span, 0.55, 0.74 * p.ground) for span in bays(p.width, 3, 0.86)]
            row[1] = row[1]._replace(low=0.08)
        case "gates":
            *gates, office = bays(p.width, 3, 0.72)
            row = [Opening(*gate, 0.05, 0.85 * p.ground, glazed=False) for gate in gates]
            row.append(Opening(*office, 1.6, 0.7 * p.ground))
        case "decks":
            row = [Opening(*span, 0.9, top, glazed=False) for span in windows]
        case "windows":
            row = [Opening(*span, 0.3, top) for span in windows]
        case _:
            row = [Opening(*span, 0.9, top) for span in windows]
            for bay in p.doors:
                row[bay] = row[bay]._replace(low=0.15, glazed=False)
    return [[opening] for opening in row]


def _opening_fill(
    rng: np.random.Generator, p: BuildingParams, opening: Opening, panes: tuple[int, int]
) -> Iterable[Part]:
    """Build the inside of an opening: panes, a door, or the darkness of a parking deck."""
    if opening.glazed:
        return facade.window(rng, opening, panes, p.curtain)
    if p.ground_floor == "decks":
        return [Patch(upright(*opening[:4], facade.PANE), WINDOW, "plain")]
    return facade.door(opening, p.accent)


def _facade(rng: np.random.Generator, p: BuildingParams) -> Iterable[Part]:
    """Build ground floor and upper storeys of the front with frames, panes, doors, sills and lintels."""
    top = eaves(p)
    upper, ground = _upper_openings(p), _ground_openings(p)
    yield Patch(upright(-p.width / 2, p.width / 2, 0, top, facade.RECESS), p.frame, "paint")
    yield from facade.pierced_wall(p.width, (0, p.ground), ground, p.ground_wall)
    yield from facade.pierced_wall(p.width, (p.ground, top), upper, p.wall)
    ground_panes = {"doors": p.panes, "shop": (2, 1)}.get(p.ground_floor, (1, 1))
    for (opening,) in ground:
        yield from _opening_fill(rng, p, opening, ground_panes)
    for bay, column in enumerate(upper):
        for opening in column:
            yield from _opening_fill(rng, p, opening, p.panes)
            if p.head != "flat" and bay not in p.balconies:
                yield from facade.arch(opening, p.wall, pointed=p.head == "pointed")
            if "sills" in p.trim and bay not in p.balconies:
                yield from facade.sill(opening, p.frame)
            if "lintels" in p.trim and p.head == "flat":
                yield facade.lintel(opening, p.frame)


def _trim(rng: np.random.Generator, p: BuildingParams) -> Iterable[Part]:
    """Build the ornaments and fittings on the facade that ``trim`` names."""
    top, half, floors = eaves(p), p.width / 2, _floors(p)
    columns = bays(p.width, p.bays, p.window[0])
    for name in p.trim:
        match name:
            case "strings":
                for z in floors[1:]:
                    yield ornament.band((-half, half), ornament.STRING, z - 0.08, 0.16, p.frame)
            case "cornice":
                yield ornament.band((-half, half), ornament.CORNICE, top - 0.3, 0.26, p.frame)
            case "quoins":
                yield from ornament.quoins(p.width, (0.0, top - 0.3), p.frame)
            case "timbers":
                yield from ornament.timbers(p.width, [*floors, top - 0.12], columns, p.accent)
            case "pilasters" | "mullions" | "ribs":
                width = {"pilasters": 0.42, "mullions": 0.12, "ribs": 0.06}[name]
                foot = p.ground if p.ground_floor == "shop" else 0.0
                count, low = (12, p.ground) if name == "ribs" else (p.bays, foot)
                edges = np.linspace(-half + width / 2, half - width / 2, count + 1)
                for x in edges.tolist():
                    left, right = x - width / 2, x + width / 2
                    corners = (left, -ornament.PILASTER, low), (right, 0.05, top - 0.32)
                    yield facade.relief(*corners, p.frame, "concrete")
            case "pipe":
                yield from ornament.drainpipe(half - 0.2, top)
            case "dish":
                if rng.random() < 0.6:
                    yield from ornament.dish(float(rng.uniform(-0.4, 0.4)) * p.width, top - 0.35)
            case "number":
                x = columns[p.doors[0]][1] + 0.25
                plate = upright(x - 0.1, x + 0.1, 1.6, 1.78, -facade.PROUD)
                yield Patch(plate, ornament.contrast(p.ground_wall[0]), "paint")
            case "sign":
                x = (1, -1)[rng.integers(2)] * (half - 0.5)
                yield from ornament.hanging_sign(x, p.ground + 0.3, p.accent)
            case "board":
                low, high = p.ground - 0.42, p.ground + 0.08
                left, right, y = -0.45 * p.width, 0.45 * p.width, -ornament.BOARD
                yield facade.relief((left, y, low), (right, 0.05, high), p.accent)
                span, levels = (0.55 * left, 0.6 * right), (low + 0.09, high - 0.09)
                ink = ornament.contrast(p.accent)
                yield from ornament.capitals(rng, span, levels, y - facade.PROUD, ink)
            case "turret":
                yield from ornament.turret(-half + 1.0, 1.25, top, floors, p.wall, p.roof_color)
            case "plant":
                yield from roof.plant_room((p.width, p.depth), top + p.rise, p.frame)
            case "battlements":
                for x in np.arange(-half + 0.3, half, 1.1):
                    yield box((0.55, 0.3, 0.5), (float(x), 0.15, top + p.rise), *p.wall)


def _additions(rng: np.random.Generator, p: BuildingParams) -> Iterable[Part]:
    """Build shop fronts, bay windows, hoods over the doors and balconies."""
    if p.ground_floor == "shop":
        yield from ornament.shop_front(rng, p.width, p.ground, (p.accent, p.second_color), p.hood)
    elif p.ground_floor == "doors" and p.hood:
        spans = bays(p.width, p.bays, p.window[0] + 0.15)
        for d in p.doors:
            yield ornament.band(spans[d], p.hood, 0.84 * p.ground, 0.14, p.frame)
    bay_spans = bays(p.width, p.bays, 0.9)
    for bay in p.bay_windows:
        levels = (0.75, 0.78 * p.ground, 0.9 * p.ground)
        yield from ornament.bay_window(bay_spans[bay], levels, p.ground_wall, p.frame, p.roof_color)
    for bay, floor in product(p.balconies, _floors(p)):
        yield from ornament.balcony(bay_spans[bay], floor, p.frame, p.accent)


def _sides(p: BuildingParams) -> Iterable[Part]:
    """Build the back wall, and the side walls with their windows."""
    top, half = eaves(p), p.width / 2
    yield Patch(upright(-half, half, 0, top, p.depth), *p.wall)
    middles = (np.arange(p.side_windows) + 0.5) / max(p.side_windows, 1) * p.depth
    for x in (-half, half):
        corners = [(x, 0, 0), (x, p.depth, 0), (x, p.depth, top), (x, 0, top)]
        yield Patch(corners, *p.wall)
        for storey, middle in product(range(p.storeys), middles):
            low = p.ground + (storey + 0.3) * p.storey
            yield from facade.side_window(x, middle, low, low + 0.5 * p.storey, p.frame)


def _roof(p: BuildingParams) -> Iterable[Part]:
    """Build the roof with its dormers and chimneys, and the tower."""
    plan, base = (p.width, p.depth), eaves(p)
    if p.roof == "flat":
        yield from roof.flat_roof(plan, base, p.rise, p.frame, p.wall)
    else:
        yield from roof.pitched_roof(plan, base, p.rise, p.roof, p.roof_color, p.wall)
        if p.roof != "front gable":
            y = 0.12 * p.depth
            slope = (y, base + p.rise * y / (p.depth / 2 + roof.OVERHANG))
            spread = np.linspace(-1, 1, p.dormers + 2)[1:-1] * p.width / 2
            for x in spread.tolist():
                yield from roof.dormer(x, slope, p.frame, p.roof_color)
    reach = p.width / 2 - 0.6
    for x in (-reach, reach)[: p.chimneys]:
        yield roof.chimney((x, p.depth / 2 + 0.4, base), p.rise + 0.9, p.chimney)
    if p.tower:
        centre = (-p.width / 2 + 1.8, 1.4)
        height = max(p.tower, base + p.rise + 1.5)  # a tower ends above the roof
        yield from roof.steeple(centre, 3.6, height, p.spire, p.wall, p.roof_color)


def building(p: BuildingParams) -> Asset:
    """Build the building."""
    rng = np.random.default_rng(p.seed)
    return facade.assemble(
        [*_facade(rng, p), *_trim(rng, p), *_additions(rng, p), *_sides(p), *_roof(p)]
    )


FAMILY = Family(
    "building", TrainId.BUILDING, tuple(KINDS), sample_building, building,
    count=106, size=Size((3, 120), (2.5, 120)), tone=0.72, line=("building", 0.96),
    facing="road", front="right", stage=FRONTAGE,
)  # fmt: skip
