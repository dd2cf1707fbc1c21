"""The 23 global attributes of a street: names, ranges, units, defaults. The only place with ranges.

Everything outside this file handles attributes as unit values in [0, 1]; ``street_params`` turns them
into metres, radians and probabilities. Source: section 3 of the paper; the ranges are ours and frozen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Attribute(NamedTuple):
    """One row of the table; ``low`` and ``high`` are the physical values at unit 0 and 1."""

    name: str
    low: float
    high: float
    scale: str  # "linear" or "log"
    default: float  # a street set by eye
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
    Attribute("bicycle_position", 1, 14, "linear", 3.2, "m", "centre line to bicycle (or motorcycle)"),
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
# fmt: on

NAMES: tuple[str, ...] = tuple(a.name for a in ATTRIBUTES)
BY_NAME: dict[str, Attribute] = {a.name: a for a in ATTRIBUTES}


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


def default_unit() -> np.ndarray:
    """The street set by eye, f32[23] unit values."""
    return np.array([a.to_unit(a.default) for a in ATTRIBUTES], np.float32)


def check_unit(unit: np.ndarray) -> np.ndarray:
    """``unit`` as f32[..., 23].

    Raises:
        ValueError: wrong number of attributes, or a value that is NaN or outside [0, 1], by name.
    """
    unit = np.asarray(unit, np.float32)
    if unit.ndim == 0 or unit.shape[-1] != len(ATTRIBUTES):
        raise ValueError(f"attributes must have {len(ATTRIBUTES)} values, got shape {unit.shape}")
    bad = np.argwhere(~((unit >= 0) & (unit <= 1)))
    if len(bad):
        where = tuple(bad[0])
        raise ValueError(
            f"attribute {NAMES[where[-1]]} is {unit[where]}; unit values must lie in [0, 1]"
        )
    return unit


def street_params(unit: np.ndarray) -> StreetParams:
    """Physical parameters of one street from unit values f32[23].

    Raises:
        ValueError: as ``check_unit``.
    """
    values = []
    for attribute, value in zip(ATTRIBUTES, check_unit(unit).tolist(), strict=True):
        physical = attribute.physical(value)
        values.append(math.radians(physical) if attribute.unit == "deg" else physical)
    return StreetParams(*values)
