"""Images that many nets of a run see, and what a frozen trunk sees in them: made once, read by all processes.

    RUN/shared/3f2ab07c91d4e655/            images.npy, labels.npy: 4 bytes a pixel
    RUN/shared/3f2ab07c91d4e655-1c9d02aa/   eighth.npy, sixteenth.npy, thirtysecond.npy: 3.6 bytes a
                                            pixel of every view
    RUN/shared/pool-90b3c5d07e1f2a64/       all of them, of streets of one shot

``about.json`` beside them says what they are of, with hashes of the files, which are looked at once per
run. A folder is there as a whole or not at all; one that lacks a file is written anew.
"""

from __future__ import annotations

import io
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np

from experiments.reward.miou import Recipe
from experiments.reward.store import digest_of
from experiments.reward.truth import Shared, loaded, removable
from experiments.target.base import Target
from scene.dataset.render import render_street
from scene.workers import Workers
from seg.data import LabelledImages
from seg.nets.lite0 import Pyramid
from seg.pyramid import Statistics, channel_statistics, features
from seg.settings import TrainSettings
from seg.views import LOOKS, view_images
from seg.weights import lite0
from shell.errors import UserError
from shell.files import digest, file_digest, read_json, whole_folder, write, write_json

FOLDER, ABOUT = "shared", "about.json"
CHUNK = 16
"""Images per task of a worker: whole batches of the trunk."""


