"""Digests of streets by stage of the engine, and rewards: which of them a change has touched.

    python -m tests.guard                        # compare with tests/guard.json: what differs, stage by stage
    python -m tests.guard --streets              # the same without the rewards, which take most of the time
    python -m tests.guard --record               # write tests/guard.json and tests/guard_searches.json anew

A hundred streets of random attributes are rendered at 64x32: 25 of each space with one shot and with
eight, every other one with two rays a pixel along each axis. Fifty rewards are those of the main job's
preset ``smoke``. Fast arithmetic differs between processors, so that only the machine that recorded the
digests can be compared with them.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from hashlib import sha256
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from common.workers.pool import WorkerPool
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.in_worker import evaluate_miou
from experiments.evaluation.job import Recipe
from experiments.targets.twin import TABLE, twin_split, twin_world
from scene.assets.catalogue import AssetPool
from scene.dataset.render import street_of
from scene.proposal import draw, random_proposal
from scene.render import RenderSettings, renderer, shot
from scene.street.camera import Camera
from scene.version import ENGINE
from tests import guard_searches

RECORD = Path(__file__).parent / "guard.json"
SPACES, SHOTS, STREETS, SEED = ("scenex", "extended"), (1, 8), 25, 5
REWARDS = 50
STAGES = ("objects", "labels", "radiance", "image")
"""Objects, ground and cameras; label, instance, depth and normal; before the sensor; after it."""
PACKAGES = ("jax", "numba", "numpy", "embreex")


def machine() -> str:
    """What the digests depend on beside the code."""
    names = [line for line in _cpu_lines() if line.startswith(("model name", "flags"))][:2]
    processor = sha256("".join(names).encode()).hexdigest()[:8]
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"{platform.machine()} {processor}, Python {platform.python_version()}, {versions}"


def _cpu_lines() -> list[str]:
    path = Path("/proc/cpuinfo")
    return (
        path.read_text().splitlines() if path.exists() else [f"model name {platform.processor()}"]
    )


def streets() -> dict[str, list[str]]:
    """One digest a stage for each street, by stage, space and shots."""
    found: dict[str, list[str]] = {}
    for space, shots in product(SPACES, SHOTS):
        units = draw(random_proposal(space), SEED, STREETS)
        each = [_stages(unit, index, shots) for index, unit in enumerate(units)]
        for stage in STAGES:
            found[f"{stage}, {space}, {shots} shots"] = [own[stage] for own in each]
    return found


def _stages(unit: np.ndarray, index: int, shots: int) -> dict[str, str]:
    street = street_of(unit, SEED, index, shots, AssetPool())
    radiance: list[np.ndarray] = []

    def develop(image: np.ndarray, *rest: Any) -> np.ndarray:
        radiance.append(image.copy())
        return seen(image, *rest)

    seen = shot.develop
    with patch.object(shot, "develop", develop):
        settings = RenderSettings(64, 32, samples=1 + index % 2)
        frames = renderer("embree").render(street, settings)
    places = [
        (p.family, str(p.asset), p.instance, p.train_id, p.far, p.pose) for p in street.placements
    ]
    values: dict[str, Any] = {
        "objects": (places, street.cameras, street.ground),
        "labels": [(f.label, f.instance, f.depth, f.normal) for f in frames],
        "radiance": radiance,
        "image": [f.image for f in frames],
    }
    return {stage: digest(values[stage]) for stage in STAGES}


def digest(value: Any) -> str:
    """Sha256, cut short, of arrays, numbers and words in any nesting of tuples and lists."""
    found = sha256()

    def add(part: Any) -> None:
        if isinstance(part, np.ndarray):
            found.update(
                f"{part.dtype}{part.shape}".encode() + np.ascontiguousarray(part).tobytes()
            )
        elif isinstance(part, Camera):
            add(tuple(part[:10]))  # what cameras had when the record was made
        elif isinstance(part, tuple | list):
            found.update(f"({len(part)}".encode())
            for each in part:
                add(each)
        else:
            found.update(repr(part).encode() + b";")

    add(value)
    return found.hexdigest()[:10]


def rewards() -> list[float]:
    """MIoU of nets on streets of random attributes, on the twin's images."""
    config = defaults(MainConfig, "twin", "smoke")
    fidelity = config.reward
    with WorkerPool(0) as workers:
        truth = twin_split(
            twin_world(0), "train", (fidelity.height, fidelity.width),
            images=config.reward_images, renderer="embree", workers=workers,
        )  # fmt: skip
    recipe = Recipe(fidelity, TABLE, "embree", config.pool)
    proposal = random_proposal(config.space)
    return [evaluate_miou(recipe, proposal, seed, truth).reward for seed in range(REWARDS)]


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """A line for each list in which something differs."""
    lines = []
    for name in new:
        count = sum(a != b for a, b in zip(old[name], new[name], strict=True))
        if count:
            lines.append(f"{name}: {count} of {len(new[name])} differ")
    return lines


def main() -> int:
    """Record, or compare; 1 where something differs, 2 where this is another machine."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--record", action="store_true", help="write the records anew")
    parser.add_argument("--streets", action="store_true", help="leave out the rewards")
    options = parser.parse_args()
    if not options.record:
        old = json.loads(RECORD.read_text())
        if old["machine"] != machine():
            print(f"recorded on another machine: {old['machine']}; this is {machine()}")
            return 2
    new: dict[str, Any] = streets()
    if not options.streets:
        new["rewards"] = rewards()
    if options.record:
        about = {"engine": ENGINE, "machine": machine()}
        lines = [
            f"{json.dumps(name)}: {json.dumps(value)}" for name, value in (about | new).items()
        ]
        RECORD.write_text("{\n" + ",\n".join(lines) + "\n}\n")
        guard_searches.record()
        return 0
    found = differences(old, new)
    print("\n".join(found) or f"as recorded with engine {old['engine']}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
