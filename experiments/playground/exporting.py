"""A dataset rendered in a process of its own, which tells how far it is and can be ended at any moment."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from experiments.playground.state import State
from scene.dataset.export import export_dataset
from scene.proposal import draw
from scene.render import RendererError

MOST_IMAGES = 100_000


class News(NamedTuple):
    """How far an export is."""

    done: int  # images
    images: int
    error: str = ""  # why it ended before all were done

    @property
    def over(self) -> bool:
        """Whether nothing more will come."""
        return bool(self.error) or self.done == self.images


class Export:
    """One export under way; what is finished stays when it is cancelled, and the same order goes on.

    Args:
        state: its streets, with seed, shots, size, rays and assets of its view.
        images: how many.
        format: a layout, as `scene.dataset.formats.layout` names it.
        folder: new, empty, or the same export to be continued.

    Raises:
        ValueError: no folder, or a number of images out of range.
    """

    def __init__(self, state: State, images: int, format: str, folder: str) -> None:
        if not folder.strip():
            raise ValueError("folder: name a new one, or that of an export to be continued")
        if not 1 <= images <= MOST_IMAGES:
            raise ValueError(f"images must lie in 1..{MOST_IMAGES:,}, not {images}")
        context = multiprocessing.get_context("spawn")
        self._ear, mouth = context.Pipe(duplex=False)
        order = (state, images, format, Path(folder.strip()).expanduser(), mouth)
        self._process = context.Process(target=_work, args=order, daemon=True)
        self._last = News(0, images)
        self._process.start()
        mouth.close()

    def news(self) -> News:
        """The latest; never waits."""
        try:
            while not self._last.over and self._ear.poll():
                self._last = self._ear.recv()
        except EOFError:
            self._last = self._last._replace(error="the process died (out of memory, or killed?)")
        return self._last

    def cancel(self) -> None:
        """End it now; an image that is half-written is made again when the export is continued."""
        self._process.terminate()
        self._process.join()
        if not self._last.over:
            self._last = self._last._replace(
                error=f"cancelled after {self._last.done} images; the same order continues it"
            )


def _work(state: State, images: int, format: str, folder: Path, mouth: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    view = state.view

    def tell(done: int, wanted: int, _: int) -> None:
        if done < wanted:  # all rendered is not yet all written
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
