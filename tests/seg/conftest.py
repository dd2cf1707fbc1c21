"""Tiny data sets on disk, in the public layouts, and files of the weights of a narrow VGG16."""

import re
from functools import partial
from pathlib import Path

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import strategies as st
from PIL import Image

from seg.data import DataError
from seg.errors import WeightsError
from seg.nets.backbones import BACKBONES, Backbone
from seg.nets.lite import STRIDES, Block, Lite, channels_of
from seg.weights import convert, vgg16
from seg.weights.__main__ import main
from seg.weights.normalisation import from_bgr
from seg.weights.read import read_npz
from tests.conftest import refuses as refuses
from tests.trees import assert_close as assert_close
from tests.trees import assert_same as assert_same

H, W = 6, 8
WIDTH, HIDDEN = 2, 5  # of the VGG16 in files of weights, where a test says `narrow`
SEEDS = st.integers(0, 2**32 - 1)


def normal(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def pixels(*shape, seed=0, below=256):
    return np.random.default_rng(seed).integers(0, below, shape, np.uint8)


refuses_file = partial(refuses, error=DataError)
refuses_weights = partial(refuses, error=WeightsError)


def same_function(function, reference, *inputs, atol=1e-5, of_gradients=1e-4, rtol=1e-7):
    """Values agree, alone and on the way to a gradient, and so do the gradients of every input."""
    (result, back), (expected, reference_back) = (
        jax.vjp(f, *inputs) for f in (function, reference)
    )
    assert result.dtype == expected.dtype
    for value in (result, function(*inputs)):
        assert_close(jnp.float32(value), jnp.float32(expected), rtol, atol)
    weight = normal(*expected.shape, seed=9).astype(expected.dtype)
    assert_close(back(weight), reference_back(weight), rtol, of_gradients)


def toy(count=2, size=(32, 32)):
    """Two classes: a bright box on dark noise, at a place of its own; a strip of ignored pixels."""
    labels = np.zeros((count, *size), np.uint8)
    columns = size[1] // 8
    for number, label in enumerate(labels):
        label[size[0] // 6 : 5 * size[0] // 6, columns * number : columns * (number + 3)] = 1
    images = np.where(labels[..., None] == 1, (220, 190, 60), (40, 60, 90))
    images = images + np.random.default_rng(0).normal(0, 10, images.shape)
    labels[:, :2] = 255
    return np.clip(images, 0, 255).astype(np.uint8), labels


def filled(module, images, seed: int = 0):
    """Parameters of a module for such images."""
    return random_params(jax.eval_shape(module.init, jax.random.key(0), images)["params"], seed)


def random_params(outline, seed: int = 0):
    """Parameters of ordinary sizes, none of them 0: drawing them with JAX would compile for a minute."""
    rng = np.random.default_rng(seed)

    def draw(leaf):
        scale = np.sqrt(2 / np.prod(leaf.shape[:-1])) if len(leaf.shape) == 4 else 0.1
        return rng.normal(0, scale, leaf.shape).astype(np.float32)

    return jax.tree.map(draw, outline)


@pytest.fixture
def narrow_lite(monkeypatch):
    """A backbone of five blocks with lite0's maps, by its name: lite0 compiles for most of a minute."""
    blocks = (Block(3, 1, 1, 8), *(Block(3, 2, 1, width) for width in (8, 56, 112, 320)))
    module = Lite(blocks)
    weights = filled(module, jnp.zeros((1, 32, 32, 3)))
    made = Backbone(module, STRIDES, channels_of(blocks), lambda: weights, {"package": "none"})
    monkeypatch.setitem(BACKBONES, "narrow_lite", lambda _: made)
    return "narrow_lite"


def narrow_vgg16(patch: pytest.MonkeyPatch, width: int, hidden: int) -> None:
    """Files of weights have so many channels where the published VGG16 has 64: kilobytes, not 500 MB."""
    patch.setattr(vgg16, "_CHANNELS", (3, *(c * width // 64 for c in vgg16._CHANNELS[1:])))
    patch.setattr(vgg16, "_HIDDEN", hidden)


@pytest.fixture
def narrow(monkeypatch):
    narrow_vgg16(monkeypatch, WIDTH, HIDDEN)


def vgg16_arrays(seed=0):
    rng = np.random.default_rng(seed)
    return {n: rng.normal(size=s).astype(np.float32) for n, s in vgg16.shapes().items()}


def run(source, out, *options):
    return main(["convert", str(source), "--out", str(out), *options])


def check_vgg16(path, normalisation, layers=vgg16.LAYERS):
    """The weights of `vgg16_arrays` for our images, bit by bit; returns the source that the file names."""
    arrays = read_npz(path)
    assert str(arrays.pop("normalisation")) == normalisation
    source = str(arrays.pop("source"))
    expected = {n: a for n, a in vgg16_arrays().items() if n.split("/")[0] in layers}
    if normalisation != "torchvision":
        first = "conv1_1/kernel", "conv1_1/bias"
        expected |= zip(first, from_bgr(*(expected[n] for n in first)), strict=True)
    assert_same(arrays, expected)
    return source


def check_bad(path, message, capsys):
    """Refused by the function, and in one line by the command; what was there stays."""
    out = path.with_name("o.npz")
    out.write_text("before")
    refuses_weights(rf"{re.escape(path.name)}: {message}", convert, path, out)
    assert run(path, out) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and re.search(message, line)
    assert out.read_text() == "before" and len(list(path.parent.iterdir())) == 2


def check_cut(path):
    """Cut short at any length it is refused."""
    data = path.read_bytes()
    for share in np.linspace(0, 1, 25, endpoint=False):
        path.write_bytes(data[: int(share * len(data))])
        refuses_weights(path.name, convert, path, path.with_name("out.npz"))


def write_image(path: Path, seed: int = 0, size: tuple[int, int] = (H, W)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels(*size, 3, seed=seed)).save(path)


def write_label(path: Path, values: np.ndarray, dtype=np.uint8) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), values.astype(dtype))
