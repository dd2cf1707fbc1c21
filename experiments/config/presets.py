"""Defaults of every command by target and preset, as tables of differences from the fields' own defaults."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

from experiments.config.config import AnyConfig, GroupsConfig, Preset, TargetName
from scene.attributes import NAMES, SpaceName
from seg.recipes import RECIPES

PRESETS: tuple[Preset, ...] = get_args(Preset)
TARGETS: tuple[TargetName, ...] = get_args(TargetName)
VARIABLES: dict[TargetName, str] = {"camvid": "CAMVID_DIR", "labelmefacade": "LABELMEFACADE_DIR"}
"""Environment variables for the folder of a target's data, used where no flag names it."""
FOUR_BY_THREE: tuple[TargetName, ...] = ("camvid", "labelmefacade")
"""Targets with images of aspect ratio 4:3."""
TWO_BY_ONE: tuple[TargetName, ...] = ("twin", "cityscapes")
"""Targets with images of aspect ratio 2:1."""

POSITIONS = tuple(
    f"{n}_position" for n in ("building", "fence", "tree", "pole", "bicycle", "person", "car")
)
DENSITIES = (
    "building_probability",
    *(f"{n}_interval" for n in ("building", "fence", "tree", "bicycle", "person", "pole", "car")),
)
ENVIRONMENT = NAMES[:8]

CITYSCAPES_GROUPS: tuple[tuple[str, ...], ...] = (
    POSITIONS,
    *(DENSITIES[i : i + 2] for i in range(0, 8, 2)),
    ENVIRONMENT,
)
"""The paper's six groups for Cityscapes: positions, densities in four pairs, environment."""

CAMVID_GROUPS: tuple[tuple[str, ...], ...] = (
    *(POSITIONS[i : i + 2] for i in range(0, 7, 2)),
    DENSITIES,
    ENVIRONMENT,
)
"""The paper's six groups for CamVid: positions in four, densities, environment."""

ADDED_GROUPS: tuple[tuple[str, ...], ...] = (
    ("field_of_view", "camera_roll", "exposure", "white_balance"),
    ("road_width", "sidewalk_width", "bend", "gradient", "junction_share"),
    ("parked_share", "queue_share", "open_share", "bare_tree_share", "overcast_share"),
    ("asphalt_sidewalk_share", "green_verge_share", "road_wear"),
)
"""Our groups of the attributes that the extended space adds: camera, road, roadside, ground."""

Table = dict[str, Any]
"""Values by field; a group of fields is itself a table. In the table of a network's training, ``recipe``
names the recipe of `seg.recipes` that its other values change."""


_SMOKE_NET = {"steps": 12, "batch": 4, "warmup": 2}
_SMOKE_FINAL = {"streets": 3, "shots": 2, "samples": 1, "train": {**_SMOKE_NET, "steps": 20}}
_SMOKE: Table = {
    "search": {"updates_per_group": 1, "datasets_per_update": 2, "bins": 5},
    "reward": {"streets": 2, "shots": 2, "samples": 1, "train": _SMOKE_NET},
    "final": _SMOKE_FINAL,
    "compact": _SMOKE_FINAL,
    "vgg": _SMOKE_FINAL,
    "reward_images": 8,
    "test_images": 8,
    "seeds": 2,
    "asset_count": 4,
}

_FROZEN = {"recipe": "lite0-frozen", "average_mirror": True}
_BRIEF = {"recipe": "lite0-frozen", "steps": 150, "views": 1}
_QUICK: Table = {
    "search": {"method": "intervals", "relaxation": 0.3},
    "reward": {"samples": 1, "train": _BRIEF},
    "final": {"shots": 1, "samples": 1, "train": _FROZEN},
    # Sizes and steps at which two cores can train networks other than the preset's.
    "compact": {"streets": 50, "shots": 8, "train": {"recipe": "compact"}},
    "vgg": {"streets": 100, "shots": 4, "train": {"recipe": "scratch", "steps": 150}},
}
_QUICK_TWIN: Table = {
    "search": {"updates_per_group": 4},
    "reward": {"streets": 12, "shots": 6},
    "final": {"streets": 80},
    "seeds": 4,
}
_QUICK_REAL: Table = {
    "search": {"updates_per_group": 3, "datasets_per_update": 8},
    # 12 streets with 8 images each are noisier (`sdr-jax study fidelity`).
    "reward": {"streets": 24, "shots": 4},
    "final": {"streets": 400},
}

