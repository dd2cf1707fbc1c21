"""Reads named arrays from any file that weights come in; what it is, its first bytes say."""

import zipfile
from pathlib import Path

import numpy as np

from seg.errors import WeightsError
from seg.weights.safetensors_file import read_safetensors
from seg.weights.torch_file import read_legacy, read_zip

_KINDS = "a .pth of torch.save, .safetensors, or .npz"


def read(path: Path) -> dict[str, np.ndarray]:
    """Read a `.pth`, `.safetensors` or `.npz` file, whatever its name: its arrays by name.

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
    """Read the arrays of a `.npz` file; of the names in `only` those that there are, None for all.

    Raises:
        WeightsError: it cannot be read, is damaged, or holds objects other than arrays.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files if only is None else [n for n in archive.files if n in only]
            return {name: archive[name] for name in names}
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror or error}") from None
    except Exception as error:  # zipfile, zlib and NumPy each have their own
        raise WeightsError(f"{path}: a damaged .npz, or not of plain arrays ({error})") from None
