"""Every documented command that writes JSON, at preset smoke with nets: its files have the recorded keys."""

import sys

import pytest

from common.files import read_json
from experiments.app.stores import main as store
from scene.check import main as check
from scene.dataset.formats.layout import FORMATS
from scene.render.__main__ import main as render
from scene.stats import main as stats
from sdr_jax.tune.__main__ import main as tune
from tests.guard_files import as_recorded, keys_of

from .conftest import ROOT, TINY, main_job

NETS = ("table", "pretrain", "assets", "ablation", "labels")
"""Studies whose rows are of nets."""


def test_keys_of_lists_and_of_maps_with_free_names_are_one():
    value = {
        "over_classes": {"a": {"mean": 1}, "b": {"all": [1, 2]}}, "iou": {"road": 1, "sky": 2},
        "some": [{"x": 1}, {"y": [{"z": None}]}, {}], "train": {"net": "lite0"},
    }  # fmt: skip
    known = (
        "iou.* over_classes.*.all over_classes.*.mean some some[].x some[].y some[].y[].z train.net"
    )
    assert keys_of(value) == set(known.split())


def test_a_key_that_went_or_came_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.guard_files.RECORD", tmp_path / "record")
    monkeypatch.delenv("GUARD_RECORD", raising=False)
    (tmp_path / "record").write_text('{"some": {"a.json": "all, mean"}}')
    (tmp_path / "a.json").write_text('{"all": 2, "median": 1}')
    with pytest.raises(
        AssertionError, match=r"gone: \['a.json: mean'\], new: \['a.json: median'\]"
    ):
        as_recorded("some", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("target", "flags"), [
    ("camvid", ("--few", "2")),
    ("cityscapes", ()),
    ("labelmefacade", ("--holdout", "a_p")),
])  # fmt: skip
def test_the_main_job_on_files(target, flags, request, out):
    data = request.getfixturevalue(target)
    assert (
        main_job(target, *TINY, *flags, "--workers", "0", "--data", str(data), "--out", str(out))
        == 0
    )
    as_recorded(" ".join((f"{target} --data", *flags)), out)


@pytest.mark.slow
@pytest.mark.parametrize("name", (*NETS, "sensitivity", "fidelity"))
def test_the_studies_on_the_twin(name, start_job, out):
    flags = ["--preset", "smoke", "--workers", "1"]
    code, stdout, stderr = start_job(out, *flags, experiment=name).finish()
    assert (code, stderr) == (0, "") and "NOT real data" in stdout
    as_recorded(name, out)
    report = read_json(out / f"{name}.json")
    assert report["real"] is False
    if name == "fidelity":
        assert len(report["rungs"]) == 3
        return
    assert name != "sensitivity" or report["records"]["rewards"] == 12
    nets = [row.get("final") or row for row in report.get("rows", ())]
    assert len(nets) >= 4 * (name in NETS) and all(0 < row["mean"] < 100 for row in nets)
    assert (out / "attributes.json").exists() == (name in ("table", "pretrain"))


@pytest.mark.slow
def test_a_search_is_enough_for_sensitivity(unbroken, start_job, out):
    flags = ("--preset", "smoke", "--workers", "1", "--records", str(unbroken[0]))
    code, _, stderr = start_job(out, *flags, experiment="sensitivity").finish()
    assert (code, stderr) == (0, "")
    as_recorded("sensitivity --records", out)


@pytest.mark.slow
def test_stores(unbroken, tmp_path):
    assert store(["merge", str(unbroken[0]), "--out", str(tmp_path / "store.jsonl")]) == 0
    as_recorded("store merge", tmp_path)


@pytest.mark.parametrize("format", FORMATS)
def test_datasets(format, tmp_path):
    if format == "parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    flags = ("--images", "2", "--shots", "1", "--size", "64x32", "--samples", "1", "--workers", "0")
    out = str(tmp_path / "streets")
    assert render([*flags, "--asset-count", "4", "--format", format, "--out", out]) == 0
    assert check([out]) == 0
    has_labels = format != "yolo-seg"
    assert stats([out, "--json", str(tmp_path / "stats.json")]) == (0 if has_labels else 2)
    as_recorded(f"render --format {format}", tmp_path)


@pytest.mark.slow
def test_a_simulator(out):
    example = ROOT / "examples" / "tune"
    words = (sys.executable, str(example / "simulator.py"), "{attributes.json}")
    flags = (str(example / "space.toml"), "--evaluations", "16", "--out", str(out))
    assert tune([*flags, "--", *words]) == 0
    as_recorded("tune", out)
