"""Networks that benchmarks train on renders and on labelled images of a target, and store by their keys."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np

from common import files
from common.command import exit_code
from common.errors import UserError
from common.labels.target_file import TargetFile, find_target
from common.lines import CURE, JsonLines
from common.progress import Progress
from common.workers.pool import WorkerError, WorkerPool
from experiments.evaluation.in_worker import worker_environment
from experiments.targets.few import CHOICE, spread
from experiments.targets.folder import parts_of
from scene.assets.catalogue import AssetPool
from scene.attributes import SpaceName
from scene.dataset.render import render_street
from scene.proposal import NAMES, draw, read_streets
from scene.render import RenderSettings
from scene.version import ENGINE
from seg.data import DataError, LabelledImages, load
from seg.pyramid import prediction_features, training_features
from seg.recipes import RECIPES, with_steps
from seg.settings import TrainSettings
from seg.train import TrainingError

Variant = TypeVar("Variant")
Line = dict[str, Any]
"""A finished network: its ``key``, which says all that it depends on, its ``scores``, and more."""
DEVELOPMENT, REPORTED = "development", "reported"
NETWORKS = "networks.jsonl"


class Recipe(NamedTuple):
    """What all networks of a table share; only their labels differ."""

    data: str
    target: str | None = None
    holdout: str | None = None
    attributes: str = "default"  # a name, or a file of attributes
    space: SpaceName = "extended"
    width: int = 240
    height: int = 176
    streets: int = 300
    few: int = 0  # labelled images in every training set
    training: str = "lite0-frozen"
    steps: int = 500

    @property
    def train(self) -> TrainSettings:
        """The training settings of a network."""
        return with_steps(RECIPES[self.training], self.steps)

    @property
    def file(self) -> TargetFile:
        """The file of the target."""
        return find_target(self.target, Path(self.data))

    @property
    def rendered(self) -> dict[str, Any]:
        """Everything that renders depend on, but their seed."""
        names = ("space", "width", "height", "streets")
        path = Path(self.attributes)
        source = self.attributes if self.attributes in NAMES else files.file_digest(path)
        return {"engine": ENGINE, "attributes": source, **{n: getattr(self, n) for n in names}}

    @property
    def real(self) -> dict[str, Any]:
        """Everything that the labelled images depend on."""
        return {
            "target": self.file.name,
            "holdout": self.holdout,
            "few": self.few,
            "data": _digest(self),
        }


@lru_cache(maxsize=2)
def _digest(recipe: Recipe) -> str:
    """The digest of a target's file, and of the labelled images and their labels."""
    target = recipe.file
    parts = parts_of(target, Path(recipe.data), recipe.holdout)
    entries = [
        (entry.name, *(files.file_digest(path) for path in (entry.image_path, entry.label_path)))
        for entry in (*parts.entries, *parts.held_out)
    ]
    return files.digest([msgspec.to_builtins(target), entries])[:16]


class Renders(NamedTuple):
    """Rendered images, and what their labels are made from."""

    images: np.ndarray  # u8[n, h, w, 3]
    labels: np.ndarray  # u8[n, h, w] train ids
    depths: np.ndarray  # f32[n, h, w]


def renders(recipe: Recipe, seed: int, folder: Path) -> Renders:
    """Load the renders of a seed from their file, or render and store them."""
    key = files.digest({**recipe.rendered, "seed": seed})[:16]
    path = folder / f"renders-{key}.npz"
    if not path.exists():
        settings, pool = RenderSettings(recipe.width, recipe.height, 1), AssetPool()
        streets = read_streets(recipe.attributes, recipe.space)
        frames = [
            render_street(unit, seed, k, 1, settings, "embree", pool)[0]
            for k, unit in enumerate(draw(streets, seed, recipe.streets))
        ]
        part = path.with_name(f"{path.stem}.part.npz")
        np.savez(
            part,
            images=np.stack([frame.image for frame in frames]),
            labels=np.stack([frame.label for frame in frames]),
            depths=np.stack([frame.depth for frame in frames]),
        )
        part.replace(path)
    with np.load(path) as arrays:
        return Renders(*(arrays[name] for name in Renders._fields))


class Real(NamedTuple):
    """A target's labelled images by their use."""

    few: LabelledImages | None
    development: LabelledImages
    reported: LabelledImages | None


