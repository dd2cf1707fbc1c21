"""Reads state dicts of `torch.save` without PyTorch: the zip format and the older one.

Source: torch/serialization.py, `_save` and `_legacy_save`; torchvision's files have version 1001 of the older
format.
"""

import zipfile
from collections.abc import Callable, Mapping
from io import BufferedIOBase, BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from seg.errors import WeightsError
from seg.weights import pickles
from seg.weights.tensors import Tensor, from_bytes, item_size

_MAGIC = 0x1950A86A20F9469CFC6C
_VERSION = 1001


def read_zip(path: Path) -> dict[str, np.ndarray]:
    """Read a state dict from a zip archive: one pickle, and one file per storage.

    Raises:
        WeightsError: damaged, or no state dict.
        OSError: it cannot be read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(info.file_size for info in archive.infolist()) > path.stat().st_size:
                raise WeightsError(f"{path}: its entries share their bytes; it is damaged")
            pickled = [n for n in archive.namelist() if n.rsplit("/", 1)[-1] == "data.pkl"]
            if len(pickled) != 1:
                raise WeightsError(
                    f"{path}: a zip archive, but not of torch.save (it has no data.pkl)"
                )
            root = pickled[0].removesuffix("data.pkl")
            if _entry(archive, f"{root}byteorder", b"little", path).strip() != b"little":
                raise WeightsError(f"{path}: written on a big-endian machine; save it on another")
            program = _entry(archive, pickled[0], None, path)
            value = pickles.load(BytesIO(program), str(path))

            def storage(key: str) -> bytes:
                return _entry(archive, f"{root}data/{key}", None, path)

            return _arrays(value, storage, path)
    except zipfile.BadZipFile as error:
        raise WeightsError(f"{path}: a damaged zip archive ({error})") from None


def _entry(archive: zipfile.ZipFile, name: str, default: bytes | None, path: Path) -> bytes:
    try:
        info = archive.getinfo(name)
    except KeyError:
        if default is not None:
            return default
        raise WeightsError(f"{path}: the entry {name} is missing; the file is damaged") from None
    if info.compress_type != zipfile.ZIP_STORED:
        raise WeightsError(f"{path}: {name} is compressed, which torch.save never does")
    return archive.read(info)


def read_legacy(path: Path) -> dict[str, np.ndarray]:
    """Read a state dict in the format before PyTorch 1.6: five pickles, then the storages.

    Raises:
        WeightsError: damaged, or no state dict.
        OSError: it cannot be read.
    """
    with open(path, "rb") as file:
        if pickles.load(file, str(path)) != _MAGIC:
            raise WeightsError(f"{path}: a pickle, but no state dict of torch.save")
        if pickles.load(file, str(path)) != _VERSION:
            raise WeightsError(f"{path}: torch.save of an unknown version; expected {_VERSION}")
        system = pickles.load(file, str(path))
        if not isinstance(system, dict) or not system.get("little_endian", True):
            raise WeightsError(f"{path}: written on a big-endian machine; save it on another")
        value = pickles.load(file, str(path))
        keys = pickles.load(file, str(path))
        if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
            raise WeightsError(f"{path}: its list of storages is damaged")
        sizes = {t.storage: t for t in _named(value, path).values()}
        storages = {key: _storage(file, sizes.get(key), key, path) for key in keys}

    def storage(key: str) -> bytes:
        if key not in storages:
            raise WeightsError(f"{path}: the storage {key} is missing; the file is damaged")
        return storages[key]

    return _arrays(value, storage, path)


def _storage(file: BufferedIOBase, tensor: Tensor | None, key: Any, path: Path) -> bytes:
    """Read the next storage: the number of elements, then the elements, whose size the pickle gives."""
    count = int.from_bytes(file.read(8), "little")
    if tensor is None or count != tensor.elements:
        raise WeightsError(f"{path}: the storage {key} has not the size it should; damaged?")
    size = count * item_size(tensor.dtype)
    if size > path.stat().st_size:
        raise WeightsError(f"{path}: the storage {key} is cut short; the file is damaged")
    return file.read(size)


def _named(value: Any, path: Path) -> dict[str, Tensor]:
    if not isinstance(value, Mapping):
        raise WeightsError(f"{path}: holds a {type(value).__name__}; expected a state dict")
    for name, tensor in value.items():
        if not isinstance(name, str) or not isinstance(tensor, Tensor):
            nested = "; save that one alone" if isinstance(tensor, Mapping) else ""
            raise WeightsError(
                f"{path}: {name!r} is a {type(tensor).__name__}; expected a state dict, "
                f"nothing but named tensors{nested}"
            )
        tensor.check(f"{path}: {name}")
    return dict(value)


def _arrays(value: Any, storage: Callable[[str], bytes], path: Path) -> dict[str, np.ndarray]:
    read: dict[str, np.ndarray] = {}
    arrays = {}
    for name, tensor in _named(value, path).items():
        if tensor.storage not in read:
            data = storage(tensor.storage)
            if len(data) != tensor.elements * item_size(tensor.dtype):
                raise WeightsError(f"{path}: {name}: its storage is cut short; the file is damaged")
            read[tensor.storage] = from_bytes(data, tensor.dtype)
        elif len(read[tensor.storage]) < tensor.elements:
            raise WeightsError(f"{path}: {name}: two sizes of one storage; the file is damaged")
        arrays[name] = tensor.view(read[tensor.storage])
    return arrays
