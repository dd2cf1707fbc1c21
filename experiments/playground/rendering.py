"""From a state to pictures, in one warm process; of what is asked for meanwhile, only the last is made."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from experiments.playground.state import State, View
from scene.dataset.render import street_of
from scene.preview.layout import tile
from scene.render import renderer
from scene.street.street import Street
from scene.workers import WorkerPool

QUALITY = 90
"""Of JPEG."""
SETTLED = 0.15
"""Seconds without a newer wish after which a quick picture is refined."""


class Request(NamedTuple):
    """One picture to be made."""

    unit: tuple[float, ...]  # attributes, exact single precision
    view: View
    quick: bool = False  # half the size and one ray a pixel


class Pictures(NamedTuple):
    """What a request gives, as files."""

    image: bytes  # JPEG
    label: bytes  # PNG
    depth: bytes  # JPEG, near is bright
    weather: str
    placed: int  # assets in the street
    seconds: float  # of work


def request(state: State, quick: bool = False) -> Request:
    """What a state shows."""
    return Request(tuple(state.unit.tolist()), state.view, quick)


def pictures(wanted: Request) -> Pictures:
    """Make one request's pictures; the street of the last few is kept."""
    began, view = time.perf_counter(), wanted.view
    street = _street(wanted.unit, view.seed, view.street, view.shots, view.pool)
    settings = view.settings
    if wanted.quick:
        width, height = max(view.width // 2, 8), max(view.height // 2, 8)
        settings = settings._replace(width=width, height=height, samples=1)
    shot = street._replace(cameras=street.cameras[view.shot : view.shot + 1])
    (frame,) = renderer("embree").render(shot, settings)
    image, label, depth = np.split(tile(frame), 3)
    return Pictures(
        _file(".jpg", image),
        _file(".png", label),
        _file(".jpg", depth),
        street.sky.weather,
        len(street.placements),
        time.perf_counter() - began,
    )


@lru_cache(maxsize=8)
def _street(unit: tuple[float, ...], *rest: object) -> Street:
    return street_of(np.array(unit, np.float32), *rest)  # type: ignore[arg-type]


def _file(suffix: str, picture: np.ndarray) -> bytes:
    quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if suffix == ".jpg" else []
    data: np.ndarray = cv2.imencode(suffix, picture[..., ::-1], quality)[1]
    return data.tobytes()


class RenderProcess:
    """One process that makes pictures, shared by all pages; what it compiled and built is kept."""

    def __init__(self) -> None:
        self._workers = WorkerPool(1)
        self._turn = asyncio.Lock()
        self.warm = False

    async def make(self, wanted: Request) -> Pictures:
        """Pictures of one request, off the event loop.

        Raises:
            WorkerError: the process died, and died again.
        """
        async with self._turn:
            made = await asyncio.to_thread(self._make, wanted)
            self.warm = True
            return made

    def _make(self, wanted: Request) -> Pictures:
        ((_, made),) = self._workers.map(pictures, [(wanted,)])
        found: Pictures = made
        return found

    def close(self) -> None:
        """Stop the process."""
        self._workers.close()


class LatestOnly:
    """Makes what one page asks for: of pictures that wait only the last, and quick ones again in full.

    Args:
        make: gives a request's pictures.
        show: is told the request, its pictures, and the seconds since it was asked for.
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
        """Want a picture in place of all that wait; the first to ask also serves those after it."""
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
