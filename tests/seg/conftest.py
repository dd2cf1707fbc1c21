"""Tiny data sets on disk, in the public layouts."""

from pathlib import Path

import cv2
import jax
import numpy as np
import pytest
from PIL import Image

from seg.weights import vgg16

H, W = 6, 8


def filled(module, images, seed: int = 0):
    """Parameters of ordinary sizes, none of them 0: drawing them with JAX would compile for a minute."""
    rng = np.random.default_rng(seed)

    def draw(leaf):
        scale = np.sqrt(2 / np.prod(leaf.shape[:-1])) if len(leaf.shape) == 4 else 0.1
        return rng.normal(0, scale, leaf.shape).astype(np.float32)

    outline = jax.eval_shape(module.init, jax.random.key(0), images)
    return jax.tree.map(draw, outline["params"])


def narrow_vgg16(patch: pytest.MonkeyPatch, width: int, hidden: int) -> None:
    """Files of weights have so many channels where the published VGG16 has 64: kilobytes, not 500 MB."""
    patch.setattr(vgg16, "_CHANNELS", (3, *(c * width // 64 for c in vgg16._CHANNELS[1:])))
    patch.setattr(vgg16, "_HIDDEN", hidden)


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
