"""Converts ImageNet weights of VGG16, once, into the file that training starts from.

    python -m seg.weights convert vgg16-397923af.pth --out vgg16.npz

Reads .pth of torch.save (nothing in it is run, PyTorch is not needed), .safetensors and .npz, with the
names of torchvision or timm, or conv1_1/kernel, conv1_1/bias ... fc7/bias. Then, for example,
TrainSettings(net="fcn8s", weights="vgg16.npz").
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from seg.weights import NORMALISATIONS, WeightsError, convert


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m seg.weights",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command = parser.add_subparsers(required=True, metavar="convert").add_parser(
        "convert", help="check a file of weights and write it as .npz"
    )
    command.add_argument("file", type=Path, help=".pth, .safetensors or .npz")
    command.add_argument("--out", type=Path, required=True, help="the .npz file to write")
    command.add_argument(
        "--normalisation",
        choices=NORMALISATIONS,
        help="which images the weights expect: torchvision (RGB in [0, 1], minus mean, by deviation; "
        "the default for torchvision's names) or caffe (BGR in 0..255, minus mean)",
    )
    options = parser.parse_args(arguments)
    try:
        normalisation = convert(options.file, options.out, options.normalisation)
    except WeightsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    print(f"{options.out}: VGG16 of {options.file}, which expected {normalisation}'s images")
    return 0


if __name__ == "__main__":
    sys.exit(main())