_PAPER_NET = {"recipe": "paper"}
_PAPER_FINAL = {"streets": 45, "shots": 10, "samples": 1}
_LARGE = {"width": 1024, "height": 512}
_PAPER: Table = {
    "search": {"method": "sdr", "updates_per_group": 50, "datasets_per_update": 1},
    "reward": {"streets": 18, "shots": 10, "samples": 1, "train": _PAPER_NET},
    "final": {**_PAPER_FINAL, "train": {**_PAPER_NET, "steps": 20_000}},
    "compact": {**_PAPER_FINAL, "train": {"recipe": "compact"}},
    "vgg": {**_PAPER_FINAL, "train": {**_PAPER_NET, "steps": 20_000}},
}

TABLES: tuple[tuple[Preset, tuple[TargetName, ...], Table], ...] = (
    ("smoke", TARGETS, _SMOKE),
    ("quick", TARGETS, _QUICK),
    ("quick", ("twin",), _QUICK_TWIN),
    ("quick", (*FOUR_BY_THREE, "cityscapes"), _QUICK_REAL),
    ("quick", ("cityscapes",), {"reward_images": 500}),
    ("paper", TARGETS, _PAPER),
    ("paper", TWO_BY_ONE, {
        "reward_images": 500, "final": _LARGE, "compact": _LARGE, "vgg": _LARGE,
    }),
)  # fmt: skip
"""Changes by a preset for some targets; later rows override earlier ones, and all override `SIZES`."""
Size = tuple[int, int]
SIZES: tuple[tuple[Preset, tuple[TargetName, ...], Size, Size], ...] = (
    ("smoke", FOUR_BY_THREE, (64, 48), (64, 48)),
    ("smoke", TWO_BY_ONE, (64, 32), (64, 32)),
    ("quick", FOUR_BY_THREE, (240, 176), (128, 96)),
    ("quick", ("twin",), (128, 64), (96, 48)),
    ("quick", ("cityscapes",), (256, 128), (128, 64)),
    ("paper", FOUR_BY_THREE, (480, 360), (480, 360)),
    ("paper", TWO_BY_ONE, (640, 320), (640, 320)),
)
"""Width and height of the images of rewards and final networks, then of the table's other networks."""


def defaults(
    kind: type[AnyConfig], target: TargetName, preset: Preset, **changes: Any
) -> AnyConfig:
    """Make the defaults of a command's configuration.

    Args:
        kind: its class; fields that no table mentions keep their own defaults, and values for fields that it
            lacks are ignored.
        target: the target of the networks.
        preset: "smoke", "quick" or "paper".
        changes: values of this command instead of the preset's, as a `Table`.
    """
    groups = CAMVID_GROUPS if target in FOUR_BY_THREE else CITYSCAPES_GROUPS
    values: Table = {"target": target, "preset": preset, "groups": groups}
    if folder := data_of(target):
        values["data"] = folder
    for name, targets, size, other_size in SIZES:
        if name == preset and target in targets:
            sizes = {"reward": size, "final": size, "compact": other_size, "vgg": other_size}
            values = _merged(values, {k: {"width": w, "height": h} for k, (w, h) in sizes.items()})
    for name, targets, table in TABLES:
        if name == preset and target in targets:
            values = _merged(values, table)
    return _build(kind, _merged(values, changes))


def data_of(target: TargetName) -> Path | None:
    """Return the folder of a target's data that an environment variable names, if one does."""
    folder = os.environ.get(VARIABLES.get(target, ""))
    return Path(folder) if folder else None


def _merged(values: Table, changes: Table) -> Table:
    """Change some values; within groups of fields one by one."""
    groups = {
        name: _merged(values[name], changes[name])
        for name in values.keys() & changes.keys()
        if isinstance(values[name], dict) and isinstance(changes[name], dict)
    }
    return values | changes | groups


def _build(kind: Any, values: Table) -> Any:
    """Make a dataclass from the values of its fields; other values are ignored."""
    hints, names = get_type_hints(kind), {field.name for field in fields(kind)}
    field_values = {
        name: _build(hints[name], value) if isinstance(value, dict) else value
        for name, value in values.items()
        if name in names
    }
    recipe = values.get("recipe")
    return kind(**field_values) if recipe is None else replace(RECIPES[recipe], **field_values)


def in_space(config: AnyConfig, space: SpaceName) -> AnyConfig:
    """Return defaults with the attributes of another space; added attributes are searched after the 23."""
    if space == config.space:
        return config
    config = replace(config, space=space)
    if isinstance(config, GroupsConfig):
        return replace(config, groups=(*config.groups, *ADDED_GROUPS))
    return config
