"""Pictures of a run's report: streets, test images with the worst results, confusions.

``pictures/`` holds images as JPEG and labels as PNG in the colours of their classes; ``seen.json``, written
last, describes them.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from common.files import naming, write, write_json
from common.lines import Record
from experiments.attribute_search.loop import Found
from experiments.evaluation.predictions import Predictions, file_of, load
from experiments.session.session import Session
from seg.classes import ClassTable, class_table, colorize
from seg.data import LabelledImages

SHOWN = 6
"""Numbers of streets of each set, and of test images."""
PICTURES, INDEX = "pictures", "seen.json"
"""Names in the run folder: the pictures, and the file that describes them."""


def search(folder: Path, found: Found) -> None:
    """Write the policy after every update, f32[updates, attributes, bins], and the model's expectations."""
    kept = {"probabilities": found.probabilities, "expected": found.expected}
    for name, values in kept.items():
        if values is not None:
            data = io.BytesIO()
            np.save(data, values)
            _write(folder, f"{name}.npy", data.getvalue())


def show(run: Session[Any], test: LabelledImages, sets: Mapping[str, LabelledImages]) -> None:
    """Write all pictures, and the file that describes them.

    Args:
        run: the run, whose final nets are done.
        test: the test images.
        sets: training sets by row, with labels in the target's classes.
    """
    folder, table = run.config.out / PICTURES, class_table(run.target.table)
    kept = _kept(run.config.out, run.finals.records)
    index = {
        "classes": list(table.classes),
        "colors": table.colors.tolist(),
        "streets": {name: _streets(folder, name, own, table) for name, own in sets.items()},
        "shares": {name: shares(own.labels, len(table.classes)) for name, own in sets.items()},
        "confusion": {row: _confusion(own) for row, own in kept.items()},
        "worst": _worst(folder, test, kept, table),
    }
    write_json(folder / INDEX, index)


def shares(labels: np.ndarray, classes: int) -> dict[str, Any]:
    """Each class's share of the labelled pixels, and its mean row.

    Args:
        labels: u8[n, h, w], 255 for void.
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


def _kept(folder: Path, records: Sequence[Record]) -> dict[str, list[Predictions]]:
    """The kept predictions of each row's final nets, in the order of the seeds."""
    found: dict[str, dict[int, Predictions]] = {}
    for line in records:
        if line.get("nets") == "final" and (own := load(file_of(folder, line["key"]))) is not None:
            found.setdefault(line["row"], {})[line["seed"]] = own
    return {row: [own[seed] for seed in sorted(own)] for row, own in found.items()}


def _confusion(kept: Sequence[Predictions]) -> dict[str, Any]:
    """The confusion matrix in pixels over all nets of a row; row: true class."""
    total = np.sum([own.confusion for own in kept], axis=0)
    return {"nets": len(kept), "pixels": total.tolist()}


def _streets(
    folder: Path, name: str, own: LabelledImages, table: ClassTable
) -> list[dict[str, str]]:
    """Write some images of a set, spread evenly, with their labels."""
    chosen = np.linspace(0, len(own.images) - 1, min(SHOWN, len(own.images))).astype(int)
    return [
        {
            "image": _jpeg(folder, f"{name}-{k}", own.images[i]),
            "labels": _png(folder, f"{name}-{k}-labels", colorize(own.labels[i], table.colors)),
        }
        for k, i in enumerate(chosen)
    ]


def _worst(
    folder: Path, test: LabelledImages, kept: Mapping[str, Sequence[Predictions]], table: ClassTable
) -> dict[str, Any] | None:
    """Write the test images worst for the first net on learnt streets, and every row's predictions."""
    first = {row: own[0] for row, own in kept.items() if own[0].predictions is not None}
    best = next((row for row in ("few+learnt", "learnt", *first) if row in first), None)
    if best is None:
        return None
    chosen, miou = first[best].picked, first[best].miou
    assert chosen is not None and miou is not None
    order = [k for k in np.argsort(miou, kind="stable")[:SHOWN] if np.isfinite(miou[k])]
    images = [
        {
            "name": test.names[chosen[k]],
            "image": _jpeg(folder, f"worst-{n}", test.images[chosen[k]]),
            "labels": _png(
                folder, f"worst-{n}-labels", colorize(test.labels[chosen[k]], table.colors)
            ),
            "predictions": {
                row: {
                    "image": _png(
                        folder, f"worst-{n}-{row}", colorize(own.predictions[k], table.colors)
                    ),
                    "miou": round(100 * float(own.miou[k]), 2),
                }
                for row, own in first.items()
                if own.predictions is not None and own.miou is not None
            },
        }
        for n, k in enumerate(order)
    ]
    return {"by": best, "of": len(chosen), "images": images}


def _jpeg(folder: Path, name: str, image: np.ndarray) -> str:
    return _save(folder, f"{name}.jpg", image, quality=90)


def _png(folder: Path, name: str, image: np.ndarray) -> str:
    return _save(folder, f"{name}.png", image, optimize=True)


def _save(folder: Path, name: str, image: np.ndarray, **options: Any) -> str:
    """Write u8[h, w, 3] in the format that the name says; returns the name."""
    data = io.BytesIO()
    Image.fromarray(image).save(data, {"jpg": "JPEG"}.get(name[-3:], "PNG"), **options)
    _write(folder, name, data.getvalue())
    return name


def _write(folder: Path, name: str, data: bytes) -> None:
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write(folder / name, data, sync=False)
