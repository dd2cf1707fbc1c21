"""A browser and a served playground, for the screenshots and the tests of the page."""

from __future__ import annotations

import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE, Popen

ROOT = Path(__file__).resolve().parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def browser() -> str | None:
    """Find the program of an installed browser."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@contextmanager
def served(size: str) -> Iterator[str]:
    """Serve a playground; yields its address."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    words = ["-m", "experiments", "playground", "--no-browser", "--size", size, "--port", port]
    # NiceGUI reads pytest's variables.
    environment = {name: v for name, v in os.environ.items() if "PYTEST" not in name}
    command = [sys.executable, *words]
    with Popen(command, cwd=ROOT, stdout=PIPE, text=True, env=environment) as server:
        try:
            assert server.stdout is not None
            if port not in server.stdout.readline():
                raise SystemExit("error: the playground did not start")
            yield f"http://127.0.0.1:{port}/"
        finally:
            server.terminate()
