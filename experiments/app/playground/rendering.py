"""Makes the pictures of a state in one warm process; of the requests that wait, it answers only the last."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from common.workers.pool import WorkerPool
from experiments.app.playground.state import MOST_STREETS, State, View
from scene.classes import VOID, TrainId, colorize
from scene.dataset.render import street_of
from scene.preview.layout import FAR
from scene.render import renderer
from scene.street.street import Street

QUALITY = 90
"""The quality of JPEG files."""
NEAR, BLOCKED = 2.5, 0.3
"""A view is from inside a thing if things, but not ground, that are nearer than `NEAR` metres cover a larger
share of it than `BLOCKED`."""
LOOKED_AT = 20
"""The number of streets among which the first with a free view is shown."""
SKETCH = 48
"""The width in pixels of the picture that shows whether a view is free."""
GROUND = (TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN)
SETTLED = 0.15
"""Seconds without a newer request after which a quick picture is refined."""


class Request(NamedTuple):
    """A request for one picture."""

    unit: tuple[float, ...]  # attributes, exact single precision
    view: View
    quick: bool = False  # half the size and one ray a pixel


class Pictures(NamedTuple):
    """The pictures of a request, as files."""

    image: bytes  # JPEG
    label: bytes  # PNG
    depth: bytes  # PNG in a colour map, near is yellow; pixels without depth are black
    shares: tuple[
        tuple[int, float], ...
    ]  # train ids in the picture with their percent, the largest first
    weather: str
    placed: int  # assets in the street
    seconds: float  # of work


def request(state: State, quick: bool = False) -> Request:
    """The request for the picture of a state."""
    return Request(tuple(state.unit.tolist()), state.view, quick)


def pictures(wanted: Request) -> Pictures:
    """Make the pictures of a request; the last few streets are kept."""
    began, view = time.perf_counter(), wanted.view
    street = _street(wanted.unit, view.seed, view.street, view.shots, view.pool)
    settings = view.settings
    if wanted.quick:
        width, height = max(view.width // 2, 8), max(view.height // 2, 8)
        settings = settings._replace(width=width, height=height, samples=1)
    shot = street._replace(cameras=street.cameras[view.shot : view.shot + 1])
    (frame,) = renderer("embree").render(shot, settings)
    return Pictures(
        _file(".jpg", frame.image),
        _file(".png", colorize(frame.label)),
        _file(".png", coloured(frame.depth)),
        shares(frame.label),
        street.sky.weather,
        len(street.placements),
        time.perf_counter() - began,
    )


def shares(label: np.ndarray) -> tuple[tuple[int, float], ...]:
    """Train ids in a label image u8[h, w], each with its percent of all pixels, the largest first."""
    ids, counts = np.unique(label[label != VOID], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return tuple((int(ids[k]), 100 * float(counts[k]) / label.size) for k in order)


def coloured(depth: np.ndarray) -> np.ndarray:
    """The colours u8[h, w, 3] of depth f32[h, w] in metres, where 0 is no depth."""
    near = (255 * (1 - np.clip(depth / FAR, 0, 1))).astype(np.uint8)
    found: np.ndarray = cv2.applyColorMap(near, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(depth[..., None] > 0, found, 0).astype(np.uint8)


def free(depth: np.ndarray, label: np.ndarray) -> bool:
    """Whether a view with depth f32[h, w] in metres and label u8[h, w] is not from inside a thing."""
    close = (depth > 0) & (depth < NEAR) & ~np.isin(label, GROUND)
    return float(close.mean()) <= BLOCKED


def first_free(state: State) -> int:
    """The first street with a free view, beginning at the state's; the state's own if there is none."""
    view = state.view
    settings = view.settings._replace(
        width=SKETCH, height=max(SKETCH * view.height // view.width, 8), samples=1
    )
    for k in range(view.street, min(view.street + LOOKED_AT, MOST_STREETS)):
        wanted = request(state._replace(view=view._replace(street=k)))
        street = _street(wanted.unit, view.seed, k, view.shots, view.pool)
        shot = street._replace(cameras=street.cameras[view.shot : view.shot + 1])
        (frame,) = renderer("embree").render(shot, settings)
        if free(frame.depth, frame.label):
            return k
    return view.street


@lru_cache(maxsize=8)
def _street(unit: tuple[float, ...], *rest: object) -> Street:
    return street_of(np.array(unit, np.float32), *rest)  # type: ignore[arg-type]


def _file(suffix: str, picture: np.ndarray) -> bytes:
    quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if suffix == ".jpg" else []
    data: np.ndarray = cv2.imencode(suffix, picture[..., ::-1], quality)[1]
    return data.tobytes()


class RenderProcess:
    """One process that makes pictures, shared by all pages; it keeps what it has compiled and built."""

    def __init__(self) -> None:
        self._workers = WorkerPool(1)
        self._turn = asyncio.Lock()
        self.warm = False

    async def make(self, wanted: Request) -> Pictures:
        """Make the pictures of a request without blocking the event loop.

        Raises:
            WorkerError: the process died twice.
        """
        made: Pictures = await self._call(pictures, wanted)
        self.warm = True
        return made

    async def first_free(self, state: State) -> int:
        """Find the street of `first_free`; raises as `make` does."""
        found: int = await self._call(first_free, state)
        return found

    async def _call(self, work: Callable[[Any], Any], wanted: Any) -> Any:
        async with self._turn:
            ((_, made),) = await asyncio.to_thread(
                lambda: list(self._workers.map(work, [(wanted,)]))
            )
            return made

    def close(self) -> None:
        """Stop the process."""
        self._workers.close()


class LatestOnly:
    """Answers the requests of one page: of those that wait only the last, and quick ones again in full.

    Args:
        make: gives a request's pictures.
        show: receives the request, its pictures, and the seconds since the request.
    """

    def __init__(
        self,
        make: Callable[[Request], Awaitable[Pictures]],
        show: Callable[[Request, Pictures, float], None],
    ) -> None:
        self._make, self._show = make, show
        self._next: tuple[Request, float] | None = None
        self._busy = False

    async def ask(self, wanted: Request) -> None:
        """Replace the waiting request; the first caller also answers the requests that come meanwhile."""
        self._next = wanted, time.perf_counter()
        if self._busy:
            return
        self._busy = True
        try:
            while self._next is not None:
                (wanted, asked), self._next = self._next, None
                self._show(wanted, await self._make(wanted), time.perf_counter() - asked)
                if wanted.quick and self._next is None:
                    await asyncio.sleep(SETTLED)
                    refined = wanted._replace(quick=False), time.perf_counter()
                    self._next = self._next or refined
        finally:
            self._busy = False
