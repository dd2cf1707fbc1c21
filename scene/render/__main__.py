"""Renders a labelled dataset into a folder; the same command continues one that was cut short.

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

from scene.assets.catalogue import AssetPool
from scene.dataset.export import export_dataset
from scene.dataset.read import DESCRIPTION, MOST_IMAGES
from scene.executors import workers_of
from scene.held import hold, in_words, read_fixed
from scene.parsers import render as parser
from scene.proposal import draw, read_streets, space_in
from scene.render import RendererError, RenderSettings, check_settings
from scene.render.protocol import refuse_large_images, refuse_many_shots
from scene.workers import WorkerError, refuse_many_workers
from shell.command import exit_code
from shell.memory import refuse_larger

if TYPE_CHECKING:
    from shell.progress import Progress

STREET = 2000
"""Bytes that are kept of a street until all are rendered, at least: its attributes."""


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
                overlap=options.overlap,
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
        each = "one image" if options.shots == 1 else f"up to {options.shots} images"
        of = f"{found['images']} images of {len(found['streets'])} streets, {each} of each,"
        print(f"{of} in {seconds}: {options.out / DESCRIPTION}", flush=True)

    users = (ValueError, RendererError)
    return exit_code(work, also=(WorkerError,), users=users, debug=options.debug)


if __name__ == "__main__":
    sys.exit(main())
