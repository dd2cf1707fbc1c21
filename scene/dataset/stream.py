"""A stream of labelled images without files; they equal those of an export."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from common.errors import UserError, hint
from common.labels.classes import Outline
from common.workers.pool import Workers, opened
from scene.assets.catalogue import AssetPool, check_pool
from scene.attributes import SpaceName
from scene.dataset.formats.labels import (
    Labels,
    engine_labels,
    refuse_with_target,
    target_entry,
    target_labels,
)
from scene.dataset.render import check_request, check_seed, compile_first, render_street
from scene.outline import outlined
from scene.proposal import Streets, draw, read_streets
from scene.render import RenderSettings
from scene.street.camera import Camera

if TYPE_CHECKING:
    from common.labels.target_file import TargetFile


EXTRA = ("depth", "instances", "normals", "camera")
"""Names for ``passes`` of `stream`."""


class _Sample(NamedTuple):
    image: np.ndarray  # u8[h, w, 3] sRGB
    label: np.ndarray  # u8[h, w] class indices, 255 is ignored
    street: np.ndarray  # f32[attributes] of its street, in [0, 1]


class Sample(_Sample):
    """One image of a stream; it unpacks into image, label and street.

    The requested ``passes`` are attributes, the others None: ``depth`` f32[h, w] in metres along the optical
    axis (0: sky), ``instances`` u16[h, w] (0: sky), ``normals`` f32[h, w, 3] in the camera's frame (x right,
    y up, z towards the camera), and ``camera``, a `Camera`.
    """

    depth: np.ndarray | None = None
    instances: np.ndarray | None = None
    normals: np.ndarray | None = None
    camera: Camera | None = None

    def _replace(self, **fields: Any) -> Sample:
        """A copy with other fields; it keeps the passes."""
        changed = super()._replace(**{k: fields.pop(k) for k in self._fields if k in fields})
        vars(changed).update(vars(self) | fields)
        return changed


def stream(
    streets: Streets | str | Path = "default",
    seed: int = 0,
    *,
    size: tuple[int, int] = (640, 320),
    settings: RenderSettings | None = None,
    shots: int = 1,
    start: int = 0,
    images: int | None = None,
    space: SpaceName | None = None,
    renderer_name: str = "embree",
    pool: AssetPool | None = None,
    target: TargetFile | str | Path | None = None,
    workers: int | Workers = 0,
    passes: Sequence[str] = (),
) -> Generator[Sample, None, None]:
    """Render images one by one; image k equals image k of an export with the same settings.

    Args:
        streets: the distribution of the streets' attributes, or ``default``, ``random``, ``mixed`` or a JSON
            file, as ``--attributes`` of ``sdr-jax render``.
        seed: random seed.
        size: width and height in pixels.
        settings: size and quality; overrides ``size``.
        shots: images per street.
        start: index of the first image, to resume a stream.
        images: number of images; by default endless.
        space: space of ``default``, ``random`` or ``mixed`` streets, by default scenex.
        renderer_name: ``embree`` or ``opengl``.
        pool: the assets to use, and the user's own class, whose label is 19.
        target: a target, its name or its file, whose classes the labels have; by default labels are train
            ids.
        workers: number of processes, which render a few streets ahead; 0 renders in this process. ``Workers``
            are used and left open.
        passes: additional arrays in samples: ``depth``, ``instances``, ``normals``, ``camera``.

    Yields:
        Samples of image, label, the attributes of its street, and the passes.

    Raises:
        ValueError: an argument is out of range, or the renderer is unknown.
        OSError: the JSON file cannot be read.
        RendererError: this machine lacks what the renderer needs.
        WorkerError: worker processes keep dying.
    """
    distribution = read_streets(str(streets), space) if isinstance(streets, str | Path) else streets
    settings = settings or RenderSettings(*size)
    for name, value in (("start", start), ("images", images or 0)):
        if value < 0:
            raise ValueError(f"{name} must be 0 or more, not {value}")
    check_seed(seed)
    for name in passes:
        if name not in EXTRA:
            raise UserError(f"passes: {name!r} is unknown; {hint(name, EXTRA)}")
    check_request(draw(distribution, seed, 1), shots, settings, renderer_name)
    pool = check_pool(pool or AssetPool())
    if target is None:
        classes = engine_labels(True, pool.own_class and pool.own_class.name)
    else:
        entry = target_entry(target)
        if pool.own_class is not None:
            refuse_with_target(pool.own_class.name, entry["name"])
        classes = target_labels(entry)
    last = None if images is None else start + images
    return _samples(
        distribution,
        seed,
        start,
        last,
        shots,
        settings,
        renderer_name,
        pool,
        classes,
        workers,
        tuple(passes),
    )


def _samples(
    distribution: Streets,
    seed: int,
    start: int,
    last: int | None,
    shots: int,
    settings: RenderSettings,
    renderer_name: str,
    pool: AssetPool,
    classes: Labels,
    workers: int | Workers,
    passes: tuple[str, ...],
) -> Generator[Sample, None, None]:
    first = start // shots

    def units(index: int) -> np.ndarray:
        return draw(distribution, seed, 1, start=index)[0]

    streets = count(first) if last is None else range(first, -(-last // shots))
    number = first * shots
    with opened(workers) as processes:
        compile_first(processes, renderer_name)
        shared_pool = pool.with_paths(processes.share)
        tasks: Iterator[tuple[Any, ...]] = (
            (
                passes,
                classes.outlines,
                units(k),
                seed,
                k,
                shots,
                settings,
                renderer_name,
                shared_pool,
            )
            for k in streets
        )
        for index, shot_arrays in enumerate(processes.in_order(_shown, tasks), start=first):
            street = units(index)
            for image, label, extra in shot_arrays:
                if start <= number and (last is None or number < last):
                    sample = Sample(image, classes.of_engine[label], street)
                    vars(sample).update(extra)
                    yield sample
                number += 1


def _shown(
    passes: tuple[str, ...], outlines: Sequence[Outline], *task: Any
) -> list[tuple[np.ndarray, np.ndarray, dict[str, Any]]]:
    """Render a street with `render_street`'s arguments: image, label and passes of each shot."""
    fields = {"depth": "depth", "instances": "instance", "normals": "normal", "camera": "camera"}
    frames = [outlined(frame, outlines) for frame in render_street(*task)]
    return [
        (frame.image, frame.label, {name: getattr(frame, fields[name]) for name in passes})
        for frame in frames
    ]
