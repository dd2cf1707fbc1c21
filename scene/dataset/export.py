"""Datasets on disk: rendered by worker processes, file by file, so that a kill loses a street at most.

While an export is under way, ``.export/`` in its folder holds the settings and one record per finished
street. The same call again does what is missing; the files about all images and ``dataset.json`` come last.
"""

from __future__ import annotations

import json
import shutil
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filelock import FileLock, Timeout

from scene.assets import library
from scene.assets.catalogue import AssetPool, check_pool
from scene.classes import CLASS_NAMES
from scene.dataset import description
from scene.dataset.formats.layout import SPLITS, layout, stem
from scene.dataset.formats.shot import shot_files
from scene.dataset.read import DESCRIPTION, WORK, pictures
from scene.dataset.render import Dataset, check_request, street_of
from scene.proposal import Proposal, describe, shortest
from scene.render import RenderSettings, renderer
from scene.version import ENGINE
from scene.workers import WorkerPool, opened
from shell.errors import UserError
from shell.files import read_json, write, write_json
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


def export_dataset(
    units: np.ndarray,
    seed: int,
    folder: Path,
    *,
    shots: int,
    settings: RenderSettings,
    images: int | None = None,
    format: str = "cityscapes",
    split: str = "train",
    renderer_name: str = "embree",
    pool: AssetPool | None = None,
    proposal: Proposal | None = None,
    workers: int | WorkerPool = 0,
    progress: Callable[[int, int, int], None] | None = None,
) -> dict[str, Any]:
    """Render streets into a folder, with every label the engine knows.

    The same arguments continue an export that was cut short; the files do not depend on that, nor on the
    number of workers.

    Args:
        units: f32[streets, 23] attributes of each street, in [0, 1].
        seed: with the street's index it decides everything left to chance.
        folder: new, empty, or the same export to be continued.
        shots: images per street.
        settings: size and quality.
        images: how many; by default all shots of all streets.
        format: ``cityscapes`` or ``coco``.
        split: ``train`` or ``val``.
        renderer_name: ``embree`` or ``opengl``.
        pool: which assets may appear.
        proposal: what ``units`` was drawn from, for the record.
        workers: processes to render in; 0 renders here, a ``WorkerPool`` is used and left open.
        progress: called with (images done, images, bytes written by this call).

    Returns:
        What ``dataset.json`` says.

    Raises:
        ValueError: attributes, numbers or size out of range, unknown renderer, format or split.
        ExportError: the folder holds something else, is in use, or the disk has not enough room.
        OSError: the disk is full or read-only, with the file's name; what is finished stays.
        RendererError: this machine lacks what the renderer needs.
        WorkerError: worker processes keep dying.
    """
    units = check_request(units, shots, settings, renderer_name)
    images = len(units) * shots if images is None else images
    if not (len(units) - 1) * shots < images <= len(units) * shots:
        raise ValueError(f"{images} images do not fit {len(units)} streets of {shots} shots")
    if split not in SPLITS:
        raise ValueError(f"unknown split {split!r}; known: {', '.join(SPLITS)}")
    layout(format)
    pool = check_pool(pool or AssetPool())
    plan = Plan(
        Path(folder), format, split, images, shots, seed, settings, renderer_name, pool
    )  # fmt: skip
    wanted = _settings(plan, units, proposal)
    if not _complete(plan.folder, wanted):
        _check_room(plan, units)
        (plan.folder / WORK).mkdir(parents=True, exist_ok=True)
        with _locked(plan.folder):
            if not _complete(plan.folder, wanted):
                _export(plan, units, wanted, workers, progress)
    found: dict[str, Any] = read_json(plan.folder / DESCRIPTION)
    shutil.rmtree(plan.folder / WORK, ignore_errors=True)
    return found


def read_dataset(folder: Path) -> Dataset:
    """All images and labels of an exported dataset, as ``render_dataset`` would give them.

    Raises:
        ValueError, OSError: not a dataset, or a file is damaged or missing, with its name.
    """
    images, labels = zip(*pictures(folder), strict=True)
    return Dataset(np.stack(images), np.stack(labels))


def _export(
    plan: Plan,
    units: np.ndarray,
    wanted: dict[str, Any],
    workers: int | WorkerPool,
    progress: Callable[[int, int, int], None] | None,
) -> None:
    """The work itself, in a folder that nobody else writes to."""
    work, scratch = plan.folder / WORK, plan.folder / WORK / "parts"
    shutil.rmtree(scratch, ignore_errors=True)  # what a kill left half-written
    scratch.mkdir(parents=True)
    if not (work / "settings.json").exists():
        write_json(work / "settings.json", {**wanted, "versions": description.versions()})
    paths = layout(plan.format).paths(plan.split, "").values()
    summaries = layout(plan.format).summaries(plan.split).values()
    for folder in {(plan.folder / path).parent for path in (*paths, *summaries)}:
        folder.mkdir(parents=True, exist_ok=True)
    (work / "streets").mkdir(exist_ok=True)
    finished = set(_finished(plan, range(len(units))))
    done, written = sum(_shots(plan, street) for street in finished), 0
    if progress is not None:
        progress(done, plan.images, written)
    tasks = [(plan, k, unit) for k, unit in enumerate(units) if k not in finished]
    with opened(workers) as processes:
        for position, size in processes.map(_export_street, tasks):
            done, written = done + _shots(plan, tasks[position][1]), written + size
            if progress is not None:
                progress(done, plan.images, written)
    _summarize(plan, len(units))


