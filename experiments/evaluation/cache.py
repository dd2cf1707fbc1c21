"""Images for many networks of a run with their frozen features: made once, read by all processes.

A folder of images and labels is named by its content, and so is the folder of their features.

    RUN/shared/3f2ab07c91d4e655/            images.npy, labels.npy: 4 bytes a pixel
    RUN/shared/3f2ab07c91d4e655-1c9d02aa/   map0.npy, map1.npy and so on, feature maps of a frozen backbone:
                                            for lite0 3.5 bytes per pixel of every view
    RUN/shared/pool-90b3c5d07e1f2a64/       all of these for streets of one shot
    RUN/shared/renders/                     sets on their way from renderers to separate trainers

Each folder has an ``about.json`` with hashes of the files, which are checked once per run. A folder exists as
a whole or not at all; a folder that lacks a file is written again.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np

from common.errors import UserError
from common.files import digest, file_digest, read_json, whole_folder, write, write_json
from common.workers.pipeline import Split
from common.workers.pool import Workers
from experiments.evaluation.cached import Cached, map_names, removable
from experiments.evaluation.in_worker import core_seconds, parts_of
from experiments.evaluation.job import Recipe
from experiments.evaluation.renders import Part, Rendered, Written, joined, render_part
from experiments.evaluation.store import digest_of
from experiments.targets.base import Target
from seg.data import LabelledImages
from seg.nets.backbones import backbone_of
from seg.nets.head import Maps
from seg.pyramid import Statistics, channel_statistics, prediction_features, training_features
from seg.settings import TrainSettings
from seg.views import LOOKS

FOLDER, ABOUT, SECONDS, RENDERS = "shared", "about.json", "seconds", "renders"
CHUNK = 16
"""Images per task of a worker, in whole batches of the backbone."""


def _files(maps: Maps) -> dict[str, np.ndarray]:
    """Feature maps by the names of their files."""
    return dict(zip(map_names(len(maps)), maps, strict=False))


class Cache:
    """The files in which the workers of a run find images.

    Args:
        workers: the workers that render and compute features.
        run: folder of the run.
        say: called with the progress of features.
    """

    def __init__(
        self, workers: Workers, run: Path, say: Callable[[str], None] = lambda text: None
    ) -> None:
        self._workers, self._say = workers, say
        self._root = (run / FOLDER).absolute()
        self._checked: set[Path] = set()

    @property
    def renders(self) -> str | None:
        """The folder in which renderers leave images for trainers; None if they have no common disk."""
        return str(self._root / RENDERS) if self._workers.share_disk else None

    def remove_renders(self) -> None:
        """Remove images that no trainer has taken."""
        shutil.rmtree(self._root / RENDERS, ignore_errors=True)

    def put(
        self, images: LabelledImages, train: TrainSettings, what: str, *, training: bool = False
    ) -> Cached:
        """Give images for tasks; their files are written if they do not exist.

        Args:
            images: real images and labels.
            train: settings of the networks; networks with a frozen backbone get features.
            what: name of the images in progress lines, such as "reward".
            training: whether networks are trained on the images instead of tested.

        Raises:
            UserError: files are damaged, or belong to other images or another backbone.
        """
        source = digest_of(images.images, images.labels)
        folder = self._root / source[:16]
        count, arrays = len(images.images), {"images": images.images, "labels": images.labels}

        def store(part: Path) -> None:
            with _Arrays(part, count) as files:
                files.write(arrays, 0, count)

        self._keep(folder, {"images": source}, store)
        cached = Cached(self._workers.share(str(folder)))
        if not train.frozen:
            return cached
        views = _views(train, training)
        folder = self._root / f"{source[:16]}-{digest(views)[:8]}"
        description = {"images": source, **views}
        train = _sent(train, self._workers)

        def fill(part: Path) -> None:
            starts = range(0, max(count - CHUNK // 2, 1), CHUNK)  # no batch of another size
            tasks = [(cached, s, s + CHUNK, train, training) for s in starts]
            tasks[-1] = (cached, starts[-1], count, train, training)
            self._compute(part, count, tasks, what)

        self._keep(folder, description, fill)
        return cached._replace(features=self._workers.share(str(folder)))

    def streets(
        self,
        name: str,
        recipe: Recipe,
        units: np.ndarray,
        seed: int,
        done: Callable[[int, bool], None],
    ) -> Cached:
        """Render one shot of each street with its features for a frozen backbone, if it does not exist.

        Args:
            name: hash of the attributes, the seed and the size.
            recipe: sizes, assets, backbone, and the classes of the labels.
            units: f32[streets, attributes] of every street, in [0, 1].
            seed: decides, with the street's index, all random choices.
            done: called with a number of streets, and whether an earlier call has rendered them.
        """
        folder = self._pool(name, recipe)
        pieces = _pieces_of(folder)
        starts = range(0, len(units), CHUNK)

        def fill(part: Path) -> dict[str, Any]:
            pieces.mkdir(exist_ok=True)
            files = {start: pieces / f"{start:06d}.npz" for start in starts}
            missing = [start for start in starts if _piece(files[start]) is None]
            done(sum(len(units[s : s + CHUNK]) for s in starts if s not in missing), True)
            worker_recipe = sent(recipe, self._workers)
            tasks = [(worker_recipe, units[s : s + CHUNK], seed, s) for s in missing]
            split = Split(self._parts_of_streets, render_part)
            for index, arrays in self._workers.map(_pool_streets, tasks, net=True, split=split):
                start = missing[index]
                buffer = io.BytesIO()
                np.savez(buffer, **arrays)
                write(files[start], buffer.getvalue(), sync=False)
                done(len(units[start : start + CHUNK]), False)
            return {SECONDS: _assemble(part, [files[start] for start in starts], len(units))}

        if not self._keep(folder, {"streets": name}, fill):
            done(len(units), True)
        shutil.rmtree(pieces, ignore_errors=True)
        return self.pool(name, recipe)

    def pool(self, name: str, recipe: Recipe) -> Cached:
        """The streets of a name, once `streets` has rendered them."""
        folder = self._workers.share(str(self._pool(name, recipe)))
        return Cached(folder, folder if recipe.fidelity.train.frozen else None)

    def _parts_of_streets(self, most: int, task: tuple) -> list[tuple[Part]]:
        recipe, units, seed, start = task
        return _pool_parts(recipe, units, seed, start, most, self.renders)

    def seconds(self, name: str, recipe: Recipe) -> float | None:
        """The core seconds in which the streets of a name were rendered, if they exist, with features."""
        file = self._pool(name, recipe) / ABOUT
        return float(read_json(file).get(SECONDS, 0.0)) if file.exists() else None

    def forget(self, name: str, recipe: Recipe) -> None:
        """Remove the streets of a name once all their networks are trained."""
        folder = self._pool(name, recipe)
        for path in (folder, _pieces_of(folder)):
            shutil.rmtree(path, ignore_errors=True)
        self._checked.discard(folder)

    def _pool(self, name: str, recipe: Recipe) -> Path:
        # The name is part of the keys of evaluations, which have the classes apart from it.
        return self._root / f"pool-{digest([name, recipe.table, *recipe.classes.outlines])[:16]}"

    def normalised(self, recipe: Recipe, target: Target) -> Recipe:
        """Add the head's statistics to a recipe if they are those of the target.

        They are those of the reward images, without their labels; never those of the test images.
        """
        fidelity = recipe.fidelity
        if not by_target(fidelity.train):
            return recipe
        real = target.at(fidelity.height, fidelity.width)["reward"]
        backbone = replace(fidelity.train, backbone="frozen")  # a tuned one starts like this
        cached = self.put(real, backbone, "reward")
        ((_, statistics),) = self._workers.map(_statistics_of_cached, [(cached,)], net=True)
        return recipe._replace(statistics=statistics)

    def _compute(self, part: Path, count: int, tasks: list[tuple], what: str) -> None:
        """Write the features of all tasks into the files of a folder, view after view."""
        done = 0
        with _Arrays(part, count) as arrays:
            for index, maps in self._workers.map(_features_of, tasks, net=True):
                _, start, stop, *_ = tasks[index]
                arrays.write(_files(maps), start, stop)
                done += stop - start
                self._say(f"features of {what} images, once per run: {done} of {count}")

    def _keep(
        self,
        folder: Path,
        description: Mapping[str, Any],
        fill: Callable[[Path], dict[str, Any] | None],
    ) -> bool:
        """Write a folder if it does not exist, and return whether it did not; check it once per run.

        ``fill`` writes its files, and may return more fields of `ABOUT`.
        """
        if folder in self._checked:
            return False
        is_new = not _is_whole(folder, description)
        if is_new:
            with whole_folder(folder) as part:
                more_fields = fill(part) or {}
                files = {path.name: file_digest(path) for path in sorted(part.iterdir())}
                write_json(part / ABOUT, {**description, **more_fields, "files": files})
        self._checked.add(folder)
        return is_new


def sent(recipe: Recipe, workers: Workers) -> Recipe:
    """A recipe with files that workers find: own assets, weights."""
    fidelity = replace(recipe.fidelity, train=_sent(recipe.fidelity.train, workers))
    return recipe._replace(fidelity=fidelity, pool=recipe.pool.with_paths(workers.share))


def _sent(train: TrainSettings, workers: Workers) -> TrainSettings:
    """Settings with a file of weights that workers find."""
    if train.weights is None:
        return train
    return replace(train, weights=workers.share(train.weights))


def by_target(train: TrainSettings) -> bool:
    """Whether a network's head normalises features by statistics of the target's images."""
    return train.has_backbone and train.head_statistics == "target"


def _views(train: TrainSettings, training: bool) -> dict[str, Any]:
    """The settings that decide the features of images."""
    looks: dict[str, Any] = {"views": 1}
    if training:
        looks = {name: getattr(train, name) for name in LOOKS}
    elif train.average_mirror:
        looks["average_mirror"] = True
    return {"backbone": dict(backbone_of(train).source), "dtype": train.dtype, **looks}


def _features(images: np.ndarray, train: TrainSettings, training: bool) -> Maps:
    """Compute features of images as a test or training needs them, view after view.

    A view depends on its image alone, so that the features of a subset are among those of all images.
    """
    return (training_features if training else prediction_features)(images, train)


def _features_of(
    cached: Cached, start: int, stop: int, train: TrainSettings, training: bool
) -> Maps:
    """Compute features of some of the images; runs in a worker."""
    return _features(cached.load().images[start:stop], train, training)


def _statistics_of_cached(cached: Cached) -> Statistics:
    """Compute the statistics of all features; runs in a worker."""
    maps = cached.load().features
    assert maps is not None
    return channel_statistics(maps)


def statistics_of(images: np.ndarray, train: TrainSettings) -> Statistics:
    """Compute in this process what `Cache.normalised` adds to a recipe, from the reward images."""
    return channel_statistics(_features(images, replace(train, backbone="frozen"), False))


def _pool_parts(
    recipe: Recipe, units: np.ndarray, seed: int, start: int, most: int, folder: str | None
) -> list[tuple[Part]]:
    """Divide streets of a pool, which have one shot each, for renderers."""
    one_shot = recipe._replace(fidelity=replace(recipe.fidelity, shots=1))
    return parts_of(one_shot, units, seed, most, folder, start)


def _pool_streets(
    recipe: Recipe,
    units: np.ndarray,
    seed: int,
    start: int,
    ready: Sequence[Rendered | Written] | None = None,
) -> dict[str, np.ndarray]:
    """Make some streets of a pool from an index on, and their features; runs in a worker."""
    one_part = _pool_parts(recipe, units, seed, start, 1, None)
    parts = ready or [render_part(*part) for part in one_part]
    images, labels, seconds = joined(parts)
    started, train = core_seconds(), recipe.fidelity.train
    maps = _features(images, train, True) if train.frozen else ()
    total = np.array(seconds + core_seconds() - started)
    return {"images": images, "labels": labels, **_files(maps), SECONDS: total}


def _pieces_of(pool: Path) -> Path:
    """The folder of the pieces of a pool that is not complete yet."""
    return pool.with_name(f"{pool.name}.pieces")


def _piece(path: Path) -> dict[str, np.ndarray] | None:
    """Read a piece of a pool; None if it is not complete."""
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, BadZipFile):
        return None


def _assemble(part: Path, pieces: Sequence[Path], count: int) -> float:
    """Assemble the files of a pool from its pieces, with features view after view.

    Returns:
        The core seconds in which the pieces were made.
    """
    first, seconds = 0, 0.0
    with _Arrays(part, count) as arrays:
        for path in pieces:
            piece = _piece(path)
            if piece is None:
                raise UserError(
                    f"{path} was damaged after it was written; run the same command again to replace it"
                )
            seconds += float(piece.pop(SECONDS, 0.0))
            end = first + len(piece["images"])
            arrays.write(piece, first, end)
            first = end
    return round(seconds, 3)


class _Arrays:
    """Arrays of a number of images in files of a folder, written some images at a time.

    An array holds one view after the other. Files are not memory maps, with which a full disk would end the
    process without a message.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self._folder, self._count = folder, count
        self._files: dict[str, tuple[IO[bytes], int]] = {}  # files, and offsets of their rows

    def __enter__(self) -> _Arrays:
        return self

    def __exit__(self, *_: object) -> None:
        for file, _begin in self._files.values():
            file.close()

    def write(self, arrays: Mapping[str, np.ndarray], first: int, end: int) -> None:
        """Write the rows of the images first .. end - 1."""
        for name, array in arrays.items():
            views = len(array) // (end - first)
            if name not in self._files:
                file: IO[bytes] = (self._folder / f"{name}.npy").open("wb")
                shape = (self._count * views, *array.shape[1:])
                descr = np.lib.format.dtype_to_descr(array.dtype)
                header = {"descr": descr, "fortran_order": False, "shape": shape}
                np.lib.format.write_array_header_1_0(file, header)
                self._files[name] = file, file.tell()
            file, begin = self._files[name]
            for view, rows in enumerate(np.split(array, views)):
                file.seek(begin + (view * self._count + first) * rows[0].nbytes)
                file.write(np.ascontiguousarray(rows).data)


def _is_whole(folder: Path, description: Mapping[str, Any]) -> bool:
    """Whether all files exist; raises UserError if they are wrong."""
    path, end = folder / ABOUT, removable(folder)
    if not path.exists():
        return False
    try:
        about = read_json(path)
        files = dict(about["files"])
    except (UserError, LookupError, TypeError, ValueError):
        raise UserError(f"{path} is damaged; {end}") from None
    if not all(os.path.isfile(folder / name) for name in files):
        return False
    for name, value in description.items():
        if about.get(name) != value:
            raise UserError(
                f"{path}: this folder is of other {name}, {about.get(name)!r} and not {value!r}; {end}"
            )
    for name, value in files.items():
        if file_digest(folder / name) != value:
            raise UserError(f"{folder / name} is damaged; {end}")
    return True
