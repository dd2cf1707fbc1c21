"""The page: sliders on the left, images of one street and panels on the right."""

from __future__ import annotations

import base64
import random
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from nicegui import app, ui
from nicegui.events import (
    GenericEventArguments,
    UploadEventArguments,
    ValueChangeEventArguments,
)

from common.command import size
from common.files import json_text, parse_json
from common.labels.classes import OWN as OWN_ROW
from common.loopback import HOST, MOST_BYTES
from experiments.app.playground import state as states
from experiments.app.playground.guard import Guard
from experiments.app.playground.photographs import photograph
from experiments.app.playground.rendering import (
    LatestOnly,
    Pictures,
    RenderProcess,
    Request,
    request_for,
)
from experiments.app.playground.sliders import Sliders
from experiments.app.playground.state import State
from scene.assets.catalogue import USES
from scene.assets.families import FAMILIES
from scene.classes import CLASS_NAMES, COLORS, OWN
from scene.preview.layout import FAR
from scene.proposal import describe, named, parse_streets
from scene.render.protocol import MOST_SAMPLES

ACCENT = "#4f7ea3"
"""The colour of sliders and buttons."""
STYLE = Path(__file__).with_name("page.css")
ENLARGE = """() => {
    const box = document.querySelector('.picture.image');
    const leave = e => { if (e.key === 'Escape') box.click_out(); };
    box.click_out = () => {
        box.classList.remove('whole');
        document.removeEventListener('keydown', leave);
        emit(null);
    };
    if (box.classList.contains('whole')) return box.click_out();
    box.classList.add('whole');
    document.addEventListener('keydown', leave);
    emit(window.innerWidth, window.innerHeight);
}"""
"""Makes the image fill the window, or ends that; emits the window's size, or nothing."""
BLANK = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


for kind in (ui.input, ui.number, ui.select):
    kind.default_props("dense options-dense" if kind is ui.select else "dense")


def serve(state: State, photographs: Sequence[Path], port: int, browser: bool) -> None:
    """Serve the page on 127.0.0.1 until Ctrl-C.

    Args:
        state: the first state of every page.
        photographs: real images to compare the street with.
        port: the port.
        browser: whether to open a browser.
    """
    process = RenderProcess()

    @ui.page("/")
    async def _() -> None:
        await Page(state, photographs, process).begin()

    app.add_middleware(Guard)
    app.on_startup(lambda: print(f"http://{HOST}:{port} (press Ctrl-C to stop)", flush=True))
    app.on_shutdown(process.close)
    ui.run(
        host=HOST,
        port=port,
        title="Playground",
        favicon="🏙️",
        dark=None,
        show=browser,
        reload=False,
        show_welcome_message=False,
    )


