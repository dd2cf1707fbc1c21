"""The command lines of all commands but the optimisations; they import no work, so help is fast."""

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
from seg.settings import BackboneName, BackboneTraining

TARGET = f"{', '.join(SHIPPED)}, or a target file; by default DATA/target.yaml"
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
    """target that describes the folder; by default doctor proposes one"""
    write: Annotated[Path | None, Option("FILE")] = None
    """write the proposed target.yaml to this file"""
    out: Annotated[Path | None, Option("DIR")] = None
    """folder of the page (default: runs/doctor)"""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Options of `sdr-jax fit`."""

    data: Annotated[Path, ARGUMENT, Option("DATA")]
    """folder of images and labels"""
    out: Annotated[Path, Option("DIR")]
    """folder of the run"""
    target: Annotated[str | None, Option("NAME|FILE")] = None
    """target that describes DATA, if it has no target.yaml"""
    few: Annotated[int | None, Option("N")] = None
    """use only N labelled images, spread over groups and time"""
    holdout: Annotated[str | None, Option("GROUP")] = None
    """test on this group and train on the others"""
    search: Annotated[bool, SWITCH] = False
    """also optimise the streets for each fold, which seldom gains more; prints the cost first"""
    preset: FitPreset | None = None
    """smoke: one to three minutes; quick: minutes on a CPU; full: also trains the backbone, at up to 480x360
    (the default on a GPU; hours on a CPU)"""
    size: Size | None = None
    """size of the images for networks; by default that of your images up to about 480x360, or the largest
    that takes ten minutes"""
    minutes: Annotated[float | None, Option("N", excludes=("--size",))] = None
    """choose the largest size that takes N minutes"""
    shape: Shape | None = None
    """pad or cut images of another aspect ratio; by default as the target file says"""
    fix: Annotated[tuple[str, ...], REPEATED, Option("NAME=VALUE", help=HELD)] = ()
    seeds: Annotated[int, Option("N")] = 3
    """networks for each training set and fold"""
    workers: Annotated[int | None, Option("N")] = None
    """processes; by default one per core"""
    trainers: Annotated[int | None, Option("N")] = None
    """processes that only train, while the others render; by default one per GPU, none without"""
    init: Annotated[Path | None, Option("MODEL")] = None
    """start the saved model from this one; the tested networks start from scratch"""
    store: Annotated[Path | None, Option("FILE")] = None
    """file of evaluations to share between runs"""
    net: BackboneName = "lite0"
    """backbone under the segmentation head; see docs/howto/net.md"""
    backbone: BackboneTraining | None = None
    """tuned: also train the backbone, which takes hours of one core; default: frozen, or tuned with --preset
    full"""
    weights: Annotated[Path | None, Option("FILE")] = None
    """for dinov2: model.safetensors in Hugging Face's layout"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average with the mirrored image: twice as fast, about half a point lower"""


@dataclass(frozen=True, kw_only=True)
class Predict:
    """Options of `sdr-jax predict`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or renders19"""
    images: Annotated[Path, ARGUMENT, Option("IMAGES")]
    """image, video or folder"""
    out: Annotated[Path, Option("DIR")]
    """folder for the results"""
    how: Annotated[As | None, Option(flag="--as")] = None
    """content of the PNGs: class ids, class colours, or colours over the image; by default as in the label
    files on which the model was trained"""
    probabilities: Annotated[bool, SWITCH] = False
    """also write class probabilities as NAME.npy, float16 of shape height, width, classes"""
    rank: Annotated[bool, SWITCH] = False
    """rank images, least certain first, and write pre-labels for CVAT and Label Studio"""
    first: Annotated[int, Option("N", needs=("--rank",))] = 100
    """with --rank: number of images with pre-labels"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average with the mirrored image: twice as fast, about half a point lower"""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Options of `sdr-jax evaluate`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or renders19"""
    data: Annotated[Path, ARGUMENT, Option("DATA")]
    """folder of labelled images"""
    target: Annotated[str | None, Option("NAME|FILE", help=TARGET)] = None
    split: Annotated[tuple[str, ...], Option("NAME", nargs="+")] = ()
    """splits to test on; by default test or val, or all splits if there is neither"""
    group: Annotated[tuple[str, ...], Option("NAME", nargs="+")] = ()
    """groups to test on, such as sequences or cities; by default all"""
    json: Annotated[Path | None, Option("FILE")] = None
    """also write the scores to this file"""
    pictures: Annotated[Path | None, Option("DIR")] = None
    """folder for the 6 worst images with labels and predictions"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average with the mirrored image: twice as fast, about half a point lower"""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Options of `sdr-jax export`."""

    model: Annotated[str, ARGUMENT, Option("MODEL")]
    """folder of a model, or renders19"""
    onnx: Annotated[Path, Option("FILE")]
    """the file to write"""
    no_mirror: Annotated[bool, SWITCH] = False
    """do not average with the mirrored image: twice as fast, about half a point lower"""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Options of `sdr-jax report`."""

    run: Annotated[Path, ARGUMENT, Option("RUN")]
    """folder of a run"""
    out: Annotated[Path | None, Option("FILE")] = None
    """the page; by default RUN/report.html"""
    serve: Annotated[int | None, Option("PORT", nargs="?", const=REPORT_PORT)] = None
    """serve the page to a browser on this machine, also during the run (default port: 8421)"""


@dataclass(frozen=True, kw_only=True)
class Store:
    """Options of `sdr-jax store`."""

    command: Annotated[Literal["show", "merge"], ARGUMENT]
    """show what stores hold, or merge them"""
    files: Annotated[tuple[Path, ...], ARGUMENT, Option("FILE", nargs="+")]
    """stores or run folders"""
    out: Annotated[Path | None, Option("FILE")] = None
    """new store, for merge"""


@dataclass(frozen=True, kw_only=True)
class Playground:
    """Options of `sdr-jax playground`."""

    port: Annotated[int, Option("N")] = PORT
    """port on 127.0.0.1"""
    no_browser: Annotated[bool, SWITCH] = False
    """do not open a browser"""
    attributes: Annotated[str, Option("NAME|FILE")] = "default"
    """streets to start with: default, random, mixed, or an attributes.json"""
    space: SpaceName | None = None
    """attributes of the named streets (default: scenex)"""
    real: Annotated[Path | None, Option("DIR")] = None
    """folder of real images to compare the street with"""
    size: Size = (480, 270)
    """size of the image in pixels"""
    samples: Annotated[int, Option("N")] = 2
    """rays per pixel along each axis"""
    seed: Annotated[int, Option("N")] = 0
    """seed of the street"""
    shots: Annotated[int, Option("N")] = 6
    """images per street"""
    assets: Annotated[str, Option("DIR")] = ""
    """folder of your own assets"""


doctor = partial(command_line, "doctor", Doctor, "experiments.app.doctor.command")
fit = partial(
    command_line,
    "fit",
    Fit,
    "experiments.app.fit.command",
    {"network": ("net", "backbone", "weights")},
)
predict = partial(command_line, "predict", Predict, "experiments.app.predict")
evaluate = partial(command_line, "evaluate", Evaluate, "experiments.app.evaluate")
export = partial(command_line, "export", Export, "experiments.app.export")
report = partial(command_line, "report", Report, "experiments.app.report.command")
store = partial(command_line, "store", Store, "experiments.app.stores")
playground = partial(command_line, "playground", Playground, "experiments.app.playground.command")
"""Functions that make the parsers."""
