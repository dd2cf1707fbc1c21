"""Measure images with labels per second for both renderers on the same streets.

    python -m benchmarks.render --json render.json
    python -m benchmarks.render --peers     # also other installed renderers on the same street
    python -m benchmarks.render --against ../before     # only compare this checkout with another one

Streets are default ones, and times include building them. Workers are started and have loaded their assets
before the clock starts, as after the first streets of any dataset; ``starts`` has the cost of the first
ones. ``ratio`` is the speed relative to the first row of the same size. The split is that of one process, in
ms per image: ``build`` (the street, its arrays and its sky), ``bvh`` (hierarchies, or upload to OpenGL),
``rays`` (visibility and light), ``shade`` (to the finished frame), ``write`` (image and label as PNG, not
part of the speed).
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import against
from benchmarks.peers import PEERS, export_street, run_peer
from benchmarks.report import Row, count, parser, table, timed, write
from common.workers.pool import WorkerPool
from scene.assets.catalogue import AssetPool
from scene.dataset.render import render_dataset, street_of
from scene.proposal import default_proposal, draw
from scene.render import RENDERERS, RendererError, RenderSettings, renderer
from scene.render.geometry import build

SIZES = ((64, 48, 2), (128, 96, 2), (640, 320, 1), (1024, 512, 1))
"""Width, height, rays per pixel along each axis: the quick preset's two stages and the paper's sizes."""
STAGES = ("build", "bvh", "rays", "shade", "write")


def _memory(_: int) -> float:
    """Read the peak memory of this process, MiB."""
    status = Path("/proc/self/status")
    if status.exists():  # ``getrusage`` may give the peak of the parent process
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(fields["VmHWM"].split()[0]) / 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def speed(
    name: str, size: tuple[int, int, int], workers: int, streets: int, shots: int
) -> tuple[float, float]:
    """Measure images per second: the median of three renderings of a dataset, after one that makes assets.

    Returns:
        Images per second, and the peak memory of a worker, MiB.
    """
    units, settings = draw(default_proposal(), 0, streets), RenderSettings(*size)
    with WorkerPool(workers) as pool:
        run = partial(
            render_dataset,
            units,
            0,
            shots=shots,
            settings=settings,
            renderer_name=name,
            workers=pool,
        )
        seconds = [timed(run)[0] for _ in range(4)]
        memory = max(peak for _, peak in pool.map(_memory, [(k,) for k in range(workers)]))
    return streets * shots / statistics.median(seconds[1:]), memory


def split(name: str, size: tuple[int, int, int], streets: int, shots: int) -> dict[str, float]:
    """Measure milliseconds per image of every stage: the median over streets, rendered once before."""
    settings, engine = RenderSettings(*size), renderer(name)
    costs = defaultdict(list)
    for k, unit in enumerate(draw(default_proposal(), 0, streets)):
        for warm in (False, True):
            spent: dict[str, float] = defaultdict(float)
            last = time.perf_counter()

            def lap(stage: str) -> None:
                nonlocal last
                now = time.perf_counter()
                spent[stage] += 1000 * (now - last) / shots  # noqa: B023
                last = now

            street = street_of(unit, 0, k, shots, AssetPool())
            frames = engine.render(street, settings, lap)
            for frame in frames:
                cv2.imencode(".png", frame.image)
                cv2.imencode(".png", frame.label)
            lap("write")
            if warm:
                for stage in STAGES:
                    costs[stage].append(spent[stage])
    return {f"{stage}_ms": statistics.median(costs[stage]) for stage in STAGES}


def renderers(sizes: list[tuple[int, int, int]], streets: int, shots: int) -> list[Row]:
    """Measure a row per size, renderer and number of workers."""
    drawn_streets = [
        street_of(u, 0, k, 1, AssetPool())
        for k, u in enumerate(draw(default_proposal(), 0, streets))
    ]
    triangles = int(np.mean([build(street).triangles for street in drawn_streets]))
    rows: list[Row] = []
    for size in sizes:
        base = None
        for name in RENDERERS:
            try:
                renderer(name)
            except RendererError as error:
                print(f"{name} left out: {error}", file=sys.stderr)
                continue
            cost = split(name, size, min(streets, 4), shots)
            for workers in (1, 2):
                images_per_s, memory = speed(name, size, workers, streets, shots)
                base = base or images_per_s
                rows.append(
                    {
                        "renderer": name,
                        "width": size[0],
                        "height": size[1],
                        "rays_per_pixel": size[2] ** 2,
                        "workers": workers,
                        "triangles": triangles,
                        "images_per_s": images_per_s,
                        "ratio": images_per_s / base,
                        **cost,
                        "mib_per_worker": memory,
                    }
                )
                print(
                    f"{name} {size[0]}x{size[1]}, {workers} workers: {images_per_s:.1f} images/s",
                    file=sys.stderr,
                    flush=True,
                )
    return rows


def starts() -> list[Row]:
    """Measure seconds until the first image: of a new process, and of an additional worker."""
    program = [sys.executable, "-c", against.FIRST_IMAGE]
    runs: dict[str, Callable[[], Any]] = {
        "new process to first image": partial(subprocess.run, program, check=True)
    }
    unit, settings = draw(default_proposal(), 0, 1), RenderSettings(64, 48)
    with WorkerPool(1) as pool:
        street = partial(render_dataset, unit, 0, shots=1, settings=settings, workers=pool)
        runs |= {"new worker to first street": street, "warm worker to next street": street}
        return [{"start": name, "seconds": timed(run)[0]} for name, run in runs.items()]


def peers(pythons: list[str], width: int, height: int, ours_ms: float) -> list[Row]:
    """Measure milliseconds per image of other renderers on one default street, as one merged mesh."""
    rows: list[Row] = [
        {"renderer": "embree, one worker", "what": "image and label", "ms": ours_ms, "ratio": 1.0}
    ]
    street = street_of(draw(default_proposal(), 0, 1)[0], 0, 0, 1, AssetPool())
    with tempfile.TemporaryDirectory() as folder:
        export_street(Path(folder), street, width, height)
        for name in PEERS:
            measurements = next(
                filter(None, (run_peer(p, name, Path(folder)) for p in pythons)), []
            )
            for what, ms in measurements:
                rows.append({"renderer": name, "what": what, "ms": ms, "ratio": ms / ours_ms})
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    positive = partial(count, 1)
    command.add_argument("--streets", type=positive, default=6)
    command.add_argument("--shots", type=positive, default=6, help="images per street")
    command.add_argument(
        "--widths",
        type=int,
        nargs="+",
        choices=[size[0] for size in SIZES],
        help="only sizes with these widths; by default all",
    )
    command.add_argument("--peers", action="store_true", help="measure other renderers, too")
    command.add_argument(
        "--peer-python",
        default=sys.executable,
        help="another Python, in which some of them are installed",
    )
    command.add_argument(
        "--against", metavar="CHECKOUT", help="compare with the engine of a folder"
    )
    command.add_argument("--rounds", type=positive, default=5, help="of --against")
    options = command.parse_args(arguments)
    if options.against is not None:
        try:
            checkout = against.check_checkout(options.against)
        except ValueError as error:
            command.error(f"--against: {error}")
        compared = against.speeds(checkout, options.streets, options.rounds)
        print(table(compared))
        write(options.json, against=compared)
        return 0
    if options.peers and options.widths is not None and 640 not in options.widths:
        command.error("--peers compares at 640x320, which --widths leaves out")
    sizes = [size for size in SIZES if options.widths is None or size[0] in options.widths]
    rows = renderers(sizes, options.streets, options.shots)
    parts = {"rows": rows, "starts": starts()}
    if options.peers:
        single = next(r for r in rows if (r["width"], r["workers"]) == (640, 1))
        pythons = list(dict.fromkeys((sys.executable, options.peer_python)))
        parts["peers"] = peers(pythons, 640, 320, 1000 / single["images_per_s"])
    print("\n\n".join(map(table, parts.values())))
    write(options.json, **parts)
    return 0


if __name__ == "__main__":
    sys.exit(main())
