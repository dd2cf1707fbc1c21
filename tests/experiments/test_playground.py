"""The playground: states, pictures, errors; and the page itself in a browser, where there is one."""

import asyncio
import json
import shutil
import socket
import sys
import time
import urllib.error
import urllib.request
from importlib.util import find_spec
from subprocess import PIPE, Popen

import cv2
import numpy as np
import pytest

from experiments.playground import __main__ as command
from experiments.playground.exporting import Export
from experiments.playground.guard import MOST_BYTES, refusal
from experiments.playground.rendering import Desk, pictures, request
from experiments.playground.state import GROUPS, View, centred, check_view, moved, opened, shown
from scene.assets.catalogue import AssetPool
from scene.attributes import BY_NAME
from scene.classes import TrainId, colorize
from scene.dataset.read import DESCRIPTION
from scene.dataset.render import render_street
from scene.proposal import default_proposal, describe, draw, mixture, parse_streets, random_proposal
from tests.conftest import ROOT

VIEW = View(seed=3, street=2, shot=1, shots=2, width=64, height=32, samples=1)
MIXED = opened(mixture((0.25, 0.75), (default_proposal(), random_proposal())), VIEW)


def test_a_moved_slider_changes_its_attribute_only_and_what_is_saved_is_loaded():
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(BY_NAME)
    state = moved(MIXED, "car_interval", 0.0, 0.5)
    assert shown(state, "car_interval", state.unit)[0] == "5 – 15.8 m"  # 5 sqrt(10)
    same = np.array(list(BY_NAME)[:23]) != "car_interval"
    for now, before in zip(state.proposal, MIXED.proposal, strict=True):
        assert (now == before)[same].all() and not (now == before).all()
    again = opened(parse_streets(json.loads(json.dumps(describe(state.streets)))), VIEW)
    for mine, theirs in zip(again.proposals, state.proposals, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert (centred(state).proposal.width == state.proposal.width).all()


def test_the_picture_is_the_one_of_the_dataset_and_a_quick_one_is_half_as_large():
    state = moved(MIXED, "camera_position_y", 0.2, 0.3)
    view = state.view._replace(pool=AssetPool(without=("tree", "car")))
    state = state._replace(view=view)
    unit = draw(state.proposal, 3, 3)[2]
    frame = render_street(unit, 3, 2, 2, view.settings, "embree", view.pool)[1]
    assert not np.isin(frame.label, [TrainId.CAR]).any()
    made, quick = pictures(request(state)), pictures(request(state, quick=True))
    label = cv2.imdecode(np.frombuffer(made.label, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(label, colorize(frame.label))
    image = cv2.imdecode(np.frombuffer(quick.image, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (16, 32, 3)


def test_of_wishes_that_wait_only_the_last_is_made_and_then_refined():
    first = request(MIXED, quick=True)
    wishes = [first._replace(view=VIEW._replace(seed=k)) for k in range(5)]
    seen = []

    async def make(wanted):
        await asyncio.sleep(0.02)
        return wanted

    async def drag():
        desk = Desk(make, lambda wanted, made, seconds: seen.append((wanted.view.seed, made.quick)))
        await asyncio.gather(*(desk.ask(wish) for wish in wishes))

    asyncio.run(drag())
    assert seen == [(0, True), (4, True), (4, False)]


@pytest.mark.slow
def test_an_export_can_be_cancelled_and_continued_and_refuses_a_foreign_folder(tmp_path):
    def wait(export, enough):
        until = time.monotonic() + 300
        while not enough(news := export.news()) and time.monotonic() < until:
            time.sleep(0.05)
        return news

    order = MIXED, 40, "cityscapes", str(tmp_path / "made")
    export = Export(*order)
    assert wait(export, lambda news: news.done or news.over).done
    export.cancel()
    assert "cancelled" in export.news().error and not (tmp_path / "made" / DESCRIPTION).exists()
    news = wait(Export(*order), lambda news: news.over)
    assert news == (40, 40, "") and (tmp_path / "made" / DESCRIPTION).exists()
    (tmp_path / "other").write_text("")
    assert "holds other files" in wait(Export(*order[:3], str(tmp_path)), lambda n: n.over).error


@pytest.mark.parametrize(("headers", "status"), [
    ({"host": "127.0.0.1:80", "origin": "http://127.0.0.1:80", "content-length": "9"}, 0),
    ({"host": "elsewhere.example"}, 403),
    ({"host": "localhost:80", "origin": "http://elsewhere.example"}, 403),
    ({"host": "localhost:80", "content-length": str(MOST_BYTES + 1)}, 413),
    ({"host": "localhost:80", "transfer-encoding": "chunked"}, 411),
])  # fmt: skip
def test_only_the_page_itself_is_answered(headers, status):
    assert refusal(headers) == status


@pytest.mark.parametrize(("arguments", "complaint"), [
    (["--port", "0"], "--port must lie in 1..65535, not 0"),
    (["--port", "TAKEN"], "choose another"),
    (["--size", "9000x9000"], "pixels"),
    (["--shots", "0"], "shots must lie in 1..60, not 0"),
    (["--attributes", "BAD"], "bad.json: unknown attribute 'nonsense'"),
    (["--real", "BAD"], "no such folder"),
])  # fmt: skip
def test_what_is_wrong_is_one_line_and_code_2(arguments, complaint, tmp_path, capsys):
    (tmp_path / "bad.json").write_text('{"nonsense": 1}')
    with socket.create_server(("127.0.0.1", 0)) as taken:
        known = {"TAKEN": str(taken.getsockname()[1]), "BAD": str(tmp_path / "bad.json")}
        port = ["--port", "8499"] if "--port" not in arguments else []
        with pytest.raises(SystemExit) as ended:
            command.main([*port, *(known.get(word, word) for word in arguments)])
    message = capsys.readouterr().err
    assert ended.value.code == 2 and complaint in message and message.count("\n") == 1


def test_the_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="2"):
        command.main([])
    assert "sdr-jax[playground]" in capsys.readouterr().err
    with pytest.raises(ValueError, match="no family 'cloud'"):
        check_view(VIEW._replace(pool=AssetPool(without=("cloud",))))


@pytest.fixture(scope="module")
def page():
    """A browser's tab on a server of its own, warm; and the server's address."""
    browser = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    if not (browser and find_spec("playwright") and find_spec("nicegui")):
        pytest.skip("needs chromium, playwright and nicegui")
    from playwright.sync_api import sync_playwright

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = ["--no-browser", "--size", "96x54", "--port", str(port)]
    server = Popen([sys.executable, "-m", "experiments.playground", *words], cwd=ROOT, stdout=PIPE)
    try:
        assert server.stdout is not None and str(port) in server.stdout.readline().decode()
        with sync_playwright() as playwright:
            tab = playwright.chromium.launch(executable_path=browser).new_page()
            tab.set_default_timeout(240_000)
            address = f"http://127.0.0.1:{port}/"
            for _ in range(200):
                try:
                    urllib.request.urlopen(address, timeout=60).close()
                    break
                except urllib.error.URLError:
                    time.sleep(0.2)
            tab.goto(address)
            tab.wait_for_selector(".time:has-text('picture in')")
            yield tab, address
    finally:
        server.terminate()
        server.wait(60)


@pytest.mark.slow
def test_a_slider_moves_the_picture_and_the_page_needs_no_network(page, tmp_path):
    tab, address = page
    hosts = "[...new Set(performance.getEntriesByType('resource').map(r => new URL(r.name).host))]"
    assert tab.evaluate(hosts) == [address.split("/")[2]]
    before = tab.get_attribute(".image img", "src")
    row = tab.locator("[data-attribute=camera_position_y]")
    low, _, high = row.locator(".ends").inner_text().partition(" – ")
    row.locator(".q-slider__thumb").nth(1).press("End")
    tab.wait_for_function("old => document.querySelector('.image img').src != old", arg=before)
    assert row.locator(".ends").inner_text() == f"{low} – 4 m" != f"{low} – {high}"
    with tab.expect_download() as saved:
        tab.get_by_role("button", name="save").click()
    found = json.loads(saved.value.path().read_text())["components"][0]["attributes"]
    assert found["camera_position_y"]["physical"]["high"] == 4


@pytest.mark.slow
def test_a_file_is_refused_in_one_message_and_a_mixture_offers_its_components(page, tmp_path):
    tab, address = page
    (tmp_path / "bad.json").write_text('{"nonsense": 1}')
    (tmp_path / "good.json").write_text(json.dumps(describe(MIXED.streets)))
    tab.set_input_files("input[type=file]", tmp_path / "bad.json")
    tab.wait_for_selector(".q-notification:has-text(\"bad.json: unknown attribute 'nonsense'\")")
    tab.set_input_files("input[type=file]", tmp_path / "good.json")
    tab.wait_for_selector("text=component 1 · 25%")
    with pytest.raises(urllib.error.HTTPError, match="413"):
        urllib.request.urlopen(address, data=b"x" * (MOST_BYTES + 1))
