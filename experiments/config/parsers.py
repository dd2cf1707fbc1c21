"""The command lines of commands that are no jobs, without their work: a help loads no net."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from scene.attributes import SPACES
from scene.names import HELD
from seg.names import As
from seg.settings import Trunk, TrunkName
from shell.command import Parser, docstring, size
from shell.target_file import SHIPPED, Fit

PORT, REPORT_PORT = 8420, 8421
"""Ports of the playground and of a served report."""
WORST = 6
"""Number of images that `sdr-jax evaluate` shows."""


def doctor() -> Parser:
    """The command line of `sdr-jax doctor`."""
    options = Parser("doctor", docstring("experiments.doctor"))
    add = options.add_argument
    add("data", type=Path, nargs="?", metavar="DATA", help="folder of labelled images")
    add(
        "--target",
        metavar="NAME|FILE",
        help="the file that describes them; by default one is proposed",
    )
    add("--write", type=Path, metavar="FILE", help="where to write the proposed file")
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the page and the picture (default: runs/doctor)",
    )
    return options


def _no_mirror(options: Parser) -> None:
    """Add the flag of all commands that use a network."""
    options.add_argument(
        "--no-mirror",
        dest="mirror",
        action="store_false",
        help="do not average over the mirror image: half the time, about half a point less",
    )


def fit() -> Parser:
    """The command line of `sdr-jax fit`."""
    options = Parser("fit", docstring("experiments.fit"))
    add = options.add_argument
    add("data", type=Path, metavar="DATA", help="folder of images and labels")
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    add("--target", metavar="NAME|FILE", help="the data's target, if DATA has no target.yaml")
    add(
        "--few",
        type=int,
        metavar="N",
        help="use the labels of N images only, spread over groups and time",
    )
    add(
        "--holdout",
        metavar="GROUP",
        help="report on this group; no figure comes from nets that have seen it",
    )
    add(
        "--search",
        action="store_true",
        help="learn streets, too, for each fold; its cost is printed first",
    )
    add("--preset", choices=("smoke", "quick"), default="quick", help="how much is spent")
    add(
        "--size",
        type=size,
        metavar="WxH",
        help="size of the images for networks; by default the photographs' own up to about 480x360, or "
        "the largest that takes ten minutes",
    )
    add("--minutes", type=float, metavar="N", help="the largest size that takes N minutes instead")
    options.excludes("--minutes", "--size")
    add(
        "--shape",
        choices=get_args(Fit),
        help="pad or cut images of another shape; by default as the target's file says",
    )
    add("--fix", action="append", default=[], metavar="NAME=VALUE", help=HELD)
    add("--seeds", type=int, default=3, metavar="N", help="nets of each row and fold")
    add("--workers", type=int, metavar="N", help="processes; by default one for each core")
    add(
        "--init",
        type=Path,
        metavar="MODEL",
        help="model from which the saved net starts; the tested nets do not",
    )
    add("--store", type=Path, metavar="FILE", help="evaluations that runs share")
    _no_mirror(options)
    add = options.group("net")
    add(
        "--net",
        choices=get_args(TrunkName),
        default="lite0",
        help="trunk on whose features a head is trained; docs/howto/net.md",
    )
    add(
        "--trunk",
        choices=get_args(Trunk),
        default="frozen",
        help="tuned: train the trunk, too, which takes hours of a core",
    )
    add(
        "--weights",
        type=Path,
        metavar="FILE",
        help="for dinov2: model.safetensors in Hugging Face's layout",
    )
    return options


def predict() -> Parser:
    """The command line of `sdr-jax predict`."""
    options = Parser("predict", docstring("experiments.predict"))
    add = options.add_argument
    add("model", metavar="MODEL", help="folder of a model, or a name: renders19")
    add("images", type=Path, metavar="IMAGES", help="image, video or folder")
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the results")
    add(
        "--as",
        dest="how",
        choices=get_args(As),
        help="content of the PNGs: ids of the model's own label files, their colours, or the image with "
        "colours over it; by default ids, or colours if the model's label files have these",
    )
    add(
        "--probabilities",
        action="store_true",
        help="beside each PNG NAME.npy, float16 of height, width and classes: the probabilities of classes",
    )
    add(
        "--rank",
        action="store_true",
        help="order images, the least certain first, and write pre-labels for CVAT and Label Studio",
    )
    add(
        "--first",
        type=int,
        default=100,
        metavar="N",
        help="with --rank: images with pre-labels",
    )
    _no_mirror(options)
    options.needs("--first", "--rank")
    return options


def evaluate() -> Parser:
    """The command line of `sdr-jax evaluate`."""
    options = Parser("evaluate", docstring("experiments.evaluate"))
    add = options.add_argument
    add("model", metavar="MODEL", help="folder of a model, or a name: renders19")
    add("data", type=Path, metavar="DATA", help="folder of labelled images")
    add(
        "--target",
        metavar="NAME|FILE",
        help=f"the target: {', '.join(SHIPPED)}, or a target's file; by default DATA/target.yaml",
    )
    add(
        "--split",
        nargs="+",
        default=[],
        metavar="NAME",
        help="splits to test on; by default test or val, or all if there is neither",
    )
    add(
        "--group",
        nargs="+",
        default=[],
        metavar="NAME",
        help="drives, cities or albums; by default all",
    )
    add("--json", type=Path, metavar="FILE", help="also write the figures into a file")
    add(
        "--pictures",
        type=Path,
        metavar="DIR",
        help=f"folder for the {WORST} worst images, labels and predictions",
    )
    _no_mirror(options)
    return options


def export() -> Parser:
    """The command line of `sdr-jax export`."""
    options = Parser("export", docstring("experiments.export"))
    options.add_argument("model", metavar="MODEL", help="folder of a model, or a name: renders19")
    options.add_argument(
        "--onnx", type=Path, required=True, metavar="FILE", help="the file to write"
    )
    _no_mirror(options)
    return options


def report() -> Parser:
    """The command line of `sdr-jax report`."""
    options = Parser("report", docstring("experiments.report"))
    options.add_argument("run", type=Path, metavar="RUN", help="run folder")
    options.add_argument(
        "--out", type=Path, metavar="FILE", help="the page; by default RUN/report.html"
    )
    options.add_argument(
        "--serve",
        type=int,
        nargs="?",
        const=REPORT_PORT,
        metavar="PORT",
        help=f"show the page to this machine, also while the run goes on; {REPORT_PORT} unless told",
    )
    return options


def store() -> Parser:
    """The command line of `sdr-jax store`."""
    options = Parser("store", docstring("experiments.store"))
    options.add_argument("command", choices=("show", "merge"), help="what to do")
    options.add_argument(
        "files", type=Path, nargs="+", metavar="FILE", help="stores, or run folders"
    )
    options.add_argument("--out", type=Path, metavar="FILE", help="the new store that merge writes")
    return options


def playground() -> Parser:
    """The command line of `sdr-jax playground`."""
    options = Parser("playground", docstring("experiments.playground"))
    add = options.add_argument
    add("--port", type=int, default=PORT, metavar="N", help="of 127.0.0.1")
    add("--no-browser", action="store_true", help="only serve; open no browser")
    add(
        "--attributes",
        default="default",
        metavar="NAME|FILE",
        help="default, random, mixed, or a JSON file to begin with",
    )
    add("--space", choices=SPACES, help="attributes of streets given by name (default: scenex)")
    add("--real", type=Path, metavar="DIR", help="real images to look at beside the street")
    add("--size", type=size, default="480x270", metavar="WxH", help="in pixels")
    add("--samples", type=int, default=2, metavar="N", help="rays per pixel along each axis")
    add("--seed", type=int, default=0, metavar="N", help="seed of the street")
    add("--shots", type=int, default=6, metavar="N", help="images per street")
    add("--assets", default="", metavar="DIR", help="folder of your own assets")
    return options
