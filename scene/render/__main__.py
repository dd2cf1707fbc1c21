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

from common.command import Arguments, exit_code
from common.errors import UserError
from common.memory import refuse_larger
from common.workers.executors import workers_of
from common.workers.pool import WorkerError, refuse_many_workers
from scene.assets.catalogue import AssetPool
from scene.assets.own_class import OwnClass
from scene.dataset.export import export_dataset
from scene.dataset.read import DESCRIPTION, MOST_IMAGES
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
"""Bytes that are kept of a street until all are rendered, at least: its attributes."""


def reporter(progress: Progress) -> Callable[[int, int, int], None]:
    """Tells how far the export is; what an earlier call has finished took this one no time."""
    before: list[int] = []

    def report(done: int, images: int, written: int) -> None:
        progress.advance(done - (before[-1] if before else 0), replayed=not before)
        before.append(done)
        progress.update(f"{done} of {images} images | {written / 1e6:.1f} MB")

    return report


def own_class_of(options: argparse.Namespace) -> OwnClass | None:
    """The class of the user's own that the options ask for.

    Raises:
        UserError: one of its flags goes without the other.
    """
    flags = {f"--{name.replace('_', '-')}": getattr(options, name) for name in OWN_FLAGS}
    given = [flag for flag, value in flags.items() if value is not None]
    if not given:
        return None
    for flag in ("--own-asset", "--own-class"):
        if flags[flag] is None:
            raise UserError(
                f"{given[0]} needs {flag} beside it: a class of one's own has a file and a name"
            )
    return OwnClass(options.own_class, options.own_asset, options.own_place or PLACES[0])


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
    own_class = own_class_of(options)
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
    kind = options.executor, options.workers, options.scheduler
    with workers_of(*kind, versions=picture_versions) as workers:
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
                weather=options.weather,
                own_class=own_class,
            ),
            target=options.target,
            streets=chosen,
            workers=workers,
            progress=reporter(progress),
        )


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from common.progress import Progress, duration  # its library is nothing for worker processes

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
        print(f"Contact sheet: {write_sheet(options.out)}", flush=True)
        if options.own_class and options.own_class not in found["placed"]:
            print(
                f"No {options.own_class} stands in any street: there was no room for one",
                flush=True,
            )

    users = (ValueError, RendererError)
    return exit_code(work, also=(WorkerError,), users=users, debug=options.debug)


if __name__ == "__main__":
    sys.exit(main())
