"""The column of sliders: an interval for each attribute, by group, in physical units."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from experiments.app.playground.state import State, as_before, interval, rows, shown
from scene.attributes import BY_NAME

STEPS = 1000
"""The steps of a slider; an interval that is not moved keeps its exact value."""
OPEN = ("Light and weather", "Camera")
"""Groups that are open at first."""


class Sliders:
    """Sliders over the attributes of one space.

    Args:
        state: the first state.
        moved: receives a name and the ends of its new interval, in unit values, when the user moves a thumb.
        reset: receives the name of an attribute whose interval is to be reset.
    """

    def __init__(
        self,
        state: State,
        moved: Callable[[str, float, float], Awaitable[None]],
        reset: Callable[[str], Awaitable[None]],
    ) -> None:
        self._state, self._moved, self._reset = state, moved, reset
        self._resets: dict[str, ui.button] = {}
        self._ranges: dict[str, ui.range] = {}
        self._texts: dict[str, tuple[ui.label, ui.label]] = {}
        for title, names in rows(state.space).items():
            with ui.expansion(title, value=title in OPEN).classes("knobgroup w-full"):
                for name in names:
                    self._row(state, name)
        self.show(state, state)

    def show(self, state: State, first: State) -> None:
        """Show a state; attributes that differ from those of ``first`` can be reset."""
        self._state, unit = state, state.unit
        for name, thumbs in self._ranges.items():
            if thumbs.value != (values := _thumbs(state, name)):
                thumbs.value = values
            for label, text in zip(self._texts[name], shown(state, name, unit), strict=True):
                label.set_text(text)
            self._resets[name].set_visibility(not as_before(state, name, first))

    def _row(self, state: State, name: str) -> None:
        with ui.element("div").classes("attribute").props(f"data-attribute={name}"):
            with ui.element("div").classes("head"):
                ui.label(BY_NAME[name].meaning).classes("meaning").tooltip(name)
                reset = ui.button("reset", on_click=partial(self._reset, name)).classes("reset")
                reset.props(f'flat dense size=10px padding="0 4px" aria-label="reset {name}"')
                ends = ui.label().classes("ends")
            thumbs = ui.range(min=0, max=STEPS, value=_thumbs(state, name))
            thumbs.props(f'drag-range dense aria-label="{name}"')
            sampled = ui.label().classes("drawn").tooltip("value of the street in view")
        self._ranges[name], self._texts[name] = thumbs, (ends, sampled)
        self._resets[name] = reset

        async def change(event: ValueChangeEventArguments) -> None:
            if event.value != _thumbs(self._state, name):
                await self._moved(name, event.value["min"] / STEPS, event.value["max"] / STEPS)

        thumbs.on_value_change(change)


def _thumbs(state: State, name: str) -> dict[str, float]:
    low, high = interval(state, name)
    return {"min": round(low * STEPS), "max": round(high * STEPS)}
