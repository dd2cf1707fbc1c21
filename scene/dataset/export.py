"""Datasets on disk: rendered by worker processes, file by file, so that a kill loses a street at most.

While an export is under way, ``.export/`` in its folder holds the settings and one record per finished
street. The same call again does what is missing; the files about all images and ``dataset.json`` come last.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout

from scene.assets import library
from scene.assets.catalogue import AssetPool, check_pool
from scene.dataset.description import ENCODINGS, Plan, outcome, own_class_entry, own_files
from scene.dataset.description import settings as settings_of
from scene.dataset.formats.about import About, stem
from scene.dataset.formats.labels import refuse_with_target, target_entry
from scene.dataset.formats.layout import SPLITS, layout
from scene.dataset.formats.shot import shot_files
from scene.dataset.read import DESCRIPTION, WORK, describe, pictures
from scene.dataset.render import Dataset, check_request, street_of
from scene.proposal import Streets
from scene.render import RenderSettings, renderer
from scene.version import MAKERS
from scene.workers import Workers, opened
from shell.errors import UserError
from shell.files import read_json, write, write_json
from shell.folder import differences

if TYPE_CHECKING:
    from shell.target_file import TargetFile

BLOCK = 4096
"""Bytes that disks give out at a time."""
MARGIN = 1.2
"""Room asked for, over what the first image needs."""


class ExportError(UserError):
    """A folder cannot take an export; the message names the folder and says what would do."""


Files = list[tuple[str, str, bytes]]
"""Path in the folder, name while it is being written, content."""


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
    """Render streets into a folder, with every label the engine knows.

    The same arguments continue an export that was cut short; the files do not depend on that, nor on the
    number of workers.

    Args:
        units: f32[streets, attributes] attributes of each street, in [0, 1].
        seed: with the street's index it decides everything left to chance.
        folder: new, empty, or the same export to be continued.
        shots: images per street.
        settings: size and quality.
        images: how many; by default all shots of all streets.
        format: a name of `scene.dataset.formats.layout.LAYOUTS`.
        split: ``train`` or ``val``.
        renderer_name: ``embree`` or ``opengl``.
        pool: which assets may appear, and a class of the user's own.
        target: whose classes label pictures have, in its ids or colours, or its name or file; by default
            the engine's.
        streets: what ``units`` was drawn from, for the record.
        workers: processes to render in; 0 renders here, ``Workers`` are used and left open.
        progress: called with (images done, images, bytes written by this call).

    Returns:
        What ``dataset.json`` says.

    Raises:
        ValueError: attributes, numbers or size out of range, unknown renderer, format or split.
        ExportError: the folder holds something else, is in use, or the disk has not enough room.
        UserError: assets or target cannot be used, or not together.
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
        _check_room(plan, units)
        (plan.work).mkdir(parents=True, exist_ok=True)
        with _locked(plan.folder):
            if not _complete(plan.folder, wanted):
                _export(plan, units, wanted, workers, progress)
    found: dict[str, Any] = read_json(plan.folder / DESCRIPTION)
    shutil.rmtree(plan.work, ignore_errors=True)
    return found


def read_dataset(folder: Path) -> Dataset:
    """All images and labels of an exported dataset, as ``render_dataset`` would give them.

    Raises:
        ValueError, OSError: not a dataset, or a file is damaged or missing, with its name.
    """
    images, labels = zip(*pictures(describe(folder)), strict=True)
    return Dataset(np.stack(images), np.stack(labels))


def _export(
    plan: Plan,
    units: np.ndarray,
    wanted: dict[str, Any],
    workers: int | Workers,
    progress: Callable[[int, int, int], None] | None,
) -> None:
    """The work itself, in a folder that nobody else writes to."""
    work, scratch = plan.work, plan.work / "parts"
    shutil.rmtree(scratch, ignore_errors=True)  # what a kill left half-written
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
        sent = plan._replace(pool=plan.pool.called(processes.share))
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
    """The folder of own assets, or the file of the own class, if it is not what it was; else empty."""
    if own_files(plan.own) != wanted["own_files"]:
        return plan.own
    own = plan.pool.own_class
    return own.file if own is not None and own_class_entry(own) != wanted["own_class"] else ""


def _draw_street(plan: Plan, index: int, unit: np.ndarray) -> tuple[Files, dict[str, Any]]:
    """The files of one street, and its record; runs in a worker, which need not see the folder."""
    street = street_of(unit, plan.seed, index, plan.shots, plan.pool)
    frames, labels = renderer(plan.renderer).render(street, plan.settings), plan.labels
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
    """Write a street's files, then its record; the bytes of the files."""
    scratch = plan.work / "parts"
    for path, part, content in files:
        # A power cut may cost what is not synced; what is shorter than its record is rendered again.
        write(plan.folder / path, content, scratch / part, sync=False)
    write_json(plan.record(index), record)
    return sum(len(content) for _, _, content in files)


def _summarize(plan: Plan, streets: int) -> None:
    """Write the files about all images; ``dataset.json`` says that all is done."""
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
        # Authors and licences go wherever the pictures of their assets go.
        listing = Path(plan.pool.own) / library.MANIFEST
        write(plan.folder / library.MANIFEST, listing.read_bytes())
    write_json(plan.folder / DESCRIPTION, found)


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
    engine, mine = theirs.get("engine", 0), wanted["engine"]
    if engine != mine:
        raise ExportError(
            f"{folder} holds an export of engine version {engine}, and this is {mine}; continue it "
            "with the release that began it, or choose another folder"
        )
    wanted = {"target": None, "own_class": None, **wanted}
    for name, ours, other in differences(wanted, {key: theirs.get(key) for key in wanted}):
        if name.startswith("versions.") and name.partition(".")[2] not in MAKERS:
            continue  # it is for the record
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
    image *= 1 if plan.layout.pack is None else 2  # as pictures, then packed
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
            continue  # a disk lost power, or someone tidied up: it is rendered again
        yield street


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
