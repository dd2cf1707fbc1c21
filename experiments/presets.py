"""The defaults of every command by target and preset."""

from __future__ import annotations

import os
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from experiments.config import Config, Fidelity, PoolOptions, Preset, Search, TargetName
from scene.attributes import NAMES, SpaceName
from seg.recipes import RECIPES
from seg.settings import TrainSettings

PRESETS: tuple[Preset, ...] = get_args(Preset)
TARGETS: tuple[TargetName, ...] = get_args(TargetName)
VARIABLES: dict[TargetName, str] = {"camvid": "CAMVID_DIR", "labelmefacade": "LABELMEFACADE_DIR"}
"""Of the environment: the folder of a target's data, where no flag says it."""
FOUR_BY_THREE: tuple[TargetName, ...] = ("camvid", "labelmefacade")
"""Targets whose images are four wide to three high; the others' are two wide to one high."""

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
)
"""Ours, of what the extended space adds: the camera, the road, what stands beside it."""

AnyConfig = TypeVar("AnyConfig", bound=Config)


def defaults(kind: type[AnyConfig], target: TargetName, preset: Preset, **own: Any) -> AnyConfig:
    """The defaults of a command's configuration.

    Args:
        kind: its class; what the presets do not know has defaults of its own.
        target: what the nets must be good on.
        preset: "smoke", "quick" or "paper".
        own: values of this command in place of the preset's; of nested fields as a dictionary.
    """
    values = {**_PRESETS[preset](target), "target": target, "preset": preset}
    variable = VARIABLES.get(target)
    if variable and os.environ.get(variable):
        values["data"] = Path(os.environ[variable])
    for name, value in own.items():
        inner = values.get(name)
        nested = is_dataclass(inner) and not isinstance(inner, type) and isinstance(value, dict)
        values[name] = replace(inner, **value) if nested else value  # type: ignore[type-var]
    known = {field.name: field for field in fields(kind)}
    picked = {name: value for name, value in values.items() if name in known}
    if "search" in picked:
        picked["search"] = _narrowed(picked["search"], kind)
    return kind(**picked)


def in_space(config: AnyConfig, space: SpaceName) -> AnyConfig:
    """The defaults with the attributes of another space; what it adds is searched after the 23."""
    if space == config.space:
        return config
    changes: dict[str, Any] = {"space": space}
    if hasattr(config, "groups"):
        changes["groups"] = (*config.groups, *ADDED_GROUPS)
    return replace(config, **changes)


def _narrowed(search: Search, kind: type[Config]) -> Any:
    """The options of a search that a command has."""
    own = get_type_hints(kind)["search"]
    return own(**{field.name: getattr(search, field.name) for field in fields(own)})


def _groups(target: TargetName) -> tuple[tuple[str, ...], ...]:
    return CAMVID_GROUPS if target in FOUR_BY_THREE else CITYSCAPES_GROUPS


_FINAL = RECIPES["lite0-frozen"]
_REWARD = replace(_FINAL, steps=150, views=1)


def _others(width: int, height: int) -> dict[str, Any]:
    """Sizes and steps at which two cores train the nets that are not the preset's."""
    brief = replace(RECIPES["scratch"], steps=150)
    return {
        "compact": Fidelity(width, height, 50, 8, train=RECIPES["compact"]),
        "vgg": Fidelity(width, height, 100, 4, train=brief),
    }


def _smoke(target: TargetName) -> dict[str, Any]:
    tiny = TrainSettings(steps=12, batch=4, warmup=2)
    width, height = (64, 48) if target in FOUR_BY_THREE else (64, 32)
    final = Fidelity(width, height, streets=3, shots=2, samples=1, train=replace(tiny, steps=20))
    return {
        "groups": _groups(target),
        "search": Search(
            updates_per_group=1,
            datasets_per_update=2,
            bins=5,
            pool=PoolOptions(streets=8, subset=4, rewards=3, rounds=2),
        ),
        "reward": Fidelity(width, height, streets=2, shots=2, samples=1, train=tiny),
        "final": final,
        "compact": final,
        "vgg": final,
        "reward_images": 8,
        "test_images": 8,
        "candidate_seeds": 1,
        "candidates": ("argmax", "broad", "last", "mixed"),
        "seeds": 2,
        "asset_count": 4,
    }


def _quick(target: TargetName) -> dict[str, Any]:
    if target == "twin":
        return {
            "groups": _groups(target),
            "search": Search(
                method="intervals",
                updates_per_group=5,
                datasets_per_update=4,
                relaxation=0.3,
                pool=PoolOptions(subset=100, rewards=300, rounds=3),
            ),
            "reward": Fidelity(128, 64, streets=12, shots=6, samples=1, train=_REWARD),
            "final": Fidelity(128, 64, streets=120, shots=1, samples=1, train=_FINAL),
            **_others(96, 48),
            "seeds": 6,
        }
    size = (240, 176) if target in FOUR_BY_THREE else (256, 128)
    return {
        "groups": _groups(target),
        "search": Search(
            method="intervals", updates_per_group=4, datasets_per_update=8, relaxation=0.3
        ),
        # Of methods without a pool; 12 streets with 8 images have more noise (`experiments.fidelity`).
        "reward": Fidelity(*size, streets=24, shots=4, samples=1, train=_REWARD),
        "final": Fidelity(*size, streets=400, shots=1, samples=1, train=_FINAL),
        **_others(128, 96 if target in FOUR_BY_THREE else 64),
        **({} if target in FOUR_BY_THREE else {"reward_images": 500}),
        "ladder": True,
    }


def _paper(target: TargetName) -> dict[str, Any]:
    net = RECIPES["paper"]
    width, height = (480, 360) if target in FOUR_BY_THREE else (640, 320)
    final = Fidelity(width, height, 45, 10, samples=1, train=replace(net, steps=20_000))
    return {
        "groups": _groups(target),
        "search": Search(method="sdr", updates_per_group=50, datasets_per_update=1),
        "reward": Fidelity(width, height, 18, 10, samples=1, train=net),
        "final": final,
        "compact": replace(final, train=RECIPES["compact"]),
        "vgg": final,
        "candidates": ("argmax",),
        "candidate_seeds": 1,
        **({} if target in FOUR_BY_THREE else {"reward_images": 500}),
    }


_PRESETS = {"smoke": _smoke, "quick": _quick, "paper": _paper}
