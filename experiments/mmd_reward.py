"""A reward without labels: how near rendered images are to real ones in the features of a net.

The reward is -MMD^2 (``seg.mmd``), at most about 0 and the higher the better; its units are not those
of mIoU. The net is compact and trained once per run, on a rendered dataset with random attributes, so
that no label of a real image is ever read.
"""

from __future__ import annotations

import hashlib
import io
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import jax
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict

from experiments.config import Config, Stage
from experiments.errors import UserError
from experiments.folder import write_atomically
from experiments.reward import render
from scene.attributes import NAMES
from scene.catalogue import AssetPool
from scene.workers import WorkerPool
from seg.classes import class_table
from seg.features import features
from seg.mmd import mmd2
from seg.train import TrainSettings, train

FILE = "feature-net.npz"
"""The net's parameters, in the run folder."""
SEED = 20060
"""Of the net, its streets and its attributes; the same for all runs, so that they can share a store."""


class Reference(NamedTuple):
    """Real images as the net sees them: all that this reward knows of the target."""

    features: np.ndarray  # f32[n, vector]
    net: str  # file of the net's parameters
    classes: int
    source: str  # hash of the images and of the net


class Distance(NamedTuple):
    """What one dataset was worth."""

    reward: float  # -MMD^2
    render_seconds: float
    train_seconds: float  # of the features; nothing is trained

    @property
    def class_iou(self) -> list[float | None]:
        """Nothing: classes are not told apart."""
        return []


class FeatureNet(NamedTuple):
    """A net in a file, whose features tell images apart."""

    path: Path
    classes: int

    def reference(self, images: np.ndarray) -> Reference:
        """Real images u8[n, h, w, 3] as the net sees them; no labels are asked for.

        Raises:
            UserError: fewer than two images, or a damaged file.
        """
        if len(images) < 2:
            raise UserError("--reward-kind mmd needs at least 2 reward images")
        params = _load(str(self.path))
        source = hashlib.sha256(np.ascontiguousarray(images).tobytes())
        for leaf in jax.tree.leaves(params):
            source.update(leaf.tobytes())
        found = features(params, images, self.classes)
        return Reference(found, str(self.path), self.classes, source.hexdigest())


def feature_net(config: Config, table: str, folder: Path, workers: WorkerPool) -> FeatureNet:
    """The net of a run folder, trained if there is none yet.

    Args:
        config: the run: its reward stage, renderer and assets.
        table: name of the class table.
        folder: the run folder.
        workers: who renders and trains it.

    Raises:
        TrainingError: training diverged.
    """
    path = folder / FILE
    if not path.exists():
        task = (config.reward, table, config.renderer, config.pool)
        ((_, params),) = workers.map(train_features, [task])
        data = io.BytesIO()
        np.savez(data, **flatten_dict(params, sep="/"))
        write_atomically(path, data.getvalue())
    return FeatureNet(path, len(class_table(table).classes))


def train_features(stage: Stage, table: str, renderer: str, pool: AssetPool) -> Any:
    """Parameters of a compact net that has seen every attribute anywhere in its range."""
    shape = (stage.streets, len(NAMES))
    units = np.random.default_rng(SEED).uniform(0, 1, shape).astype(np.float32)
    dataset = render(stage, renderer, pool, units, SEED)
    labels = class_table(table).from_train_id[dataset.labels]
    # Compact whatever the stage trains, with the settings that suit it.
    settings = replace(
        TrainSettings(), table=table, steps=stage.train.steps, batch=stage.train.batch
    )
    return jax.tree.map(np.asarray, train(SEED, dataset.images, labels, settings))


def evaluate_mmd(
    stage: Stage,
    table: str,
    renderer: str,
    pool: AssetPool,
    units: np.ndarray,
    seed: int,
    real: Reference,
) -> Distance:
    """Render and compare; the arguments are those of ``reward.evaluate``, but for the last."""
    del table
    started = time.perf_counter()
    dataset = render(stage, renderer, pool, units, seed)
    rendered = time.perf_counter()
    ours = features(_load(real.net), dataset.images, real.classes)
    reward = -mmd2(ours, real.features)
    return Distance(reward, rendered - started, time.perf_counter() - rendered)


@lru_cache(maxsize=1)
def _load(path: str) -> Any:
    try:
        with np.load(path) as file:
            return unflatten_dict(dict(file), sep="/")
    except (ValueError, EOFError, OSError, BadZipFile) as error:
        raise UserError(f"{path} cannot be read ({error}); remove it to train it anew") from None
