"""Networks: shapes and parameter counts at full size (without running), behaviour at a small one."""

from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn
from hypothesis import given, settings
from hypothesis import strategies as st

from seg.nets import VGG16, Compact, DeepLabV2, FCN8s, net, normalise
from seg.nets.fcn8s import bilinear_kernel
from seg.nets.ops.conv import Conv, conv, kernel_gradient, xla_conv
from seg.nets.ops.group_norm import GroupNorm
from seg.nets.ops.max_pool import max_pool
from seg.nets.ops.product_conv import patch_conv, product_conv
from seg.nets.ops.resize import bilinear, repeat_pixels, space_to_depth

from .conftest import SEEDS, filled, normal, refuses, same_function


def outline(module, *shape):
    """Shape of the output and number of parameters, from `eval_shape`: nothing is computed."""
    rngs = {"params": jax.random.key(0), "dropout": jax.random.key(1)}
    train = {} if isinstance(module, VGG16) else {"train": True}
    run = partial(module.init_with_output, rngs, **train)
    out, variables = jax.eval_shape(run, jax.ShapeDtypeStruct(shape, jnp.float32))
    assert set(variables) == {"params"}
    return out, sum(leaf.size for leaf in jax.tree.leaves(variables))


def conv_count(side, c_in, c_out):
    return side * side * c_in * c_out + c_out


@pytest.mark.parametrize("classes", [11, 19])
def test_parameters_are_as_many_as_published(classes):
    channels = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
    vgg16 = sum(conv_count(3, c_in, c_out) for c_in, c_out in pairwise(channels))
    assert vgg16 == 14_714_688
    fcn8s = conv_count(7, 512, 4096) + conv_count(1, 4096, 4096) + 2 * 4 * 4 * classes**2
    fcn8s += sum(conv_count(1, c_in, classes) for c_in in (4096, 512, 256))
    branch = conv_count(3, 512, 1024) + conv_count(1, 1024, 1024) + conv_count(1, 1024, classes)
    blocks = (49, 24), (24, 24), (24, 48), (48, 48), (48, 48), (24, 24)
    # No bias; GroupNorm has two numbers per channel.
    compact = sum(9 * c_in * c_out + 2 * c_out for c_in, c_out in blocks)
    compact += conv_count(1, 48, 24) + conv_count(1, 24, classes)
    for kind, expected in (
        (FCN8s, vgg16 + fcn8s), (DeepLabV2, vgg16 + 4 * branch), (Compact, compact),
    ):  # fmt: skip
        out, count = outline(kind(classes), 2, 360, 480, 3)
        assert out.shape == (2, 360, 480, classes) and count == expected
    for atrous in (False, True):
        assert outline(VGG16(atrous=atrous), 1, 64, 96, 3)[1] == vgg16


def test_vgg16_strides_and_factory_errors():
    strided, atrous = (outline(VGG16(atrous=a), 1, 320, 640, 3)[0] for a in (False, True))
    channels = (64, 128, 256, 512, 512)
    expected = [(320 >> k, 640 >> k, c) for k, c in enumerate(channels, 1)]
    assert [p.shape[1:] for p in strided] == expected
    assert [p.shape[1] for p in atrous] == [160, 80, 40, 40, 40]
    refuses(r"unknown network 'unet'; .*: compact, deeplabv2, dinov2, fcn8s", net, "unet", 11)
    for classes in (0, 256):
        refuses(f"a network has 1 to 255 classes; got {classes}", net, "compact", classes)


@pytest.mark.parametrize("kind", [FCN8s, DeepLabV2])
def test_narrow_vgg_nets_run_and_drop_out(kind):
    module = kind(3, width=4, hidden=8)
    images = jax.random.normal(jax.random.key(0), (1, 32, 32, 3))
    variables = {"params": filled(module, images)}
    noisy = jax.jit(lambda key: module.apply(variables, images, train=True, rngs={"dropout": key}))
    first, again, other = (noisy(jax.random.key(seed)) for seed in (1, 1, 2))
    assert jnp.isfinite(first).all()
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def layers(monkeypatch, module, *shape):
    """Side and rate of each convolution by name, and side and stride of each pooling."""
    convolutions, pools = {}, []

    def note(call, args, kwargs, context):
        if isinstance(context.module, Conv):
            convolutions[context.module.name] = (context.module.side, context.module.rate)
        return call(*args, **kwargs)

    def pool(x, side, stride):
        pools.append((side, stride))
        return max_pool(x, side, stride)

    monkeypatch.setattr("seg.nets.vgg16.max_pool", pool)
    with nn.intercept_methods(note):
        jax.eval_shape(module.init, jax.random.key(0), jax.ShapeDtypeStruct(shape, jnp.float32))
    return convolutions, pools