def _export_street(plan: Plan, index: int, unit: np.ndarray) -> int:
    """Render one street and write its files, then its record; the bytes written."""
    kind_of, scratch = layout(plan.format), plan.folder / WORK / "parts"
    street = street_of(unit, plan.seed, index, plan.shots, plan.pool)
    frames = renderer(plan.renderer).render(street, plan.settings)
    placed = Counter(CLASS_NAMES[p.train_id] for p in street.placements)
    record: dict[str, Any] = {"placed": dict(sorted(placed.items())), "images": []}
    total = 0
    for shot in range(_shots(plan, index)):
        name = stem(index, shot)
        files, known = shot_files(frames[shot], street.cameras[shot], plan.settings, kind_of)
        paths = kind_of.paths(plan.split, name)
        # A power cut may cost what is not synced; what is shorter than its record is rendered again.
        sizes = [
            write(plan.folder / paths[k], files[k], scratch / f"{name}.{k}", sync=False)
            for k in files
        ]
        record["images"].append({"stem": name, "bytes": sizes, **known})
        total += sum(sizes)
    write_json(_record_path(plan, index), record)
    return total


def _summarize(plan: Plan, streets: int) -> None:
    """Write the files about all images; ``dataset.json`` says that all is done."""
    size = (plan.settings.width, plan.settings.height)

    def records() -> Iterator[dict[str, Any]]:
        return (read_json(_record_path(plan, k)) for k in range(streets))

    def images() -> Iterator[dict[str, Any]]:
        return (image for record in records() for image in record["images"])

    kind_of = layout(plan.format)
    for name, path in kind_of.summaries(plan.split).items():
        text = kind_of.summary_text(name, plan.split, images, size)
        write(plan.folder / path, text)
    if _own_folder(plan.pool):
        # Authors and licences go wherever the pictures of their assets go.
        listing = Path(plan.pool.own) / library.MANIFEST
        write(plan.folder / library.MANIFEST, listing.read_bytes())
    found = {
        **read_json(plan.folder / WORK / "settings.json"),
        "encodings": description.ENCODINGS,
        **description.outcome(records(), size[0] * size[1]),
    }
    write_json(plan.folder / DESCRIPTION, found)


def _settings(plan: Plan, units: np.ndarray, proposal: Proposal | None) -> dict[str, Any]:
    """All that decides the files, as ``dataset.json`` has it."""
    render = {**plan.settings._asdict(), "response": plan.settings.response._asdict()}
    unit = {name: row["unit"] for name, row in describe(proposal).items()} if proposal else None
    return {
        "engine": ENGINE,
        "format": plan.format,
        "split": plan.split,
        "images": plan.images,
        "shots": plan.shots,
        "seed": plan.seed,
        "renderer": plan.renderer,
        "render": plain(render),
        "assets": {**plan.pool._asdict(), "own": Path(plan.pool.own).name},
        "own_assets": _own_assets(plan.pool),
        "attributes": unit,
        "streets": [[shortest(value) for value in row] for row in units.tolist()],
    }


def _own_folder(pool: AssetPool) -> str:
    """The folder of own assets, if any of them may appear."""
    return "" if pool.use == "built-in" else pool.own


def _own_assets(pool: AssetPool) -> list[dict[str, Any]]:
    """What the manifest says of every own asset, and a checksum, since a file may be exchanged."""
    folder = _own_folder(pool)
    rows = library.manifest(folder) if folder else ()
    return [
        {**row._asdict(), "crc32": zlib.crc32((Path(folder) / row.file).read_bytes())}
        for row in rows
    ]


def _complete(folder: Path, wanted: dict[str, Any]) -> bool:
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
    engine = theirs.get("engine", "0")
    if engine != ENGINE:
        raise ExportError(
            f"{folder} holds an export of engine version {engine}, and this is {ENGINE}; continue it "
            "with the release that began it, or choose another folder"
        )
    for name, ours, other in differences(wanted, {key: theirs.get(key) for key in wanted}):
        values = "" if isinstance(ours, list | dict) else f" = {other}, not {ours}"
        raise ExportError(
            f"{folder} holds an export with {'' if values else 'other '}{name}{values}; "
            "use the same settings to continue it, or another folder"
        )
    return stored == described


def _check_room(plan: Plan, units: np.ndarray) -> None:
    """Measure one image, and refuse an export that the disk cannot take."""
    street = street_of(units[0], plan.seed, 0, 1, plan.pool)
    frame = renderer(plan.renderer).render(street, plan.settings)[0]
    files, record = shot_files(frame, street.cameras[0], plan.settings, layout(plan.format))
    sizes = [*(len(content) for content in files.values()), 2 * len(json.dumps(record, indent=2))]
    image = sum(-(-size // BLOCK) * BLOCK for size in sizes)
    finished = sum(1 for _ in (plan.folder / WORK / "streets").glob("*.json"))
    need = MARGIN * image * max(plan.images - finished * plan.shots, 0)
    existing = next(p for p in (plan.folder, *plan.folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(existing).free
    if need > free:
        raise ExportError(
            f"{plan.folder}: about {need / 1e9:.1f} GB are needed and {free / 1e9:.1f} GB are free; "
            "ask for fewer or smaller images, or choose another disk"
        )


def _finished(plan: Plan, streets: range) -> Iterator[int]:
    """The streets whose record is there and whose files are as long as it says."""
    kind_of = layout(plan.format)
    for street in streets:
        path = _record_path(plan, street)
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


def _record_path(plan: Plan, street: int) -> Path:
    return plan.folder / WORK / "streets" / f"{street:06d}.json"


def _shots(plan: Plan, street: int) -> int:
    """Images of one street; the last may be cut short."""
    return min(plan.shots, plan.images - street * plan.shots)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
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