class Page:
    """One tab: its state and its elements."""

    def __init__(self, state: State, photographs: Sequence[Path], process: RenderProcess) -> None:
        self._state, self._photographs, self._process = state, photographs, process
        self._first = state  # to which sliders are reset
        self._window: tuple[int, int] | None = None  # size of the window that the image fills
        self._boxes: dict[str, ui.number] = {}  # by field of the view
        self._requests = LatestOnly(process.make, self._show)
        self._note: ui.notification | None = None
        ui.colors(primary=ACCENT)
        ui.add_css(STYLE)
        self._bar()
        with ui.element("main").classes("desk"):
            self._column = ui.element("section").classes("knobs")
            with ui.element("section").classes("stage"):
                self._pictures()
                with ui.element("div").classes("panels"):
                    self._view_panel()
                    self._asset_panel()
        self._fill()

    async def begin(self) -> None:
        """Request the first image once the page is loaded: of the first street with a free view."""
        await ui.context.client.connected()
        if not self._process.warm:
            self._time.set_text("compiling the renderer (only the first time)")
        try:
            street = await self._process.first_free(self._state)
        except (ValueError, RuntimeError) as error:
            self._error.set_text(str(error))
            return
        await self._look(street=street)

    def _bar(self) -> None:
        with ui.element("header").classes("bar"):
            ui.html("<h1>Playground</h1>", sanitize=False)
            for text, hint, change in (
                (
                    "default",
                    "narrow intervals around the default street",
                    partial(states.set_to, name="default"),
                ),
                (
                    "random",
                    "the whole range of every attribute",
                    partial(states.set_to, name="random"),
                ),
                ("centre all", "move every interval to the middle of its range", states.centred),
            ):
                button = ui.button(text, on_click=self._press(change)).tooltip(hint)
                button.props("outline dense padding='2px 12px'")
            self._component = ui.select([], on_change=self._choose).props("borderless")
            for text, hint, turn in (
                ("next street", "the next street with this seed", self._next),
                ("new seed", "another random seed", self._shuffle),
            ):
                button = ui.button(text, on_click=turn).tooltip(hint)
                button.props("unelevated dense padding='2px 12px'")
            ui.element("div").classes("grow")
            self._time = ui.label().classes("quiet time")
            upload = ui.upload(auto_upload=True, max_file_size=MOST_BYTES, on_upload=self._load)
            upload.props('accept=".json"').classes("hidden")
            too_large = f"the file is too large: at most {MOST_BYTES:,} bytes"
            upload.on("rejected", lambda: self._say(too_large))
            load = ui.button("load", on_click=lambda: upload.run_method("pickFiles"))
            load.props("flat dense padding='2px 10px'").tooltip("open an attributes.json")
            copy = ui.button("copy command", on_click=self._copy)
            copy.props("flat dense padding='2px 10px'")
            copy.tooltip("copy the sdr-jax render command that makes this image")
            save = ui.button("save", on_click=self._save)
            save.props("flat dense padding='2px 10px'").tooltip("download an attributes.json")

    def _pictures(self) -> None:
        with ui.element("div").classes("shown with-real" if self._photographs else "shown"):
            with ui.element("div"):
                self._image = _picture("image")
                assert self._image.parent_slot is not None
                box = self._image.parent_slot.parent
                box.on("click", self._enlarge, js_handler=ENLARGE)
                self._caption = ui.label("starting").classes("caption")
            if self._photographs:
                with ui.element("div"):
                    self._real = _picture("real")
                    most = len(self._photographs) - 1
                    number = ui.number(f"real image, 0 to {most}", value=0, min=0, max=most)
                    number.props("borderless").on_value_change(self._turn)
            with ui.element("div").classes("planes"):
                self._label, self._depth = _picture("label"), _picture("depth")
            with ui.element("div").classes("legend"):
                self._legend = ui.html(sanitize=False).classes("classes")
                ui.html(f"<span>0 m</span><i></i><span>{FAR:.0f} m</span>", sanitize=False).classes(
                    "metres"
                )
        if self._photographs:
            self._put_photograph(0)

    def _view_panel(self) -> None:
        view = self._state.view
        with ui.element("div").classes("panel"):
            ui.html("<h2>Street</h2>", sanitize=False)
            with ui.element("div").classes("fields"):
                for name in ("seed", "street", "shot", "shots"):
                    self._number(name, getattr(view, name))
                rays = ui.select([*range(1, MOST_SAMPLES + 1)], value=view.samples, label="rays")
                rays.tooltip("rays per pixel along each axis")
                rays.on_value_change(lambda e: self._look(samples=int(e.value)))
            with ui.element("div").classes("fields"):
                box = ui.input("size", value=f"{view.width}x{view.height}")
                box.on("change", lambda: self._resize(box.value))
                self._space = ui.toggle(list(states.SPACES), value=self._state.space)
                self._space.on_value_change(self._respace)
                self._space.props("dense unelevated no-caps padding='2px 10px' size=12px")
            self._error = ui.label().classes("wrong")

    def _asset_panel(self) -> None:
        pool = self._state.view.pool
        with ui.element("div").classes("panel"):
            ui.html("<h2>Assets</h2>", sanitize=False)
            if pool.own:
                use = ui.select(list(USES), value=pool.use, label="which assets")
                use.on_value_change(lambda e: self._stock(use=e.value))
            with ui.element("div").classes("fields"):
                for label, name, value in (
                    ("first index", "first", pool.first),
                    ("assets per family", "size", pool.size),
                ):
                    box = ui.number(label, value=value, min=0, precision=0)
                    box.on_value_change(lambda e, name=name: self._restock(name, e.value))
            without = ui.select(
                list(FAMILIES), multiple=True, value=[], label="families to leave out"
            )
            without.on_value_change(lambda e: self._stock(without=tuple(e.value)))
            ui.label("share of assets in use").classes("quiet")
            share = ui.slider(min=0.05, max=1, step=0.05, value=pool.fraction).props("label dense")
            share.on("change", lambda: self._stock(fraction=float(share.value)))

    def _number(self, name: str, value: int) -> None:
        box = self._boxes[name] = ui.number(name, value=value, min=0, precision=0)

        async def change(event: ValueChangeEventArguments) -> None:
            if event.value is not None and event.value != getattr(self._state.view, name):
                await self._look(**{name: int(event.value)})

        box.on_value_change(change)

    def _fill(self) -> None:
        """Build the elements that depend on the space and on the number of components."""
        self._column.clear()
        with self._column:
            self._sliders = Sliders(self._state, self._moved, self._reset)
        self._space.set_value(self._state.space)
        shares = self._state.shares
        options = {k: f"component {k + 1} · {share:.0%}" for k, share in enumerate(shares)}
        self._component.set_options(options, value=self._state.component)
        self._component.set_visibility(len(shares) > 1)

    async def _ask(self, quick: bool) -> None:
        try:
            states.check_view(self._state.view)
            self._error.set_text("")
            new = request_for(self._state, quick)
            if self._window is not None:
                new = new._replace(view=states.enlarged(new.view, *self._window))
            await self._requests.ask(new)
        except (ValueError, RuntimeError) as error:
            self._error.set_text(str(error))

    def _show(self, answered: Request, images: Pictures, seconds: float) -> None:
        for element, kind, data in (
            (self._image, "jpeg", images.image),
            (self._label, "png", images.label),
            (self._depth, "png", images.depth),
        ):
            element.set_source(_source(kind, data))
        self._legend.set_content(_legend(images.shares))
        self._time.set_text(
            f"{'preview' if answered.quick else 'image'} in {seconds * 1000:.0f} ms"
        )
        view = answered.view
        self._caption.set_text(
            f"street {view.street}, shot {view.shot} of {view.shots}  ·  {images.weather}  ·  "
            f"{images.placed} assets"
        )

    async def _become(self, state: State, quick: bool = False) -> None:
        rebuild = (state.space, state.shares) != (self._state.space, self._state.shares)
        self._state = state
        if rebuild:
            self._fill()
        with suppress(ValueError):  # _ask reports what is out of range
            states.check_view(state.view)
            self._sliders.show(state, self._first)
        for name, box in self._boxes.items():
            box.set_value(getattr(state.view, name))
        await self._ask(quick)

    async def _begin_with(self, state: State) -> None:
        """Show a new state, to which sliders are reset from now on."""
        self._first = state
        await self._become(state)

    async def _moved(self, name: str, low: float, high: float) -> None:
        await self._become(states.moved(self._state, name, low, high), quick=True)

    async def _reset(self, name: str) -> None:
        await self._become(states.restored(self._state, name, self._first))

    async def _next(self) -> None:
        await self._look(street=(self._state.view.street + 1) % states.MOST_STREETS)

    async def _shuffle(self) -> None:
        await self._look(seed=random.randrange(states.SEEDS))

    async def _enlarge(self, event: GenericEventArguments) -> None:
        """Fill the window with the image, or end that."""
        self._window = (int(event.args[0]), int(event.args[1])) if event.args else None
        if self._window is not None:
            await self._ask(quick=False)

    def _copy(self) -> None:
        """Copy the command that makes the image, and download the file that it reads, if any."""
        command = states.command(self._state)
        ui.clipboard.write(command)
        note = ""
        if states.name_of(self._state) is None:
            text = json_text(describe(self._state.proposal))
            ui.download.content(text, states.FILE, "application/json")
            note = f". It reads {states.FILE}, which your browser has downloaded"
        pool = self._state.view.pool
        if pool.first or pool.without:
            note += ". It has no flags for the first index and for families left out"
        self._say(f"Copied; the last image it renders is this one: {command}{note}", "primary")

    async def _look(self, **changes: object) -> None:
        await self._become(self._state._replace(view=self._state.view._replace(**changes)))  # type: ignore[arg-type]

    async def _stock(self, **changes: object) -> None:
        await self._look(pool=self._state.view.pool._replace(**changes))  # type: ignore[arg-type]

    async def _restock(self, name: str, value: float | None) -> None:
        await self._look(pool=states.restocked(self._state.view.pool, name, value))

    async def _resize(self, text: str) -> None:
        try:
            width, height = size(text)
        except Exception as error:
            self._say(f"size {error}")
            return
        await self._look(width=width, height=height)

    async def _respace(self, event: ValueChangeEventArguments) -> None:
        if event.value != self._state.space:
            await self._begin_with(states.opened(named("default", event.value), self._state.view))

    async def _choose(self, event: ValueChangeEventArguments) -> None:
        if event.value is not None and event.value != self._state.component:
            await self._become(self._state._replace(component=event.value))

    def _press(self, change: Callable[[State], State]) -> Callable[[], object]:
        return lambda: self._begin_with(change(self._state))

    async def _load(self, event: UploadEventArguments) -> None:
        try:
            streets = parse_streets(parse_json(await event.file.read()))
        except ValueError as error:
            self._say(f"{event.file.name}: {error}")
            return
        await self._begin_with(states.opened(streets, self._state.view))
        if states.has_probabilities(streets):
            self._say(f"{event.file.name}: {states.LOSS}")

    def _save(self) -> None:
        text = json_text(describe(self._state.streets))
        ui.download.content(text, "attributes.json", "application/json")

    def _turn(self, event: ValueChangeEventArguments) -> None:
        if event.value is not None and 0 <= event.value < len(self._photographs):
            self._put_photograph(int(event.value))

    def _put_photograph(self, index: int) -> None:
        try:
            self._real.set_source(_source("jpeg", photograph(self._photographs[index])))
        except ValueError as error:
            self._say(str(error))

    def _say(self, message: str, color: str | None = None) -> None:
        """Show a message in place of the one before, until it is closed."""
        if self._note is not None:
            self._note.dismiss()
        self._note = ui.notification(
            message, timeout=None, close_button="close", position="bottom", color=color
        )


def _picture(kind: str) -> ui.interactive_image:
    with ui.element("div").classes(f"picture {kind}"):
        return ui.interactive_image(BLANK).classes("w-full")


def _source(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _legend(shares: Sequence[tuple[int, float]]) -> str:
    """The legend: colours, names and percentages of train ids."""
    parts = []
    for train_id, percent in shares:
        name = "own class" if train_id == OWN else CLASS_NAMES[train_id]
        colour = OWN_ROW.colour if train_id == OWN else COLORS[train_id]
        share = "under 0.1" if percent < 0.05 else f"{percent:.1f}"
        red, green, blue = map(int, colour)
        swatch = f'<i style="background:rgb({red},{green},{blue})"></i>'
        parts.append(f"<span>{swatch}{name} {share} %</span>")
    return "".join(parts)