def test_sides_rates_and_strides_of_the_vgg_nets_as_published(monkeypatch):
    stages = {1: 2, 2: 2, 3: 3, 4: 3, 5: 3}
    names = [f"conv{stage}_{k}" for stage, count in stages.items() for k in range(1, count + 1)]
    of_fcn8s = dict.fromkeys(names, (3, 1))
    convolutions, pools = layers(monkeypatch, FCN8s(3), 1, 32, 32, 3)
    assert convolutions == of_fcn8s | {"fc6": (7, 1), "fc7": (1, 1)}
    assert pools == [(2, 2)] * 5
    convolutions, pools = layers(monkeypatch, DeepLabV2(3), 1, 32, 32, 3)
    atrous = of_fcn8s | dict.fromkeys(("conv5_1", "conv5_2", "conv5_3"), (3, 2))
    aspp = {f"fc6_{k}": (3, rate) for k, rate in enumerate((6, 12, 18, 24), 1)}
    assert convolutions == atrous | aspp | {f"fc7_{k}": (1, 1) for k in (1, 2, 3, 4)}
    assert pools == [(3, 2)] * 3 + [(3, 1)] * 2


@pytest.mark.parametrize("kind", [FCN8s, DeepLabV2])
def test_every_hidden_convolution_of_the_vgg_nets_has_a_relu(kind):
    """A bias far below 0 does the same as a layer of zeros."""
    module, images = kind(3, width=2, hidden=3), normal(1, 32, 32, 3)
    params = filled(module, images)
    run = jax.jit(module.apply)

    def changed(tree, name, layer):
        return {
            key: layer if key == name else changed(leaf, name, layer) if key == "vgg16" else leaf
            for key, leaf in tree.items()
        }

    hidden = params["vgg16"] | {
        k: leaf for k, leaf in params.items() if k.startswith(("fc6", "fc7"))
    }
    assert len(hidden) == 13 + (2 if kind is FCN8s else 8)
    for name, layer in hidden.items():
        zeros = jax.tree.map(np.zeros_like, layer)
        below = {**layer, "bias": zeros["bias"] - np.float32(1e6)}
        result, expected = (
            run({"params": changed(params, name, leaf)}, images) for leaf in (below, zeros)
        )
        np.testing.assert_array_equal(result, expected, name)


@pytest.mark.parametrize(("dtype", "wide"), [(None, 1e-4), (jnp.bfloat16, 0.1)])
def test_our_group_norm_and_its_gradients_are_flax_s(dtype, wide):
    x = 3 + normal(2, 5, 7, 6)
    kinds = [kind(num_groups=3, dtype=dtype, name="norm") for kind in (GroupNorm, nn.GroupNorm)]
    variables, flax_variables = (kind.init(jax.random.key(0), x) for kind in kinds)
    jax.tree.map(np.testing.assert_array_equal, variables, flax_variables)
    params = jax.tree.map(lambda p: p + 0.5, variables)
    same = {"atol": wide, "of_gradients": wide, "rtol": wide}
    same_function(*(kind.apply for kind in kinds), params, x, **same)


def test_vgg16_has_our_group_norm(monkeypatch):
    monkeypatch.setattr(nn, "GroupNorm", None)
    images = jax.ShapeDtypeStruct((1, 32, 32, 3), jnp.float32)
    params = jax.eval_shape(VGG16(norm=True).init, jax.random.key(0), images)["params"]
    assert params["norm1_1"].keys() == {"scale", "bias"}


