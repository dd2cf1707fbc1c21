"""The benchmark of single layers: both ways compute the same, at tiny sizes; rows hold their ratio."""

import json

import jax
import numpy as np
import pytest

from benchmarks import layers as benchmark
from seg.nets.ops.product_conv import product_conv

SMALL = (
    benchmark.convolution("dilated", product_conv, (1, 4, 6, 2), (3, 3, 2, 3), 2),
    benchmark.pooling("pool", (1, 4, 6, 2), 3, 2),
)


def test_rows_are_of_every_pass(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(benchmark, "LAYERS", SMALL)
    path = tmp_path / "layers.json"
    assert benchmark.main(["--repeats", "1", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())["rows"]
    convolution = ["forward", "gradient by features", "gradient by kernel"]
    assert [row["pass"] for row in rows] == [*convolution, *convolution[:2]]
    for row in rows:
        assert row["ratio_to_xla"] == pytest.approx(row["xla_ms"] / row["ms"])
    assert "| dilated | gradient by kernel" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("layer", benchmark.LAYERS, ids=lambda layer: layer.name)
def test_both_ways_are_of_one_shape(layer):
    given = [jax.ShapeDtypeStruct(shape, np.float32) for shape in layer.shapes]
    assert jax.eval_shape(layer.ours, *given) == jax.eval_shape(layer.xlas, *given)


@pytest.mark.parametrize("layer", SMALL, ids=lambda layer: layer.name)
def test_both_ways_compute_the_same(layer):
    rng = np.random.default_rng(0)
    values = tuple(rng.normal(size=shape).astype(np.float32) for shape in layer.shapes)
    ours, xlas = (dict(benchmark.passes(way, values)) for way in (layer.ours, layer.xlas))
    for name, run in ours.items():
        np.testing.assert_allclose(run(), xlas[name](), atol=1e-4, err_msg=name)
