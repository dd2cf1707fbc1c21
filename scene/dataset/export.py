"""Exports datasets to disk by worker processes, file by file, so that a kill loses at most a street.

During an export, ``.export/`` in its folder holds the settings and one record per finished street. The same
call again does the rest; the files about all images and ``dataset.json`` come last.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout

from common.errors import UserError
from common.files import read_json, write, write_json
from common.folder import differences
from common.labels.classes import Outline
from common.workers.pool import WorkerPool, Workers, opened
from scene.assets import library
from scene.assets.catalogue import AssetPool, check_pool
from scene.dataset.description import ENCODINGS, Plan, outcome, own_class_entry, own_files
from scene.dataset.description import settings as settings_of
from scene.dataset.formats.about import About, stem
from scene.dataset.formats.labels import refuse_with_target, target_entry
from scene.dataset.formats.layout import SPLITS, layout
from scene.dataset.formats.shot import shot_files
from scene.dataset.read import DESCRIPTION, WORK, describe, pictures
from scene.dataset.render import Dataset, check_request, compile_first, street_of
from scene.outline import outlined
from scene.proposal import Streets
from scene.render import RenderSettings, renderer
from scene.version import MAKERS

if TYPE_CHECKING:
    from common.labels.target_file import TargetFile

BLOCK = 4096
"""Bytes that a disk allocates at a time."""
MARGIN = 1.2
"""Factor of the required room over the need of the first image."""


class ExportError(UserError):
    """A folder cannot take an export; the message names the folder and says what would be right."""


Files = list[tuple[str, str, bytes]]
"""Path in the folder, temporary name, content."""


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
    target: TargetFile | str | Path | None = None,
    streets: Streets | None = None,
    workers: int | Workers = 0,
    progress: Callable[[int, int, int], None] | None = None,
) -> dict[str, Any]:
    """Render streets into a folder with all of the engine's labels.

    The same arguments continue an interrupted export; the files do not depend on interruptions or on the
    number of workers.

    Args:
        units: f32[streets, attributes] attributes of each street, in [0, 1].
        seed: decides, with the street's index, all random choices.
        folder: a new or empty folder, or that of the same export.
        shots: images per street.
        settings: size and quality.
        images: number of images; by default all shots of all streets.
        format: a name of `scene.dataset.formats.layout.LAYOUTS`.
        split: ``train`` or ``val``.
        renderer_name: ``embree`` or ``opengl``.
        pool: the assets that may appear, and the user's own class.
        target: the target, or its name or file, whose classes label pictures have in its ids or colours; by
            default the engine's classes.
        streets: the distribution of ``units``, for the record.
        workers: processes to render in; 0 renders here, ``Workers`` are used and left open.
        progress: called with (images done, images, bytes written by this call).

    Returns:
        The content of ``dataset.json``.

    Raises:
        ValueError: attributes, numbers or size out of range, unknown renderer, format or split.
        ExportError: the folder holds other files or is in use, or the disk has too little room.
        UserError: assets or target cannot be used, or not together.
        OSError: the disk is full or read-only; the error names the file, and finished streets stay.
        RendererError: this machine lacks what the renderer needs.
        WorkerError: worker processes keep dying.
    """
    units = check_request(units, shots, settings, renderer_name)
    images = len(units) * shots if images is None else images
    if not (len(units) - 1) * shots < images <= len(units) * shots:
        raise ValueError(f"{images} images do not fit {len(units)} streets of {shots} shots")
    if split not in SPLITS:
        raise ValueError(f"unknown split {split!r}; known: {', '.join(SPLITS)}")
    layout(format).check()
    pool = check_pool(pool or AssetPool())
    own = None if target is None else target_entry(target)
    if own is not None and pool.own_class is not None:
        refuse_with_target(pool.own_class.name, own["name"])
    plan = Plan(
        Path(folder), format, split, images, shots, seed, settings, renderer_name, pool, own
    )
    if "objects" in plan.layout.files and not plan.labels.things:
        raise UserError(
            f"format {format} has things only, and target {plan.target and plan.target['name']} has none"
        )
    wanted = settings_of(plan, units, streets)
    if not _complete(plan.folder, wanted):
        compile_first(WorkerPool(0), plan.renderer)
        _check_room(plan, units)
        (plan.work).mkdir(parents=True, exist_ok=True)
        with _locked(plan.folder):
            if not _complete(plan.folder, wanted):
                _export(plan, units, wanted, workers, progress)
    found: dict[str, Any] = read_json(plan.folder / DESCRIPTION)
    shutil.rmtree(plan.work, ignore_errors=True)
    return found


def read_dataset(folder: Path, outlines: Sequence[Outline] = ()) -> Dataset:
    """Read all images and labels of an exported dataset, as ``render_dataset`` would give them.

    Args:
        folder: the dataset.
        outlines: classes to draw as a whole, as `engine_outlines` of a target; needs exact labels and depth,
            which has steps of a centimetre in files, so a few pixels may differ.

    Raises:
        ValueError, OSError: it is no dataset, or a file is damaged or missing; the message names it.
    """
    images, labels = zip(*pictures(describe(folder), outlines), strict=True)
    return Dataset(np.stack(images), np.stack(labels))


def _export(
    plan: Plan,
    units: np.ndarray,
    wanted: dict[str, Any],
    workers: int | Workers,
    progress: Callable[[int, int, int], None] | None,
) -> None:
    """Do the work in a locked folder."""
    work, scratch = plan.work, plan.work / "parts"
    shutil.rmtree(scratch, ignore_errors=True)  # half-written files of a killed export
    scratch.mkdir(parents=True)
    if not (work / "settings.json").exists():
        write_json(work / "settings.json", wanted)
    paths = plan.layout.paths(plan.split, "").values()
    summaries = plan.layout.summary_paths(plan.split).values()
    for folder in {(plan.folder / path).parent for path in (*paths, *summaries)}:
        folder.mkdir(parents=True, exist_ok=True)
    (work / "streets").mkdir(exist_ok=True)
    done_before = set(_finished(plan, range(len(units))))
    done, written = sum(plan.shots_of(street) for street in done_before), 0
    if progress is not None:
        progress(done, plan.images, written)
    with opened(workers) as processes:
        sent = plan._replace(pool=plan.pool.with_paths(processes.share))
        tasks = [(sent, k, unit) for k, unit in enumerate(units) if k not in done_before]
        for position, (files, record) in processes.map(_draw_street, tasks):
            street = tasks[position][1]
            changed = _changed(plan, wanted)
            if changed:
                raise ExportError(
                    f"{changed} has changed since {plan.folder} was begun; put the files back and run the "
                    "same command to go on, or choose another folder"
                )
            written += _write_street(plan, street, files, record)
            done += plan.shots_of(street)
            if progress is not None:
                progress(done, plan.images, written)
    left = set(_finished(plan, range(len(units))))
    if len(left) < len(units):
        raise ExportError(
            f"{plan.folder}: files of {len(units) - len(left)} streets vanished while others were "
            "rendered; the same command renders them again"
        )
    _summarize(plan, len(units))


def _changed(plan: Plan, wanted: dict[str, Any]) -> str:
    """The folder of own assets, or the file of the own class, if it has changed; else empty."""
    if own_files(plan.own) != wanted["own_files"]:
        return plan.own
    own = plan.pool.own_class
    return own.file if own is not None and own_class_entry(own) != wanted["own_class"] else ""


def _draw_street(plan: Plan, index: int, unit: np.ndarray) -> tuple[Files, dict[str, Any]]:
    """Make the files of one street and its record; runs in a worker, which need not see the folder."""
    street = street_of(unit, plan.seed, index, plan.shots, plan.pool)
    labels = plan.labels
    frames = [
        outlined(frame, labels.outlines)
        for frame in renderer(plan.renderer).render(street, plan.settings)
    ]
    placed = Counter(labels.rendered[p.train_id] for p in street.placements)
    record: dict[str, Any] = {"placed": dict(sorted(placed.items())), "images": []}
    all_files: Files = []
    for shot in range(plan.shots_of(index)):
        name = stem(index, shot)
        files, known = shot_files(
            frames[shot], street.ground.path, plan.settings, plan.layout, labels
        )
        paths = plan.layout.paths(plan.split, name)
        all_files += [(paths[k], f"{name}.{k}", files[k]) for k in files]
        sizes = [len(files[k]) for k in files]
        record["images"].append({"stem": name, "bytes": sizes, **known})
    return all_files, record


def _write_street(plan: Plan, index: int, files: Files, record: dict[str, Any]) -> int:
    """Write a street's files, then its record; returns the bytes of the files."""
    scratch = plan.work / "parts"
    for path, part, content in files:
        # A power cut may lose unsynced data; files shorter than in their record are rendered again.
        write(plan.folder / path, content, scratch / part, sync=False)
    write_json(plan.record(index), record)
    return sum(len(content) for _, _, content in files)


