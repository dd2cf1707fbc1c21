"""Renders the images of a state in one warm process; of waiting requests, it answers only the last."""

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
"""A view is blocked if things nearer than `NEAR` metres, other than ground, cover a share above `BLOCKED`."""
LOOKED_AT = 20
"""The number of streets among which to look for a free view."""
SKETCH = 48
"""The width in pixels of the image that shows whether a view is free."""
GROUND = (TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN)
SETTLED = 0.15
"""Seconds without a newer request after which a preview is refined."""


class Request(NamedTuple):
    """A request for one image."""

    unit: tuple[float, ...]  # attributes, exact single precision
    view: View
    quick: bool = False  # half the size and one ray a pixel


class Pictures(NamedTuple):
    """The images of a request, as files."""

    image: bytes  # JPEG
    label: bytes  # PNG
    depth: bytes  # PNG in a colour map, yellow is near; pixels without depth are black
    shares: tuple[tuple[int, float], ...]  # train ids in the image, percent; largest first
    weather: str
    placed: int  # assets in the street


def request_for(state: State, quick: bool = False) -> Request:
    """The request for the image of a state."""
    return Request(tuple(state.unit.tolist()), state.view, quick)


def pictures(request: Request) -> Pictures:
    """Render the images of a request; the last few streets are cached."""
    view = request.view
    street = _street(request.unit, view.seed, view.street, view.shots, view.pool)
    settings = view.settings
    if request.quick:
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
    )


def shares(label: np.ndarray) -> tuple[tuple[int, float], ...]:
    """Train ids in a label image u8[h, w], each with its percentage of all pixels, largest first."""
    ids, counts = np.unique(label[label != VOID], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return tuple((int(ids[k]), 100 * float(counts[k]) / label.size) for k in order)


def coloured(depth: np.ndarray) -> np.ndarray:
    """The colours u8[h, w, 3] of depth f32[h, w] in metres, where 0 is no depth."""
    near = (255 * (1 - np.clip(depth / FAR, 0, 1))).astype(np.uint8)
    colours: np.ndarray = cv2.applyColorMap(near, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(depth[..., None] > 0, colours, 0).astype(np.uint8)


def free(depth: np.ndarray, label: np.ndarray) -> bool:
    """Whether nothing near blocks a view with depth f32[h, w] in metres and label u8[h, w]."""
    close = (depth > 0) & (depth < NEAR) & ~np.isin(label, GROUND)
    return float(close.mean()) <= BLOCKED


def first_free(state: State) -> int:
    """The first street with a free view from the state's street on; that street if there is none."""
    view = state.view
    settings = view.settings._replace(
        width=SKETCH, height=max(SKETCH * view.height // view.width, 8), samples=1
    )
    for k in range(view.street, min(view.street + LOOKED_AT, MOST_STREETS)):
        unit = request_for(state._replace(view=view._replace(street=k))).unit
        street = _street(unit, view.seed, k, view.shots, view.pool)
        shot = street._replace(cameras=street.cameras[view.shot : view.shot + 1])
        (frame,) = renderer("embree").render(shot, settings)
        if free(frame.depth, frame.label):
            return k
    return view.street


@lru_cache(maxsize=8)
def _street(unit: tuple[float, ...], *rest: object) -> Street:
    return street_of(np.array(unit, np.float32), *rest)  # type: ignore[arg-type]


def _file(suffix: str, image: np.ndarray) -> bytes:
    quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if suffix == ".jpg" else []
    data: np.ndarray = cv2.imencode(suffix, image[..., ::-1], quality)[1]
    return data.tobytes()


class RenderProcess:
    """One rendering process, shared by all pages; it keeps compiled code and built streets."""

    def __init__(self) -> None:
        self._workers = WorkerPool(1)
        self._turn = asyncio.Lock()
        self.warm = False

    async def make(self, request: Request) -> Pictures:
        """Render the images of a request without blocking the event loop.

        Raises:
            WorkerError: the process died twice.
        """
        images: Pictures = await self._call(pictures, request)
        self.warm = True
        return images

    async def first_free(self, state: State) -> int:
        """Find the street of `first_free`; raises as `make` does."""
        street: int = await self._call(first_free, state)
        return street

    async def _call(self, work: Callable[[Any], Any], argument: Any) -> Any:
        async with self._turn:
            ((_, result),) = await asyncio.to_thread(
                lambda: list(self._workers.map(work, [(argument,)]))
            )
            return result

    def close(self) -> None:
        """Stop the process."""
        self._workers.close()


class LatestOnly:
    """Answers the requests of one page: of waiting ones only the last, and quick ones later in full.

    Args:
        make: renders a request's images.
        show: receives the request, its images, and the seconds since the request.
    """

    def __init__(
        self,
        make: Callable[[Request], Awaitable[Pictures]],
        show: Callable[[Request, Pictures, float], None],
    ) -> None:
        self._make, self._show = make, show
        self._next: tuple[Request, float] | None = None
        self._busy = False

    async def ask(self, request: Request) -> None:
        """Replace the waiting request; the first caller also answers requests that arrive meanwhile."""
        self._next = request, time.perf_counter()
        if self._busy:
            return
        self._busy = True
        try:
            while self._next is not None:
                (request, asked_at), self._next = self._next, None
                self._show(request, await self._make(request), time.perf_counter() - asked_at)
                if request.quick and self._next is None:
                    await asyncio.sleep(SETTLED)
                    refined = request._replace(quick=False), time.perf_counter()
                    self._next = self._next or refined
        finally:
            self._busy = False
