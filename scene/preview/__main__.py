"""Write a page of streets, attribute sweeps or assets as one image.

    sdr-jax preview --out sheet.png                         # default streets, labels, depth
    sdr-jax preview --attributes random --renderer opengl --out sheet.png
    sdr-jax preview --sweep car_interval --out sweep.png    # one attribute from 0 to 1
    sdr-jax preview --sweep all --out sweeps.jpg            # all attributes
    sdr-jax preview --theme all --out themes.jpg            # junctions, bends, parked rows
    sdr-jax preview --asset car --count 24 --out cars.png   # assets of one class
    sdr-jax preview --asset all --out assets.jpg            # some of every class
    sdr-jax preview --asset car --assets DIR --asset-use own --out mine.png

Writes PNG, or JPEG if the file name ends in .jpg.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from common import files
from common.command import Arguments, exit_code
from common.errors import flagged
from common.workers.pool import WorkerPool
from scene.assets.catalogue import AssetPool, check_pool, missing_families
from scene.dataset.render import check_seed, compile_first
from scene.parsers import preview as parser
from scene.preview.closeup import all_classes, class_page
from scene.preview.layout import Studio, save
from scene.preview.streets import all_sweeps, contact_sheet, sweep
from scene.preview.themes import all_themes, theme_page
from scene.proposal import draw, streets_named
from scene.render import RENDERERS, RendererError, RenderSettings, check_settings

FORMATS = (".png", ".jpg", ".jpeg")
MOST = 400
"""The largest number of streets, shots, assets, columns or steps on a page."""
SIZES = {"streets": (320, 240), "sweep": (320, 160), "sweep all": (224, 112), "theme": (480, 360),
         "theme all": (480, 360), "asset": (240, 180), "asset all": (200, 140)}  # fmt: skip
"""Default size of each image in pixels; themes are shown at two thirds of it."""
BOTH = "both"
"""Value of --renderer for all of them, one below the other."""


def page(options: argparse.Namespace) -> np.ndarray:
    """Make the page that the options describe, u8[h, w, 3] RGB.

    Raises:
        ValueError: an option out of range, or own assets that cannot be used.
        RendererError: the renderer cannot run here.
    """
    for name in ("streets", "shots", "count", "columns"):
        value = getattr(options, name)
        if value is not None and not 1 <= value <= MOST:
            raise ValueError(f"--{name} must lie in 1..{MOST}, not {value}")
    if not 2 <= options.steps <= MOST:
        raise ValueError(f"--steps must lie in 2..{MOST}, not {options.steps}")
    check_seed(options.seed, "--seed")
    pool = check_pool(
        AssetPool(
            fraction=options.asset_fraction,
            own=options.assets,
            use=options.asset_use,
            overlap=options.overlap,
            weather=options.weather,
        )
    )
    modes = {name: getattr(options, name) for name in ("sweep", "theme", "asset")}
    mode = next((name for name, argument in modes.items() if argument), "streets")
    everything = "all" in modes.values()
    if options.renderer == BOTH and mode != "theme":
        raise ValueError(f"--renderer {BOTH} works with --theme only")
    width, height = options.size or SIZES[f"{mode} all" if everything else mode]
    settings = check_settings(RenderSettings(width, height, samples=2))
    columns = options.columns or (8 if everything else min(options.count, 6))
    for name in RENDERERS if options.renderer == BOTH else (options.renderer,):
        compile_first(WorkerPool(0), name)
    studio = Studio(settings, options.renderer, pool)
    if mode == "sweep":
        if everything:
            return all_sweeps(options.steps, options.seed, studio)
        with flagged("--sweep"):
            return sweep(options.sweep, options.steps, options.seed, studio)
    if mode == "theme":
        names = RENDERERS if options.renderer == BOTH else (options.renderer,)
        studios = [studio._replace(renderer=name) for name in names]
        if everything:
            return all_themes(options.streets, options.seed, studios)
        with flagged("--theme"):
            return theme_page(options.theme, options.streets, options.seed, studios)
    if mode == "asset":
        studio = studio._replace(settings=settings._replace(samples=3))
        if everything:
            return all_classes(columns, studio)
        with flagged("--asset"):
            return class_page(options.asset, options.count, columns, studio)
    streets = streets_named(options.attributes, options.space)
    rows = draw(streets, options.seed, options.streets)
    return contact_sheet(rows, options.seed, options.shots, studio)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    command = parser()
    options = command.parse_args(arguments)
    if options.out.suffix.lower() not in FORMATS:
        command.error(f"--out must end in {', '.join(FORMATS)}, not {options.out.name!r}")
    if not options.out.absolute().parent.is_dir():
        command.error(f"--out: the folder {options.out.parent} does not exist")

    def work() -> None:
        files.check_file("--out", options.out)
        image = page(options)
        missing = missing_families(AssetPool(own=options.assets, use=options.asset_use))
        if missing:
            print(f"Without own assets, so left out: {', '.join(missing)}")
        save(image, options.out)

    users = (ValueError, RendererError)
    return exit_code(work, users=users, debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