def _summarize(plan: Plan, streets: int) -> None:
    """Write the files about all images, last ``dataset.json``, which marks the export as done."""
    size = (plan.settings.width, plan.settings.height)

    def records() -> Iterator[dict[str, Any]]:
        return (read_json(plan.record(k)) for k in range(streets))

    def images() -> Iterator[dict[str, Any]]:
        return (image for record in records() for image in record["images"])

    labels = plan.labels
    found = {
        **read_json(plan.work / "settings.json"),
        "encodings": {k: text for k, text in ENCODINGS.items() if k in plan.layout.files},
        **outcome(records(), size[0] * size[1], labels),
    }
    about = About(images, plan.split, size, labels, found)
    paths = plan.layout.summary_paths(plan.split)
    for name, summary in plan.layout.summaries.items():
        write(plan.folder / paths[name], summary.text(about))
    if plan.layout.pack is not None:
        plan.layout.pack(plan.folder, about)
    if plan.own:
        # Authors and licences accompany the pictures of their assets.
        listing = Path(plan.pool.own) / library.MANIFEST
        write(plan.folder / library.MANIFEST, listing.read_bytes())
    write_json(plan.folder / DESCRIPTION, found)


def _complete(folder: Path, wanted: dict[str, Any]) -> bool:
    """Whether the folder already holds the whole export.

    Raises:
        ExportError: it holds other files than this export or a part of it.
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
    wanted = {"target": None, "own_class": None, **wanted}
    for name, ours, other in differences(wanted, {key: theirs.get(key) for key in wanted}):
        if name.startswith("versions.") and name.partition(".")[2] not in MAKERS:
            continue  # it is only for the record
        nested = isinstance(ours, list | dict) or isinstance(other, list | dict)
        values = "" if nested else f" = {other}, not {ours}"
        raise ExportError(
            f"{folder} holds an export with {'' if values else 'other '}{name}{values}; "
            "use the same settings to continue it, or another folder"
        )
    return stored == described


def _check_room(plan: Plan, units: np.ndarray) -> None:
    """Measure one image, and refuse an export that the disk cannot take."""
    street = street_of(units[0], plan.seed, 0, 1, plan.pool)
    frame = renderer(plan.renderer).render(street, plan.settings)[0]
    files, record = shot_files(frame, street.ground.path, plan.settings, plan.layout, plan.labels)
    sizes = [*(len(content) for content in files.values()), 2 * len(json.dumps(record, indent=2))]
    image = sum(-(-size // BLOCK) * BLOCK for size in sizes)
    finished = sum(1 for _ in (plan.work / "streets").glob("*.json"))
    image *= 1 if plan.layout.pack is None else 2  # pictures, then packed ones
    need = MARGIN * image * max(plan.images - finished * plan.shots, 0)
    existing = next(p for p in (plan.folder, *plan.folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(existing).free
    if need > free:
        raise ExportError(
            f"{plan.folder}: about {need / 1e9:.1f} GB are needed and {free / 1e9:.1f} GB are free; "
            "ask for fewer or smaller images, or choose another disk"
        )


def _finished(plan: Plan, streets: range) -> Iterator[int]:
    """The streets with a record and with files of the recorded lengths."""
    for street in streets:
        path = plan.record(street)
        if not path.exists():
            continue
        try:
            for image in read_json(path)["images"]:
                paths = plan.layout.paths(plan.split, image["stem"]).values()
                for name, size in zip(paths, image["bytes"], strict=True):
                    if (plan.folder / name).stat().st_size != size:
                        raise ValueError(name)
        except (OSError, ValueError, LookupError, TypeError):
            continue  # files were lost, so it is rendered again
        yield street


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock out a second process; the system releases the lock of a killed one."""
    lock = FileLock(folder / WORK / "lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ExportError(f"{folder} is in use by another export") from None
    try:
        yield
    finally:
        lock.release()
