"""Reads named arrays from any kind of weights file; the first bytes tell the kind."""

import math
import shlex
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from seg.errors import WeightsError
from seg.weights.safetensors_file import read_safetensors
from seg.weights.tensors import LARGEST
from seg.weights.torch_file import read_legacy, read_zip

_KINDS = "a .pth of torch.save, .safetensors or .npz"
_HDF5 = b"\x89HDF\r\n\x1a\n"


def read(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of a weights file by name, whatever the file is called.

    It may be a `.pth`, `.safetensors` or `.npz`.

    Raises:
        WeightsError: there is no such file, or it is damaged or of an unknown kind.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(9)
        if head.startswith(b"PK\x03\x04"):
            return _read_archive(path)
        if head.startswith(_HDF5):
            raise _keras(path)
        if head[8:9] == b"{":
            return read_safetensors(path)
        if head.startswith(b"\x80"):
            return read_legacy(path)
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror or error}; expected {_KINDS}") from None
    raise WeightsError(f"{path}: no file of weights; expected {_KINDS}")


def _read_archive(path: Path) -> dict[str, np.ndarray]:
    """Read one of the two kinds that are zip archives."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except zipfile.BadZipFile as error:
        raise WeightsError(f"{path}: a damaged zip archive ({error})") from None
    if any(name.endswith((".h5", ".hdf5")) for name in names):
        raise _keras(path)
    return read_npz(path) if any(name.endswith(".npy") for name in names) else read_zip(path)


def _keras(path: Path) -> WeightsError:
    command = f"python -m scripts.convert_weights {shlex.quote(str(path))} --out vgg16.safetensors"
    return WeightsError(f"{path}: Keras's .h5 is not read; in a checkout, convert it: {command}")


def read_npz(path: Path, only: tuple[str, ...] | None = None) -> dict[str, np.ndarray]:
    """Read the arrays of a `.npz` file: those of `only` that it has, or all for None.

    Raises:
        WeightsError: it cannot be read, is damaged, or holds other objects than arrays.
    """
    try:
        with open(path, "rb") as file:
            if file.read(8) == _HDF5:
                raise _keras(path)
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files if only is None else [n for n in archive.files if n in only]
            _refuse_bomb(archive.zip, [f"{name}.npy" for name in names], path)
            return {name: archive[name] for name in names}
    except WeightsError:
        raise
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror or error}") from None
    except Exception as error:  # zipfile, zlib and NumPy have different errors
        raise WeightsError(f"{path}: a damaged .npz, or not of plain arrays ({error})") from None


def _refuse_bomb(archive: zipfile.ZipFile, names: list[str], path: Path) -> None:
    """Raise WeightsError for arrays that are larger than VGG16's, or than their data in the archive."""
    total = 0
    for name in names:
        info = archive.getinfo(name)
        with archive.open(info) as file:
            shape, dtype = _npy_header(file)
        size = math.prod(shape) * dtype.itemsize
        total += max(size, info.file_size)
        if size > info.file_size:
            raise WeightsError(f"{path}: {name} says {list(shape)}, and is cut short")
        if total > LARGEST:
            raise WeightsError(f"{path}: {total:,} bytes of arrays; VGG16 has 553,433,888")


def _npy_header(file: Any) -> tuple[tuple[int, ...], np.dtype]:
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        read_header = np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(file)
    return shape, dtype
