"""Tiny data sets on disk, in the public layouts."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

H, W = 6, 8


def write_image(path: Path, seed: int = 0, size: tuple[int, int] = (H, W)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path)


def write_label(path: Path, values: np.ndarray, dtype=np.uint8) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), values.astype(dtype))


def label_values(seed: int, highest: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, highest + 1, (H, W))


@pytest.fixture
def camvid(tmp_path: Path) -> Path:
    """Three images of two sequences, with lists as in the public distribution."""
    root = tmp_path / "CamVid"
    names = ["0001TP_000001", "0001TP_000002", "Seq05VD_f00003"]
    for i, name in enumerate(names):
        write_image(root / "train" / f"{name}.png", i)
        write_label(root / "trainannot" / f"{name}.png", label_values(i, 11))
    prefix = "/SegNet/CamVid"
    lines = [f"{prefix}/train/{name}.png {prefix}/trainannot/{name}.png" for name in names]
    (root / "train.txt").write_text("\n".join(lines) + "\n")
    return root
