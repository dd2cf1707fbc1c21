"""The command lines of commands that are no jobs, without their work: a help loads no net."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from common.flags import ARGUMENT, REPEATED, SWITCH, Option, Size, command_line
from common.labels.target_file import SHIPPED
from common.labels.target_file import Fit as Shape
from experiments.config.config import FitPreset
from scene.attributes import SpaceName
from scene.names import HELD
from seg.names import As
from seg.settings import Trunk, TrunkName

TARGET = f"the target: {', '.join(SHIPPED)}, or a target's file; by default DATA/target.yaml"
PORT, REPORT_PORT = 8420, 8421
"""Ports of the playground and of a served report."""
WORST = 6
"""Number of images that `sdr-jax evaluate` shows."""


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Options of `sdr-jax doctor`."""

    data: Annotated[Path | None, ARGUMENT, Option("DATA", nargs="?")] = None
    """folder of labelled images"""
    target: Annotated[str | None, Option("NAME|FILE")] = None
    """the file that describes them; by default one is proposed"""
    write: Annotated[Path | None, Option("FILE")] = None
    """where to write the proposed file"""
    out: Annotated[Path | None, Option("DIR")] = None
    """folder of the page and the picture (default: runs/doctor)"""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Options of `sdr-jax fit`."""

    data: Annotated[Path, ARGUMENT, Option("DATA")]
    """folder of images and labels"""
    out: Annotated[Path, Option("DIR")]
    """folder of the run"""
    target: Annotated[str | None, Option("NAME|FILE")] = None
    """the data's target, if DATA has no target.yaml"""
    few: Annotated[int | None, Option("N")] = None
    """use the labels of N images only, spread over groups and time"""
    holdout: Annotated[str | None, Option("GROUP")] = None
    """report on this group; no figure comes from nets that have seen it"""
    search: Annotated[bool, SWITCH] = False
    """learn streets, too, for each fold; its cost is printed first"""
    preset: FitPreset | None = None
    """smoke: a minute; quick: minutes of a CPU; full: the backbone trains, too, at up to 480x360 (the default
    on a GPU; hours of a CPU)"""
    size: Size | None = None
    """size of the images for networks; by default the photographs' own up to about 480x360, or the largest
    that takes ten minutes"""
    minutes: Annotated[float | None, Option("N", excludes=("--size",))] = None
    """the largest size that takes N minutes instead"""
    shape: Shape | None = None
    """pad or cut images of another shape; by default as the target's file says"""
    fix: Annotated[tuple[str, ...], REPEATED, Option("NAME=VALUE", help=HELD)] = ()
    seeds: Annotated[int, Option("N")] = 3
    """nets of each row and fold"""
    workers: Annotated[int | None, Option("N")] = None
    """processes; by default one for each core"""
    init: Annotated[Path | None, Option("MODEL")] = None
    """model from which the saved net starts; the tested nets do not"""
    store: Annotated[Path | None, Option("FILE")] = None
    """evaluations that runs share"""
    net: TrunkName = "lite0"
    """trunk on whose features a head is trained; docs/howto/net.md"""
    trunk: Trunk | None = None
    """tuned: train the backbone, too, which takes hours of a core; by default frozen, but with --preset full
    tuned"""
    weights: Annotated[Path | None, Option("FILE")] = None
    """for dinov2: model.safetensors in Hugging Face's layout"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average over the mirror image: half the time, about half a point less"""


