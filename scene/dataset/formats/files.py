"""Files of a dataset: PNG and JSON, written whole or not at all, and read with suspicion."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def png(plane: np.ndarray) -> bytes:
    """A picture, u8 or u16, [h, w] or RGB [h, w, 3], as a PNG file."""
    done, data = cv2.imencode(".png", plane[..., ::-1] if plane.ndim == 3 else plane)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {plane.shape} and type {plane.dtype}")
    return data.tobytes()


def png_fault(data: bytes) -> str | None:
    """What is wrong with the bytes of a PNG file: not one, cut short, or damaged; None if nothing.

    Decoders fill up what a cut file lacks and say nothing, so chunks and checksums are walked here.
    """
    if not data.startswith(_SIGNATURE):
        return "is no PNG file"
    at = len(_SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, end = data[at + 4 : at + 8], at + 12 + length
        if end > len(data):
            break
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(data[at + 4 : end - 4]) != checksum:
            return "is damaged"
        if kind == b"IEND":
            return None
        at = end
    return "is cut short"


def read_png(path: Path) -> np.ndarray:
    """A picture as it was given to ``png``.

    Raises:
        ValueError: not a whole PNG file, with the file's name.
        OSError: it cannot be read.
    """
    data = path.read_bytes()
    fault = png_fault(data)
    if fault is not None:
        raise ValueError(f"{path} {fault}")
    plane = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if plane is None:
        raise ValueError(f"{path} cannot be decoded")
    return plane[..., ::-1] if plane.ndim == 3 else plane


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is not JSON")


def read_json(path: Path) -> Any:
    """The value in a JSON file.

    Raises:
        ValueError: it is no JSON (NaN is none), with the file's name.
        OSError: it cannot be read.
    """
    try:
        return json.loads(path.read_bytes(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no JSON file: {error}") from None


def json_text(value: Any) -> str:
    """A value as indented JSON."""
    return json.dumps(value, indent=1, allow_nan=False) + "\n"


def json_lines(members: dict[str, Iterable[Any]]) -> Iterator[str]:
    """An object of lists, one item a line, without holding the lists in memory."""
    yield "{"
    for position, (name, items) in enumerate(members.items()):
        yield f"{',' if position else ''}\n{json.dumps(name)}: ["
        for number, item in enumerate(items):
            yield f"{',' if number else ''}\n{json.dumps(item, allow_nan=False)}"
        yield "]"
    yield "\n}\n"


def write(path: Path, content: bytes | str | Iterable[str], scratch: Path) -> int:
    """Write a whole file or nothing; the number of bytes.

    Args:
        path: the file; folders above it are made.
        content: all of it, or text piece by piece.
        scratch: a folder on the same disk for the file while it is being written. What a kill leaves
            there is the caller's to sweep.

    Raises:
        OSError: with the file's name, which a full disk would not tell.
    """
    part = scratch / f"{path.name}.{os.getpid()}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(part, "wb") as file:
            if isinstance(content, bytes | str):
                file.write(content.encode() if isinstance(content, str) else content)
            else:
                for piece in content:
                    file.write(piece.encode())
            file.flush()
            size = os.fstat(file.fileno()).st_size
        os.replace(part, path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    return size
