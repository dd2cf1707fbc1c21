"""Make the toy target, experiments/toy: streets of our engine in another style, not photographs.

    python -m scripts.make_toy

It has other assets than `sdr-jax render`, and a warm, pale, softer camera, which renders lack: 14 images
to train on and 8 to test on, each of another street.
"""

from __future__ import annotations

from pathlib import Path

import cv2

from scene.assets.catalogue import AssetPool
from scene.dataset.formats.segments import LABEL_OF_TRAIN
from scene.dataset.render import render_dataset
from scene.proposal import default_proposal, draw, slide
from scene.render import RenderSettings
from scene.render.sensor import CameraResponse

OUT = Path(__file__).resolve().parents[1] / "experiments" / "toy"
SEED = 11
SPLITS = {"train": 14, "test": 8}
WIDTH = 0.4
"""Width of every attribute's interval around the default street, as a share of its range."""
CAMERA = CameraResponse(
    exposure=1.1, gain=(1.12, 1.0, 0.84), blur=0.6, noise=0.015, contrast=1.25, saturation=0.6, vignette=0.2
)  # fmt: skip
POOL = AssetPool(first=200_000, size=24)
QUALITY = 85


def main() -> None:
    """Write images, labels and lists."""
    count = sum(SPLITS.values())
    wide = slide(default_proposal(space="extended").centre, WIDTH)
    settings = RenderSettings(480, 270, samples=2, response=CAMERA)
    rendered = render_dataset(
        draw(wide, SEED, count), SEED, shots=1, settings=settings, pool=POOL, workers=2
    )
    for folder in ("images", "labels"):
        (OUT / folder).mkdir(parents=True, exist_ok=True)
    names = [f"street{k:02d}" for k in range(count)]
    for name, image, label in zip(names, rendered.images, rendered.labels, strict=True):
        quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        cv2.imwrite(str(OUT / "images" / f"{name}.jpg"), image[..., ::-1], quality)
        cv2.imwrite(str(OUT / "labels" / f"{name}.png"), LABEL_OF_TRAIN[label])
    first = 0
    for split, size in SPLITS.items():
        (OUT / f"{split}.txt").write_text("\n".join(names[first : first + size]) + "\n")
        first += size


if __name__ == "__main__":
    main()
