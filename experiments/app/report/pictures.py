"""Images of a run's report: streets, test images with predictions, confusion matrices.

``pictures/`` holds images as JPEG and labels as PNG in the colours of their classes. ``seen.json``, written
last, describes them.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from common.files import naming, write, write_json
from common.lines import Record
from experiments.attribute_search.loop import Found
from experiments.evaluation.predictions import Predictions, file_of, load
from experiments.session.session import Session
from experiments.tables.row_names import TRAINED_ON
from scene.preview.layout import captioned, grid, save, stack
from seg.classes import ClassTable, class_table, colorize
from seg.data import LabelledImages

SHOWN = 6
"""The number of streets of each set, and of test images."""
PICTURES, INDEX = "pictures", "seen.json"
"""Names in the run folder: the images, and the file that describes them."""
START = "start.jpg"
"""Name in the run folder: what the search starts from."""
START_WIDTH = 240
"""Width of its images, pixels."""


def write_start(
    folder: Path, target: str, test: LabelledImages, sets: Mapping[str, LabelledImages]
) -> Path:
    """Write one image of what a search starts from: images of the target above streets of each set.

    Args:
        folder: the run folder.
        target: the title of the target.
        test: the target's test images.
        sets: rendered images by row.

    Returns:
        The file.
    """
    named = {f"Target: {target}": test}
    named |= {TRAINED_ON[row].capitalize(): images for row, images in sets.items()}
    rows = [captioned(_row(images.images), caption) for caption, images in named.items()]
    save(stack(rows), folder / START)
    return folder / START


def _row(images: np.ndarray) -> np.ndarray:
    """Up to four of the images u8[n, h, w, 3] side by side, spread evenly."""
    chosen = _evenly(len(images), 4)
    height = max(images.shape[1] * START_WIDTH // images.shape[2], 1)
    return grid([cv2.resize(images[i], (START_WIDTH, height)) for i in chosen], len(chosen))


def _evenly(count: int, most: int) -> np.ndarray:
    """Up to so many indices of ``count`` images, spread evenly."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def write_policy(folder: Path, result: Found) -> None:
    """Write the policy after every update, f32[updates, attributes, bins], and the predicted rewards."""
    arrays = {"probabilities": result.probabilities, "expected": result.expected}
    for name, values in arrays.items():
        if values is not None:
            data = io.BytesIO()
            np.save(data, values)
            _write(folder, f"{name}.npy", data.getvalue())


def write_images(
    run: Session[Any],
    test: LabelledImages,
    sets: Mapping[str, LabelledImages],
    nets: Sequence[str],
    ranked_by: Sequence[str],
) -> None:
    """Write all images, and the file that describes them.

    Args:
        run: the run, whose networks are tested.
        test: the test images.
        sets: training sets by row, with labels in the target's classes.
        nets: the kinds of networks in the run's log; those of the first kind predict the test images.
        ranked_by: rows in order of preference; the first network of the first one with predictions ranks the
            test images.
    """
    folder, table = run.config.out / PICTURES, class_table(run.target.table)
    predictions = _predictions(run.config.out, run.finals.records, nets)
    index = {
        "classes": list(table.classes),
        "colors": table.colors.tolist(),
        "streets": {row: _streets(folder, row, images, table) for row, images in sets.items()},
        "shares": {row: shares(images.labels, len(table.classes)) for row, images in sets.items()},
        "confusion": {row: _confusion(of_seeds) for row, of_seeds in predictions.items()},
        "tested": _tested(folder, test, predictions, table, ranked_by),
    }
    write_json(folder / INDEX, index)


def shares(labels: np.ndarray, classes: int) -> dict[str, Any]:
    """Each class's share of the labelled pixels, and its mean row.

    Args:
        labels: u8[n, h, w], 255 for ignored pixels.
        classes: number of classes in the table.

    Returns:
        The number of ``images``; ``pixels`` in percent; ``row``, 0 at the top, 100 at the bottom, None for
        absent classes.
    """
    height = labels.shape[1]
    lines = 256 * np.arange(height)[:, None]
    counts = np.zeros(256 * height, np.int64)
    for image in labels:
        counts += np.bincount((lines + image).ravel(), minlength=256 * height)
    counts = counts.reshape(height, 256)[:, :classes]
    pixels, middles = counts.sum(axis=0), (np.arange(height) + 0.5) / height
    rows = (counts * middles[:, None]).sum(axis=0) / np.maximum(pixels, 1)
    return {
        "images": len(labels),
        "pixels": [round(100 * float(v), 4) for v in pixels / max(int(pixels.sum()), 1)],
        "row": [round(100 * float(v), 2) if p else None for v, p in zip(rows, pixels, strict=True)],
    }