@pytest.mark.parametrize("channels", [4, 40])  # scores of classes, and features
@pytest.mark.parametrize(
    ("times", "stride"), [(4, 1), (2, 1), (3, 1), (8, 2), (8, 4), (4, 3), (3, 5)]
)
def test_bilinear_and_its_gradient_are_those_of_jax(channels, times, stride):
    kept = np.s_[:, stride // 2 :: stride, stride // 2 :: stride]

    def reference(x):
        return jax.image.resize(x, (2, 3 * times, 5 * times, channels), "bilinear")[kept]

    x = normal(2, 3, 5, channels)
    enlarge = partial(bilinear, times=times, stride=stride)
    same_function(enlarge, reference, x, atol=2e-6, of_gradients=1e-5)


@pytest.mark.parametrize(("convolve", "side", "rate"), [
    *((product_conv, 3, rate) for rate in (1, 2, 4, 6, 9)),  # 9 leaves the centre only
    *((product_conv, side, 1) for side in (1, 5, 7)),
    *((patch_conv, side, 1) for side in (1, 3, 7)),
    (patch_conv, 3, 2),
    *((conv, 3, rate) for rate in (1, 2, 4)),
    *((conv, side, 1) for side in (1, 5, 7)),
])  # fmt: skip
def test_our_convolutions_are_xla_s_with_their_gradients(convolve, side, rate):
    functions = (partial(f, rate=rate) for f in (convolve, xla_conv))
    inputs = normal(2, 5, 7, 4), normal(side, side, 4, 6, seed=rate)
    same_function(*functions, *inputs, atol=1e-5 * max(1, side**2 / 9))


@pytest.mark.parametrize(("dtype", "wide"), [(None, 1e-5), (jnp.bfloat16, 0.1)])
@pytest.mark.parametrize(
    ("convolve", "side"), [(conv, 3), (product_conv, 3), (product_conv, 7), (patch_conv, 7)]
)
def test_our_convolutions_have_the_parameters_of_flax_s(convolve, side, dtype, wide):
    key, x = jax.random.key(3), normal(2, 5, 7, 4)
    options = {"kernel_init": nn.initializers.he_normal(), "dtype": dtype, "name": "conv"}
    expected, flax_variables = nn.Conv(6, (side, side), **options).init_with_output(key, x)
    features, same = Conv(6, convolve, side, dtype=dtype, name="conv").init_with_output(key, x)
    jax.tree.map(np.testing.assert_array_equal, same, flax_variables)
    assert features.dtype == expected.dtype
    np.testing.assert_allclose(features.astype(float), expected.astype(float), atol=wide)


@pytest.mark.parametrize("features", [1, 4, 5, 9])  # the narrower one is copied, x has 4
@pytest.mark.parametrize("rate", [1, 3])
def test_gradient_of_a_kernel_is_that_of_xla(features, rate):
    x, grad = normal(2, 5, 7, 4), normal(2, 5, 7, features, seed=features)
    zeros = jnp.zeros((3, 3, 4, features))
    (expected,) = jax.vjp(lambda kernel: xla_conv(x, kernel, rate), zeros)[1](grad)
    np.testing.assert_allclose(kernel_gradient(x, grad, 3, rate), expected, atol=1e-4)


@pytest.mark.parametrize(("side", "stride"), [(2, 2), (3, 1), (3, 2), (4, 2), (5, 1), (3, 3)])
@settings(max_examples=8)
@given(seed=SEEDS, equal=st.booleans())
def test_max_pool_is_that_of_flax_with_its_gradient(side, stride, seed, equal):
    x = normal(2, 2 * stride, 3 * stride, 3, seed=seed)
    x = jnp.clip(jnp.round(1.5 * x), -2, 2) if equal else x
    window = {"window_shape": (side, side), "strides": (stride, stride)}
    flax_s = partial(nn.max_pool, **window, padding=[((side - 1) // 2,) * 2] * 2)
    pool = partial(max_pool, side=side, stride=stride)
    same_function(pool, flax_s, x, atol=0, of_gradients=1e-5, rtol=0)
    half, back = jax.vjp(pool, x.astype(jnp.bfloat16))
    assert half.dtype == back(half)[0].dtype == jnp.bfloat16


def test_resizing_and_normalising_by_hand_and_transposed_convolutions_start_bilinear():
    row = bilinear(jnp.array([0.0, 4.0]).reshape(1, 1, 2, 1), 2)
    np.testing.assert_allclose(row[0, :, :, 0], [[0, 1, 3, 4], [0, 1, 3, 4]])
    folded = space_to_depth(jnp.arange(16.0).reshape(1, 4, 4, 1), 2)
    np.testing.assert_array_equal(folded[0, [0, 1], [1, 0]], [[2, 3, 6, 7], [8, 9, 12, 13]])
    x = jnp.arange(120.0).reshape(2, 3, 4, 5)  # repeated pixels average back
    back = space_to_depth(repeat_pixels(x, 2), 2).reshape(2, 3, 4, 4, 5)
    np.testing.assert_allclose(back.mean(3), x)
    mean_and_white = normalise(jnp.array([[[[0.485, 0.456, 0.406], [1, 1, 1]]]]))[0, 0]
    white = [0.515 / 0.229, 0.544 / 0.224, 0.594 / 0.225]
    np.testing.assert_allclose(mean_and_white, [[0] * 3, white], atol=1e-6)
    x = normal(1, 5, 6, 3)
    double = nn.ConvTranspose(3, (4, 4), (2, 2), use_bias=False, kernel_init=bilinear_kernel)
    y, _ = double.init_with_output(jax.random.key(0), x)
    inside = np.s_[:, 1:-1, 1:-1]  # at the border one sees zeros, the other repeats
    np.testing.assert_allclose(y[inside], bilinear(x, 2)[inside], atol=1e-6)
