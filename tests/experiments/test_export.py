"""`sdr-jax export`: the ONNX file gives the labels that the model gives."""

import json
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest

import seg
from common.errors import UserError
from experiments.app.export import export, main
from seg.inference import logits, variable_shapes
from seg.model import Model, label_classes
from seg.settings import VGG_NETS, TrainSettings
from tests.conftest import refused

SIZE = (36, 44)  # no multiple of any stride
CLASSES = label_classes(["road", "sky", "car"], ids=[7, 23, 26])
LITE0 = replace(seg.RECIPES["lite0-frozen"], steps=1, warmup=0, batch=1, views=1, head_width=8)
NETS = {
    "compact": TrainSettings(steps=1, warmup=0, batch=1),
    "frozen": LITE0,
    "heads": replace(LITE0, heads=2, average_mirror=True),
    "tuned": replace(LITE0, backbone="tuned", average=0.0),
    "fcn8s": replace(seg.RECIPES["scratch"], net="fcn8s", steps=1, warmup=0),
    "deeplabv2": replace(seg.RECIPES["scratch"], norm=False, steps=1, warmup=0),
}


def model_of(settings: TrainSettings) -> Model:
    """A net with random weights of ordinary sizes, in which every layer matters."""
    rng = np.random.default_rng(0)

    def draw(path, leaf):
        scale = np.sqrt(2 / np.prod(leaf.shape[:-1])) if len(leaf.shape) == 4 else 0.1
        centre = float(
            path[-1].key in ("deviation", "scale")
        )  # what features are divided or multiplied by
        return rng.normal(centre, scale, leaf.shape).astype(np.float32)

    variables = jax.tree_util.tree_map_with_path(draw, variable_shapes(settings, 3))
    return Model(settings, variables, SIZE, CLASSES)


@pytest.mark.parametrize("kind", [
    *(pytest.param(kind, marks=pytest.mark.slow if kind in VGG_NETS else ()) for kind in NETS)
])  # fmt: skip
def test_the_file_gives_the_same_labels(kind, tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    model = model_of(NETS[kind])
    path = tmp_path / "net.onnx"
    assert export(model, path) == path.stat().st_size
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    images = np.random.default_rng(1).integers(0, 256, (3, *SIZE, 3), np.uint8)
    labels, scores = (
        np.concatenate(outputs)
        for outputs in zip(*(session.run(None, {"image": x[None]}) for x in images), strict=True)
    )
    expected = logits(model.variables, images, model.settings, 3)
    np.testing.assert_allclose(scores, expected, atol=2e-3 * np.abs(expected).max())
    predictions = model.predict(images)
    assert labels.dtype == np.uint8 and (len(np.unique(predictions)) > 1 or kind in VGG_NETS)
    # Where they differ, two classes are tied up to rounding.
    ordered = np.sort(expected, axis=-1)
    tied = ordered[..., -1] - ordered[..., -2] < 2e-3 * np.abs(expected).max()
    np.testing.assert_array_equal(labels[~tied], predictions[~tied])
    assert tied.mean() < 0.05


def test_the_file_says_what_its_labels_mean(tmp_path):
    onnx = pytest.importorskip("onnx")
    model = model_of(NETS["compact"])
    export(model, tmp_path / "net.onnx")
    read = onnx.load(tmp_path / "net.onnx")
    about = {entry.key: entry.value for entry in read.metadata_props}
    assert json.loads(about["classes"])[1] == {"name": "sky", "id": 23, "color": [0, 128, 0]}
    assert about["model"] == model.digest
    (image,) = read.graph.input
    assert [axis.dim_value for axis in image.type.tensor_type.shape.dim] == [1, *SIZE, 3]
    # Weights of networks in bfloat16 are float32, and so is what the file computes.
    half = replace(model, settings=replace(model.settings, dtype="bfloat16"))
    export(half, tmp_path / "half.onnx")
    assert onnx.load(tmp_path / "half.onnx").graph == read.graph
    # Depthwise convolutions are nodes, and not the sums of copies that XLA's CPU backend is given.
    export(model_of(NETS["frozen"]), tmp_path / "lite0.onnx")
    kinds = [node.op_type for node in onnx.load(tmp_path / "lite0.onnx").graph.node]
    assert kinds.count("Conv") == 17 and len(kinds) < 400


def test_what_cannot_be_written_is_refused(tmp_path, capsys, monkeypatch):
    model = model_of(NETS["compact"])
    model.save(tmp_path / "model")
    refused(UserError, "is a folder; name a file", export, model, tmp_path)
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main([str(tmp_path / "model"), "--onnx", str(tmp_path / "net.onnx")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "need the package onnx: pip install 'sdr-jax[onnx]'" in line
    assert not (tmp_path / "net.onnx").exists()
