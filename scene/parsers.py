"""The command lines of `scene` without their work: a help text loads no renderer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from common.flags import ARGUMENT, ONE_OF, REPEATED, SWITCH, Option, Size, command_line
from common.labels.target_file import SHIPPED
from common.workers.pool import ExecutorName
from scene.attributes import SpaceName
from scene.dataset.formats.layout import FORMATS, SPLITS
from scene.names import HELD, OVERLAPS, OWN_EVERY, PLACES, RENDERERS, USES, WEATHERS
from scene.proposal import NAMES

TARGET = (
    "write labels of these classes, in the ids or colours of its label files: "
    f"{', '.join(SHIPPED)}, or a target's file"
)
OWN = (
    "GLB of a class of your own; about eleven stand in a street, one on every "
    f"{OWN_EVERY} m where there is room"
)
MODES = ("--sweep", "--theme", "--asset")
"""What a preview may show instead of streets."""


@dataclass(frozen=True, kw_only=True)
class Assets:
    """What streets draw from."""

    assets: Annotated[str, Option("DIR")] = ""
    """folder of your own assets, see docs/howto/assets.md"""
    asset_use: Annotated[str, Option(choices=USES)] = "both"
    """which assets may appear"""
    overlap: Annotated[str, Option(choices=OVERLAPS)] = ""
    """whether objects may stand in each other; by default they may in space scenex only"""
    weather: Annotated[str, Option(choices=WEATHERS)] = ""
    """of all streets; by default each has its own"""
    asset_fraction: Annotated[float, Option("SHARE")] = 1.0
    """of the assets, used"""


ASSETS = ("assets", "asset_use", "overlap", "weather", "asset_fraction")


@dataclass(frozen=True, kw_only=True)
class Render(Assets):
    """Options of `sdr-jax render`."""

    out: Annotated[Path, Option("DIR")]
    """folder of the dataset"""
    attributes: Annotated[str, Option("NAME|FILE")] = "default"
    """default (around a hand-set street), random, mixed (half of either), or a JSON file: a run's
    attributes.json, or every attribute's name with a value in [0, 1]"""
    space: SpaceName | None = None
    """attributes of streets given by name (default: scenex)"""
    fix: Annotated[tuple[str, ...], REPEATED, Option("NAME=VALUE", help=HELD)] = ()
    images: Annotated[int, Option("N")] = 180
    """images in all; each shows a different street, unless --shots says otherwise"""
    shots: Annotated[int, Option("N")] = 1
    """images along each street"""
    size: Size = (640, 320)
    """in pixels"""
    format: Annotated[str, Option(choices=FORMATS)] = "cityscapes"
    """layout, see docs/datasets.md"""
    target: Annotated[str | None, Option("NAME|FILE", help=TARGET)] = None
    split: Annotated[str, Option(choices=SPLITS)] = "train"
    """what the dataset calls its images"""
    seed: Annotated[int, Option("N")] = 0
    """seed of all random choices"""
    workers: Annotated[int, Option("N")] = 2
    """processes; no file depends on it"""
    renderer: Annotated[str, Option(choices=RENDERERS)] = "embree"
    """who traces the rays"""
    samples: Annotated[int, Option("N")] = 2
    """rays per pixel along each axis"""
    executor: ExecutorName = "processes"
    """who works: processes of this machine, or a Dask cluster, see docs/cluster.md"""
    scheduler: Annotated[str | None, Option("ADDRESS")] = None
    """of the cluster, such as tcp://10.0.0.1:8786"""
    asset_count: Annotated[int | None, Option("N")] = None
    """built-in assets of each family; by default all"""
    own_asset: Annotated[str | None, Option("FILE", help=OWN)] = None
    own_class: Annotated[str | None, Option("NAME")] = None
    """its name in labels, beside the 19 classes"""
    own_place: Annotated[str | None, Option(choices=PLACES)] = None
    """where it stands; by default the sidewalk"""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Options of `sdr-jax check`."""

    dataset: Annotated[Path | None, ARGUMENT, Option("DIR", nargs="?")] = None
    """folder of the dataset"""
    overlaps: Annotated[int | None, Option("N")] = None
    """instead of a dataset: count overlaps in N hand-set and N random streets"""
    overlap: Annotated[str, Option(choices=OVERLAPS, needs=("--overlaps",))] = ""
    """whether their objects may; see render"""
    space: Annotated[SpaceName, Option(needs=("--overlaps",))] = "extended"
    """attributes of these streets"""


@dataclass(frozen=True, kw_only=True)
class Stats:
    """Options of `sdr-jax stats`."""

    dataset: Annotated[Path, ARGUMENT, Option("DIR")]
    """folder that `sdr-jax render` wrote"""
    against: Annotated[Path | None, Option("DIR")] = None
    """folder of CamVid, of Cityscapes or of another dataset"""
    only: Annotated[tuple[str, ...], REPEATED, Option("PREFIX")] = ()
    """of real images, only those called PREFIX...; may be given again"""
    json: Annotated[Path | None, Option("FILE")] = None
    """file for the same figures"""


@dataclass(frozen=True, kw_only=True)
class Preview(Assets):
    """Options of `sdr-jax preview`."""

    out: Annotated[Path, Option("FILE")]
    """PNG or JPEG file to write"""
    sweep: Annotated[str | None, ONE_OF, Option("ATTRIBUTE")] = None
    """an attribute from 0 to 1; or 'all'"""
    theme: Annotated[str | None, ONE_OF, Option("THEME")] = None
    """more of one thing, such as bends; or 'all'"""
    asset: Annotated[str | None, ONE_OF, Option("CLASS")] = None
    """assets of a class or family; or 'all'"""
    attributes: Annotated[str, Option(choices=NAMES, excludes=MODES)] = "default"
    """attributes of the streets"""
    streets: Annotated[int, Option("N")] = 3
    """streets of the page"""
    shots: Annotated[int, Option("N")] = 4
    """images per street"""
    size: Size | None = None
    """size of images; by default what suits the page"""
    seed: Annotated[int, Option("N")] = 0
    """seed of all random choices"""
    space: Annotated[SpaceName, Option(excludes=MODES)] = "scenex"
    """attributes of the streets"""
    renderer: Annotated[str, Option(choices=(*RENDERERS, "both"))] = "embree"
    """who traces the rays"""
    steps: Annotated[int, Option("N", needs=("--sweep",))] = 7
    """values of a sweep"""
    count: Annotated[int, Option("N", needs=("--asset",))] = 12
    """assets of a class"""
    columns: Annotated[int | None, Option("N", needs=("--asset",))] = None
    """assets in a row"""


@dataclass(frozen=True, kw_only=True)
class Catalogue:
    """Options of `sdr-jax catalogue`."""

    json: Annotated[bool, ONE_OF, SWITCH] = False
    """print {class: count}"""
    closest: Annotated[str | None, ONE_OF, Option("CLASS")] = None
    """class or family; 'all' for every one"""
    pairs: Annotated[int, Option("N", needs=("--closest",))] = 10
    """pairs to print with --closest"""


render = partial(command_line, "render", Render, "scene.render", {
    "where and how it renders": ("renderer", "samples", "executor", "scheduler"),
    "assets": (*ASSETS, "asset_count", "own_asset", "own_class", "own_place"),
})  # fmt: skip
check = partial(command_line, "check", Check, "scene.check")
stats = partial(command_line, "stats", Stats, "scene.stats")
preview = partial(command_line, "preview", Preview, "scene.preview", {
    "what is on the page": ("space", "renderer", "steps", "count", "columns"), "assets": ASSETS,
})  # fmt: skip
catalogue = partial(command_line, "catalogue", Catalogue, "scene.assets")
"""What makes each command line."""
