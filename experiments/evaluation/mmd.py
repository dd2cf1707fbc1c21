"""A reward without labels: the closeness of rendered and real images in the features of a network.

The reward is -MMD^2 (``seg.mmd``), at most about 0, and higher is better; its units are not those of mIoU.
The network is compact and trained once per run on a rendered dataset with random attributes: it reads no
label of a real image.
"""

from __future__ import annotations

import io
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import jax
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict

from common.errors import UserError
from common.files import write
from common.sent import here
from common.workers.pool import Workers
from experiments.evaluation.cache import sent
from experiments.evaluation.in_worker import timed_set, training_set
from experiments.evaluation.job import Recipe, Result
from experiments.evaluation.made_with import refuse_other
from experiments.evaluation.renders import Rendered
from experiments.evaluation.store import digest_of
from scene.proposal import Streets, random_proposal
from seg.features import features
from seg.mmd import mmd2
from seg.recipes import with_steps
from seg.settings import TrainSettings
from seg.train import TrainingError, train

FILE = "feature-net.npz"
"""File of the network's parameters in the run folder."""
SEED = 20060
"""Seed of the network and of its streets; the same for all runs, so that they can share a store."""


class Reference(NamedTuple):
    """The features of the real images: all that this reward uses of the target."""

    features: np.ndarray  # f32[n, vector]
    net: str  # file of the network's parameters
    source: str  # hash of the images and of the network


class FeatureNet(NamedTuple):
    """A network in a file, in whose features images are compared."""

    path: Path
    classes: int

    def reference(self, images: np.ndarray) -> Reference:
        """Compute the features of real images u8[n, h, w, 3], without labels.

        Raises:
            UserError: fewer than two images, or a damaged file.
        """
        if len(images) < 2:
            raise UserError("--reward-kind mmd needs at least 2 reward images")
        params = _load(str(self.path))
        source = digest_of(images, *jax.tree.leaves(params))
        return Reference(features(params, images, self.classes), str(self.path), source)


def feature_net(recipe: Recipe, folder: Path, workers: Workers) -> FeatureNet:
    """The network of a run folder, which is trained if it does not exist.

    Raises:
        UserError: training diverged.
    """
    path = folder / FILE
    if not path.exists():
        try:
            ((_, params),) = workers.map(train_features, [(sent(recipe, workers),)], net=True)
        except TrainingError as error:
            raise UserError(f"--reward-kind mmd: {error}") from None
        data = io.BytesIO()
        np.savez(data, **flatten_dict(params, sep="/"))
        write(path, data.getvalue())
    return FeatureNet(path, len(recipe.classes.classes))


def train_features(recipe: Recipe) -> Any:
    """Train a compact network on streets with all attributes random; its parameters."""
    reward_settings = recipe.fidelity.train
    # The network is compact, with its own settings, whatever network the recipe has.
    settings = with_steps(TrainSettings(batch=reward_settings.batch), reward_settings.steps)
    refuse_other(recipe.made_with)
    images, labels, *_ = training_set(recipe, random_proposal(), SEED)
    params = train(SEED, images, labels, settings, len(recipe.classes.classes))
    return jax.tree.map(np.asarray, params)


def evaluate_mmd(
    recipe: Recipe, source: Streets, seed: int, real: Reference, ready: Rendered | None = None
) -> Result:
    """Render and compare; the arguments are those of ``evaluate_miou``, but for ``real``."""
    refuse_other(recipe.made_with)
    rendered, seconds = timed_set(recipe, source, seed, ready)
    started = time.perf_counter()
    rendered_features = features(_load(real.net), rendered.images, len(recipe.classes.classes))
    reward = -mmd2(rendered_features, real.features)
    return Result(reward, [], seconds, time.perf_counter() - started)


@lru_cache(maxsize=1)
def _load(path: str) -> Any:
    try:
        with np.load(here(path)) as file:
            return unflatten_dict(dict(file), sep="/")
    except (ValueError, EOFError, OSError, BadZipFile) as error:
        cure = "remove it, and run the same command again"
        raise UserError(f"{path} cannot be read ({error}); {cure}") from None
