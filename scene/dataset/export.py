"""Export datasets to disk with worker processes, file by file, so that a kill loses at most a street.

During an export, ``.export/`` in its folder holds the settings and one record per finished street. The same
call resumes an interrupted export; summary files and ``dataset.json`` are written last.
"""

from __future__ import annotations

import json
import operator
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout

from common.errors import UserError, hint
from common.files import read_json, write, write_json
from common.folder import differences
from common.labels.classes import Outline
from common.memory import in_words
from common.workers.pool import WorkerPool, Workers, opened
from scene.assets import library
from scene.assets.catalogue import AssetPool, check_pool
from scene.dataset.description import ENCODINGS, Plan, outcome, own_class_entry, own_files
from scene.dataset.description import settings as settings_of
from scene.dataset.formats.about import About, stem
from scene.dataset.formats.labels import refuse_with_target, target_entry
from scene.dataset.formats.layout import SPLITS, layout
from scene.dataset.formats.shot import shot_files
from scene.dataset.read import DESCRIPTION, WORK, describe, images_and_classes
from scene.dataset.render import Dataset, check_request, check_seed, compile_first, street_of
from scene.outline import outlined
from scene.proposal import Streets
from scene.render import RenderSettings, renderer
from scene.version import MAKERS

if TYPE_CHECKING:
    from common.labels.target_file import TargetFile

BLOCK = 4096
"""Bytes that a disk allocates at a time."""
MARGIN = 1.2
"""Factor of the required disk space over that of the first image."""


