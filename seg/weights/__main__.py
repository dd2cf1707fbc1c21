"""Converts ImageNet weights of VGG16, once, into the file that training starts from.

    python -m seg.weights convert vgg16-397923af.pth --out vgg16.npz

Reads .pth of torch.save (nothing in it is run, PyTorch is not needed), .safetensors and .npz, with the
names of torchvision or timm, or conv1_1/kernel, conv1_1/bias ... fc7/bias. Then, for example,
TrainSettings(net="fcn8s", weights="vgg16.npz").
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from seg.weights import NORMALISATIONS, convert
from shell.command import Parser, exit_code


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = Parser("seg.weights", __doc__)
    parser.add_argument("convert", choices=["convert"], help="check a file, write it as .npz")
    parser.add_argument("file", type=Path, help=".pth, .safetensors or .npz")
    parser.add_argument("--out", type=Path, required=True, help="the .npz file to write")
    parser.add_argument(
        "--normalisation",
        choices=NORMALISATIONS,
        help="which images the weights expect: torchvision (RGB in [0, 1], minus mean, by deviation; "
        "the default for torchvision's names) or caffe (BGR in 0..255, minus mean)",
    )
    options = parser.parse_args(arguments)

    def work() -> None:
        expected = convert(options.file, options.out, options.normalisation)
        print(f"{options.out}: VGG16 of {options.file}, which expected {expected}'s images")

    return exit_code(work)


if __name__ == "__main__":
    sys.exit(main())
