"""Draw the images of the pages, again for each engine.

    python -m scripts.pictures --out docs --run runs/demo

`strip.jpg` has streets of the twin, their labels, and the predictions of `renders19`, which was trained on
neither the twin nor photographs. `streets.jpg` has the images of `sdr-jax render --images 8`. With `--run`, a
finished `make demo`, `search_streets.webp` shows two streets as the search changes their attributes, next to
the same streets with the attributes that it should find.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import scene
from common.files import read_json
from common.workers.pool import WorkerPool
from experiments.targets.twin import twin_split, twin_world
from scene.attributes import default_unit
from scene.dataset.render import render_dataset
from scene.preview import layout
from scene.render import RenderSettings
from seg.model import load_model

TWIN_STREETS = (2, 6)
"""Streets of the twin's test split, one a row: both show cars, people and a traffic light or sign."""
TWIN_SIZE = (304, 424)
"""Height and width of each image of the strip: three and two gaps are 1280 wide."""
SEARCHED_STREETS = (3, 14)
"""Seeds of the streets of `search_streets.webp`, one a row."""
SEARCH_SIZE = (384, 192)
"""Width and height of each of its images."""
EVERY = 5
"""Updates of the search between two frames."""
CAPTION = 26
"""Pixels of the bar above a frame."""
GAP = 4


def main() -> None:
    """Write the images."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the images")
    parser.add_argument(
        "--run", type=Path, help="finished run of make demo, for search_streets.webp"
    )
    options = parser.parse_args()
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    if options.run is not None:
        search(options.run, out / "search_streets.webp")
    save(out / "strip.jpg", strip())
    save(out / "streets.jpg", streets())


def strip() -> np.ndarray:
    """Show image, label and prediction of streets of the twin, u8[rows, 1280, 3]."""
    world, model = twin_world(0), load_model("renders19")
    count = (max(TWIN_STREETS) + 1) * world.shots
    with WorkerPool(2) as workers:
        twin = twin_split(
            world, "test", TWIN_SIZE, images=count, renderer="embree", workers=workers
        )
    first = [street * world.shots for street in TWIN_STREETS]
    images, labels = [twin.images[k] for k in first], [twin.labels[k] for k in first]
    predictions = [model.painted(classes, "colours") for classes in model.predict(images)]
    truth = [model.painted(label, "colours") for label in labels]
    return grid(list(zip(images, truth, predictions, strict=True)))


def streets() -> np.ndarray:
    """The eight images of `sdr-jax render --images 8`, at half their size, u8[rows, 1292, 3]."""
    samples = scene.stream("default", seed=0, size=(640, 320), images=8, workers=2)
    half = [cv2.resize(image, (320, 160), interpolation=cv2.INTER_AREA) for image, *_ in samples]
    return grid([half[:4], half[4:]])


def search(run: Path, path: Path) -> None:
    """Animate the streets of a finished search on a far twin, after every `EVERY` of its updates."""
    config = read_json(run / "config.json")
    policies = np.load(run / "pictures" / "probabilities.npy")  # updates, attributes, bins
    centres = (np.arange(policies.shape[-1]) + 0.5) / policies.shape[-1]
    world = twin_world(config["twin_seed"], config["twin"])
    targets = [_street(world.centre, seed) for seed in SEARCHED_STREETS]
    per_update = config["search"]["datasets_per_update"]
    frames = [_frame("default streets", default_unit(config["space"]), targets)]
    for update in range(EVERY, len(policies) + 1, EVERY):
        caption = f"after {per_update * update} rewards"
        frames.append(_frame(caption, policies[update - 1] @ centres, targets))
    first, *others = map(Image.fromarray, frames)
    durations = [1500, *[700] * (len(others) - 1), 2500]  # ms
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0, quality=70)


def _street(centre: np.ndarray, seed: int) -> np.ndarray:
    """The first image of a street with exactly these attributes, u8[h, w, 3]."""
    settings = RenderSettings(*SEARCH_SIZE, 2)
    return render_dataset(centre[None].astype(np.float32), seed, shots=1, settings=settings).images[
        0
    ]


def _frame(caption: str, centre: np.ndarray, targets: Sequence[np.ndarray]) -> np.ndarray:
    rows = [
        (_street(centre, seed), target)
        for seed, target in zip(SEARCHED_STREETS, targets, strict=True)
    ]
    images = grid(rows)
    bar = np.full((CAPTION, images.shape[1], 3), 255, np.uint8)
    for text, left in ((caption, 4), ("target", SEARCH_SIZE[0] + GAP + 4)):
        cv2.putText(
            bar, text, (left, CAPTION - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (60,) * 3, 1, cv2.LINE_AA
        )
    return np.vstack([bar, images])


def grid(rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    """Arrange images of one size in rows, white between them."""
    gap = ((0, GAP), (0, GAP), (0, 0))
    framed = [np.pad(image, gap, constant_values=255) for row in rows for image in row]
    return layout.grid(framed, len(rows[0]))[:-GAP, :-GAP]


def save(path: Path, image: np.ndarray) -> None:
    """Write an RGB image as a JPEG file."""
    cv2.imwrite(str(path), image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
