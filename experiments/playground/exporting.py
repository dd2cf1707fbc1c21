"""Renders a dataset in its own process, which reports its progress and can be cancelled at any time."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from experiments.playground.state import State, check_view
from scene.dataset.export import export_dataset
from scene.proposal import draw
from scene.render import RendererError

MOST_IMAGES = 100_000


class News(NamedTuple):
    """The progress of an export."""

    done: int  # images
    images: int
    error: str = ""  # why it ended early

    @property
    def over(self) -> bool:
        """Whether the export has ended."""
        return bool(self.error) or self.done == self.images


class Export:
    """One running export; finished images stay when it is cancelled, and the same export continues it.

    Args:
        state: gives the streets; its view gives seed, shots, size, rays and assets.
        images: their number.
        format: a layout, as `scene.dataset.formats.layout` names it.
        folder: a new or empty folder, or that of the same export, which is continued.

    Raises:
        ValueError: no folder is named, or the view or the number of images is out of range.
    """

    def __init__(self, state: State, images: int, format: str, folder: str) -> None:
        if not folder.strip():
            raise ValueError("folder: name a new one, or that of an export to be continued")
        if not 1 <= images <= MOST_IMAGES:
            raise ValueError(f"images must lie in 1..{MOST_IMAGES:,}, not {images}")
        check_view(state.view)
        context = multiprocessing.get_context("spawn")
        self._ear, mouth = context.Pipe(duplex=False)
        order = (state, images, format, Path(folder.strip()).expanduser(), mouth)
        self._process = context.Process(target=_work, args=order, daemon=True)
        self._last = News(0, images)
        self._process.start()
        mouth.close()

    def news(self) -> News:
        """The latest progress; never waits."""
        try:
            while not self._last.over and self._ear.poll():
                self._last = self._ear.recv()
        except EOFError:
            self._last = self._last._replace(error="the process died (out of memory, or killed?)")
        return self._last

    def cancel(self) -> None:
        """End the process now; a half-written image is made again when the export is continued."""
        self._process.terminate()
        self._process.join()
        if not self._last.over:
            self._last = self._last._replace(
                error=f"cancelled after {self._last.done} images; the same order continues it"
            )


def _work(state: State, images: int, format: str, folder: Path, mouth: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    view = state.view

    def tell(done: int, wanted: int, _: int) -> None:
        if done < wanted:  # the last images may not be written yet
            mouth.send(News(done, wanted))

    try:
        export_dataset(
            draw(state.streets, view.seed, -(-images // view.shots)),
            view.seed,
            folder,
            shots=view.shots,
            settings=view.settings,
            images=images,
            format=format,
            pool=view.pool,
            streets=state.streets,
            progress=tell,
        )
        mouth.send(News(images, images))
    except BrokenPipeError:
        return  # the page's process is gone
    except (ValueError, OSError, RendererError) as error:
        mouth.send(News(0, images, str(error)))
