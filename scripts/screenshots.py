"""Take the screenshots of the pages: a report and the playground, in an installed browser.

    python -m scripts.screenshots --run runs/demo --out docs

`report.png` and `report_dark.png` show the report of a finished `make demo`, whose images are all rendered;
`playground.png` shows the playground as it opens.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, sync_playwright

from experiments.app.report.command import make
from scripts.browser import browser, served

PLAYGROUND_SIZE = "640x360"
"""Size of the playground's image."""


def main() -> None:
    """Write the screenshots."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--run", type=Path, required=True, help="finished run of make demo")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the screenshots")
    options = parser.parse_args()
    program = browser()
    if program is None:
        parser.error("needs Chromium or Chrome on the PATH")
    with sync_playwright() as playwright:
        window = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        report(window, options.run, options.out)
        playground(window, options.out)


def report(window: Browser, run: Path, out: Path) -> None:
    """Write the top of a run's report, and its test images in dark mode."""
    with TemporaryDirectory() as folder:
        address = make(run, Path(folder) / "report.html").as_uri()
        for name, theme, width, height, section in (
            ("report.png", "light", 1400, 1600, ""),
            ("report_dark.png", "dark", 1240, 1060, "#tested"),
        ):
            tab = window.new_page(
                viewport={"width": width, "height": height},
                color_scheme=theme,  # type: ignore[arg-type]
            )
            tab.goto(address + section)
            tab.wait_for_selector(".plot .main-svg")
            tab.wait_for_timeout(1000)
            tab.screenshot(path=out / name)


def playground(window: Browser, out: Path) -> None:
    """Write the playground with its first street."""
    with served(PLAYGROUND_SIZE) as address:
        tab = window.new_page(viewport={"width": 1360, "height": 530})
        tab.goto(address)
        tab.wait_for_selector(".time:has-text('image in')", timeout=600_000)
        tab.add_style_tag(content=".time { visibility: hidden }")  # the machine's, at that moment
        tab.wait_for_timeout(1000)
        tab.screenshot(path=out / "playground.png")


if __name__ == "__main__":
    main()
