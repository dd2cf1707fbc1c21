"""Renders parts of training sets. Renderers run this file, and nothing that it imports loads JAX."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.files import naming
from common.labels.classes import Outline
from scene.assets.catalogue import AssetPool
from scene.dataset.render import images_and_labels
from scene.render import RenderSettings

NAMES = ("images", "labels")


class Part(NamedTuple):
    """Some consecutive streets of a training set."""

    units: np.ndarray  # f32[streets, attributes] in [0, 1]
    seed: int  # of the whole set
    start: int  # index of the first street in the set
    shots: int  # images of a street
    settings: RenderSettings
    renderer: str
    pool: AssetPool
    outlines: Sequence[Outline]
    from_train_id: np.ndarray  # u8[256], the class of each train id
    folder: str | None  # where to write the images, on a disk that trainers read; None returns them


class Rendered(NamedTuple):
    """Images and labels in the order of streets, and what they took."""

    images: np.ndarray  # u8[n, h, w, 3]
    labels: np.ndarray  # u8[n, h, w]
    seconds: float  # of a core


class Written(NamedTuple):
    """Rendered images and labels in files."""

    folder: str
    seconds: float  # of a core

    def take(self) -> Rendered:
        """Read the files and remove them."""
        images, labels = (np.load(Path(self.folder, f"{name}.npy")) for name in NAMES)
        shutil.rmtree(self.folder, ignore_errors=True)
        return Rendered(images, labels, self.seconds)


def render_part(part: Part) -> Rendered | Written:
    """Render some streets; runs on a renderer."""
    started = time.process_time()
    settings, name, pool = part.settings, part.renderer, part.pool
    streets = [
        images_and_labels(
            part.outlines, unit, part.seed, part.start + k, part.shots, settings, name, pool
        )
        for k, unit in enumerate(part.units)
    ]
    images, labels = (np.concatenate(arrays) for arrays in zip(*streets, strict=True))
    labels = part.from_train_id[labels]
    if part.folder is None:
        return Rendered(images, labels, time.process_time() - started)
    root = Path(part.folder)
    with naming(root):
        root.mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(dir=root)
        for array_name, array in zip(NAMES, (images, labels), strict=True):
            _save(Path(folder, f"{array_name}.npy"), array)
    return Written(folder, time.process_time() - started)


def joined(parts: Sequence[Rendered | Written]) -> Rendered:
    """Join the parts of a training set in order; files are read and removed."""
    taken = [part.take() if isinstance(part, Written) else part for part in parts]
    if len(taken) == 1:
        return taken[0]
    images, labels, seconds = zip(*taken, strict=True)
    return Rendered(np.concatenate(images), np.concatenate(labels), sum(seconds))


def _save(path: Path, array: np.ndarray) -> None:
    """Write an array; unlike `numpy.save` it says why a disk takes no more."""
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(array))
        file.write(np.ascontiguousarray(array).data)


def mean_seconds(
    work: Callable[..., object],
    arguments: tuple,
    seconds: float,
    clock: Callable[[], float] = time.process_time,
) -> float:
    """Repeat work for some seconds, after a first time that compiles it; the mean time by a clock.

    By default other programs do not count.
    """
    work(*arguments)
    end = time.perf_counter() + seconds
    started, times = clock(), 0
    while not times or time.perf_counter() < end:
        work(*arguments)
        times += 1
    return (clock() - started) / times
