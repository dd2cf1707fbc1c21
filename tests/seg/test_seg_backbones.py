"""The protocol of backbones, by one that a user adds: two maps, trained on, tuned, saved and exported."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from experiments.app.export import export
from seg import RECIPES, ModelError, check_settings, mean_iou, predict, score
from seg.inference import logits
from seg.model import Model, label_classes, load_model
from seg.nets.backbones import BACKBONES, Backbone, make_backbone
from seg.pyramid import features
from seg.recipes import with_net
from seg.train import train
from seg.weights import check

from .conftest import assert_same, pixels, refuses, toy

SIZE = (48, 64)
TOY = toy(4, SIZE)


class Patches(nn.Module):
    """Convolutions at 1/6 and 1/12."""

    dtype: Any = None

    @nn.compact
    def __call__(self, images):
        fine = nn.relu(nn.Conv(5, (6, 6), strides=6, dtype=self.dtype, name="fine")(images))
        return fine, nn.Conv(5, (2, 2), strides=2, dtype=self.dtype, name="coarse")(fine)


def patches(weights: str | None) -> Backbone:
    module = Patches()

    def load():
        return module.init(jax.random.key(3), jnp.zeros((1, 12, 12, 3)))["params"]

    return Backbone(module, (6, 12), (5, 5), load, {"name": "patches", "version": "1"})


@pytest.fixture(autouse=True)
def added(monkeypatch):
    monkeypatch.setitem(BACKBONES, "patches", patches)
    yield
    make_backbone.cache_clear()


def settings_of(tuning="frozen", **changes):
    settings = with_net(RECIPES["lite0-frozen"], net="patches", backbone=tuning)
    return replace(settings, steps=60, batch=2, predict_batch=2, **changes)


@pytest.mark.parametrize("tuning", ["frozen", "tuned"])
def test_a_backbone_of_ones_own_is_all_that_a_backbone_is(tuning, tmp_path):
    settings = settings_of(tuning, lr=1e-2)
    check_settings(settings)
    check(settings, 2)
    images, labels = TOY
    net = train(0, images, labels, settings, 2)
    assert net["params"]["head"]["project"]["kernel"].shape == (1, 1, 10, 64)
    assert ("backbone" in net["params"]) == (tuning == "tuned")
    assert mean_iou(score(net, images, labels, settings, 2)) > 0.6
    if tuning == "tuned":
        kernel, before = (
            params["fine"]["kernel"] for params in (net["params"]["backbone"], patches(None).load())
        )
        assert 0 < np.abs(kernel - before).max() < 60 * 1.1e-3  # at a tenth of the rate
    model = Model(settings, net, SIZE, label_classes(["road", "sky"]))
    model.save(tmp_path / "model")
    again = load_model(tmp_path / "model")
    assert again.settings.net == "patches"
    expected = model.predict(images)
    assert_same(again.predict(images), expected)
    runtime = pytest.importorskip("onnxruntime")
    export(model, tmp_path / "net.onnx")
    session = runtime.InferenceSession(
        str(tmp_path / "net.onnx"), providers=["CPUExecutionProvider"]
    )
    scores = session.run(["logits"], {"image": images[:1]})[0]
    np.testing.assert_allclose(scores, logits(net, images[:1], settings, 2), atol=1e-2)


def test_maps_of_any_size_are_counted_by_strides():
    """At a size that is no multiple of a stride, and in bfloat16."""
    images = pixels(3, 45, 61, 3)
    maps = features(images, settings_of(dtype="bfloat16"))
    assert [(m.shape, m.dtype) for m in maps] == [
        ((3, 8, 11, 5), np.float16), ((3, 4, 6, 5), np.float16),
    ]  # fmt: skip
    exact = features(images, settings_of())
    assert not np.array_equal(maps[0], exact[0])
    np.testing.assert_allclose(maps[0], exact[0], atol=0.05)
    assert make_backbone("patches").pixel_bytes == 2 * 5 * (1 / 36 + 1 / 144)
    cell = images[0, :6, :6].astype(np.float32) / 255
    kernel = patches(None).load()["fine"]["kernel"]
    expected = np.maximum((cell[..., None] * kernel).sum((0, 1, 2)), 0)
    whole = features(images[:, :42, :60], settings_of())[0]
    np.testing.assert_allclose(whole[0, 0, 0], expected, atol=2e-3)


def test_what_a_backbone_cannot_be_is_refused(monkeypatch, tmp_path):
    settings = settings_of()
    refuses("11x40 pixels are too small for patches: .* stride of 12", train, 0,
            pixels(1, 40, 11, 3), np.zeros((1, 40, 11), np.uint8), settings, 2)  # fmt: skip
    maps = features(TOY[0], settings)[:1]
    refuses(r"features are float16\[4, 8, 11, 5\]; expected .* those of patches", predict, {}, TOY[0],
            settings, 2, features=maps)  # fmt: skip
    refuses("there is no backbone compact; known backbones: lite0, lite1", make_backbone, "compact")
    monkeypatch.setitem(
        BACKBONES, "odd", lambda weights: patches(weights)._replace(strides=(8, 12))
    )
    refuses(r"strides of odd are \(8, 12\); the first must divide", make_backbone, "odd")
    # The head is for the features of these weights, and of no others.
    net = train(0, *TOY, replace(settings, steps=1, warmup=0), 2)
    Model(settings, net, SIZE, label_classes(["road", "sky"])).save(tmp_path / "model")
    monkeypatch.setitem(
        BACKBONES, "patches", lambda weights: patches(weights)._replace(source={"name": "other"})
    )
    make_backbone.cache_clear()
    refuses("its head was trained on the backbone patches 1, not on other", load_model,
            tmp_path / "model", error=ModelError)  # fmt: skip
