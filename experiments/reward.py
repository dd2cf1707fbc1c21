"""One reward: render a dataset, train a fresh net on it, score the net on real images.

The functions here run in worker processes; they are pure in their arguments, so work lost with a worker
can be done again.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.config import Stage
from scene.catalogue import AssetPool
from scene.dataset import Dataset, render_dataset
from scene.workers import WorkerPool
from seg.classes import class_table
from seg.metrics import iou, mean_iou
from seg.train import score, train

REWARD_NAMES = {"miou": "mIoU", "mmd": "-MMD^2"}
"""What each ``--reward-kind`` is."""


class Truth(NamedTuple):
    """Real images and their labels, ids of the target's table."""

    images: np.ndarray  # u8[n, h, w, 3]
    labels: np.ndarray  # u8[n, h, w]


class Evaluation(NamedTuple):
    """What one dataset was worth."""

    confusion: np.ndarray  # i64[classes, classes]; row: true class
    render_seconds: float
    train_seconds: float  # training and scoring

    @property
    def reward(self) -> float:
        """MIoU in [0, 1]."""
        return mean_iou(self.confusion)

    @property
    def class_iou(self) -> list[float | None]:
        """IoU of each class in [0, 1]; None for classes that do not occur in the truth."""
        present = self.confusion.sum(axis=1) > 0
        values = iou(self.confusion)
        return [float(v) if p else None for v, p in zip(values, present, strict=True)]


def in_words(kind: str, reward: float) -> str:
    """A reward as progress tells it: mIoU in percent, or -MMD^2 as it is."""
    return f"{100 * reward:.1f}" if kind == "miou" else f"{reward:.4f}"


def render(
    stage: Stage,
    renderer: str,
    pool: AssetPool,
    units: np.ndarray,
    seed: int,
    workers: int | WorkerPool = 0,
) -> Dataset:
    """The dataset of a stage from attributes f32[streets, 23]; by default in this process."""
    return render_dataset(
        units,
        seed,
        shots=stage.shots,
        settings=stage.render_settings(),
        renderer_name=renderer,
        pool=pool,
        workers=workers,
    )


def evaluate(
    stage: Stage,
    table: str,
    renderer: str,
    pool: AssetPool,
    units: np.ndarray,
    seed: int,
    truth: Truth,
) -> Evaluation:
    """Render, train, score.

    Args:
        stage: sizes, net and training.
        table: name of the class table.
        renderer: name of the renderer.
        pool: the assets that may appear.
        units: f32[streets, 23].
        seed: of the streets and of the net.
        truth: what to score on.
    """
    started = time.perf_counter()
    dataset = render(stage, renderer, pool, units, seed)
    labels = class_table(table).from_train_id[dataset.labels]
    rendered = time.perf_counter() - started
    return _train_and_score(stage, table, dataset.images, labels, seed, truth, rendered)


def evaluate_real(
    stage: Stage, table: str, images: np.ndarray, labels: np.ndarray, seed: int, truth: Truth
) -> Evaluation:
    """Train on real images instead: the bound that a rendered dataset is compared with."""
    return _train_and_score(stage, table, images, labels, seed, truth, 0.0)


def _train_and_score(
    stage: Stage,
    table: str,
    images: np.ndarray,
    labels: np.ndarray,
    seed: int,
    truth: Truth,
    render_seconds: float,
) -> Evaluation:
    started = time.perf_counter()
    settings = replace(stage.train, table=table)
    params = train(seed, images, labels, settings)
    confusion = score(params, *truth, settings)
    return Evaluation(confusion, render_seconds, time.perf_counter() - started)


def worker_environment() -> dict[str, str]:
    """Variables for workers: one thread each, and compiled functions kept between runs."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sdr-jax" / "xla"
    flags = os.environ.get("XLA_FLAGS", "")
    return {
        "XLA_FLAGS": f"{flags} --xla_cpu_multi_thread_eigen=false".strip(),
        # XLA's Cholesky is OpenBLAS's, whose threads spin: 300 times slower where cores are shared.
        "OPENBLAS_NUM_THREADS": "1",
        "JAX_COMPILATION_CACHE_DIR": os.environ.get("JAX_COMPILATION_CACHE_DIR", str(cache)),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "1",
        "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
        "TF_CPP_MIN_LOG_LEVEL": "3",
    }
