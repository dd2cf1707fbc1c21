"""Write files that stay whole if the program is killed, and read JSON with checks."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from itertools import repeat
from pathlib import Path
from typing import Any, NoReturn

from common.errors import UserError

FRESH = 2.0
"""Seconds within which the time of a file does not show whether it has changed."""
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings of the image files that are read, in lower case."""
LARGEST = 2**30
"""The most bytes of a JSON file: the lists of a dataset of a million images."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Make errors of the disk name ``path``; the error of a full disk names no file."""
    try:
        yield
    except OSError as error:
        error.filename = str(path)
        raise


def write(
    path: Path,
    content: bytes | str | Iterable[str],
    part: Path | None = None,
    *,
    sync: bool = True,
) -> int:
    """Write a file whole or not at all; returns the number of bytes.

    Args:
        path: the file.
        content: its content, or text piece by piece.
        part: the unfinished file, on the same disk; by default ``path`` and ``.part``.
        sync: whether to wait for the disk, some milliseconds per file, so that the file outlives a power cut.

    Raises:
        OSError: with the file's name.
    """
    part = part or path.with_name(path.name + ".part")
    pieces = [content] if isinstance(content, bytes | str) else content
    with naming(path):
        try:
            with open(part, "wb") as file:
                for piece in pieces:
                    file.write(piece.encode() if isinstance(piece, str) else piece)
                file.flush()
                if sync:
                    os.fsync(file.fileno())
                size = file.tell()
            os.replace(part, path)
            if sync:
                sync_folder(path.parent)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
    return size


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk; a power cut may lose new names otherwise."""
    with suppress(OSError):  # some systems, such as Windows, cannot open folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Write a folder at ``path`` whole or not at all.

    It replaces the old content of ``path``, also after a kill at any moment.

    Yields:
        The folder to write into, a hidden neighbour of ``path``.

    Raises:
        OSError: with the folder's name.
    """
    path = path.absolute()
    # Names that no user gives to a copy of the folder.
    part, old = (path.with_name(f".{path.name}.sdr-jax-{role}") for role in ("part", "old"))
    shutil.rmtree(part, ignore_errors=True)
    with naming(path):
        if old.exists() and not path.exists():  # a kill came between the two renames below
            os.replace(old, path)
        try:
            part.mkdir(parents=True)
            yield part
            for folder, _, names in os.walk(part, topdown=False):
                for name in names:
                    with open(os.path.join(folder, name), "rb") as file:
                        os.fsync(file.fileno())
                sync_folder(Path(folder))
            shutil.rmtree(old, ignore_errors=True)
            with suppress(FileNotFoundError):
                os.replace(path, old)
            os.replace(part, path)
            sync_folder(path.parent)
            shutil.rmtree(old, ignore_errors=True)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            if old.exists() and not path.exists():
                os.replace(old, path)
            raise


def read_bytes(path: Path, most: int | None = None) -> bytes:
    """Read all bytes of a file of any origin.

    Raises:
        UserError: there are more than ``most`` (by default `LARGEST`), such as from an endless device.
        OSError: it cannot be read.
    """
    most = LARGEST if most is None else most
    with naming(path), open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(most + 1) if size <= most else b""
    if size > most or len(data) > most:
        raise UserError(f"{path} has more than {most:,} bytes, the limit for such a file")
    return data


WIDE = 100
"""Width of a line of JSON in characters."""


def check_folder(path: Path, expected: str) -> None:
    """Raise UserError, which says what was expected, if a path is not a folder that exists."""
    if not path.is_dir():
        raise UserError(
            f"{path}: {'not a' if path.exists() else 'no such'} folder; expected {expected}"
        )