class ExportError(UserError):
    """A folder cannot take an export; the message names the folder and the remedy."""


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

    The same arguments resume an interrupted export; the files do not depend on interruptions or on the
    number of workers.

    Args:
        units: f32[streets, attributes] attributes of each street, in [0, 1].
        seed: random seed.
        folder: a new or empty folder, or the folder of the same export.
        shots: images per street.
        settings: size and quality.
        images: number of images; by default all shots of all streets.
        format: a name of `scene.dataset.formats.layout.LAYOUTS`.
        split: ``train`` or ``val``.
        renderer_name: ``embree`` or ``opengl``.
        pool: the assets to use, and the user's own class.
        target: a target, its name or its file, whose classes label images have in its ids or colours; by
            default the engine's classes.
        streets: the distribution of ``units``, for ``dataset.json``.
        workers: number of processes; 0 renders in this process. ``Workers`` are used and left open.
        progress: called with (images done, images, bytes written by this call).

    Returns:
        The content of ``dataset.json``.

    Raises:
        ValueError: an argument is out of range, or the renderer, format or split is unknown.
        ExportError: the folder holds other files or is in use, or the disk has too little space.
        UserError: assets or target cannot be used, or not together.
        OSError: the disk is full or read-only; the error names the file, and finished streets are kept.
        RendererError: this machine lacks what the renderer needs.
        WorkerError: worker processes keep dying.
    """
    units = check_request(units, shots, settings, renderer_name)
    # JSON has no numbers of NumPy.
    seed, shots = operator.index(check_seed(seed)), operator.index(shots)
    images = len(units) * shots if images is None else operator.index(images)
    settings = settings._replace(
        width=int(settings.width), height=int(settings.height), samples=int(settings.samples)
    )
    if not (len(units) - 1) * shots < images <= len(units) * shots:
        raise ValueError(f"{images} images do not fit {len(units)} streets with {shots} shots")
    if split not in SPLITS:
        raise ValueError(f"unknown split {split!r}; {hint(split, SPLITS)}")
    layout(format).check()
    pool = check_pool(pool or AssetPool())
    target_record = None if target is None else target_entry(target)
    if target_record is not None and pool.own_class is not None:
        refuse_with_target(pool.own_class.name, target_record["name"])
    plan = Plan(
        Path(folder),
        format,
        split,
        images,
        shots,
        seed,
        settings,
        renderer_name,
        pool,
        target_record,
    )
    if "objects" in plan.layout.files and not plan.labels.things:
        raise UserError(
            f"format {format} stores things only, but target {plan.target and plan.target['name']} has none"
        )
    expected = settings_of(plan, units, streets)
    if not _complete(plan.folder, expected):
        compile_first(WorkerPool(0), plan.renderer)
        _check_room(plan, units)
        (plan.work).mkdir(parents=True, exist_ok=True)
        with _locked(plan.folder):
            if not _complete(plan.folder, expected):
                _export(plan, units, expected, workers, progress)
    description: dict[str, Any] = read_json(plan.folder / DESCRIPTION)
    shutil.rmtree(plan.work, ignore_errors=True)
    return description


def read_dataset(folder: str | Path, outlines: Sequence[Outline] = ()) -> Dataset:
    """Read all images and labels of an exported dataset, as ``render_dataset`` returns them.

    Args:
        folder: the dataset.
        outlines: classes with closed outlines, as `engine_outlines` of a target. It needs exact labels and
            depth; files store depth in centimetres, so a few pixels may differ.

    Raises:
        ValueError, OSError: it is not a dataset, or a file is damaged or missing; the message names it.
    """
    images, labels = zip(*images_and_classes(describe(Path(folder)), outlines), strict=True)
    return Dataset(np.stack(images), np.stack(labels))


def _export(
    plan: Plan,
    units: np.ndarray,
    expected: dict[str, Any],
    workers: int | Workers,
    progress: Callable[[int, int, int], None] | None,
) -> None:
    """Export into a locked folder."""
    work, scratch = plan.work, plan.work / "parts"
    shutil.rmtree(scratch, ignore_errors=True)  # half-written files of a killed export
    scratch.mkdir(parents=True)
    if not (work / "settings.json").exists():
        write_json(work / "settings.json", expected)
    paths = plan.layout.paths(plan.split, "").values()
    summaries = plan.layout.summary_paths(plan.split).values()
    for folder in {(plan.folder / path).parent for path in (*paths, *summaries)}:
        folder.mkdir(parents=True, exist_ok=True)
    (work / "streets").mkdir(exist_ok=True)
    done_before = set(_finished(plan, range(len(units))))
    done, bytes_written = sum(plan.shots_of(street) for street in done_before), 0
    if progress is not None:
        progress(done, plan.images, bytes_written)
    with opened(workers) as processes:
        worker_plan = plan._replace(pool=plan.pool.with_paths(processes.share))
        tasks = [(worker_plan, k, unit) for k, unit in enumerate(units) if k not in done_before]
        for position, (files, record) in processes.map(_draw_street, tasks):
            street = tasks[position][1]
            changed = _changed(plan, expected)
            if changed:
                raise ExportError(
                    f"{changed} has changed since the export to {plan.folder} started; restore its files "
                    "and run the same command to resume, or choose another folder"
                )
            bytes_written += _write_street(plan, street, files, record)
            done += plan.shots_of(street)
            if progress is not None:
                progress(done, plan.images, bytes_written)
    finished = set(_finished(plan, range(len(units))))
    if len(finished) < len(units):
        raise ExportError(
            f"{plan.folder}: files of {len(units) - len(finished)} streets disappeared during the export; "
            "run the same command to render them again"
        )
    _summarize(plan, len(units))


def _changed(plan: Plan, expected: dict[str, Any]) -> str:
    """The folder of own assets or the file of the own class if it has changed, else an empty string."""
    if own_files(plan.own_folder) != expected["own_files"]:
        return plan.own_folder
    own_class = plan.pool.own_class
    return (
        own_class.file
        if own_class is not None and own_class_entry(own_class) != expected["own_class"]
        else ""
    )


def _draw_street(plan: Plan, index: int, unit: np.ndarray) -> tuple[Files, dict[str, Any]]:
    """Make the files of one street and its record; runs in a worker, which does not need the folder."""
    street = street_of(unit, plan.seed, index, plan.shots, plan.pool)
    labels = plan.labels
    frames = [
        outlined(frame, labels.outlines)
        for frame in renderer(plan.renderer).render(street, plan.settings)
    ]
    placed_counts = Counter(labels.rendered[p.train_id] for p in street.placements)
    record: dict[str, Any] = {"placed": dict(sorted(placed_counts.items())), "images": []}
    all_files: Files = []
    for shot in range(plan.shots_of(index)):
        name = stem(index, shot)
        files, shot_record = shot_files(
            frames[shot], street.ground.path, plan.settings, plan.layout, labels
        )
        paths = plan.layout.paths(plan.split, name)
        all_files += [(paths[k], f"{name}.{k}", files[k]) for k in files]
        sizes = [len(files[k]) for k in files]
        record["images"].append({"stem": name, "bytes": sizes, **shot_record})
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
    """Write the summary files, and last ``dataset.json``, which marks the export as finished."""
    size = (plan.settings.width, plan.settings.height)

    def records() -> Iterator[dict[str, Any]]:
        return (read_json(plan.record(k)) for k in range(streets))

    def images() -> Iterator[dict[str, Any]]:
        return (image for record in records() for image in record["images"])

    labels = plan.labels
    description = {
        **read_json(plan.work / "settings.json"),
        "encodings": {k: text for k, text in ENCODINGS.items() if k in plan.layout.files},
        **outcome(records(), size[0] * size[1], labels),
    }
    about = About(images, plan.split, size, labels, description)
    paths = plan.layout.summary_paths(plan.split)
    for name, summary in plan.layout.summaries.items():
        write(plan.folder / paths[name], summary.text(about))
    if plan.layout.pack is not None:
        plan.layout.pack(plan.folder, about)
    if plan.own_folder:
        # Authors and licences accompany the images of their assets.
        listing = Path(plan.pool.own) / library.MANIFEST
        write(plan.folder / library.MANIFEST, listing.read_bytes())
    write_json(plan.folder / DESCRIPTION, description)


def _complete(folder: Path, expected: dict[str, Any]) -> bool:
    """Whether the folder already holds the whole export.

    Raises:
        ExportError: it holds other files, or another export.
    """
    if folder.exists() and not folder.is_dir():
        raise ExportError(f"{folder} is a file, but an export needs a folder")
    described, started = folder / DESCRIPTION, folder / WORK / "settings.json"
    stored = described if described.exists() else started
    if not stored.exists():
        if folder.exists() and any(not p.name.startswith(".") for p in folder.iterdir()):
            raise ExportError(f"{folder} holds other files, not an export; choose another folder")
        return False
    recorded = read_json(stored)
    if not isinstance(recorded, dict):
        raise ExportError(f"{stored} does not describe an export; choose another folder")
    engine, this_engine = recorded.get("engine", 0), expected["engine"]
    if engine != this_engine:
        raise ExportError(
            f"{folder} holds an export of engine version {engine}, but this is version {this_engine}; resume "
            "it with the release that started it, or choose another folder"
        )
    expected = {"target": None, "own_class": None, **expected}
    for name, new, old in differences(expected, {key: recorded.get(key) for key in expected}):
        if name.startswith("versions.") and name.partition(".")[2] not in MAKERS:
            continue  # recorded only: bytes may differ between processors, images hardly do
        nested = isinstance(new, list | dict) or isinstance(old, list | dict)
        values = "" if nested else f" = {old}, not {new}"
        raise ExportError(
            f"{folder} holds an export with {'' if values else 'other '}{name}{values}; "
            "use the same settings to resume it, or choose another folder"
        )
    return stored == described


def _check_room(plan: Plan, units: np.ndarray) -> None:
    """Measure one image, and refuse an export that does not fit on the disk."""
    street = street_of(units[0], plan.seed, 0, 1, plan.pool)
    frame = renderer(plan.renderer).render(street, plan.settings)[0]
    files, record = shot_files(frame, street.ground.path, plan.settings, plan.layout, plan.labels)
    sizes = [*(len(content) for content in files.values()), 2 * len(json.dumps(record, indent=2))]
    image = sum(-(-size // BLOCK) * BLOCK for size in sizes)
    finished = sum(1 for _ in (plan.work / "streets").glob("*.json"))
    image *= 1 if plan.layout.pack is None else 2  # images, then packed ones
    need = MARGIN * image * max(plan.images - finished * plan.shots, 0)
    existing = next(p for p in (plan.folder, *plan.folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(existing).free
    if need > free:
        raise ExportError(
            f"{plan.folder}: the export needs about {in_words(need)}, but {in_words(free)} are free; "
            "render fewer or smaller images, or choose another disk"
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
            continue  # files are missing, so it is rendered again
        yield street


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock the folder; the system releases the lock of a killed process."""
    lock = FileLock(folder / WORK / "lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ExportError(f"{folder} is in use by another export") from None
    try:
        yield
    finally:
        lock.release()
