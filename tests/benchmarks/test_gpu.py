"""The benchmark of a GPU, in its tiny form."""

import json

import jax
import pytest

from benchmarks import gpu
from benchmarks.gpu import FULL, figures
from seg.nets.backbones import BACKBONES


@pytest.fixture(autouse=True)
def other_tests_have_their_cache_and_backbones(monkeypatch):
    monkeypatch.setitem(BACKBONES, "narrow", None)  # the key goes at the end
    yield
    jax.config.update("jax_enable_compilation_cache", True)


def test_rows_are_written_at_once_and_not_measured_again(tmp_path, capsys, monkeypatch):
    out = tmp_path / "gpu.jsonl"
    flags = ["--tiny", "--out", str(out), "--only"]
    assert gpu.main([*flags, "features", "--seconds", "0"]) == 0
    assert "2 rows are left" in capsys.readouterr().out and not out.exists()
    assert gpu.main([*flags, "features"]) == 0
    first = out.read_text()
    assert [json.loads(line)["what"] for line in first.splitlines()] == [
        "features of 4 images by narrow, batches of 8",
        "features of 4 images by narrow, batches of 4",
    ]
    out.write_text(
        first + '{"what": "half'
    )  # a row that was being written when the machine stopped
    monkeypatch.setattr(gpu, "measured", lambda figure: pytest.fail(figure.name))
    assert gpu.main([*flags, "features"]) == 0
    assert out.read_text().startswith(first)


@pytest.mark.slow
def test_every_row_of_the_tiny_form_is_measured(tmp_path):
    out, report = tmp_path / "gpu.jsonl", tmp_path / "gpu.json"
    assert gpu.main(["--tiny", "--out", str(out), "--json", str(report)]) == 0
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert json.loads(report.read_text())["rows"] == rows
    of_jax = [row["what"] for row in rows if "PyTorch" not in row["what"]]
    assert len(of_jax) == 9 and all(row["ms"] > 0 and row["first_s"] > 0 for row in rows)
    assert of_jax == [figure.name for figure in figures(gpu.TINY) if "PyTorch" not in figure.name]
    assert len(of_jax) == len([f for f in figures(FULL) if "PyTorch" not in f.name])
