"""Images with labels per second, both renderers side by side on the same streets.

    python -m benchmarks.render --json render.json

Streets set by eye, street building included; workers are started and warm before the clock runs.
``ratio`` is the speed against the first row of the same size.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

from benchmarks.report import Row, parser, report
from scene.catalogue import AssetPool
from scene.dataset import render_dataset, street_of
from scene.geometry import build
from scene.preview import units
from scene.render import RENDERERS, RendererError, RenderSettings, renderer
from scene.workers import WorkerPool

SIZES = ((64, 48, 2), (128, 96, 2), (640, 320, 1))
"""Width, height, rays per pixel along each axis: the quick preset's two stages and the paper's size."""


def measure(name: str, size: tuple[int, int, int], workers: int, streets: int, shots: int) -> float:
    """Images per second: the median of three datasets, after one that warms up."""
    width, height, samples = size
    settings = RenderSettings(width, height, samples)
    speeds = []
    with WorkerPool(workers) as pool:
        for repeat in range(4):
            started = time.perf_counter()
            render_dataset(
                units("default", streets, repeat),
                repeat,
                shots=shots,
                settings=settings,
                renderer_name=name,
                workers=pool,
            )
            speeds.append(streets * shots / (time.perf_counter() - started))
    return statistics.median(speeds[1:])


def main() -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    command.add_argument("--streets", type=int, default=4)
    command.add_argument("--shots", type=int, default=6, help="images per street")
    options = command.parse_args()
    streets = units("default", options.streets, 0)
    counts = [len(build(street_of(u, 0, k, 1, AssetPool())).faces) for k, u in enumerate(streets)]
    rows: list[Row] = []
    for size in SIZES:
        base = None
        for name in RENDERERS:
            try:
                renderer(name)
            except RendererError as error:
                print(f"{name} left out: {error}", file=sys.stderr)
                continue
            for workers in (1, 2):
                speed = measure(name, size, workers, options.streets, options.shots)
                base = base or speed
                rows.append(
                    {
                        "renderer": name,
                        "width": size[0],
                        "height": size[1],
                        "rays_per_pixel": size[2] ** 2,
                        "workers": workers,
                        "triangles": int(np.mean(counts)),
                        "images_per_s": speed,
                        "ratio": speed / base,
                    }
                )
    report(rows, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
