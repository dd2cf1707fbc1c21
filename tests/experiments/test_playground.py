"""The playground: states, pictures, errors; and the page itself in a browser, where there is one."""

import asyncio
import json
import shlex
import socket

import cv2
import numpy as np
import pytest
from playwright.sync_api import sync_playwright
from starlette.responses import PlainTextResponse

from common.loopback import MOST_BYTES
from experiments.app.playground import command, guard
from experiments.app.playground.rendering import (
    LatestOnly,
    coloured,
    first_free,
    free,
    pictures,
    request_for,
    shares,
)
from experiments.app.playground.state import (
    FILE,
    GROUPS,
    MOST_PIXELS,
    View,
    as_before,
    centred,
    enlarged,
    moved,
    opened,
    restocked,
    restored,
    shown,
)
from experiments.app.playground.state import command as command_of
from scene.assets.catalogue import AssetPool
from scene.attributes import BY_NAME
from scene.classes import TrainId, colorize
from scene.dataset.export import read_dataset
from scene.dataset.render import render_street
from scene.proposal import (
    Histogram,
    default_proposal,
    describe,
    draw,
    mixture,
    moments,
    parse_streets,
    random_proposal,
)
from scene.render.__main__ import main as render
from scripts.browser import browser, served

VIEW = View(seed=3, street=2, shot=1, shots=2, width=64, height=32, samples=1)
MIXED = opened(mixture((0.25, 0.75), (default_proposal(), random_proposal())), VIEW)


def test_a_moved_slider_changes_its_attribute_only_and_what_is_saved_is_loaded():
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(BY_NAME)
    state = moved(MIXED, "car_interval", 0.0, 0.5)
    assert shown(state, "car_interval", state.unit)[0] == "5 – 15.8 m"  # 5 sqrt(10)
    (changed,) = np.flatnonzero(state.proposal.width != MIXED.proposal.width)
    assert changed == np.flatnonzero(state.proposal.centre != MIXED.proposal.centre)
    again = opened(parse_streets(json.loads(json.dumps(describe(state.streets)))), VIEW)
    np.testing.assert_array_equal(again.proposals, state.proposals)
    assert (centred(state).proposal.width == state.proposal.width).all()


def test_sliders_take_the_moments_of_probabilities_and_that_is_said(tmp_path, capsys):
    histogram = Histogram(np.tile(np.float32([0.25, 0.5, 0.25]), (23, 1)))
    file = tmp_path / "attributes.json"
    for streets, is_reported in (
        (histogram, True),
        (mixture((0.25, 0.75), (default_proposal(), histogram)), True),
        (MIXED.streets, False),
    ):
        file.write_text(json.dumps(describe(streets)))
        state = command.first_state(command.parser().parse_args(["--attributes", str(file)]))
        message = (
            f"{file}: the file has probabilities, which sliders cannot show; they show, and save,"
        )
        assert (message in capsys.readouterr().out) == is_reported
        if is_reported:
            np.testing.assert_array_equal(state.proposals[-1], moments(histogram))
            assert shown(state, "car_interval", state.unit)[0]