class Shelf:
    """Workers, and the files in which they find real images.

    Args:
        workers: who render, train and compute features.
        run: folder of the run; None keeps nothing, and tasks carry arrays.
        say: told how far features are.
    """

    def __init__(
        self,
        workers: Workers,
        run: Path | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.workers, self._say = workers, say
        self._root = None if run is None else (run / FOLDER).absolute()
        self._checked: set[Path] = set()

    def put(
        self, truth: LabelledImages, train: TrainSettings, *, training: bool = False
    ) -> LabelledImages | Shared:
        """Images for tasks; their files are written if they are not there.

        Args:
            truth: real images and labels.
            train: of the nets that see them; those on a frozen trunk get features.
            training: whether nets are trained on the images, and not scored.

        Raises:
            UserError: files that are damaged, or of other images or another trunk.
        """
        if self._root is None:
            return truth._replace(origin=None)
        if truth.origin is not None:
            held = self.put(truth.origin[0], train, training=training)
            assert isinstance(held, Shared)
            return held._replace(picked=truth.origin[1])
        source = digest_of(truth.images, truth.labels)
        folder = self._root / source[:16]
        self._keep(folder, {"images": source}, lambda part: _write_truth(part, truth))
        held = Shared(self.workers.share(str(folder)))
        if not train.frozen:
            return held
        views = _views(train, training)
        folder = self._root / f"{source[:16]}-{digest(views)[:8]}"
        told = {"images": source, "trunk": lite0.SHA256, **views}
        count = len(truth.images)

        def fill(part: Path) -> None:
            starts = range(0, max(count - CHUNK // 2, 1), CHUNK)  # no batch of another size
            tasks = [(held, s, s + CHUNK, train, training) for s in starts]
            tasks[-1] = (held, starts[-1], count, train, training)
            self._compute(part, count, tasks)

        self._keep(folder, told, fill)
        return held._replace(features=self.workers.share(str(folder)))

    def streets(
        self, name: str, recipe: Recipe, units: np.ndarray, seed: int, done: Callable[[int], None]
    ) -> tuple[Shared, float]:
        """One shot of each street with its features; what an earlier process has made is not made again.

        Args:
            name: hash of all that decides them.
            recipe: sizes, assets and trunk.
            units: f32[streets, attributes] of every street, in [0, 1].
            seed: with the street's index it decides everything left to chance.
            done: told how many streets more there are.

        Returns:
            The streets, and how many CPU seconds they have taken.
        """
        assert self._root is not None
        folder = self._pool(name)
        pieces = folder.with_name(f"{folder.name}.pieces")
        starts = range(0, len(units), CHUNK)

        def fill(part: Path) -> None:
            pieces.mkdir(exist_ok=True)
            files = {start: pieces / f"{start:06d}.npz" for start in starts}
            missing = [start for start in starts if _piece(files[start]) is None]
            done(sum(len(units[s : s + CHUNK]) for s in starts if s not in missing))
            own = sent(recipe, self.workers)
            tasks = [(own, units[s : s + CHUNK], seed, s) for s in missing]
            for index, made in self.workers.map(_made_streets, tasks, net=True):
                start = missing[index]
                buffer = io.BytesIO()
                np.savez(buffer, **made)
                write(files[start], buffer.getvalue(), sync=False)
                done(len(units[start : start + CHUNK]))
            _assemble(part, [files[start] for start in starts], len(units))

        self._keep(folder, {"streets": name}, fill)
        shutil.rmtree(pieces, ignore_errors=True)
        held = self.workers.share(str(folder))
        return Shared(held, held), float(np.load(folder / "seconds.npy"))

    def forget(self, name: str) -> None:
        """Remove the streets of a name: all their nets are trained."""
        if self._root is not None:
            shutil.rmtree(self._pool(name), ignore_errors=True)
            self._checked.discard(self._pool(name))

    def _pool(self, name: str) -> Path:
        assert self._root is not None
        return self._root / f"pool-{name[:16]}"

    def normalised(self, recipe: Recipe, target: Target) -> Recipe:
        """The recipe with the statistics that its head normalises features by, where those are the target's.

        They are of the images that give the reward, without their labels; never of those reported on.
        """
        fidelity = recipe.fidelity
        if not by_target(fidelity.train):
            return recipe
        real = target.at(fidelity.height, fidelity.width)["reward"]
        trunk = replace(fidelity.train, trunk="frozen")  # as a tuned one begins
        held = self.put(real, trunk)
        ((_, found),) = self.workers.map(_statistics, [(held, trunk)], net=True)
        return recipe._replace(statistics=found)

    def _compute(self, part: Path, count: int, tasks: list[tuple]) -> None:
        """Features of all tasks into the files of a folder, view after view."""
        files: dict[str, tuple[IO[bytes], int]] = {}
        done = 0
        try:
            for index, maps in self.workers.map(_features_of, tasks, net=True):
                _, start, stop, *_ = tasks[index]
                _write_part(part, files, maps._asdict(), stop - start, start, count)
                done += stop - start
                self._say(f"features of real images, once per run: {done} of {count}")
        finally:
            for file, _ in files.values():
                file.close()

    def _keep(self, folder: Path, told: Mapping[str, Any], fill: Callable[[Path], None]) -> None:
        """Write a folder unless it is there; look once per run whether it is what it should be."""
        if folder in self._checked:
            return
        if not _is_whole(folder, told):
            with whole_folder(folder) as part:
                fill(part)
                files = {path.name: file_digest(path) for path in sorted(part.iterdir())}
                write_json(part / ABOUT, {**told, "files": files})
        self._checked.add(folder)


def sent(recipe: Recipe, workers: Workers) -> Recipe:
    """A recipe whose files workers find: own assets, weights."""
    fidelity, own = recipe.fidelity, recipe.pool.own
    if fidelity.train.weights is not None:
        weights = workers.share(fidelity.train.weights)
        fidelity = replace(fidelity, train=replace(fidelity.train, weights=weights))
    return recipe._replace(fidelity=fidelity, pool=recipe.pool._replace(own=workers.share(own)))


def by_target(train: TrainSettings) -> bool:
    """Whether a net's head normalises features by statistics of the target's images."""
    return train.net == "lite0" and train.head_statistics == "target"


def _views(train: TrainSettings, training: bool) -> dict[str, Any]:
    """What decides features, beside images and trunk."""
    looks = {name: getattr(train, name) for name in LOOKS} if training else {"views": 1}
    return {"dtype": train.dtype, **looks}


def _features(truth: LabelledImages, train: TrainSettings, training: bool) -> Pyramid:
    """Features of images, or of all views that training takes of them: view after view, in their order.

    What a view shows depends on its image alone, so that those of a part are part of those of all.
    """
    images = view_images(truth.images, train) if training else truth.images
    return features(images, train.dtype)


def _features_of(
    held: Shared, start: int, stop: int, train: TrainSettings, training: bool
) -> Pyramid:
    """Features of some of the images; runs in a worker."""
    whole = held.load()
    part = LabelledImages(whole.images[start:stop], whole.labels[start:stop])
    return _features(part, train, training)


def _statistics(held: LabelledImages | Shared, train: TrainSettings) -> Statistics:
    """Statistics of features; runs in a worker."""
    truth = loaded(held)
    return channel_statistics(truth.features or _features(truth, train, False))


def _made_streets(
    recipe: Recipe, units: np.ndarray, seed: int, start: int
) -> dict[str, np.ndarray]:
    """Some streets of a pool, from the one with this index on; runs in a worker."""
    began = time.perf_counter()
    fidelity, name, pool = recipe.fidelity, recipe.renderer, recipe.pool
    settings = fidelity.render_settings()
    frames = [
        render_street(unit, seed, start + k, 1, settings, name, pool)[0]
        for k, unit in enumerate(units)
    ]
    images = np.stack([frame.image for frame in frames])
    labels = recipe.classes.from_train_id[np.stack([frame.label for frame in frames])]
    maps = _features(LabelledImages(images, labels), fidelity.train, True)
    seconds = np.float64(time.perf_counter() - began)
    return {"images": images, "labels": labels, **maps._asdict(), "seconds": seconds}


def _piece(path: Path) -> dict[str, np.ndarray] | None:
    """A piece of a pool; None if it is not there as a whole."""
    try:
        with path.open("rb") as file, np.load(file) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, EOFError, BadZipFile):
        return None


def _assemble(part: Path, pieces: Sequence[Path], count: int) -> None:
    """The files of a pool from its pieces, of features view after view."""
    files: dict[str, tuple[IO[bytes], int]] = {}
    first, seconds = 0, 0.0
    try:
        for path in pieces:
            piece = _piece(path)
            if piece is None:
                raise UserError(
                    f"{path} was damaged after it was made; the same command makes it anew"
                )
            seconds += float(piece.pop("seconds"))
            own = len(piece["images"])
            _write_part(part, files, piece, own, first, count)
            first += own
        np.save(part / "seconds.npy", seconds)
    finally:
        for file, _ in files.values():
            file.close()


def _write_truth(part: Path, truth: LabelledImages) -> None:
    for name, array in (("images", truth.images), ("labels", truth.labels)):
        file, start = _npy(part / f"{name}.npy", array.shape, array.dtype)
        with file:
            _write_rows(file, start, 0, array)


def _npy(path: Path, shape: tuple[int, ...], dtype: np.dtype) -> tuple[IO[bytes], int]:
    """A new file of NumPy's whose rows are not written yet, and where they begin.

    Not a memory map: a full disk would end the process with no word.
    """
    file = path.open("wb")
    descr = np.lib.format.dtype_to_descr(dtype)
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    return file, file.tell()


def _write_rows(file: IO[bytes], begin: int, row: int, rows: np.ndarray) -> None:
    file.seek(begin + row * rows[0].nbytes)
    file.write(np.ascontiguousarray(rows).data)


def _write_part(
    part: Path,
    files: dict[str, tuple[IO[bytes], int]],
    arrays: Mapping[str, np.ndarray],
    own: int,
    first: int,
    count: int,
) -> None:
    """Rows of ``own`` of ``count`` images, from the first of them on, into the files of a folder.

    An array holds one view after the other; its file is made with its first rows.
    """
    for name, array in arrays.items():
        views = len(array) // own
        if name not in files:
            shape = (count * views, *array.shape[1:])
            files[name] = _npy(part / f"{name}.npy", shape, array.dtype)
        for view in range(views):
            rows = array[view * own : (view + 1) * own]
            _write_rows(*files[name], view * count + first, rows)


def _is_whole(folder: Path, told: Mapping[str, Any]) -> bool:
    """Whether all files are there; raises UserError if they are not what they should be."""
    path, end = folder / ABOUT, removable(folder)
    if not path.exists():
        return False
    try:
        found = read_json(path)
        files = dict(found["files"])
    except (UserError, LookupError, TypeError, ValueError):
        raise UserError(f"{path} is damaged; {end}") from None
    if not all(os.path.isfile(folder / name) for name in files):
        return False
    for name, value in told.items():
        if found.get(name) != value:
            raise UserError(
                f"{path}: this folder is of other {name}, {found.get(name)!r} and not {value!r}; {end}"
            )
    for name, value in files.items():
        if file_digest(folder / name) != value:
            raise UserError(f"{folder / name} is damaged; {end}")
    return True
