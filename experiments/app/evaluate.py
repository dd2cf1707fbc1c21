"""Test a model on labelled images: mIoU, classes, groups, boundaries, the worst images.

    sdr-jax evaluate runs/fit/model DIR --json scores.json
    sdr-jax evaluate runs/fit/model DIR --target camvid --split train val --json scores.json

DATA is a folder with a `target.yaml`; otherwise pass --target. The model has the classes of the data, in any
order, or the engine's 19 classes of Cityscapes, which are then mapped to those of the data. Classes without a
counterpart in the data are not predicted, and a class of the data without a counterpart scores 0. Scores are
percent, at each image's own size. Boundary IoU (Cheng et al., 2021) counts only pixels near outlines, within
2 % of the diagonal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.command import Arguments, exit_code, say
from common.errors import UserError, counted, refuse_repeats
from common.files import check_file, file_digest, write, write_json
from common.labels.listing import split_names
from common.labels.target_file import TargetFile, find_target
from common.progress import Progress
from experiments.config import parsers
from experiments.config.parsers import WORST
from experiments.targets.real import reported_split
from scene.dataset.formats.png import encode
from seg.boundary import SHARE, boundary_counts, boundary_iou
from seg.classes import CITYSCAPES_19, IGNORE_LABEL, colorize, table_of
from seg.data import Entry, LabelReader, list_split
from seg.data.labelled import read_entry
from seg.metrics import absent_classes, confusion_matrix, iou
from seg.model import SEEN, Model, load_model

Reader = Callable[[Entry], tuple[np.ndarray, np.ndarray]]


class Labelled(NamedTuple):
    """Labelled images of any sizes on disk."""

    classes: tuple[str, ...]  # names of labels 0, 1, 2 ...
    colors: np.ndarray  # u8[classes, 3] RGB
    of_engine: np.ndarray  # u8[19], class of each engine class, 255 for none
    entries: tuple[Entry, ...]  # with their groups
    read: Reader  # image u8[h, w, 3] and labels u8[h, w], 255 for ignored pixels
    splits: tuple[str, ...] = ()  # of the images


def labelled(
    target: TargetFile | str,
    data: Path,
    splits: Sequence[str] = (),
    groups: Sequence[str] = (),
) -> Labelled:
    """List the labelled images of a target.

    Args:
        target: the target, or the name or path of its file.
        data: the folder.
        splits: the splits to use; by default test or val, or all if there is neither.
        groups: sequences, cities or other groups to use; by default all.

    Raises:
        UserError: no such target, split or group, or the folder does not fit the target.
    """
    target = find_target(target, data) if isinstance(target, str) else target
    available = split_names(target, data)
    refuse_repeats("--split", splits)
    refuse_repeats("--group", groups)
    if not splits:
        tested = reported_split(target.name, available)
        splits = [tested] if tested in available or not available else available
    entries = [entry for split in splits for entry in list_split(target, data, split)]
    names = sorted({entry.sequence for entry in entries})
    for group in groups:
        if group not in names:
            shown = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
            where = f"split {', '.join(splits)} of {data}"
            raise UserError(f"--group {group}: {where} has no such group; it has {shown}")
    reader, table = LabelReader(target), table_of(target)

    def read(entry: Entry) -> tuple[np.ndarray, np.ndarray]:
        image, labels, unknown = read_entry(entry, reader)
        if unknown:
            raise reader.error([(entry.label_path, unknown)])
        return image, labels

    chosen = tuple(e for e in entries if not groups or e.sequence in groups)
    engine = table.from_train_id[:19]
    return Labelled(table.classes, table.colors, engine, chosen, read, tuple(splits))


def mapping(model: Model, data: Labelled) -> tuple[list[int], np.ndarray]:
    """Find the model's classes that the data have, too, and their indices there.

    Classes of one name are the same; otherwise those of Cityscapes are what the data's target renders as.

    Returns:
        Indices of the model's classes, and u8[256] from such an index to a class of the data.

    Raises:
        UserError: model and data share no class.
    """
    table = np.full(256, IGNORE_LABEL, np.uint8)
    indices = {name: k for k, name in enumerate(data.classes)}
    if set(model.names) <= set(CITYSCAPES_19.classes):
        indices = dict(zip(CITYSCAPES_19.classes, data.of_engine, strict=True)) | indices
    table[: len(model.names)] = [indices.get(name, IGNORE_LABEL) for name in model.names]
    among = np.flatnonzero(table != IGNORE_LABEL).tolist()
    if not among:
        raise UserError(
            f"model and data have no class in common: the model has {', '.join(model.names)}; the data "
            f"have {', '.join(data.classes)}; use a model with these classes or with those of Cityscapes"
        )
    return among, table


class _Scored(NamedTuple):
    """The test of one image."""

    entry: Entry
    confusion: np.ndarray  # i64[classes, classes]
    boundary: np.ndarray  # i64[2, classes]

    @property
    def miou(self) -> float:
        """Mean IoU of the classes in the image, NaN if all its pixels are ignored."""
        return _mean(iou(self.confusion))


def evaluate(
    model: Model | str | Path,
    data: Labelled,
    pictures: Path | None = None,
    *,
    progress: bool = False,
) -> dict[str, Any]:
    """Test a model.

    Args:
        model: a model, its folder, or the name of one that comes with the package.
        data: from `labelled`, or put together in Python.
        pictures: a folder for the images with the worst results, with labels and predictions.
        progress: whether to print progress and the time left.

    Returns:
        The content of `--json`: the number of `images`, and of those among them that a model of `fit` was
        `trained_on`; `miou` and `classes` in percent, None for classes that do not occur; the
        `confusion` in pixels, by true and predicted class; `boundary_iou`; all `groups`; the `worst`.

    Raises:
        UserError: no such model, no class in common, no labels, or a folder with other files.
        DataError: a file is missing or broken.
        OSError: a file cannot be written; the error names it.
    """
    model = model if isinstance(model, Model) else load_model(model)
    among, table = mapping(model, data)
    if pictures is not None:
        _refuse_others(pictures)
        pictures.mkdir(parents=True, exist_ok=True)
        check_file("--pictures", pictures / _picture(0))
    scored: list[_Scored] = []
    with closing(Progress(len(data.entries))) if progress else nullcontext() as bar:
        for entry, _, labels, prediction in _predicted(model, data, among, table, bar):
            counts = boundary_counts(labels, prediction, len(data.classes))
            confusion = confusion_matrix(labels, prediction, len(data.classes))
            scored.append(_Scored(entry, confusion, counts))
    confusion = np.sum([image.confusion for image in scored], axis=0)
    if not confusion.any():
        raise UserError("no pixel of these images has a class: all labels are ignored pixels")
    with_score = [image for image in scored if not np.isnan(image.miou)]
    worst = sorted(with_score, key=lambda image: image.miou)[:WORST]
    if pictures is not None:
        _show(pictures, model, data, [image.entry for image in worst], among, table)
    edges = boundary_iou(np.sum([image.boundary for image in scored], axis=0), confusion)
    groups = sorted({image.entry.sequence for image in scored})
    digests = model.notes.get(SEEN)
    trained_on = set(map(str, digests)) if isinstance(digests, list) else set()
    paths = [image.entry.image_path for image in scored] if trained_on else []
    repeated = [path for path in paths if path.is_file() and file_digest(path) in trained_on]
    return {
        "model": model.digest,
        "images": len(scored),
        "trained_on": len(repeated),
        **_scores(data, iou(confusion)),
        "absent": list(absent_classes(confusion, data.classes)),
        "boundary_iou": {**_scores(data, edges), "share_of_diagonal": SHARE},
        "groups": {group: _group(data, scored, group) for group in groups},
        "worst": [
            {
                "name": image.entry.name,
                "group": image.entry.sequence,
                "miou": _percent(image.miou),
                "picture": None if pictures is None else _picture(k),
            }
            for k, image in enumerate(worst)
        ],
        "confusion": {"classes": list(data.classes), "pixels": confusion.tolist()},
    }


def _predicted(
    model: Model,
    data: Labelled,
    among: Sequence[int],
    table: np.ndarray,
    bar: Progress | None = None,
) -> Iterator[tuple[Entry, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield entry, image, labels and prediction in the data's classes; predict in batches."""
    size, count = model.settings.predict_batch, len(data.entries)
    for start in range(0, count, size):
        batch = data.entries[start : start + size]
        pairs = [data.read(entry) for entry in batch]
        predictions = model.predict([image for image, _ in pairs], among)
        for entry, (image, labels), prediction in zip(batch, pairs, predictions, strict=True):
            yield entry, image, labels, table[prediction]
        if bar is not None:
            bar.advance(len(batch))
            bar.update(f"{start + len(batch)} of {count} images")


