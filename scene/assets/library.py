"""Reads a user's own assets: a folder of mesh files with a manifest of their licences.

    my_assets/
        assets.csv        file,author,licence,source and, where needed, up,forward,scale
        car/golf.glb
        traffic_sign/stop.obj

Sub-folders are named after classes or asset families. Every mistake raises a ``LibraryError`` that names the
file.
"""

from __future__ import annotations

import csv
import math
import re
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.errors import UserError
from common.files import composed, folder_digest, plain_path
from common.sent import here
from scene.assets.families import FAMILIES
from scene.assets.family import Size
from scene.classes import CLASS_NAMES
from scene.mesh.asset import Asset, rotate, translate
from scene.mesh.file import SUFFIXES, MeshError, read_mesh

MANIFEST = "assets.csv"
REQUIRED = ("file", "author", "licence", "source")

FOLDERS: dict[str, str] = {family: family for family in FAMILIES}
"""Family by name of a sub-folder (with spaces or underscores); a class means its first family."""
for _family in FAMILIES.values():
    FOLDERS.setdefault(CLASS_NAMES[_family.train_id], _family.name)

UNITS = (("millimetres", 0.001), ("centimetres", 0.01), ("inches", 0.0254), ("feet", 0.3048))
HUNG = 2.1
"""Height (metres) above the ground at which a sign or light without a pole hangs."""
POLELESS = 1.6
"""A sign or light lower than this (metres) has no pole of its own."""
POLE_RADIUS = 0.06
"""Distance (metres) of a hung sign or light from the axis of the built-in pole."""

DIGITS = 16
"""Hexadecimal digits of the digest in the name of a snapshot."""
_SNAPSHOT = re.compile(rf"[0-9a-f]{{{DIGITS}}}:")


class LibraryError(UserError):
    """A folder of own assets, or a file in it, cannot be used; the message names it."""


class Row(NamedTuple):
    """One row of the manifest."""

    file: str  # path relative to the folder, with forward slashes
    author: str
    licence: str
    source: str
    up: str = ""  # see ``mesh.file.read_mesh``; empty for the format's default
    forward: str = ""
    scale: float = 1.0  # metres per unit in the file


def snapshot(folder: str) -> str:
    """Name a folder or file by its content: a digest, a colon and its absolute path.

    Whatever is cached under such a name cannot be mistaken for that of other files. The snapshot of a
    snapshot is itself, that of an empty name is empty.

    Raises:
        LibraryError: a file cannot be read.
    """
    if not folder or _SNAPSHOT.match(folder):
        return folder
    root = here(folder).resolve()
    try:
        return f"{folder_digest(root)[:DIGITS]}:{root}"
    except OSError as error:
        raise LibraryError(f"{error.filename}: {error.strerror}") from error


def refuse_changed(name: str, root: Path) -> None:
    """Raise if a folder or file is not that of its snapshot any more, since it changed while it was read."""
    if not snapshot(str(root)).startswith(name[: DIGITS + 1]):
        raise LibraryError(f"{root} changed while it was read; run the same command again")


def manifest(folder: str) -> tuple[Row, ...]:
    """Read the rows of a folder's ``assets.csv``, one for each mesh file, sorted by the files' names.

    Args:
        folder: its path, or a snapshot.

    Raises:
        LibraryError: the folder or manifest does not exist, a column, author or licence is missing, a row
            has no file or a file no row, a sub-folder has an unknown name, or there is no mesh file.
    """
    return _manifest(snapshot(folder))


@lru_cache(maxsize=16)
def _manifest(name: str) -> tuple[Row, ...]:
    root = path_of(name)
    if not root.is_dir():
        fault = "is not a folder" if root.exists() else "does not exist"
        raise LibraryError(f"{root} {fault}; expected the folder of your own assets")
    files = _mesh_files(root)
    if not files:
        raise LibraryError(
            f"{root} has no mesh file ({', '.join(SUFFIXES)}) in a class's sub-folder"
        )
    on_disk = {composed(file): file for file in files}
    listed = _rows(root / MANIFEST)
    rows = {on_disk.get(row.file, row.file): row for row in listed}
    rows = {file: row._replace(file=file) for file, row in rows.items()}
    for file in files:
        if file not in rows:
            raise LibraryError(f"{root / MANIFEST} has no row for {file}")
    for file in rows:
        if file not in files:
            raise LibraryError(f"{root / MANIFEST} lists {file}, which does not exist")
    refuse_changed(name, root)
    return tuple(rows[file] for file in files)


def scan(folder: str) -> dict[str, tuple[str, ...]]:
    """List the names of a folder's assets by family: its snapshot, a slash, and the file's path in it."""
    return _scan(snapshot(folder))


@lru_cache(maxsize=16)
def _scan(name: str) -> dict[str, tuple[str, ...]]:
    refs: dict[str, tuple[str, ...]] = {}
    for row in _manifest(name):
        family = FOLDERS[_folder_name(row.file.partition("/")[0])]
        refs[family] = (*refs.get(family, ()), f"{name}/{row.file}")
    return refs


def check(folder: str) -> int:
    """Load every asset of a folder once, so that errors come before the work, and return their number.

    Raises:
        LibraryError: the first mistake.
    """
    assets = scan(folder)
    for family, refs in assets.items():
        for ref in refs:
            load(family, ref)
    return sum(len(refs) for refs in assets.values())


