"""The global attributes of a street: names, ranges, units, defaults. The only place with ranges.

Two spaces: ``scenex`` has the paper's 23; ``extended`` adds more properties of real streets and cameras. New
attributes go to its end: files without them get their defaults. In ``scenex`` the others have their defaults,
so the default street is the same in both spaces. All other code handles attributes as unit values in [0, 1];
``street_params`` converts them to metres, radians and probabilities. Source: section 3 of the paper for the 23;
the ranges are ours.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np

from common.errors import UserError, hint


class Attribute(NamedTuple):
    """One row of the table; ``low`` and ``high`` are the physical values at unit 0 and 1."""

    name: str
    low: float
    high: float
    scale: str  # "linear" or "log"
    default: float  # of the default street
    unit: str
    meaning: str

    def physical(self, unit_value: float) -> float:
        """The physical value at ``unit_value`` in [0, 1]."""
        if self.scale == "log":
            return self.low * (self.high / self.low) ** unit_value
        return self.low + (self.high - self.low) * unit_value

    def to_unit(self, value: float) -> float:
        """The unit value of a physical ``value``; the inverse of ``physical``."""
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


# fmt: off
# ruff: noqa: E501
ATTRIBUTES: tuple[Attribute, ...] = (
    Attribute("illumination_intensity", 0.3, 1.7, "linear", 0.9, "x nominal", "brightness of sun and sky"),
    Attribute("illumination_angle_x", 8, 80, "linear", 35, "deg", "sun elevation above the horizon"),
    Attribute("illumination_angle_y", -180, 180, "linear", 60, "deg", "sun azimuth, 0 straight ahead, left positive"),
    Attribute("camera_position_probability", 0, 1, "linear", 0.1, "probability", "camera on the right side of the road"),
    Attribute("camera_position_x", 0, 8, "linear", 1.8, "m", "camera's distance from the centre line"),
    Attribute("camera_position_y", 0.8, 4.0, "linear", 1.5, "m", "camera's height above the ground"),
    Attribute("camera_rotation_x", -12, 20, "linear", 2, "deg", "camera pitch, down positive"),
    Attribute("camera_rotation_y", -40, 40, "linear", 0, "deg", "camera yaw, right positive"),
    Attribute("building_position", 5, 30, "linear", 9, "m", "centre line to building (or train) facade"),
    Attribute("fence_position", 3.5, 20, "linear", 7.5, "m", "centre line to fence (or wall)"),
    Attribute("tree_position", 3.5, 20, "linear", 9, "m", "centre line to tree (or bush)"),
    Attribute("bicycle_position", 1, 14, "linear", 6.3, "m", "centre line to bicycle (or motorcycle)"),
    Attribute("person_position", 1, 14, "linear", 5.5, "m", "centre line to person (or rider)"),
    Attribute("pole_position", 2, 14, "linear", 4.8, "m", "centre line to pole (or traffic sign, light)"),
    Attribute("car_position", 1, 14, "linear", 3.4, "m", "centre line to car (or bus, truck)"),
    Attribute("building_probability", 0, 1, "linear", 0.8, "probability", "a slot of the building line is filled"),
    Attribute("building_interval", 8, 40, "log", 10, "m", "spacing of buildings along their line"),
    Attribute("fence_interval", 3, 40, "log", 12, "m", "spacing of fences along their line"),
    Attribute("tree_interval", 3, 40, "log", 14, "m", "spacing of trees along their line"),
    Attribute("bicycle_interval", 3, 40, "log", 18, "m", "spacing of bicycles along their line"),
    Attribute("person_interval", 1.5, 40, "log", 8, "m", "spacing of people along their line"),
    Attribute("pole_interval", 5, 50, "log", 16, "m", "spacing of poles along their line"),
    Attribute("car_interval", 5, 50, "log", 25, "m", "spacing of cars along their line"),
)
ADDED: tuple[Attribute, ...] = (
    Attribute("field_of_view", 30, 110, "linear", 50, "deg", "the camera's horizontal field of view"),
    Attribute("camera_roll", -6, 6, "linear", 0, "deg", "camera roll, clockwise positive"),
    Attribute("exposure", 0.5, 2, "log", 1, "x metered", "light that the camera lets in"),
    Attribute("white_balance", -1, 1, "linear", 0, "stops", "red against blue, warm positive"),
    Attribute("road_width", 0.6, 2, "log", 1, "x usual", "width of the carriageway"),
    Attribute("sidewalk_width", 0.4, 2.5, "log", 1, "x usual", "width of the sidewalks"),
    Attribute("bend", 0, 25, "linear", 5, "1/km", "sharpest curvature of the road"),
    Attribute("gradient", 0, 10, "linear", 2, "%", "steepest slope of the road"),
    Attribute("junction_share", 0, 1, "linear", 0.2, "share", "streets with a junction ahead"),
    Attribute("parked_share", 0, 1, "linear", 0.25, "share", "roadsides with a row of parked cars"),
    Attribute("queue_share", 0, 1, "linear", 0.2, "share", "lanes with a queue of cars"),
    Attribute("open_share", 0, 1, "linear", 0.15, "share", "roadsides open to a park, water or field"),
    Attribute("bare_tree_share", 0, 1, "linear", 0.33, "share", "trees without leaves"),
    Attribute("overcast_share", 0, 1, "linear", 0.27, "share", "streets under closed cloud"),
)
LATER: tuple[Attribute, ...] = (
    Attribute("asphalt_sidewalk_share", 0, 1, "linear", 0.35, "share", "streets with sidewalks of asphalt, as dark as the road"),
    Attribute("green_verge_share", 0, 1, "linear", 0.25, "share", "roadsides with grass, earth, gravel or plants along the sidewalk"),
    Attribute("road_wear", 0, 1, "linear", 0.45, "of the most", "age of the road: cracks, repairs, dust, faded paint"),
)
# fmt: on

NAMES: tuple[str, ...] = tuple(a.name for a in ATTRIBUTES)
"""The paper's 23."""
SpaceName = Literal["scenex", "extended"]
SPACES: dict[SpaceName, tuple[Attribute, ...]] = {
    "scenex": ATTRIBUTES,
    "extended": (*ATTRIBUTES, *ADDED, *LATER),
}
BY_NAME: dict[str, Attribute] = {a.name: a for a in SPACES["extended"]}