def _mean(values: np.ndarray) -> float:
    """Mean of the values that are not NaN; NaN if all are."""
    numbers = values[~np.isnan(values)]
    return float(numbers.mean()) if len(numbers) else float("nan")


def _percent(value: float) -> float | None:
    return None if np.isnan(value) else round(100 * value, 2)


def _scores(data: Labelled, values: np.ndarray) -> dict[str, Any]:
    classes = {name: _percent(v) for name, v in zip(data.classes, values.tolist(), strict=True)}
    return {"miou": _percent(_mean(values)), "classes": classes}


def _group(data: Labelled, scored: Sequence[_Scored], group: str) -> dict[str, Any]:
    confusions = [image.confusion for image in scored if image.entry.sequence == group]
    return {"images": len(confusions), **_scores(data, iou(np.sum(confusions, axis=0)))}


def _picture(place: int) -> str:
    return f"worst_{place + 1}.png"


def _refuse_others(pictures: Path) -> None:
    """Raise UserError for a folder with files that an earlier call has not written."""
    if pictures.exists() and not pictures.is_dir():
        raise UserError(f"--pictures {pictures} is a file; it must be a folder")
    names = {_picture(k) for k in range(WORST)}
    others = {path.name for path in pictures.iterdir()} - names if pictures.is_dir() else set()
    if others:
        raise UserError(
            f"--pictures {pictures} has other files, such as {min(others)}; choose an empty folder"
        )


