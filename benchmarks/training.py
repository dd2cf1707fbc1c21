"""One training step of the compact net: stepped from the host against scanned on the device.

    python -m benchmarks.training --json training.json

Why ``seg.train`` loops on the host on CPUs: gradient convolutions inside ``lax.scan`` are slow there.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

from benchmarks.report import Row, parser, report
from seg.train import TrainSettings, train

CLASSES = 11
SIZES = ((64, 48), (128, 96))


def seconds(steps: int, images: np.ndarray, labels: np.ndarray, stepwise: bool) -> float:
    """Median of three trainings, after one that compiles."""
    settings = TrainSettings(steps=steps)
    times = []
    for seed in range(4):
        started = time.perf_counter()
        train(seed, images, labels, settings, CLASSES, stepwise=stepwise)
        times.append(time.perf_counter() - started)
    return statistics.median(times[1:])


def main() -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    command.add_argument("--steps", type=int, default=50)
    options = command.parse_args()
    rng = np.random.default_rng(0)
    rows: list[Row] = []
    for width, height in SIZES:
        images = rng.integers(0, 256, (32, height, width, 3), np.uint8)
        labels = rng.integers(0, CLASSES, (32, height, width), np.uint8)
        base = None
        for loop in ("stepped", "scanned"):
            time_ = seconds(options.steps, images, labels, loop == "stepped")
            base = base or time_
            rows.append(
                {
                    "loop": loop,
                    "width": width,
                    "height": height,
                    "batch": TrainSettings().batch,
                    "ms_per_step": 1000 * time_ / options.steps,
                    "ratio": time_ / base,
                }
            )
    report(rows, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
