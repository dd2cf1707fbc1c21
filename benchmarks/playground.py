"""Time the playground from slider to image, within its page in a headless browser.

    python -m benchmarks.playground
    python -m benchmarks.playground --size 640x360 --repeats 10

A key moves a slider; the times end when the browser has drawn the preview, and when it has drawn the image
at full size, which follows if nothing else moves. It needs the extras `playground` and `test`, and Chromium.
"""

from __future__ import annotations

import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

import numpy as np

from benchmarks.report import Row, count, parser, report

ROOT = Path(__file__).resolve().parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SLIDERS = ("camera_position_y", "building_position", "car_interval", "illumination_intensity")
"""Sliders to move in turn: of the camera, of positions, of densities, of the light."""

LISTEN = """() => {
    document.addEventListener('keydown', () => {
        window.began = performance.now();
        window.drawn = [];
    }, true);
    document.querySelector('.image img').addEventListener('load', () => {
        if (window.began) window.drawn.push(performance.now() - window.began);
    });
}"""
"""Records in the page when a key goes down, and when images are drawn after it."""


def browser() -> str | None:
    """Find the program of an installed browser."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@contextmanager
def served(size: str) -> Iterator[str]:
    """Serve a playground; yields its address."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    words = ["-m", "experiments", "playground", "--no-browser", "--size", size, "--port", port]
    environment = {
        name: v for name, v in os.environ.items() if "PYTEST" not in name
    }  # NiceGUI reads it
    command = [sys.executable, *words]
    with Popen(command, cwd=ROOT, stdout=PIPE, text=True, env=environment) as server:
        try:
            assert server.stdout is not None
            if port not in server.stdout.readline():
                raise SystemExit("benchmarks.playground: error: the playground did not start")
            yield f"http://127.0.0.1:{port}/"
        finally:
            server.terminate()


def press(page: Any, slider: str, key: str) -> tuple[float, float]:
    """Press a key on a slider; returns the seconds to the preview, and to the full image."""
    page.locator(f"[data-attribute={slider}] .q-slider__thumb").nth(1).press(key)
    page.wait_for_function("window.drawn.length >= 2", timeout=60_000)
    first, last = page.evaluate("window.drawn.slice(0, 2)")
    return first / 1000, last / 1000


def measured(size: str, repeats: int, program: str) -> list[Row]:
    """Measure one row for previews and one for full images."""
    from playwright.sync_api import sync_playwright

    with served(size) as address, sync_playwright() as playwright:
        page = playwright.chromium.launch(executable_path=program).new_page()
        page.goto(address)
        page.wait_for_selector(".time:has-text('image in')", timeout=600_000)
        page.evaluate(LISTEN)
        for slider in SLIDERS:  # warms up
            press(page, slider, "PageDown")
        moves = [
            press(page, SLIDERS[k % len(SLIDERS)], ("PageUp", "PageDown")[k // len(SLIDERS) % 2])
            for k in range(repeats)
        ]
    rows: list[Row] = []
    for what, seconds in zip(("preview", "image"), np.array(moves).T, strict=True):
        best, median, worst = (float(1000 * value) for value in np.quantile(seconds, (0, 0.5, 1)))
        times = {"best_ms": best, "median_ms": median, "worst_ms": worst}
        rows.append({"drawn": what, "size": size, "moves": repeats, **times})
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    command.add_argument("--size", default="480x270", help="WIDTHxHEIGHT of the image")
    command.add_argument("--repeats", type=partial(count, 1), default=40, help="moves of a slider")
    options = command.parse_args(arguments)
    program = browser()
    if program is None:
        command.error(f"needs a browser, one of {', '.join(BROWSERS)}, on the PATH")
    report(measured(options.size, options.repeats, program), options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