def _show(
    pictures: Path,
    model: Model,
    data: Labelled,
    entries: Sequence[Entry],
    among: Sequence[int],
    table: np.ndarray,
) -> None:
    """Write each image with its labels and its prediction, side by side."""
    for k in range(WORST):  # of an earlier call
        (pictures / _picture(k)).unlink(missing_ok=True)
    shown = _predicted(model, data._replace(entries=tuple(entries)), among, table)
    for k, (_, image, labels, prediction) in enumerate(shown):
        coloured = [colorize(classes, data.colors) for classes in (labels, prediction)]
        write(pictures / _picture(k), encode(np.concatenate([image, *coloured], axis=1)))


def text(scores: dict[str, Any]) -> str:
    """The scores as lines to print."""
    edges = scores["boundary_iou"]
    width = max(map(len, (*scores["classes"], "mean")))
    lines = [f"{'':{width}s} {'IoU':>6s} {'boundary':>8s}"]
    for name, value in {**scores["classes"], "mean": scores["miou"]}.items():
        edge = edges["miou"] if name == "mean" else edges["classes"][name]
        if value is not None:
            lines.append(f"{name:{width}s} {value:6.2f} {edge:8.2f}")
    lines += [
        f"{group}: {score['miou']:.2f} on {counted(score['images'], 'image')}"
        for group, score in scores["groups"].items()
        if score["miou"] is not None and len(scores["groups"]) <= 12
    ]
    if scores["trained_on"]:
        lines.append(
            f"The model was trained on {scores['trained_on']} of these "
            f"{counted(scores['images'], 'image')}, so these scores are higher than for new images."
        )
    return "\n".join(lines)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.evaluate().parse_args(arguments)

    def work() -> None:
        if options.json is not None:
            check_file("--json", options.json)
        model = load_model(options.model, mirror=not options.no_mirror)
        target = find_target(options.target, options.data)
        data = labelled(target, options.data, options.split, options.group)
        scores = evaluate(model, data, options.pictures, progress=True)
        say(f"split {', '.join(data.splits)}: {counted(scores['images'], 'image')}\n{text(scores)}")
        if options.json is not None:
            about = {"target": target.name, "data": str(options.data), "splits": data.splits}
            write_json(options.json, {**about, **scores})
            print(options.json)

    return exit_code(work, debug=options.debug, resumes=False)
