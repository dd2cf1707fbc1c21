"""Write a model as an ONNX file, for onnxruntime and other programs.

    sdr-jax export runs/fit/model --onnx model.onnx

The input is `image`, u8[1, height, width, 3], RGB at the model's size. The outputs are `labels`, u8[1,
height, width], indices of the classes, and `logits`. The file's metadata has the names of the classes. The
command needs the extra onnx: pip install 'sdr-jax[onnx]'.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.export import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