def _predictions(
    folder: Path, records: Sequence[Record], nets: Sequence[str]
) -> dict[str, list[Predictions]]:
    """The saved predictions of each row's networks, in the order of their kinds and seeds."""
    by_place: dict[str, dict[tuple[int, int], Predictions]] = {}
    for line in records:
        kind = line.get("nets")
        if kind in nets and (saved := load(file_of(folder, line["key"]))) is not None:
            by_place.setdefault(line["row"], {})[nets.index(kind), line["seed"]] = saved
    return {row: [saved[place] for place in sorted(saved)] for row, saved in by_place.items()}


def _confusion(predictions: Sequence[Predictions]) -> dict[str, Any]:
    """The confusion matrix in pixels over all networks of a row; row: true class."""
    total = np.sum([network.confusion for network in predictions], axis=0)
    return {"nets": len(predictions), "pixels": total.tolist()}


def _streets(
    folder: Path, row: str, images: LabelledImages, table: ClassTable
) -> list[dict[str, str]]:
    """Write some images of a set, spread evenly, with their labels."""
    chosen = _evenly(len(images.images), SHOWN)
    return [
        {
            "image": _jpeg(folder, f"{row}-{k}", images.images[i]),
            "labels": _png(folder, f"{row}-{k}-labels", colorize(images.labels[i], table.colors)),
        }
        for k, i in enumerate(chosen)
    ]


def _tested(
    folder: Path,
    test: LabelledImages,
    predictions: Mapping[str, Sequence[Predictions]],
    table: ClassTable,
    ranked_by: Sequence[str],
) -> dict[str, Any] | None:
    """Write some test images from the best to the worst of a network, and all rows' predictions."""
    first = {
        row: networks[0]
        for row, networks in predictions.items()
        if networks[0].predictions is not None
    }
    best = next((row for row in (*ranked_by, *first) if row in first), None)
    if best is None:
        return None
    chosen, miou = first[best].picked, first[best].miou
    assert chosen is not None and miou is not None
    images = [
        {
            "name": test.names[chosen[k]],
            "image": _jpeg(folder, f"tested-{n}", test.images[chosen[k]]),
            "labels": _png(
                folder, f"tested-{n}-labels", colorize(test.labels[chosen[k]], table.colors)
            ),
            "predictions": {
                row: {
                    "image": _png(
                        folder, f"tested-{n}-{row}", colorize(network.predictions[k], table.colors)
                    ),
                    "miou": round(100 * float(network.miou[k]), 2),
                }
                for row, network in first.items()
                if network.predictions is not None and network.miou is not None
            },
        }
        for n, k in enumerate(best_to_worst(miou))
    ]
    return {"by": best, "of": len(chosen), "images": images}


def best_to_worst(miou: np.ndarray) -> list[int]:
    """Some images spread evenly from the best to the worst, without those of which all pixels are ignored.

    Args:
        miou: f32[images] of each image; NaN, if all of its pixels are ignored.
    """
    ranked = np.argsort(-miou, kind="stable")[: np.isfinite(miou).sum()]  # NaN comes last
    return ranked[_evenly(len(ranked), SHOWN)].tolist()


def _jpeg(folder: Path, name: str, image: np.ndarray) -> str:
    return _save(folder, f"{name}.jpg", image, quality=90)


def _png(folder: Path, name: str, image: np.ndarray) -> str:
    return _save(folder, f"{name}.png", image, optimize=True)


def _save(folder: Path, name: str, image: np.ndarray, **options: Any) -> str:
    """Write u8[h, w, 3] in the format of the name's ending, and return the name."""
    data = io.BytesIO()
    Image.fromarray(image).save(data, {"jpg": "JPEG"}.get(name[-3:], "PNG"), **options)
    _write(folder, name, data.getvalue())
    return name


def _write(folder: Path, name: str, data: bytes) -> None:
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write(folder / name, data, sync=False)
