"""Renders a labelled dataset into a folder; the same command continues one that was cut short.

python -m scene.render --attributes default --images 180 --size 640x320 --out streets
python -m scene.render --attributes runs/main/attributes.json --images 450 --format coco --out streets
python -m scene.render --attributes random --images 600 --format folders --target camvid --out streets
python -m scene.render --attributes random --space extended --fix field_of_view=90 --out streets
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from scene.assets.catalogue import USES, AssetPool
from scene.attributes import SPACES
from scene.dataset.export import export_dataset
from scene.dataset.formats.layout import FORMATS, SPLITS
from scene.dataset.read import DESCRIPTION, MOST_IMAGES
from scene.executors import workers_of
from scene.held import HELP, hold, in_words, read_fixed
from scene.proposal import draw, read_streets, space_in
from scene.render import RENDERERS, RendererError, RenderSettings, check_settings
from scene.render.protocol import refuse_large_images, refuse_many_shots
from scene.workers import ExecutorName, WorkerError, refuse_many_workers
from shell.command import Parser, exit_code, size
from shell.memory import refuse_larger
from shell.target_file import SHIPPED

if TYPE_CHECKING:
    from shell.progress import Progress

STREET = 2000
"""Bytes that are kept of a street until all are rendered, at least: its attributes."""


def parser() -> Parser:
    """The command line."""
    options = Parser("scene.render", __doc__)
    add = options.add_argument
    add("--out", type=Path, required=True, help="folder of the dataset, made if need be")
    add(
        "--attributes",
        default="default",
        help="default (around a hand-set street), random, mixed (half of either), or a JSON file: a "
        "run's attributes.json, or every attribute's name with a value in [0, 1]",
    )
    add("--space", choices=SPACES, default="scenex", help="attributes of streets given by name")
    add("--fix", action="append", default=[], metavar="NAME=VALUE", help=HELP)
    add("--images", type=int, default=180, help="of as many streets, unless --shots says otherwise")
    add("--size", type=size, default=(640, 320), help="WIDTHxHEIGHT in pixels")
    add("--format", choices=FORMATS, default="cityscapes", help="layout, see docs/datasets.md")
    add(
        "--target",
        metavar="NAME_OR_FILE",
        help="write labels of these classes, in the ids or colours of its label files: "
        f"{', '.join(SHIPPED)}, or a target's file",
    )
    add("--split", choices=SPLITS, default="train", help="what the dataset calls its images")
    add("--seed", type=int, default=0)
    add("--workers", type=int, default=2, help="processes; the files do not depend on it")
    add(
        "--executor",
        choices=get_args(ExecutorName),
        default="processes",
        help="who renders: processes of this machine, or a Dask cluster, see docs/cluster.md",
    )
    add("--scheduler", metavar="ADDRESS", help="of the cluster, such as tcp://10.0.0.1:8786")
    add("--shots", type=int, default=1, help="images along each street")
    add("--samples", type=int, default=2, help="rays per pixel along each axis")
    add("--renderer", choices=RENDERERS, default="embree")
    add("--assets", default="", metavar="DIR", help="folder of your own assets, see docs/engine.md")
    add("--asset-use", choices=USES, default="both", help="which assets may appear")
    add("--asset-fraction", type=float, default=1.0, help="share of the assets that is used")
    add("--asset-count", type=int, help="built-in assets of each family; by default all")
    return options


def reporter(progress: Progress) -> Callable[[int, int, int], None]:
    """Tells how far the export is; what an earlier call has finished took this one no time."""
    before: list[int] = []

    def report(done: int, images: int, written: int) -> None:
        progress.advance(done - (before[-1] if before else 0), replayed=not before)
        before.append(done)
        progress.update(f"{done} of {images} images | {written / 1e6:.1f} MB")

    return report


def export(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """What ``dataset.json`` says of the dataset that the options ask for.

    Raises:
        ValueError, OSError, RendererError, WorkerError: what went wrong.
    """
    if not 1 <= options.images <= MOST_IMAGES:
        raise ValueError(f"--images must lie in 1..{MOST_IMAGES:,}, not {options.images}")
    for name, least in (("shots", 1), ("seed", 0), ("workers", 0)):
        if getattr(options, name) < least:
            raise ValueError(f"--{name} must be {least} or more, not {getattr(options, name)}")
    width, height = options.size
    settings = check_settings(RenderSettings(width, height, samples=options.samples))
    refuse_many_workers("--workers", options.workers)
    refuse_large_images("--samples", settings)
    refuse_many_shots("--shots", options.shots, settings)
    refuse_larger("--images", options.images, lambda n: n * STREET // options.shots, "streets")
    chosen = read_streets(options.attributes, options.space)
    held = read_fixed(options.fix, space_in(chosen))
    if held:
        progress.say(f"Held: {in_words(held)}")
    chosen = hold(chosen, held)
    with workers_of(options.executor, options.workers, options.scheduler) as workers:
        if workers.dashboard is not None:
            progress.say(f"Dashboard: {workers.dashboard}")
        return export_dataset(
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
                size=options.asset_count,
                fraction=options.asset_fraction,
                own=options.assets,
                use=options.asset_use,
            ),
            target=options.target,
            streets=chosen,
            workers=workers,
            progress=reporter(progress),
        )


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    from shell.progress import Progress, duration  # its library is nothing for worker processes

    options = parser().parse_args(arguments)

    def work() -> None:
        progress = Progress(options.images)
        try:
            found = export(options, progress)
        finally:
            progress.close()
        seconds = duration(progress.elapsed)
        of = f"{found['images']} images of {len(found['streets'])} streets"
        print(f"{of} in {seconds}: {options.out / DESCRIPTION}", flush=True)

    users = (ValueError, RendererError)
    return exit_code(work, also=(WorkerError,), users=users, debug=options.debug)


if __name__ == "__main__":
    sys.exit(main())
