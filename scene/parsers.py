"""The command lines of `scene` without their work: a help text loads no renderer."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from scene.attributes import SPACES
from scene.dataset.formats.layout import FORMATS, SPLITS
from scene.names import HELD, OVERLAPS, OWN_EVERY, PLACES, RENDERERS, USES, WEATHERS
from scene.proposal import NAMES
from scene.workers import ExecutorName
from shell.command import Parser, docstring, size
from shell.target_file import SHIPPED

ASSETS: dict[str, dict[str, Any]] = {
    "--assets": {
        "default": "",
        "metavar": "DIR",
        "help": "folder of your own assets, see docs/howto/assets.md",
    },
    "--asset-use": {"choices": USES, "default": "both", "help": "which assets may appear"},
    "--overlap": {
        "choices": OVERLAPS,
        "default": "",
        "help": "whether objects may stand in each other; by default they may in space scenex only",
    },
    "--weather": {
        "choices": WEATHERS,
        "default": "",
        "help": "of all streets; by default each has its own",
    },
    "--asset-fraction": {
        "type": float,
        "default": 1.0,
        "metavar": "SHARE",
        "help": "of the assets, used",
    },
}
"""Flags of what streets draw from, of all commands that have them."""


def render() -> Parser:
    """The command line of `sdr-jax render`."""
    options = Parser("render", docstring("scene.render"))
    add = options.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the dataset")
    add(
        "--attributes",
        default="default",
        metavar="NAME|FILE",
        help="default (around a hand-set street), random, mixed (half of either), or a JSON file: a "
        "run's attributes.json, or every attribute's name with a value in [0, 1]",
    )
    add("--space", choices=SPACES, help="attributes of streets given by name (default: scenex)")
    add("--fix", action="append", default=[], metavar="NAME=VALUE", help=HELD)
    add(
        "--images",
        type=int,
        default=180,
        metavar="N",
        help="images in all; each shows a different street, unless --shots says otherwise",
    )
    add("--shots", type=int, default=1, metavar="N", help="images along each street")
    add("--size", type=size, default="640x320", metavar="WxH", help="in pixels")
    add("--format", choices=FORMATS, default="cityscapes", help="layout, see docs/datasets.md")
    add(
        "--target",
        metavar="NAME|FILE",
        help="write labels of these classes, in the ids or colours of its label files: "
        f"{', '.join(SHIPPED)}, or a target's file",
    )
    add("--split", choices=SPLITS, default="train", help="what the dataset calls its images")
    add("--seed", type=int, default=0, metavar="N", help="seed of all random choices")
    add("--workers", type=int, default=2, metavar="N", help="processes; no file depends on it")
    add = options.group("where and how it renders")
    add("--renderer", choices=RENDERERS, default="embree", help="who traces the rays")
    add("--samples", type=int, default=2, metavar="N", help="rays per pixel along each axis")
    add(
        "--executor",
        choices=get_args(ExecutorName),
        default="processes",
        help="who works: processes of this machine, or a Dask cluster, see docs/cluster.md",
    )
    add("--scheduler", metavar="ADDRESS", help="of the cluster, such as tcp://10.0.0.1:8786")
    add = options.group("assets")
    for flag, told in ASSETS.items():
        add(flag, **told)
    add(
        "--asset-count",
        type=int,
        metavar="N",
        help="built-in assets of each family; by default all",
    )
    add(
        "--own-asset",
        metavar="FILE",
        help="GLB of a class of your own; about eleven stand in a street, one on every "
        f"{OWN_EVERY} m where there is room",
    )
    add("--own-class", metavar="NAME", help="its name in labels, beside the 19 classes")
    add("--own-place", choices=PLACES, help="where it stands; by default the sidewalk")
    return options


def check() -> Parser:
    """The command line of `sdr-jax check`."""
    options = Parser("check", docstring("scene.check"))
    add = options.add_argument
    add("dataset", type=Path, nargs="?", metavar="DIR", help="folder of the dataset")
    add(
        "--overlaps",
        type=int,
        metavar="N",
        help="instead of a dataset: count overlaps in N hand-set and N random streets",
    )
    add("--overlap", choices=OVERLAPS, default="", help="whether their objects may; see render")
    add("--space", choices=SPACES, default="extended", help="attributes of these streets")
    for flag in ("--overlap", "--space"):
        options.needs(flag, "--overlaps")
    return options


def stats() -> Parser:
    """The command line of `sdr-jax stats`."""
    options = Parser("stats", docstring("scene.stats"))
    add = options.add_argument
    add("dataset", type=Path, metavar="DIR", help="folder that `sdr-jax render` wrote")
    add(
        "--against",
        type=Path,
        metavar="DIR",
        help="folder of CamVid, of Cityscapes or of another dataset",
    )
    add(
        "--only",
        action="append",
        default=[],
        metavar="PREFIX",
        help="of real images, only those called PREFIX...; may be given again",
    )
    add("--json", type=Path, metavar="FILE", help="file for the same figures")
    return options


def preview() -> Parser:
    """The command line of `sdr-jax preview`."""
    options = Parser("preview", docstring("scene.preview"))
    add = options.add_argument
    add("--out", type=Path, required=True, metavar="FILE", help="PNG or JPEG file to write")
    what = options.add_mutually_exclusive_group()
    what.add_argument("--sweep", metavar="ATTRIBUTE", help="an attribute from 0 to 1; or 'all'")
    what.add_argument("--theme", metavar="THEME", help="more of one thing, such as bends; or 'all'")
    what.add_argument("--asset", metavar="CLASS", help="assets of a class or family; or 'all'")
    add("--attributes", choices=NAMES, default="default", help="attributes of the streets")
    add("--streets", type=int, default=3, metavar="N", help="streets of the page")
    add("--shots", type=int, default=4, metavar="N", help="images per street")
    add("--size", type=size, metavar="WxH", help="size of images; by default what suits the page")
    add("--seed", type=int, default=0, metavar="N", help="seed of all random choices")
    add = options.group("what is on the page")
    add("--space", choices=SPACES, default="scenex", help="attributes of the streets")
    add("--renderer", choices=(*RENDERERS, "both"), default="embree", help="who traces the rays")
    add("--steps", type=int, default=7, metavar="N", help="values of a sweep")
    add("--count", type=int, default=12, metavar="N", help="assets of a class")
    add("--columns", type=int, metavar="N", help="assets in a row")
    for flag, mode in (("--steps", "--sweep"), ("--count", "--asset"), ("--columns", "--asset")):
        options.needs(flag, mode)
    for flag in ("--attributes", "--space"):
        options.excludes(flag, "--sweep", "--theme", "--asset")
    add = options.group("assets")
    for flag, told in ASSETS.items():
        add(flag, **told)
    return options


def catalogue() -> Parser:
    """The command line of `sdr-jax catalogue`."""
    options = Parser("catalogue", docstring("scene.assets"))
    what = options.add_mutually_exclusive_group()
    what.add_argument("--json", action="store_true", help="print {class: count}")
    what.add_argument("--closest", metavar="CLASS", help="class or family; 'all' for every one")
    options.add_argument(
        "--pairs", type=int, default=10, metavar="N", help="pairs to print with --closest"
    )
    options.needs("--pairs", "--closest")
    return options