@lru_cache(maxsize=2)
def real_images(recipe: Recipe, with_features: bool) -> Real:
    """Read the labelled images, on request with the features of a frozen backbone; the few with all views."""
    target, size, settings = recipe.file, (recipe.height, recipe.width), recipe.train
    parts = parts_of(target, Path(recipe.data), recipe.holdout)
    entries = parts.entries
    names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
    chosen = {*spread(names, sequences, recipe.few, CHOICE).tolist()} if recipe.few else set()

    def read(entries: Sequence[Any], training: bool = False) -> LabelledImages | None:
        if not entries:
            return None
        images = load(entries, target, size)
        if not (with_features and settings.frozen):
            return images
        features = training_features if training else prediction_features
        return images._replace(features=features(images.images, settings))

    few = read([entry for k, entry in enumerate(entries) if k in chosen], training=True)
    development = read([entry for k, entry in enumerate(entries) if k not in chosen])
    assert development is not None
    return Real(few, development, read(parts.held_out))


def prepare(recipe: Recipe, out: Path) -> None:
    """Make the folder of finished networks; UserError if ``--few`` leaves no image to test on."""
    labelled = len(parts_of(recipe.file, Path(recipe.data), recipe.holdout).entries)
    if recipe.few >= labelled:
        raise UserError(f"--few {recipe.few} leaves none of {labelled} labelled images to test on")
    with files.naming(out):
        out.mkdir(parents=True, exist_ok=True)


def run_benchmark(run: Callable[[argparse.Namespace], None], options: argparse.Namespace) -> int:
    """Run a benchmark with its options; returns the exit code."""
    users = (UserError, DataError, TrainingError)
    return exit_code(lambda: run(options), (WorkerError,), users=users)


def name_of(key: dict[str, Any]) -> str:
    """The text of a key."""
    return json.dumps(key, sort_keys=True)


def stored(path: Path) -> dict[str, Line]:
    """Read the lines of all networks in a file by the text of their keys."""
    log, lines = JsonLines(path), {}
    for k, line in enumerate(log.lines):
        if not isinstance(line.get("key"), dict) or not isinstance(line.get("scores"), dict):
            raise UserError(f"{log.where(k)} has no key and scores; {CURE}")
        lines[name_of(line["key"])] = line
    return lines


def store(path: Path, line: Line) -> None:
    """Add the line of a network to a file, to which other workers add theirs."""
    log = JsonLines(path)
    with log.shared():
        log.append(line)


def finished(
    train_all: Callable[..., list[Line]],
    recipe: Any,
    variants: Sequence[Variant],
    key: Callable[[Variant, int], dict[str, Any]],
    options: argparse.Namespace,
    *more: Any,
    file: str = NETWORKS,
    at_once: bool = True,
) -> dict[tuple[Variant, int], Line]:
    """Collect the lines of all networks by variant and seed, trained now or stored.

    Args:
        train_all: called in a worker with the recipe, a seed, its missing variants, ``more`` and the folder;
            returns their lines, which it has written.
        recipe: the same for every network.
        variants: the alternatives to compare.
        key: everything that the network of a variant and a seed depends on.
        options: with ``seeds``, ``workers`` and ``out``.
        more: further arguments of ``train_all``.
        file: name of the file of the lines.
        at_once: whether one call makes all networks of a seed, which share something.
    """
    done = stored(options.out / file)
    tasks: list[tuple] = []
    for seed in range(options.seeds):
        missing = [variant for variant in variants if name_of(key(variant, seed)) not in done]
        parts = [missing] if missing and at_once else [[variant] for variant in missing]
        tasks += [(recipe, seed, part, *more, options.out) for part in parts]
    total = len(variants) * options.seeds
    progress = Progress(total)
    progress.advance(total - sum(len(task[2]) for task in tasks), replayed=True)
    with WorkerPool(options.workers, worker_environment()) as workers:
        for index, lines in workers.map(train_all, tasks):
            done |= {name_of(line["key"]): line for line in lines}
            progress.advance(len(lines))
            progress.update(f"seed {tasks[index][1]}")
    progress.close()
    return {
        (variant, seed): done[name_of(key(variant, seed))]
        for variant in variants
        for seed in range(options.seeds)
    }