def load(family: str, ref: str) -> Asset:
    """Load the own asset named ``ref`` by ``scan``, turned and placed like the family's built-in ones.

    Raises:
        LibraryError: the file is broken, empty, of implausible size, or has changed; the message names it.
    """
    file = path_of(ref)
    root = file.parents[1]
    name = ref.removesuffix(f"/{file.relative_to(root).as_posix()}")
    row = next(r for r in _manifest(name) if file == root / r.file)
    try:
        asset = read_mesh(file, up=row.up, forward=row.forward, scale=row.scale, root=root)
        _check_size(asset, family)
    except MeshError as error:
        raise LibraryError(f"{file}: {error}") from error
    except OSError as error:
        raise LibraryError(f"{file}: {error.strerror}") from error
    refuse_changed(name, root)
    return _placed(asset, family)


def path_of(name: str) -> Path:
    """Return the path of a snapshot, or of a file in it."""
    return Path(name[DIGITS + 1 :])


def _folder_name(name: str) -> str:
    return name.replace("_", " ").lower()


def _mesh_files(root: Path) -> list[str]:
    """List the mesh files of all sub-folders, relative to ``root``, sorted."""
    files = []
    for folder in sorted(p for p in root.iterdir() if p.is_dir() and not p.name.startswith(".")):
        if _folder_name(folder.name) not in FOLDERS:
            raise LibraryError(
                f"{folder} is not named after a class or family of assets; known: {', '.join(FOLDERS)}"
            )
        files += [
            p.relative_to(root).as_posix()
            for p in folder.iterdir()
            if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")
        ]
    return sorted(files)


def _rows(path: Path) -> list[Row]:
    """Read the manifest, without comparing it to the files."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            head = file.readline()
            # Some spreadsheets separate columns by semicolons.
            separator = ";" if ";" in head and "," not in head else ","
            file.seek(0)
            lines = list(csv.DictReader(file, restval="", delimiter=separator))
    except FileNotFoundError:
        raise LibraryError(
            f"{path} is missing; it needs a row for each asset, with {', '.join(REQUIRED)}"
        ) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LibraryError(f"{path} cannot be read: {error}") from error
    rows: list[Row] = []
    for number, line in enumerate(lines, 2):
        values = {str(k).strip(): str(v or "").strip() for k, v in line.items() if k is not None}
        for column in REQUIRED:
            if column not in values:
                raise LibraryError(f"{path} has no column {column!r}")
            if not values[column]:
                raise LibraryError(f"{path}, line {number}: {column} is empty")
        values["file"] = plain_path(values["file"])
        if values["file"] in {row.file for row in rows}:
            raise LibraryError(f"{path}, line {number}: {values['file']} is listed twice")
        rows.append(
            Row(
                file=values["file"],
                author=values["author"],
                licence=values["licence"],
                source=values["source"],
                up=values.get("up", "").lower(),
                forward=values.get("forward", "").lower(),
                scale=_scale(values.get("scale", ""), path, number),
            )
        )
    return rows


def _scale(text: str, path: Path, number: int) -> float:
    try:
        value = float(text.replace(",", ".") or 1)  # some spreadsheets write decimal commas
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise LibraryError(f"{path}, line {number}: scale must be a positive number, not {text!r}")
    return value


def _check_size(asset: Asset, family: str) -> None:
    """Raise MeshError for a size that is implausible for the family, with a suggestion to fix it."""
    extents = np.ptp(asset.mesh.vertices, axis=0)
    sizes = FAMILIES[family].size
    if _is_plausible(extents, sizes):
        return
    measures = f"is {extents.max():.4g} m long and {extents[2]:.4g} m high"
    plausible = (
        f"a {family} is {sizes.longest[0]:g} to {sizes.longest[1]:g} m long"
        f" and {sizes.height[0]:g} to {sizes.height[1]:g} m high"
    )
    for unit, factor in UNITS:
        if _is_plausible(factor * extents, sizes):
            hint = f"scale {factor:g} ({unit}) in {MANIFEST} would fit"
            raise MeshError(f"{measures}; {plausible}; {hint}")
    for axis, k in (("x", 0), ("y", 1)):
        if _is_plausible(np.array([*np.delete(extents, k), extents[k]]), sizes):
            raise MeshError(
                f"{measures}; {plausible}; it may lie on its side: see column 'up' of {MANIFEST} "
                f"(its height is along our {axis})"
            )
    raise MeshError(f"{measures}; {plausible}; see columns 'scale' and 'up' of {MANIFEST}")


def _is_plausible(extents: np.ndarray, sizes: Size) -> bool:
    longest, height = extents.max(), extents[2]
    return bool(
        sizes.longest[0] <= longest <= sizes.longest[1]
        and sizes.height[0] <= height <= sizes.height[1]
    )


def _placed(asset: Asset, family: str) -> Asset:
    """Turn and move an asset to the front direction and origin of the family."""
    front = FAMILIES[family].front
    if front == "right":
        asset = rotate(asset, -math.pi / 2, (0, 0, 1))
    if front == "back":
        asset = rotate(asset, math.pi, (0, 0, 1))
    low, high = asset.mesh.bounds
    x, y = (low + high)[:2] / 2
    z = low[2]
    if front == "right":  # the near side is at y = 0
        y = low[1]
    if front == "back" and high[2] - low[2] < POLELESS:
        x, z = high[0] + POLE_RADIUS, low[2] - HUNG
    return translate(asset, (-float(x), -float(y), -float(z)))
