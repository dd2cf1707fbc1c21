"""Reads named arrays from any file that weights come in; what it is, its first bytes say."""

import zipfile
from pathlib import Path

import numpy as np

from seg.weights.errors import WeightsError
from seg.weights.safetensors_file import read_safetensors
from seg.weights.torch_file import read_legacy, read_zip

_KINDS = "a .pth of torch.save, .safetensors, or .npz"


def read(path: Path) -> dict[str, np.ndarray]:
    """Read a `.pth`, `.safetensors` or `.npz` file.

    Args:
        path: the file; its name does not matter.

    Returns:
        Arrays by name, as they are in the file.

    Raises:
        WeightsError: there is no such file, it is damaged, or of no kind that is known.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(9)
        if head.startswith(b"PK\x03\x04"):
            return read_npz(path) if _is_npz(path) else read_zip(path)
        if head[8:9] == b"{":
            return read_safetensors(path)
        if head.startswith(b"\x80"):
            return read_legacy(path)
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror or error}") from None
    raise WeightsError(f"{path}: no file of weights; expected {_KINDS}")


def _is_npz(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.endswith(".npy") for name in archive.namelist())
    except zipfile.BadZipFile as error:
        raise WeightsError(f"{path}: a damaged zip archive ({error})") from None


def read_npz(path: Path, only: tuple[str, ...] | None = None) -> dict[str, np.ndarray]:
    """Read the arrays of a `.npz` file.

    Args:
        path: the file.
        only: read those of these names that there are; None for all.

    Returns:
        Arrays by name.

    Raises:
        WeightsError: damaged, or it holds objects other than arrays.
        OSError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files if only is None else [n for n in archive.files if n in only]
            return {name: archive[name] for name in names}
    except OSError:
        raise
    except Exception as error:  # zipfile, zlib and NumPy each have their own
        raise WeightsError(f"{path}: a damaged .npz, or not of plain arrays ({error})") from None
