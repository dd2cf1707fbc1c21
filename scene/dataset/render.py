"""Render attribute vectors to a labelled dataset in worker processes.

A dataset is a list of attribute vectors, one per street. Its bytes depend on the vectors, the seed, the size
and the renderer, but not on the number of workers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from common.errors import UserError
from common.labels.classes import Outline
from common.workers.pool import WorkerPool, Workers, opened
from scene.assets.catalogue import AssetPool, check_pool
from scene.attributes import check_unit, default_unit, street_params
from scene.compiled import first_use
from scene.outline import outlined
from scene.render import Frame, RenderSettings, check_settings, renderer
from scene.street.street import Street, sample_street

COMPILING = "compiling the renderer (once per installation, about a minute)..."


class Dataset(NamedTuple):
    """Images and labels in the order of streets; shots of one street are consecutive."""

    images: np.ndarray  # u8[n, h, w, 3] sRGB
    labels: np.ndarray  # u8[n, h, w] train ids; 19 is a pool's own class, 255 is ignored


def street_of(unit: np.ndarray, seed: int, index: int, shots: int, pool: AssetPool) -> Street:
    """Make the ``index``-th street of the dataset with ``seed`` from unit attributes f32[attributes]."""
    return sample_street(street_params(unit), street_seed(seed, index), shots, pool)


def check_seed(seed: int, name: str = "seed") -> int:
    """Return a dataset's seed; UserError by name if it is negative or has more than 32 bits.

    A larger one would have the streets of a smaller one.
    """
    if not 0 <= seed < 2**32:
        raise UserError(f"{name} must lie in 0..{2**32 - 1}, not {seed}")
    return seed


def street_seed(seed: int, index: int) -> int:
    """The seed of the ``index``-th street of the dataset with ``seed``; UserError as `check_seed`."""
    check_seed(seed)
    return int(np.random.SeedSequence([seed, index]).generate_state(1)[0])


def render_street(
    unit: np.ndarray,
    seed: int,
    index: int,
    shots: int,
    settings: RenderSettings,
    renderer_name: str,
    pool: AssetPool,
) -> list[Frame]:
    """Render all shots of one street of a dataset."""
    return renderer(renderer_name).render(street_of(unit, seed, index, shots, pool), settings)


def images_and_labels(outlines: Sequence[Outline], *task: Any) -> tuple[np.ndarray, np.ndarray]:
    """Render a street with `render_street`'s arguments: u8[shots, h, w, 3] and u8[shots, h, w]."""
    frames = [outlined(frame, outlines) for frame in render_street(*task)]
    return np.stack([f.image for f in frames]), np.stack([f.label for f in frames])


def compile_first(workers: Workers, renderer_name: str) -> None:
    """Compile a renderer on its first use on this machine, with a message, since it takes a minute.

    One worker compiles before the others start, which then load its cache. Workers of a cluster compile on
    their own machines.
    """
    if isinstance(workers, WorkerPool) and first_use(renderer_name) is not None:
        print(COMPILING, file=sys.stderr, flush=True)
        list(workers.map(_compile, [(renderer_name,)]))


def _compile(renderer_name: str) -> None:
    """Render one street of each kind that needs different functions: straight, bent, at night."""
    settings, pool = RenderSettings(64, 48), AssetPool(size=1)
    params = street_params(default_unit())
    straight = params._replace(bend=0.0, gradient=0.0)
    night = pool._replace(weather="night")
    for variant, assets in ((straight, pool), (params._replace(bend=20.0), pool), (params, night)):
        renderer(renderer_name).render(sample_street(variant, 0, 1, assets), settings)
    marker = first_use(renderer_name)
    if marker is not None:
        marker.touch()


def check_request(
    units: np.ndarray, shots: int, settings: RenderSettings, renderer_name: str
) -> np.ndarray:
    """Check a request; returns its attributes f32[streets, attributes].

    Raises:
        ValueError: attributes, size or shots are out of range, or the renderer is unknown.
        RendererError: this machine lacks what the renderer needs.
    """
    units = check_unit(units)
    if units.ndim != 2 or len(units) == 0:
        raise ValueError(
            f"a dataset needs attributes of shape [streets, attributes], got {units.shape}"
        )
    if shots < 1:
        raise ValueError(f"shots per street must be 1 or more, not {shots}")
    check_settings(settings)
    renderer(renderer_name)
    return units


def render_dataset(
    units: np.ndarray,
    seed: int,
    *,
    shots: int,
    settings: RenderSettings,
    renderer_name: str = "embree",
    pool: AssetPool | None = None,
    outlines: Sequence[Outline] = (),
    workers: int | Workers = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Render ``len(units) * shots`` images.

    Args:
        units: f32[streets, attributes] attributes of each street, in [0, 1].
        seed: random seed.
        shots: images per street.
        settings: size and quality.
        renderer_name: ``embree`` or ``opengl``.
        pool: the assets to use.
        outlines: classes with closed outlines, as `engine_outlines` of a target; by default labels are exact.
        workers: number of processes; 0 renders in this process. ``Workers`` are used and left open.
        progress: called with (streets done, streets).

    Raises:
        ValueError: attributes, size, shots or the pool are out of range, or the renderer is unknown.
        LibraryError: the pool's files cannot be used.
        RendererError: this machine lacks what the renderer needs.
        WorkerError: worker processes keep dying.
    """
    units = check_request(units, shots, settings, renderer_name)
    check_seed(seed)
    pool = check_pool(pool or AssetPool())
    n, h, w = len(units) * shots, settings.height, settings.width
    images, labels = np.empty((n, h, w, 3), np.uint8), np.empty((n, h, w), np.uint8)
    with opened(workers) as processes:
        compile_first(processes, renderer_name)
        pool = pool.with_paths(processes.share)
        tasks = [
            (outlines, u, seed, i, shots, settings, renderer_name, pool)
            for i, u in enumerate(units)
        ]
        for done, (i, result) in enumerate(processes.map(images_and_labels, tasks), start=1):
            images[i * shots : (i + 1) * shots], labels[i * shots : (i + 1) * shots] = result
            if progress is not None:
                progress(done, len(tasks))
    return Dataset(images, labels)