class StreetParams(NamedTuple):
    """The attributes of one street in metres, radians and probabilities; fields as in the table."""

    illumination_intensity: float
    illumination_angle_x: float
    illumination_angle_y: float
    camera_position_probability: float
    camera_position_x: float
    camera_position_y: float
    camera_rotation_x: float
    camera_rotation_y: float
    building_position: float
    fence_position: float
    tree_position: float
    bicycle_position: float
    person_position: float
    pole_position: float
    car_position: float
    building_probability: float
    building_interval: float
    fence_interval: float
    tree_interval: float
    bicycle_interval: float
    person_interval: float
    pole_interval: float
    car_interval: float
    field_of_view: float | None = None  # None: the renderer's setting
    camera_roll: float = 0.0
    exposure: float = 1.0
    white_balance: float = 0.0
    road_width: float = 1.0
    sidewalk_width: float = 1.0
    bend: float = BY_NAME["bend"].default
    gradient: float = BY_NAME["gradient"].default
    junction_share: float = BY_NAME["junction_share"].default
    parked_share: float = BY_NAME["parked_share"].default
    queue_share: float = BY_NAME["queue_share"].default
    open_share: float = BY_NAME["open_share"].default
    bare_tree_share: float | None = None  # None: that of the catalogue
    overcast_share: float | None = None  # None: that of the table of skies
    asphalt_sidewalk_share: float = BY_NAME["asphalt_sidewalk_share"].default
    green_verge_share: float = BY_NAME["green_verge_share"].default
    road_wear: float = BY_NAME["road_wear"].default

    @property
    def space(self) -> SpaceName:
        """The space of the attributes; only ``extended`` has a field of view."""
        return "scenex" if self.field_of_view is None else "extended"


def names(space: SpaceName) -> tuple[str, ...]:
    """The names of a space's attributes, in order."""
    return tuple(a.name for a in SPACES[space])


def space_of(count: int) -> SpaceName:
    """The space with ``count`` attributes.

    Raises:
        ValueError: no space has this number.
    """
    for space, rows in SPACES.items():
        if len(rows) == count:
            return space
    sizes = " or ".join(f"{len(rows)} ({space})" for space, rows in SPACES.items())
    raise ValueError(f"attributes must have {sizes} values, not {count}")


def default_unit(space: SpaceName = "scenex") -> np.ndarray:
    """The default street, f32[attributes] unit values."""
    return np.array([a.to_unit(a.default) for a in SPACES[space]], np.float32)


def check_unit(unit: np.ndarray) -> np.ndarray:
    """Return ``unit`` as f32[..., attributes] of one of the spaces, see `space_of`.

    Raises:
        ValueError: the number of attributes is wrong, or a value is NaN or outside [0, 1].
    """
    unit = np.asarray(unit, np.float32)
    rows = SPACES[space_of(unit.shape[-1] if unit.ndim else 0)]
    bad = np.argwhere(~((unit >= 0) & (unit <= 1)))
    if len(bad):
        where = tuple(bad[0])
        raise ValueError(
            f"attribute {rows[where[-1]].name} is {unit[where]}; unit values must lie in [0, 1]"
        )
    return unit


def unit_value(name: str, value: Any, space: SpaceName) -> float:
    """The unit value of an attribute from its physical ``value``, a number or its text.

    Raises:
        UserError: the space has no such attribute, or the value is not a number in its range.
    """
    if name not in names(space):
        raise UserError(_unknown_attribute(name, space))
    attribute = BY_NAME[name]
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not attribute.low <= number <= attribute.high:
        raise UserError(
            f"{name} must be a number from {attribute.low:g} to {attribute.high:g} ({attribute.unit}), "
            f"not {value!r}"
        )
    return attribute.to_unit(number)


def _unknown_attribute(name: str, space: SpaceName) -> str:
    if name in BY_NAME:
        return f"space {space} has no attribute {name}; space extended does"
    return f"there is no attribute {name!r}; {hint(name, names(space))}"


def street_params(unit: np.ndarray) -> StreetParams:
    """Physical parameters of one street from unit values f32[attributes].

    Raises:
        ValueError: as ``check_unit``.
    """
    values = []
    for value, attribute in zip(check_unit(unit).tolist(), BY_NAME.values(), strict=False):
        physical = attribute.physical(value)
        values.append(math.radians(physical) if attribute.unit == "deg" else physical)
    return StreetParams(*values)
