"""Compare this checkout with another one: both render the same streets in turn.

Each has its own process, and they measure in turn, so other work on the machine slows both. Times are CPU
times of one thread, the least of all rounds; ``ratio`` is the time of the other checkout over ours,
``median`` its median over rounds.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.report import Row

HERE = Path(__file__).resolve().parents[1]
CASES = tuple(
    (*size, shots, streets)
    for size in ((640, 320, 1), (240, 176, 2), (480, 360, 2), (240, 176, 1))
    for shots in (1, 4)
    for streets in ("default", "random")
)
"""Width, height, rays per pixel along each axis, shots per street; default or random streets."""
SERVE = """
import json, sys, time
import cv2
from scene.assets.catalogue import AssetPool
from scene.dataset.render import render_street
from scene.proposal import draw, named
from scene.render import RenderSettings, renderer
cv2.setNumThreads(1)
renderer("embree")
for line in sys.stdin:
    width, height, samples, shots, kind, streets = json.loads(line)
    units = draw(named(kind, "extended"), 0, streets)
    started = time.process_time()
    for k, unit in enumerate(units):
        render_street(unit, 0, k, shots, RenderSettings(width, height, samples), "embree", AssetPool())
    print((time.process_time() - started) / (streets * shots), flush=True)
"""
"""Answers each case with seconds per image, with functions that older checkouts have, too."""
FIRST_IMAGE = """
from scene.attributes import default_unit
from scene.dataset.render import render_dataset
from scene.render import RenderSettings
render_dataset(default_unit()[None], 0, shots=1, settings=RenderSettings(640, 320))
"""


def check_checkout(text: str) -> Path:
    """Find the folder of a checkout; raise ValueError if it has no engine."""
    path = Path(text).resolve()
    if not (path / "scene" / "render" / "__init__.py").exists():
        raise ValueError(f"{text} is not a checkout of this repository: it has no scene/render")
    return path


def _environment(checkout: Path) -> dict[str, str]:
    """Make an environment that caches compiled code in the checkout, next to its sources."""
    changed = {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return {**inherited, **changed}


def speeds(
    checkout: Path, streets: int, rounds: int, cases: tuple[tuple[Any, ...], ...] = CASES
) -> list[Row]:
    """Measure a row per case; the first round, which compiles and builds assets, does not count."""
    servers = [
        subprocess.Popen(
            [sys.executable, "-c", SERVE], cwd=folder, env=_environment(folder), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )
        for folder in (checkout, HERE)
    ]  # fmt: skip
    rows: list[Row] = []
    try:
        for case in cases:
            pairs = [
                [_ask(server, (*case, streets)) for server in servers] for _ in range(rounds + 1)
            ]
            theirs_s, ours_s = zip(*pairs[1:], strict=True)
            rows.append(
                {
                    "width": case[0], "height": case[1], "rays_per_pixel": case[2] ** 2,
                    "shots": case[3], "streets": case[4],
                    "ms_there": 1000 * min(theirs_s), "ms_here": 1000 * min(ours_s),
                    "ratio": min(theirs_s) / min(ours_s),
                    "median": statistics.median(t / h for t, h in pairs[1:]),
                }
            )  # fmt: skip
    finally:
        for server in servers:
            server.kill()
            server.communicate()
    return rows


def _ask(server: subprocess.Popen[str], case: tuple[Any, ...]) -> float:
    assert server.stdin is not None and server.stdout is not None
    server.stdin.write(json.dumps(case) + "\n")
    server.stdin.flush()
    answer = server.stdout.readline()
    if not answer:
        raise SystemExit("one of the checkouts stopped; its message is above")
    return float(answer)