@dataclass(frozen=True, kw_only=True)
class Predict:
    """Options of `sdr-jax predict`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or a name: renders19"""
    images: Annotated[Path, ARGUMENT, Option("IMAGES")]
    """image, video or folder"""
    out: Annotated[Path, Option("DIR")]
    """folder of the results"""
    how: Annotated[As | None, Option(flag="--as")] = None
    """content of the PNGs: ids of the model's own label files, their colours, or the image with colours over
    it; by default ids, or colours if the model's label files have these"""
    probabilities: Annotated[bool, SWITCH] = False
    """beside each PNG NAME.npy, float16 of height, width and classes: the probabilities of classes"""
    rank: Annotated[bool, SWITCH] = False
    """order images, the least certain first, and write pre-labels for CVAT and Label Studio"""
    first: Annotated[int, Option("N", needs=("--rank",))] = 100
    """with --rank: images with pre-labels"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average over the mirror image: half the time, about half a point less"""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Options of `sdr-jax evaluate`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or a name: renders19"""
    data: Annotated[Path, ARGUMENT, Option("DATA")]
    """folder of labelled images"""
    target: Annotated[str | None, Option("NAME|FILE", help=TARGET)] = None
    split: Annotated[tuple[str, ...], Option("NAME", nargs="+")] = ()
    """splits to test on; by default test or val, or all if there is neither"""
    group: Annotated[tuple[str, ...], Option("NAME", nargs="+")] = ()
    """drives, cities or albums; by default all"""
    json: Annotated[Path | None, Option("FILE")] = None
    """also write the figures into a file"""
    pictures: Annotated[Path | None, Option("DIR")] = None
    """folder for the 6 worst images, labels and predictions"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average over the mirror image: half the time, about half a point less"""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Options of `sdr-jax export`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or a name: renders19"""
    onnx: Annotated[Path, Option("FILE")]
    """the file to write"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average over the mirror image: half the time, about half a point less"""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Options of `sdr-jax report`."""

    run: Annotated[Path, ARGUMENT, Option("RUN")]
    """run folder"""
    out: Annotated[Path | None, Option("FILE")] = None
    """the page; by default RUN/report.html"""
    serve: Annotated[int | None, Option("PORT", nargs="?", const=REPORT_PORT)] = None
    """show the page to this machine, also while the run goes on; 8421 unless told"""


@dataclass(frozen=True, kw_only=True)
class Store:
    """Options of `sdr-jax store`."""

    command: Annotated[Literal["show", "merge"], ARGUMENT]
    """what to do"""
    files: Annotated[tuple[Path, ...], ARGUMENT, Option("FILE", nargs="+")]
    """stores, or run folders"""
    out: Annotated[Path | None, Option("FILE")] = None
    """the new store that merge writes"""


@dataclass(frozen=True, kw_only=True)
class Playground:
    """Options of `sdr-jax playground`."""

    port: Annotated[int, Option("N")] = PORT
    """of 127.0.0.1"""
    no_browser: Annotated[bool, SWITCH] = False
    """only serve; open no browser"""
    attributes: Annotated[str, Option("NAME|FILE")] = "default"
    """default, random, mixed, or a JSON file to begin with"""
    space: SpaceName | None = None
    """attributes of streets given by name (default: scenex)"""
    real: Annotated[Path | None, Option("DIR")] = None
    """real images to look at beside the street"""
    size: Size = (480, 270)
    """in pixels"""
    samples: Annotated[int, Option("N")] = 2
    """rays per pixel along each axis"""
    seed: Annotated[int, Option("N")] = 0
    """seed of the street"""
    shots: Annotated[int, Option("N")] = 6
    """images per street"""
    assets: Annotated[str, Option("DIR")] = ""
    """folder of your own assets"""


doctor = partial(command_line, "doctor", Doctor, "experiments.doctor")
fit = partial(command_line, "fit", Fit, "experiments.fit", {"net": ("net", "trunk", "weights")})
predict = partial(command_line, "predict", Predict, "experiments.predict")
evaluate = partial(command_line, "evaluate", Evaluate, "experiments.evaluate")
export = partial(command_line, "export", Export, "experiments.export")
report = partial(command_line, "report", Report, "experiments.report")
store = partial(command_line, "store", Store, "experiments.store")
playground = partial(command_line, "playground", Playground, "experiments.playground")
"""What makes each command line."""
