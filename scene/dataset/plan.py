"""What an export is to be, and whether its folder can take it."""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filelock import FileLock, Timeout

from scene.assets import library
from scene.assets.catalogue import AssetPool
from scene.dataset.description import versions
from scene.dataset.formats.layout import layout
from scene.dataset.formats.shot import shot_files
from scene.dataset.read import DESCRIPTION, WORK
from scene.dataset.render import street_of
from scene.proposal import Streets, describe, shortest
from scene.render import RenderSettings, renderer
from scene.version import ENGINE, MAKERS
from shell.errors import UserError
from shell.files import folder_digest, read_json
from shell.folder import differences, plain

BLOCK = 4096
"""Bytes that disks give out at a time."""
MARGIN = 1.2
"""Room asked for, over what the first image needs."""


class ExportError(UserError):
    """A folder cannot take an export; the message names the folder and says what would do."""


class Plan(NamedTuple):
    """What every worker needs to know about an export."""

    folder: Path
    format: str
    split: str
    images: int
    shots: int
    seed: int
    settings: RenderSettings
    renderer: str
    pool: AssetPool

    @property
    def work(self) -> Path:
        """The folder inside that is there while the export is under way."""
        return self.folder / WORK

    @property
    def own(self) -> str:
        """The folder of own assets, if any of them may appear."""
        return "" if self.pool.use == "built-in" else self.pool.own

    def record(self, street: int) -> Path:
        """The file that says that a street is finished, and what came out."""
        return self.work / "streets" / f"{street:06d}.json"

    def shots_of(self, street: int) -> int:
        """Images of one street; the last may be cut short."""
        return min(self.shots, self.images - street * self.shots)


def settings(plan: Plan, units: np.ndarray, streets: Streets | None) -> dict[str, Any]:
    """All that decides the files, as ``dataset.json`` has it."""
    render = {**plan.settings._asdict(), "response": plan.settings.response._asdict()}
    return {
        "engine": ENGINE,
        "versions": versions(),
        "format": plan.format,
        "split": plan.split,
        "images": plan.images,
        "shots": plan.shots,
        "seed": plan.seed,
        "renderer": plan.renderer,
        "render": plain(render),
        "assets": {**plan.pool.decides, "own": Path(plan.pool.own).name},
        "own_assets": _own_assets(plan.own),
        "own_files": own_files(plan),
        "attributes": None if streets is None else _units(streets),
        "streets": [[shortest(value) for value in row] for row in units.tolist()],
    }


def _units(streets: Streets) -> dict[str, Any]:
    """What `scene.proposal.parse_streets` reads, without physical values; of one proposal its attributes."""
    rows = [
        {**row, "attributes": {name: own["unit"] for name, own in row["attributes"].items()}}
        for row in describe(streets)["components"]
    ]
    attributes: dict[str, Any] = rows[0]["attributes"]
    return {"components": rows} if len(rows) > 1 else attributes


def own_files(plan: Plan) -> str:
    """What all files of the folder of own assets come to, textures and manifest among them; empty without."""
    return folder_digest(Path(plan.own)) if plan.own else ""


def _own_assets(folder: str) -> list[dict[str, Any]]:
    """What the manifest says of every own asset, and a checksum, since a file may be exchanged."""
    rows = library.manifest(folder) if folder else ()
    return [
        {**row._asdict(), "crc32": zlib.crc32((Path(folder) / row.file).read_bytes())}
        for row in rows
    ]


def complete(folder: Path, wanted: dict[str, Any]) -> bool:
    """Whether the folder holds the whole export already.

    Raises:
        ExportError: it holds anything else than this export or a part of it.
    """
    if folder.exists() and not folder.is_dir():
        raise ExportError(f"{folder} is a file; an export needs a folder")
    described, started = folder / DESCRIPTION, folder / WORK / "settings.json"
    stored = described if described.exists() else started
    if not stored.exists():
        if folder.exists() and any(p.name != WORK for p in folder.iterdir()):
            raise ExportError(f"{folder} holds other files and no export; choose another folder")
        return False
    theirs = read_json(stored)
    if not isinstance(theirs, dict):
        raise ExportError(f"{stored} does not describe an export; choose another folder")
    engine, mine = theirs.get("engine", 0), wanted["engine"]
    if engine != mine:
        raise ExportError(
            f"{folder} holds an export of engine version {engine}, and this is {mine}; continue it "
            "with the release that began it, or choose another folder"
        )
    for name, ours, other in differences(wanted, {key: theirs.get(key) for key in wanted}):
        if name.startswith("versions.") and name.partition(".")[2] not in MAKERS:
            continue  # it is for the record
        values = "" if isinstance(ours, list | dict) else f" = {other}, not {ours}"
        raise ExportError(
            f"{folder} holds an export with {'' if values else 'other '}{name}{values}; "
            "use the same settings to continue it, or another folder"
        )
    return stored == described


def check_room(plan: Plan, units: np.ndarray) -> None:
    """Measure one image, and refuse an export that the disk cannot take."""
    street = street_of(units[0], plan.seed, 0, 1, plan.pool)
    frame = renderer(plan.renderer).render(street, plan.settings)[0]
    files, record = shot_files(
        frame, street.cameras[0], street.ground.path, plan.settings, layout(plan.format)
    )
    sizes = [*(len(content) for content in files.values()), 2 * len(json.dumps(record, indent=2))]
    image = sum(-(-size // BLOCK) * BLOCK for size in sizes)
    finished = sum(1 for _ in (plan.work / "streets").glob("*.json"))
    need = MARGIN * image * max(plan.images - finished * plan.shots, 0)
    existing = next(p for p in (plan.folder, *plan.folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(existing).free
    if need > free:
        raise ExportError(
            f"{plan.folder}: about {need / 1e9:.1f} GB are needed and {free / 1e9:.1f} GB are free; "
            "ask for fewer or smaller images, or choose another disk"
        )


def finished(plan: Plan, streets: range) -> Iterator[int]:
    """The streets whose record is there and whose files are as long as it says."""
    kind_of = layout(plan.format)
    for street in streets:
        path = plan.record(street)
        if not path.exists():
            continue
        try:
            for image in read_json(path)["images"]:
                paths = kind_of.paths(plan.split, image["stem"]).values()
                for name, size in zip(paths, image["bytes"], strict=True):
                    if (plan.folder / name).stat().st_size != size:
                        raise ValueError(name)
        except (OSError, ValueError, LookupError, TypeError):
            continue  # a disk lost power, or someone tidied up: it is rendered again
        yield street


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a second process out; the system forgets the lock of one that was killed."""
    lock = FileLock(folder / WORK / "lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ExportError(f"{folder} is in use by another export") from None
    try:
        yield
    finally:
        lock.release()
