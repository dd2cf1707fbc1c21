"""Write a model as an ONNX file, for onnxruntime and other programs.

    sdr-jax export runs/fit/model --onnx model.onnx

The input is `image`, u8[1, height, width, 3], RGB at the model's size. The outputs are `labels`, u8[1,
height, width], indices of the classes, and `logits`. The file's metadata has the names of the classes. The
command needs the extra onnx: pip install 'sdr-jax[onnx]'.
"""

from __future__ import annotations

from pathlib import Path

from common.command import Arguments, exit_code
from common.files import check_file, write
from experiments.config import parsers
from seg.model import Model, load_model
from seg.onnx_graph import onnx_bytes


def export(model: Model | str | Path, path: str | Path) -> int:
    """Write a model as an ONNX file, whole or not at all, and return the number of bytes.

    Args:
        model: a model, its folder, or the name of one that comes with the package.
        path: the file.

    Raises:
        UserError: there is no model, the package onnx is missing, or ONNX cannot express the model.
        OSError: the file cannot be written; the error names it.
    """
    check_file("--onnx", Path(path))
    model = model if isinstance(model, Model) else load_model(model)
    return write(Path(path), onnx_bytes(model))


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.export().parse_args(arguments)

    def work() -> None:
        model = load_model(options.model, mirror=not options.no_mirror)
        size = export(model, options.onnx)
        print(f"{options.onnx}: {size / 1e6:.1f} MB")

    return exit_code(work, debug=options.debug, resumes=False)
