"""The command lines of `scene`, apart from their work: a help text loads no renderer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from common.flags import ARGUMENT, ONE_OF, REPEATED, SWITCH, Option, Size, command_line
from common.labels.target_file import SHIPPED
from common.workers.pool import ExecutorName, cores
from scene.attributes import SpaceName
from scene.dataset.formats.layout import FORMATS, SPLITS
from scene.names import HELD, OVERLAPS, OWN_EVERY, PLACES, RENDERERS, USES, WEATHERS
from scene.proposal import NAMES

TARGET = (
    f"label images with the classes and values of a target: {', '.join(SHIPPED)}, or a target file"
)
OWN = (
    f"GLB file of your own class; a street has 7 to 11 of them, one every {OWN_EVERY} m where there is "
    "room"
)
MODES = ("--sweep", "--theme", "--asset")
"""Options of a preview that shows something else than streets."""


@dataclass(frozen=True, kw_only=True)
class Assets:
    """Assets and weather that streets draw from."""

    assets: Annotated[str, Option("DIR")] = ""
    """folder of your own assets, see docs/howto/assets.md"""
    asset_use: Annotated[str, Option(choices=USES)] = "both"
    """assets to use"""
    overlap: Annotated[str, Option(choices=OVERLAPS)] = ""
    """whether objects may overlap; by default only in space scenex"""
    weather: Annotated[str, Option(choices=WEATHERS)] = ""
    """weather of all streets; by default it varies"""
    asset_fraction: Annotated[float, Option("SHARE")] = 1.0
    """share of the assets to use"""


ASSETS = ("assets", "asset_use", "overlap", "weather", "asset_fraction")


@dataclass(frozen=True, kw_only=True)
class Render(Assets):
    """Options of `sdr-jax render`."""

    out: Annotated[Path, Option("DIR")]
    """folder of the dataset"""
    attributes: Annotated[str, Option("NAME|FILE")] = "default"
    """default, random, mixed (half default, half random), or a JSON file: a run's attributes.json, or a
    value in [0, 1] for every attribute"""
    space: SpaceName | None = None
    """set of attributes for default, random or mixed streets (default: scenex)"""
    fix: Annotated[tuple[str, ...], REPEATED, Option("NAME=VALUE", help=HELD)] = ()
    images: Annotated[int, Option("N")] = 180
    """number of images; each shows a different street unless --shots is set"""
    shots: Annotated[int, Option("N")] = 1
    """images per street"""
    size: Size = (640, 320)
    """image size in pixels"""
    format: Annotated[str, Option(choices=FORMATS)] = "cityscapes"
    """dataset layout, see docs/datasets.md"""
    target: Annotated[str | None, Option("NAME|FILE", help=TARGET)] = None
    split: Annotated[str, Option(choices=SPLITS)] = "train"
    """name of the split"""
    seed: Annotated[int, Option("N")] = 0
    """random seed"""
    workers: Annotated[int, Option("N")] = cores()
    """number of processes, by default one per core; the files do not depend on it"""
    renderer: Annotated[str, Option(choices=RENDERERS)] = "embree"
    """rendering engine"""
    samples: Annotated[int, Option("N")] = 2
    """rays per pixel along each axis"""
    executor: ExecutorName = "processes"
    """where to render: processes on this machine or a Dask cluster, see docs/cluster.md"""
    scheduler: Annotated[str | None, Option("ADDRESS")] = None
    """address of the Dask scheduler, such as tcp://10.0.0.1:8786"""
    asset_count: Annotated[int | None, Option("N")] = None
    """number of built-in assets per family; by default all"""
    own_asset: Annotated[str | None, Option("FILE", help=OWN)] = None
    own_class: Annotated[str | None, Option("NAME")] = None
    """name of your own class, in addition to the 19 classes"""
    own_place: Annotated[str | None, Option(choices=PLACES)] = None
    """where to place your own class; by default on the sidewalk"""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Options of `sdr-jax check`."""

    dataset: Annotated[Path | None, ARGUMENT, Option("DIR", nargs="?")] = None
    """folder of the dataset"""
    overlaps: Annotated[int | None, Option("N")] = None
    """instead of checking a dataset, count overlapping objects in N default and N random streets"""
    overlap: Annotated[str, Option(choices=OVERLAPS, needs=("--overlaps",))] = ""
    """whether objects of these streets may overlap, as in render"""
    space: Annotated[SpaceName, Option(needs=("--overlaps",))] = "extended"
    """attributes of these streets"""


@dataclass(frozen=True, kw_only=True)
class Stats:
    """Options of `sdr-jax stats`."""

    dataset: Annotated[Path, ARGUMENT, Option("DIR")]
    """folder written by `sdr-jax render`"""
    against: Annotated[Path | None, Option("DIR")] = None
    """folder to compare with: CamVid, Cityscapes or another rendered dataset"""
    only: Annotated[tuple[str, ...], REPEATED, Option("PREFIX", needs=("--against",))] = ()
    """use only real images whose names start with PREFIX; may be repeated"""
    json: Annotated[Path | None, Option("FILE")] = None
    """also write the statistics to this file"""


@dataclass(frozen=True, kw_only=True)
class Preview(Assets):
    """Options of `sdr-jax preview`."""

    out: Annotated[Path, Option("FILE")]
    """PNG or JPEG file to write"""
    sweep: Annotated[str | None, ONE_OF, Option("ATTRIBUTE")] = None
    """vary an attribute from 0 to 1, or 'all' in turn"""
    theme: Annotated[str | None, ONE_OF, Option("THEME")] = None
    """streets with more of one feature, such as bends, or 'all' themes"""
    asset: Annotated[str | None, ONE_OF, Option("CLASS")] = None
    """assets of a class or family, or of 'all'"""
    overlap: Annotated[str, Option(choices=OVERLAPS, excludes=("--asset",))] = ""
    """whether objects may overlap; by default only in space scenex"""
    weather: Annotated[str, Option(choices=WEATHERS, excludes=("--asset",))] = ""
    """weather of all streets; by default it varies"""
    attributes: Annotated[str, Option(choices=NAMES, excludes=MODES)] = "default"
    """attributes of the streets"""
    streets: Annotated[int, Option("N", excludes=("--sweep", "--asset"))] = 3
    """number of streets"""
    shots: Annotated[int, Option("N", excludes=MODES)] = 4
    """images per street"""
    size: Size | None = None
    """image size in pixels; by default it suits the page"""
    seed: Annotated[int, Option("N", excludes=("--asset",))] = 0
    """random seed"""
    space: Annotated[SpaceName, Option(excludes=MODES)] = "scenex"
    """attributes of the streets"""
    renderer: Annotated[str, Option(choices=(*RENDERERS, "both"))] = "embree"
    """rendering engine"""
    steps: Annotated[int, Option("N", needs=("--sweep",))] = 7
    """number of values in a sweep"""
    count: Annotated[int, Option("N", needs=("--asset",))] = 12
    """number of assets per class"""
    columns: Annotated[int | None, Option("N", needs=("--asset",))] = None
    """assets per row"""


@dataclass(frozen=True, kw_only=True)
class Catalogue:
    """Options of `sdr-jax catalogue`."""

    json: Annotated[bool, ONE_OF, SWITCH] = False
    """print the number of assets of each class as JSON"""
    closest: Annotated[str | None, ONE_OF, Option("CLASS")] = None
    """print the most similar assets of a class or family, or of 'all'"""
    pairs: Annotated[int, Option("N", needs=("--closest",))] = 10
    """number of pairs to print"""


render = partial(command_line, "render", Render, "scene.render", {
    "rendering": ("renderer", "samples", "executor", "scheduler"),
    "assets": (*ASSETS, "asset_count", "own_asset", "own_class", "own_place"),
})  # fmt: skip
check = partial(command_line, "check", Check, "scene.check")
stats = partial(command_line, "stats", Stats, "scene.stats")
preview = partial(command_line, "preview", Preview, "scene.preview", {
    "page": ("space", "renderer", "steps", "count", "columns"), "assets": ASSETS,
})  # fmt: skip
catalogue = partial(command_line, "catalogue", Catalogue, "scene.assets")
"""Functions that make the command lines."""