def check_file(flag: str, path: Path) -> None:
    """Raise UserError if the file of a flag cannot be written: before long work, not after."""
    if path.is_dir():
        raise UserError(f"{flag} {path} is a folder; name a file")
    if not path.parent.is_dir():
        raise UserError(f"{flag} {path}: no folder {path.parent}; create it, or name another")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise UserError(
            f"{flag} {path}: cannot write to {path.parent} ({error.strerror}); name another folder"
        ) from None


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as the JSON of `json_text`, whole or not at all."""
    write(path, json_text(value))


def json_text(value: Any) -> str:
    """Format JSON for readers: lists of numbers and what fits a line are on one line, the rest is indented.

    Raises:
        ValueError: NaN or an infinity, which JSON lacks.
    """

    def lines(value: Any, margin: str, key: str = "") -> str:
        text = key + json.dumps(value)
        is_object = isinstance(value, dict)
        items = list(value.values()) if is_object else value if isinstance(value, list) else []
        numbers = not is_object and not any(isinstance(item, str | list | dict) for item in items)
        if numbers or not items or len(margin) + len(text) <= WIDE:
            return text
        deeper = margin + "  "
        keys = [f"{json.dumps(name)}: " for name in value] if is_object else [""] * len(items)
        rows = [deeper + lines(*row) for row in zip(items, repeat(deeper), keys)]
        return "\n".join((text[: len(key) + 1], ",\n".join(rows), margin + text[-1]))

    return lines(json.loads(json.dumps(value, allow_nan=False)), "") + "\n"


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text; NaN and infinities, which JSON lacks, are refused.

    Raises:
        ValueError: it is not JSON.
    """
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def read_json(path: Path) -> Any:
    """Read the value of a JSON file.

    Raises:
        UserError: it is not JSON, or too large; the message names the file.
        OSError: it cannot be read.
    """
    data = read_bytes(path)
    try:
        return parse_json(data)
    except ValueError as error:
        raise UserError(f"{path} is not a JSON file: {error}") from None


def digest(value: Any) -> str:
    """Compute the SHA-256 of a value as canonical JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def composed(name: str) -> str:
    """Compose the accents of a name (NFC): macOS may store the same name with separate ones."""
    return unicodedata.normalize("NFC", name)


def plain_path(path: str) -> str:
    """Normalise a path from a list: slashes, no empty or `.` part, composed accents.

    An absolute path stays absolute, and `..` stays; the letter of a Windows drive is removed.
    """
    path = re.sub(r"^[A-Za-z]:(?=/)", "", composed(path).strip().replace("\\", "/"))
    parts = [part for part in path.split("/") if part not in ("", ".")]
    return "/" * path.startswith("/") + "/".join(parts)


def spelled(path: Path) -> Path | None:
    """Find the file of a path, whose accents may be composed or separate; None if it does not exist."""
    if path.is_file():
        return path
    if str(path).isascii():
        return None
    existing = Path(*path.parts[:1])
    for part in path.parts[1:]:
        names = (part, *(unicodedata.normalize(form, part) for form in ("NFC", "NFD")))
        steps = (existing / name for name in names)
        match = next((step for step in steps if step.exists()), None)
        if match is None:
            return None
        existing = match
    return existing if existing.is_file() else None


def leads_out(folder: Path, name: str) -> bool:
    """Whether a path relative to a folder leads out of that folder."""
    path = os.path.normpath(folder.absolute() / name)
    return not Path(path).is_relative_to(os.path.normpath(folder.absolute()))


def file_digest(path: Path) -> str:
    """Compute the SHA-256 of the bytes of a file. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def files_below(root: Path) -> list[Path]:
    """List all files below a folder, sorted, without hidden ones; folders may be links.

    Raises PermissionError for a folder that may not be read.
    """

    def refuse(error: OSError) -> None:
        if isinstance(error, PermissionError):
            raise error

    files, visited = [], set()
    for folder, inner, names in os.walk(root, onerror=refuse, followlinks=True):
        visited.add(os.path.realpath(folder))
        inner[:] = [
            name for name in inner
            if name[0] != "." and os.path.realpath(os.path.join(folder, name)) not in visited
        ]  # fmt: skip
        files += [Path(folder, name) for name in names if name[0] != "."]
    return sorted(path for path in files if path.is_file())


def folder_digest(root: Path) -> str:
    """Compute the SHA-256 of the names and bytes of ``files_below`` a folder, or of the bytes of a file.

    Files are read again only if a name, size or time has changed. Raises OSError.
    """
    files = [(path, path.stat()) for path in ([root] if root.is_file() else files_below(root))]
    state = tuple((path, s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino) for path, s in files)
    # A file just written may change again within one tick of the clock.
    if max((s.st_ctime for _, s in files), default=0.0) > time.time() - FRESH:
        return _digest_of.__wrapped__(root, state)
    return _digest_of(root, state)


@lru_cache(maxsize=16)
def _digest_of(root: Path, state: tuple[tuple[Any, ...], ...]) -> str:
    if root.is_file():
        return file_digest(root)
    names_and_bytes = hashlib.sha256()
    for path, *_ in state:
        names_and_bytes.update(
            f"{path.relative_to(root).as_posix()} {file_digest(path)}\n".encode()
        )
    return names_and_bytes.hexdigest()


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Look up the installed versions of packages by name."""
    installed = {}
    for package in packages:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "not installed"
    return installed
