"""The benchmark of renderers against another checkout, which is this one here."""

import json

from benchmarks import against, render


def test_this_checkout_is_about_as_fast_as_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(against.speeds, "__defaults__", (((32, 24, 2, 1, "random"),),))
    arguments = ["--against", str(against.HERE), "--streets", "1", "--rounds", "2"]
    assert render.main([*arguments, "--json", str(tmp_path / "out")]) == 0
    [row] = json.loads((tmp_path / "out").read_text())["against"]
    assert row["rays_per_pixel"] == 4 and 0.2 < row["ratio"] < 5 and row["ms_here"] > 0
