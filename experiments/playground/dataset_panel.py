"""The panel that renders a dataset into a folder, with its progress and a button to cancel it."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from experiments.playground.exporting import Export
from experiments.playground.state import State
from scene.dataset.formats.layout import FORMATS

LISTEN = 0.4
"""Seconds between checks of an export's progress."""


class DatasetPanel:
    """Exports one dataset at a time, from the state that the page shows when the button is pressed.

    Args:
        state: gives the state of the page.
    """

    def __init__(self, state: Callable[[], State]) -> None:
        self._state = state
        self._export: Export | None = None
        with ui.element("div").classes("panel dataset"):
            ui.html("<h2>Dataset</h2>", sanitize=False)
            self._folder = ui.input("folder")
            with ui.element("div").classes("fields"):
                self._images = ui.number("images", value=180, min=1, precision=0)
                self._format = ui.select(list(FORMATS), value="cityscapes", label="format")
            self._bar = ui.linear_progress(0, show_value=False).props("rounded")
            self._text = ui.label("size, rays, shots, seed and assets as in view")
            self._text.classes("quiet")
            with ui.row().classes("gap-2"):
                self._start = ui.button("render dataset", on_click=self._begin)
                self._start.props("unelevated dense padding='2px 12px'")
                self._end = ui.button("cancel", on_click=self._cancel).props("flat dense")
            self._end.disable()
        self._timer = ui.timer(LISTEN, self._listen, active=False)

    def close(self) -> None:
        """Cancel the export, if one is running, when the page is closed."""
        if self._export is not None:
            self._export.cancel()

    def _begin(self) -> None:
        try:
            self._export = Export(
                self._state(),
                int(self._images.value or 0),
                str(self._format.value),
                self._folder.value or "",
            )
        except (ValueError, OSError) as error:
            self._text.set_text(str(error))
            return
        self._start.disable()
        self._end.enable()
        self._text.set_text("starting")
        self._timer.activate()

    def _cancel(self) -> None:
        if self._export is not None:
            self._export.cancel()
            self._listen()

    def _listen(self) -> None:
        if self._export is None:
            return
        news = self._export.news()
        self._bar.set_value(news.done / news.images)
        self._text.set_text(f"{news.done} of {news.images} images")
        if not news.over:
            return
        self._timer.deactivate()
        self._export = None
        self._end.disable()
        self._start.enable()
        self._text.set_text(news.error or f"{news.images} images in {self._folder.value}")