def test_the_picture_is_the_one_of_the_dataset_and_a_quick_one_is_half_as_large():
    view = VIEW._replace(pool=VIEW.pool._replace(without=("car",)))
    state, unit = MIXED._replace(view=view), draw(default_proposal(), 3, 3)[2]
    frame = render_street(unit, 3, 2, 2, view.settings, "embree", view.pool)[1]
    assert not (frame.label == TrainId.CAR).any()
    full, quick = pictures(request_for(state)), pictures(request_for(state, quick=True))
    label = cv2.imdecode(np.frombuffer(full.label, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(label, colorize(frame.label))
    assert full.shares == shares(frame.label)
    assert cv2.imdecode(np.frombuffer(quick.image, np.uint8), 1).shape == (16, 32, 3)


def test_an_attribute_is_put_back_and_a_picture_fills_the_window_as_far_as_it_may():
    state = moved(moved(MIXED, "car_interval", 0.0, 0.5), "tree_interval", 0.0, 0.5)
    back = restored(state, "car_interval", MIXED)
    assert as_before(back, "car_interval", MIXED) and not as_before(back, "tree_interval", MIXED)
    np.testing.assert_array_equal(restored(back, "tree_interval", MIXED).proposals, MIXED.proposals)
    assert enlarged(VIEW, 1400, 900)[4:6] == (1400, 700)
    assert enlarged(VIEW, 60, 20) == VIEW
    width, height = enlarged(VIEW, 8000, 4000)[4:6]
    assert 0.99 * MOST_PIXELS < width * height <= MOST_PIXELS


@pytest.mark.parametrize("change", [None, "car_interval"])
def test_the_copied_command_makes_the_picture(change, tmp_path, monkeypatch):
    state = opened(default_proposal(), VIEW)
    if change:
        state = moved(state, change, 0.0, 0.5)
    words = shlex.split(command_of(state))
    assert words[:2] == ["sdr-jax", "render"] and (FILE in words) == bool(change)
    (tmp_path / FILE).write_text(json.dumps(describe(state.proposal)))
    monkeypatch.chdir(tmp_path)
    assert render([*words[2:], "--workers", "1"]) == 0
    labels = read_dataset(tmp_path / "street").labels
    assert len(labels) == 2 * VIEW.shots + VIEW.shot + 1
    label = cv2.imdecode(
        np.frombuffer(pictures(request_for(state)).label, np.uint8), cv2.IMREAD_COLOR
    )
    np.testing.assert_array_equal(label[..., ::-1], colorize(labels[-1]))


def test_the_command_names_what_is_not_usual():
    pool = AssetPool(own="/own", use="own", fraction=0.5, size=3)
    state = opened(random_proposal("extended"), VIEW._replace(pool=pool))
    assert command_of(state) == (
        "sdr-jax render --attributes random --space extended --seed 3 --shots 2 --images 6 --size 64x32 "
        "--samples 1 --assets /own --asset-use own --asset-fraction 0.5 --asset-count 3 --out street"
    )


def test_shares_and_depths_by_hand():
    assert shares(np.array([[0, 0, 0], [8, 255, 19]], np.uint8)) == (
        (0, 50), (8, pytest.approx(100 / 6)), (19, pytest.approx(100 / 6)))  # fmt: skip
    colours = coloured(np.array([[0.01, 40.0, 500.0, 0.0]], np.float32))[0].astype(int)
    viridis = [[253, 231, 37], [33, 145, 140], [68, 1, 84]]
    assert np.abs(colours[:3] - viridis).max() < 4 and not colours[3].any()


def test_the_first_picture_is_of_the_first_street_with_a_free_view(monkeypatch):
    near, label = np.full((4, 4), 1.0, np.float32), np.full((4, 4), TrainId.VEGETATION, np.uint8)
    assert not free(near, label) and free(0 * near, label) and free(near + 2, label)
    assert free(near, np.full_like(label, TrainId.ROAD))  # it may be near
    shapes = []

    def judged(depth, label):
        shapes.append(depth.shape)
        return len(shapes) == 4

    monkeypatch.setattr("experiments.app.playground.rendering.free", judged)
    assert first_free(MIXED) == VIEW.street + 3 and shapes == [(24, 48)] * 4
    shapes[:] = [None] * 4
    assert first_free(MIXED) == VIEW.street  # none is free


def test_of_wishes_that_wait_only_the_last_is_made_and_then_refined():
    async def make(request):
        await asyncio.sleep(0.02)

    async def drag(answered):
        latest = LatestOnly(
            make, lambda request, *_: answered.append((request.view.seed, request.quick))
        )
        requests = (
            request_for(MIXED, quick=True)._replace(view=VIEW._replace(seed=k)) for k in range(5)
        )
        await asyncio.gather(*map(latest.ask, requests))
        return answered

    assert asyncio.run(drag([])) == [(0, True), (4, True), (4, False)]


@pytest.mark.parametrize(("headers", "status"), [
    ({"host": "127.0.0.1:80", "origin": "http://127.0.0.1:80", "content-length": "9"}, 200),
    ({"host": "elsewhere.example"}, 400),
    ({"host": "127.0.0.1.elsewhere.example:80"}, 400),
    ({}, 400),
    ({"host": "localhost:80", "origin": "http://elsewhere.example"}, 403),
    ({"host": "localhost:80", "content-length": str(MOST_BYTES + 1)}, 413),
    ({"host": "localhost:80", "content-length": "-1"}, 413),
    ({"host": "localhost:80", "transfer-encoding": "chunked"}, 411),
])  # fmt: skip
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_only_the_page_itself_is_answered(headers, status, kind):
    """Through the whole guard; behind it stands a page that answers all with 200."""
    sent = []

    async def send(message):
        sent.append(message)

    raw = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "method": "GET", "path": "/", "headers": raw}
    scope["extensions"] = {"websocket.http.response": {}}
    asyncio.run(guard.Guard(PlainTextResponse("the page"))(scope, None, send))
    assert sent[0]["type"] == {"http": "", "websocket": "websocket."}[kind] + "http.response.start"
    assert sent[0]["status"] == status


@pytest.mark.parametrize(("arguments", "complaint"), [
    ([], "sdr-jax[playground]"),
    (["--port", "0"], "--port must lie in 1..65535, not 0"),
    (["--port", "TAKEN"], "choose another"),
    (["--size", "9000x9000"], "pixels"),
    (["--shots", "0"], "shots must be 1 to 60, not 0"),
    (["--attributes", "BAD"], "bad.json: unknown attribute 'nonsense'"),
    (["--attributes", "defualt"], "--attributes defualt: no such file; expected default, random"),
    (["--real", "BAD"], "bad.json is not a folder"),
])  # fmt: skip
def test_what_is_wrong_is_one_line_and_code_2(arguments, complaint, tmp_path, capsys, monkeypatch):
    (tmp_path / "bad.json").write_text('{"nonsense": 1}')
    if arguments == []:
        monkeypatch.setattr(command, "find_spec", lambda name: None)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        values = {"TAKEN": str(taken.getsockname()[1]), "BAD": str(tmp_path / "bad.json")}
        assert command.main([values.get(word, word) for word in arguments]) == 2
    message = capsys.readouterr().err
    assert complaint in message and message.count("\n") == 1


def test_an_empty_box_changes_no_first_index():
    pool = AssetPool(first=3, size=5)
    assert restocked(pool, "first", None) == pool and restocked(pool, "size", None).size is None
    assert restocked(pool, "first", 7.0) == AssetPool(first=7, size=5)


@pytest.fixture
def page():
    """A browser's tab on a server of its own, warm."""
    program = browser() or pytest.skip("needs chromium")
    with served("96x54") as address, sync_playwright() as playwright:
        tab = playwright.chromium.launch(executable_path=program).new_page()
        tab.goto(address)
        tab.wait_for_selector(".time:has-text('image in')", timeout=240_000)
        yield tab


@pytest.mark.slow
def test_the_page_needs_no_network_moves_saves_and_refuses_in_one_message(page, tmp_path):
    loaded = page.evaluate("performance.getEntriesByType('resource').map(r => r.name)")
    assert loaded and all(name.startswith(page.url) for name in loaded)
    before = page.get_attribute(".image img", "src")
    row = page.locator("[data-attribute=camera_position_y]")
    row.locator(".q-slider__thumb").nth(1).press("PageUp")  # from 294 to 304 thousandths
    page.wait_for_function("old => document.querySelector('.image img').src != old", arg=before)
    assert row.locator(".ends").inner_text() == "1.26 – 1.77 m"
    assert [b.get_attribute("aria-label") for b in page.locator(".reset:visible").all()] == [
        "reset camera_position_y"
    ]
    assert page.locator(".classes span").count() > 3
    with page.expect_download() as saved:
        page.get_by_role("button", name="copy command").click()
    assert saved.value.suggested_filename == FILE
    page.wait_for_selector(f".q-notification:has-text('sdr-jax render --attributes {FILE}')")
    with page.expect_download() as saved:
        page.get_by_role("button", name="save").click()
    attributes = json.loads(saved.value.path().read_text())["components"][0]["attributes"]
    assert attributes["camera_position_y"]["physical"]["high"] == 1.7728

    row.locator(".reset").click()
    page.wait_for_selector("[data-attribute=camera_position_y] .ends:has-text('1.26 – 1.74 m')")
    caption = page.locator(".caption").first
    page.get_by_role("button", name="next street").click()
    page.wait_for_selector(".caption:has-text('street 1, ')")
    assert page.get_by_label("street", exact=True).input_value() == "1" and caption.is_visible()
    page.locator(".picture.image").click()
    page.wait_for_selector(".picture.whole")
    page.wait_for_function("document.querySelector('.image img').naturalWidth > 1000")
    page.keyboard.press("Escape")
    page.wait_for_selector(".picture.image:not(.whole)")

    (tmp_path / "bad.json").write_text('{"nonsense": 1}')
    (tmp_path / "good.json").write_text(json.dumps(describe(MIXED.streets)))
    page.set_input_files("input[type=file]", tmp_path / "bad.json")
    page.wait_for_selector(".q-notification:has-text(\"bad.json: unknown attribute 'nonsense'\")")
    page.set_input_files("input[type=file]", tmp_path / "good.json")
    page.wait_for_selector("text=component 1 · 25%")
    histogram = Histogram(np.tile(np.float32([0.25, 0.5, 0.25]), (23, 1)))
    (tmp_path / "bins.json").write_text(json.dumps(describe(histogram)))
    page.set_input_files("input[type=file]", tmp_path / "bins.json")
    page.wait_for_selector('.q-notification:has-text("bins.json: the file has probabilities")')
    assert page.request.post(page.url, data=b"x" * (MOST_BYTES + 1)).status == 413
