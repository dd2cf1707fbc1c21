"""Draws the pictures of the front page, anew for each engine.

    python -m scripts.pictures --out docs

`strip.jpg` has streets of the twin, their labels, and what a net sees in them that has seen neither the
twin nor a photograph (`renders19`). `streets.jpg` has the images of `sdr-jax render --images 8`. The tops
of `report.png` and `playground.png`, screenshots that lie in the folder, become `report_small.jpg` and
`playground_small.jpg`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

import scene
from common.workers.pool import WorkerPool
from experiments.targets.twin import twin_split, twin_world
from scene.preview import layout
from seg.model import load_model

TWIN_STREETS = (2, 6)
"""Streets of the twin's test split, one a row: both show cars, people and a traffic light or sign."""
TWIN_SIZE = (304, 424)
"""Height and width of each picture of the strip: three and two gaps are 1280 wide."""
GAP = 4
SMALL = (500, 620)
"""Height and width, at most, of the small screenshots."""


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the pictures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name in ("report", "playground"):
        save(out / f"{name}_small.jpg", small(out / f"{name}.png"))
    save(out / "strip.jpg", strip())
    save(out / "streets.jpg", streets())


def strip() -> np.ndarray:
    """Image, label and prediction of streets of the twin, u8[rows, 1280, 3]."""
    world, model = twin_world(0), load_model("renders19")
    count = (max(TWIN_STREETS) + 1) * world.shots
    with WorkerPool(2) as workers:
        twin = twin_split(
            world, "test", TWIN_SIZE, images=count, renderer="embree", workers=workers
        )
    first = [street * world.shots for street in TWIN_STREETS]
    images, labels = [twin.images[k] for k in first], [twin.labels[k] for k in first]
    seen = [model.painted(found, "colours") for found in model.predict(images)]
    told = [model.painted(label, "colours") for label in labels]
    return grid(list(zip(images, told, seen, strict=True)))


def streets() -> np.ndarray:
    """The eight images of `sdr-jax render --images 8`, at half their size, u8[rows, 1292, 3]."""
    made = scene.stream("default", seed=0, size=(640, 320), images=8, workers=2)
    half = [cv2.resize(image, (320, 160), interpolation=cv2.INTER_AREA) for image, *_ in made]
    return grid([half[:4], half[4:]])


def small(screenshot: Path) -> np.ndarray:
    """The top of a screenshot, no larger than `SMALL`."""
    read = cv2.imread(str(screenshot))
    assert read is not None
    whole = read[:, :, ::-1]
    height = round(whole.shape[0] * SMALL[1] / whole.shape[1])
    return cv2.resize(whole, (SMALL[1], height), interpolation=cv2.INTER_AREA)[: SMALL[0]]


def grid(rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    """Pictures of one size beside and below each other, white between them."""
    gap = ((0, GAP), (0, GAP), (0, 0))
    framed = [np.pad(picture, gap, constant_values=255) for row in rows for picture in row]
    return layout.grid(framed, len(rows[0]))[:-GAP, :-GAP]


def save(path: Path, picture: np.ndarray) -> None:
    """Write an RGB picture as a JPEG file."""
    cv2.imwrite(str(path), picture[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
