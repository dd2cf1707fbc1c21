"""Render a labelled dataset into a folder; run the same command again to resume.

sdr-jax render --images 8 --out streets           # eight streets, one image of each
sdr-jax render --attributes runs/main/attributes.json --format coco --out streets
sdr-jax render --attributes random --format folders --target camvid --out streets
sdr-jax render --attributes random --space extended --fix field_of_view=90 --out streets
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from common.command import Arguments, exit_code
from common.errors import UserError
from common.memory import refuse_larger
from common.workers.executors import workers_of
from common.workers.pool import WorkerError, refuse_many_workers
from scene.assets.catalogue import AssetPool
from scene.assets.own_class import OwnClass
from scene.dataset.export import export_dataset
from scene.dataset.read import DESCRIPTION, MOST_IMAGES
from scene.dataset.render import check_seed
from scene.held import hold, in_words, read_fixed
from scene.names import PLACES
from scene.parsers import render as parser
from scene.preview.dataset import write_sheet
from scene.proposal import draw, read_streets, space_in
from scene.render import RendererError, RenderSettings, check_settings
from scene.render.protocol import refuse_large_images, refuse_many_shots
from scene.versions import picture_versions

if TYPE_CHECKING:
    from common.progress import Progress

OWN_FLAGS = ("own_asset", "own_class", "own_place")
STREET = 2000
"""Bytes of memory per street until all are rendered, at least: its attributes."""


def reporter(progress: Progress) -> Callable[[int, int, int], None]:
    """Make a function that reports the progress of an export; earlier calls' images count as replayed."""
    before: list[int] = []

    def report(done: int, images: int, bytes_written: int) -> None:
        progress.advance(done - (before[-1] if before else 0), replayed=not before)
        before.append(done)
        progress.update(f"{done} of {images} images | {bytes_written / 1e6:.1f} MB")

    return report


def own_class_of(options: argparse.Namespace) -> OwnClass | None:
    """The user's own class that the options describe, or None.

    Raises:
        UserError: a flag of the class is missing.
    """
    flags = {f"--{name.replace('_', '-')}": getattr(options, name) for name in OWN_FLAGS}
    given_flags = [flag for flag, value in flags.items() if value is not None]
    if not given_flags:
        return None
    for flag in ("--own-asset", "--own-class"):
        if flags[flag] is None:
            raise UserError(
                f"{given_flags[0]} needs {flag}, too: your own class has a file and a name"
            )
    return OwnClass(options.own_class, options.own_asset, options.own_place or PLACES[0])


def export(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Render the dataset that the options describe; returns the content of ``dataset.json``.

    Raises:
        ValueError, OSError, RendererError, WorkerError: the options are wrong, or rendering failed.
    """
    if not 1 <= options.images <= MOST_IMAGES:
        raise ValueError(f"--images must lie in 1..{MOST_IMAGES:,}, not {options.images}")
    for name, least in (("shots", 1), ("workers", 0)):
        if getattr(options, name) < least:
            raise ValueError(f"--{name} must be {least} or more, not {getattr(options, name)}")
    check_seed(options.seed, "--seed")
    own_class = own_class_of(options)
    width, height = options.size
    settings = check_settings(RenderSettings(width, height, samples=options.samples))
    refuse_many_workers("--workers", options.workers)
    refuse_large_images("--samples", settings)
    refuse_many_shots("--shots", options.shots, settings)
    refuse_larger("--images", options.images, lambda n: n * STREET // options.shots, "streets")
    streets = read_streets(options.attributes, options.space)
    fixed = read_fixed(options.fix, space_in(streets))
    if fixed:
        progress.say(f"Fixed: {in_words(fixed)}")
    streets = hold(streets, fixed)
    kind = options.executor, options.workers, options.scheduler
    with workers_of(*kind, versions=picture_versions) as workers:
        if workers.dashboard is not None:
            progress.say(f"Dashboard: {workers.dashboard}")
        return export_dataset(
            draw(streets, options.seed, -(-options.images // options.shots)),
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
                overlap=options.overlap,
                weather=options.weather,
                own_class=own_class,
            ),
            target=options.target,
            streets=streets,
            workers=workers,
            progress=reporter(progress),
        )


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from common.progress import Progress, duration  # worker processes do not need its library

    options = parser().parse_args(arguments)

    def work() -> None:
        progress = Progress(options.images)
        try:
            description = export(options, progress)
        finally:
            progress.close()
        seconds = duration(progress.elapsed)
        per_street = "one" if options.shots == 1 else f"up to {options.shots}"
        streets = f"{len(description['streets'])} streets, {per_street} per street"
        summary = f"{description['images']} images of {streets}, in {seconds}"
        print(f"{summary}: {options.out / DESCRIPTION}", flush=True)
        print(f"Contact sheet: {write_sheet(options.out)}", flush=True)
        if options.own_class and options.own_class not in description["placed"]:
            print(
                f"No street has a {options.own_class}: there was no room for one",
                flush=True,
            )

    users = (ValueError, RendererError)
    return exit_code(work, also=(WorkerError,), users=users, debug=options.debug)


if __name__ == "__main__":
    sys.exit(main())
