"""Renders a labelled dataset into a folder; the same command continues one that was cut short.

python -m scene.render --attributes default --images 180 --size 640x320 --out streets
python -m scene.render --attributes runs/main/attributes.json --images 450 --format coco --out streets
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from scene.assets.catalogue import USES, AssetPool
from scene.command import Parser, duration, end_line, show, size
from scene.dataset.export import export_dataset
from scene.dataset.formats.files import read_json
from scene.dataset.formats.layout import FORMATS, SPLITS
from scene.dataset.read import DESCRIPTION
from scene.proposal import Proposal, default_proposal, draw, parse_proposal, random_proposal
from scene.render import RENDERERS, RendererError, RenderSettings, check_settings
from scene.workers import WorkerError

MOST_IMAGES = 10_000_000
"""More are a slip of the hand."""
INTERRUPTED = 130


def parser() -> Parser:
    """The command line."""
    options = Parser("scene.render", __doc__)
    add = options.add_argument
    add("--out", type=Path, required=True, help="folder of the dataset, made if need be")
    add(
        "--attributes",
        default="default",
        help="default (around a street set by eye), random, or a JSON file: a run's attributes.json, "
        "or every attribute's name with a value in [0, 1]",
    )
    add("--images", type=int, default=180)
    add("--size", type=size, default=(640, 320), help="WIDTHxHEIGHT in pixels")
    add("--format", choices=FORMATS, default="cityscapes")
    add("--split", choices=SPLITS, default="train", help="what the dataset calls its images")
    add("--seed", type=int, default=0)
    add("--workers", type=int, default=2, help="processes; the files do not depend on it")
    add("--shots", type=int, default=6, help="images per street")
    add("--samples", type=int, default=2, help="rays per pixel along each axis")
    add("--renderer", choices=RENDERERS, default="embree")
    add(
        "--assets",
        default="",
        metavar="DIR",
        help="folder of your own assets, see scene/library.py",
    )
    add("--asset-use", choices=USES, default="both", help="which assets may appear")
    add("--asset-fraction", type=float, default=1.0, help="share of the assets that is used")
    return options


def proposal(source: str) -> Proposal:
    """Which streets ``--attributes`` asks for.

    Raises:
        ValueError: the file is no JSON, or not of attributes, by name.
        OSError: it cannot be read.
    """
    if source == "default":
        return default_proposal()
    if source == "random":
        return random_proposal()
    try:
        return parse_proposal(read_json(Path(source)))
    except ValueError as error:
        where = "" if str(error).startswith(source) else f"{source}: "
        raise ValueError(f"{where}{error}") from None


def reporter() -> Callable[[int, int, int], None]:
    """Prints how far the export is and how long it will take."""
    started = time.perf_counter()
    before: list[int] = []

    def report(done: int, images: int, written: int) -> None:
        before.append(done)
        fresh = done - before[0]
        pace = (time.perf_counter() - started) / fresh if fresh else 0.0
        left = f" | {duration(pace * (images - done))} left" if fresh else ""
        show(
            f"[{100 * done // images:3d} %] {done} of {images} images | {written / 1e6:.1f} MB{left}"
        )

    return report


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser()
    options = command.parse_args(arguments)
    try:
        if not 1 <= options.images <= MOST_IMAGES:
            raise ValueError(f"--images must lie in 1..{MOST_IMAGES:,}, not {options.images}")
        for name, least in (("shots", 1), ("seed", 0), ("workers", 0)):
            if getattr(options, name) < least:
                raise ValueError(f"--{name} must be {least} or more, not {getattr(options, name)}")
        width, height = options.size
        settings = check_settings(RenderSettings(width, height, samples=options.samples))
        chosen = proposal(options.attributes)
        started = time.perf_counter()
        found = export_dataset(
            draw(chosen, options.seed, -(-options.images // options.shots)),
            options.seed,
            options.out,
            shots=options.shots,
            settings=settings,
            images=options.images,
            format=options.format,
            split=options.split,
            renderer_name=options.renderer,
            pool=AssetPool(
                fraction=options.asset_fraction, own=options.assets, use=options.asset_use
            ),
            proposal=chosen,
            workers=options.workers,
            progress=reporter(),
        )
    except (ValueError, OSError, RendererError, WorkerError) as error:
        command.fail(error)
    except KeyboardInterrupt:
        end_line()
        sys.stderr.write(f"interrupted; the same command continues {options.out}\n")
        return INTERRUPTED
    seconds = duration(time.perf_counter() - started)
    end_line()
    print(f"{found['images']} images in {seconds}: {options.out / DESCRIPTION}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
