"""Ways to train the VGG networks: named recipes, weights, accumulation, bfloat16, GroupNorm, odd sizes.

The networks are narrow here: the published ones have 40 to 134 million parameters.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import seg.nets
import seg.step
import seg.weights.vgg16 as names
from seg import RECIPES, TrainSettings, WeightsError, check_settings, predict
from seg.inference import _predictor
from seg.nets import Compact, DeepLabV2, FCN8s, net
from seg.nets.ops.normalise import MEAN
from seg.recipes import with_net
from seg.step import accumulated, functions
from seg.train import train
from seg.weights import check

from .conftest import assert_close, filled, narrow_vgg16, normal, pixels, refuses, vgg16_arrays

WIDTH, HIDDEN = 8, 16
NARROW = {"width": WIDTH, "hidden": HIDDEN}
SMALL = {"fcn8s": partial(FCN8s, **NARROW), "deeplabv2": partial(DeepLabV2, **NARROW)}
SMALL |= {"compact": Compact}


@pytest.fixture(autouse=True)
def narrow_nets(monkeypatch):
    monkeypatch.setattr(seg.nets, "_NETS", SMALL)
    caches = (seg.step._compiled, _predictor)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


def data(count=4, size=(32, 32)):
    labels = pixels(count, *size, seed=1, below=11)
    labels[0, : size[0] // 2] = 255  # parts of a batch differ in how much of them is labelled
    return pixels(count, *size, 3), labels


@pytest.mark.parametrize(("recipe", "name"), [
    ("paper", "deeplabv2"),
    pytest.param("vgg-adam", "fcn8s", marks=pytest.mark.slow),
    pytest.param("scratch", "fcn8s", marks=pytest.mark.slow),
    pytest.param("paper", "fcn8s", marks=pytest.mark.slow),
    pytest.param("scratch", "deeplabv2", marks=pytest.mark.slow),
])  # fmt: skip
def test_recipes_train_both_nets(recipe, name):
    settings = replace(RECIPES[recipe], net=name, steps=2, warmup=0, batch=2)
    check_settings(settings)
    assert (settings.lr_multipliers == "deeplab") == (recipe != "scratch") != settings.norm
    params = train(0, *data(2), settings, 11)["params"]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(params))
    assert ("norm1_1" in params["vgg16"]) == settings.norm


def test_the_paper_s_recipe_has_its_numbers_and_the_warm_up_fits_fewer_steps():
    paper = RECIPES["paper"]
    assert (paper.optimizer, paper.lr, paper.momentum, paper.weight_decay) == (
        "sgd",
        5e-4,
        0.9,
        1e-4,
    )
    assert (paper.power, paper.warmup, paper.steps, paper.batch) == (0.9, 0, 1000, 4)
    assert paper.lr_multipliers == "deeplab" and paper.mirror and not paper.weighted
    assert not (paper.colour or paper.mix or paper.blur or paper.noise or paper.scale or paper.norm)
    assert paper.average == 0 and paper.dtype == "float32"
    expected = replace(paper, optimizer="adam", lr=1e-4, weighted=True)
    assert RECIPES["vgg-adam"] == expected
    rates = {name: (recipe.optimizer, recipe.lr, recipe.warmup, recipe.weight_decay, recipe.power)
             for name, recipe in RECIPES.items()}  # fmt: skip
    assert rates == {
        "compact": ("adam", 1e-2, 20, 0, 0.9), "paper": ("sgd", 5e-4, 0, 1e-4, 0.9),
        "vgg-adam": ("adam", 1e-4, 0, 1e-4, 0.9), "scratch": ("adam", 1e-3, 50, 0, 0.9),
        "lite0-frozen": ("adam", 1e-2, 20, 0, 0.9),
        "lite0-heads": ("adam", 1e-2, 20, 0, 0.9), "lite0-tuned": ("adam", 1e-3, 20, 0, 0.9),
        "lite0-full": ("adam", 1e-3, 20, 0, 0.9),
    }  # fmt: skip
    short = with_net(replace(RECIPES["compact"], steps=7, warmup=0), net="fcn8s")
    assert (short.steps, short.warmup) == (7, 1)


@pytest.mark.parametrize("parts", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_accumulated_steps_are_those_of_the_whole_batch(parts):
    whole = TrainSettings(optimizer="sgd", lr=0.1, steps=3, batch=4, warmup=0)
    losses = []
    options = {"progress": lambda _, loss: losses.append(loss)}
    settings = whole, replace(whole, accumulate=parts)
    assert_close(*(train(0, *data(), changed, 11, **options) for changed in settings), atol=1e-5)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)


@pytest.mark.parametrize(("weights", "expected"), [((1.0, 3.0), (2.5, 5.0)), ((0.0, 0.0), (0, 0))])
def test_accumulated_gradient_by_hand(weights, expected):
    """Two parts with weights 1 and 3: (1 * 2 + 3 * 6) / 4 for p * x, x = 2 and 6."""

    def sums_of(params, x, y, part):
        weight = jnp.asarray(weights)[part]
        return weight * params["p"] * x.mean(), weight

    x = jnp.array([2.0, 6.0]).reshape(2, 1, 1, 1) * jnp.ones((2, 1, 1, 3))
    labels = jnp.zeros((2, 1, 1), jnp.uint8)
    loss, gradient = accumulated(sums_of, {"p": jnp.float32(0.5)}, x, labels, 2)
    assert (float(loss), float(gradient["p"])) == pytest.approx(expected)


@pytest.mark.parametrize("name", SMALL)
def test_bfloat16_computes_about_the_same(name):
    images, exact, half = normal(1, 32, 32, 3), net(name, 5), net(name, 5, "bfloat16")
    params = filled(exact, images, 1)
    outline = jax.eval_shape(half.init, jax.random.key(0), images)["params"]
    assert {leaf.dtype for leaf in jax.tree.leaves(outline)} == {jnp.dtype("float32")}
    a, b = (jax.jit(m.apply)({"params": params}, images) for m in (exact, half))
    assert b.dtype == jnp.float32 and not np.array_equal(a, b)
    assert np.abs(a - b).max() < 0.05 * np.abs(a).max()


@pytest.mark.parametrize("name", SMALL)
def test_images_of_any_size_are_segmented_whole(name):
    """As inside a frame of the mean colour whose sides are multiples of 8 or 32, then cropped."""
    settings, images = TrainSettings(net=name, predict_batch=2), pixels(3, 45, 61, 3)
    variables = functions(settings, 11).init(np.uint32(0), images).trained
    predicted = predict(variables, images, settings, 11)
    assert predicted.shape == (3, 45, 61) and predicted.dtype == np.uint8
    rows, cols = (64, 64) if name == "fcn8s" else (48, 64)
    # The mean colour, which the network's normalisation turns into zeros.
    padded = np.tile(np.float32(MEAN), (3, rows, cols, 1))
    padded[:, :45, :61] = images / np.float32(255)
    logits = jax.jit(net(name, 11).apply)(variables, padded)[:, :45, :61]
    assert (predicted == np.argmax(logits, -1)).mean() > 0.999


def write_weights(path, monkeypatch, only=""):
    narrow_vgg16(monkeypatch, WIDTH, HIDDEN)
    arrays = {n: 0.01 * a for n, a in vgg16_arrays().items() if n.startswith(only)}
    np.savez(path, **arrays, normalisation="torchvision")
    return arrays


@pytest.mark.parametrize("name", [pytest.param("deeplabv2", marks=pytest.mark.slow), "fcn8s"])
def test_training_starts_from_weights(name, tmp_path, monkeypatch):
    arrays = write_weights(tmp_path / "vgg16.npz", monkeypatch, only="conv")
    settings = replace(RECIPES["paper"], net=name, steps=1, lr=1e-6, batch=2)
    started = replace(settings, weights=str(tmp_path / "vgg16.npz"))
    params, other = (train(0, *data(2), chosen, 11)["params"] for chosen in (started, settings))
    for layer in names.CONVS:
        kernel = arrays[f"{layer}/kernel"]
        np.testing.assert_allclose(params["vgg16"][layer]["kernel"], kernel, atol=1e-4)
        assert not np.allclose(other["vgg16"][layer]["kernel"], kernel, atol=1e-3)
    # What the file does not give is drawn as without it.
    for layer in ("fc6", "score_pool3") if name == "fcn8s" else ("fc6_1", "fc7_1"):
        np.testing.assert_allclose(params[layer]["kernel"], other[layer]["kernel"], atol=1e-4)


def test_weights_are_checked_before_they_are_needed(tmp_path, monkeypatch):
    write_weights(tmp_path / "vgg16.npz", monkeypatch)
    check(RECIPES["paper"], 11)
    check(replace(RECIPES["paper"], weights=str(tmp_path / "vgg16.npz")), 11)
    settings = replace(RECIPES["paper"], weights="none.npz")
    for use in (lambda: check(settings, 11), lambda: train(0, *data(4), settings, 11)):
        refuses(r"none\.npz: No such file", use, error=WeightsError)
