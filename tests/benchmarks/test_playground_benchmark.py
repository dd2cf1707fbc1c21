"""The playground's benchmark, where there is a browser."""

import pytest

from benchmarks import playground as benchmark


@pytest.mark.slow
def test_previews_and_images_are_timed():
    browser = benchmark.browser() or pytest.skip("needs chromium")
    preview, image = benchmark.measured("96x54", 4, browser)
    assert (preview["drawn"], image["drawn"], preview["moves"]) == ("preview", "image", 4)
    assert 0 < preview["best_ms"] <= preview["median_ms"] <= preview["worst_ms"]
    assert preview["median_ms"] < image["median_ms"]


def test_a_missing_browser_is_an_error(monkeypatch, capsys):
    monkeypatch.setattr(benchmark.shutil, "which", lambda name: None)
    with pytest.raises(SystemExit, match=r"^2$"):
        benchmark.main([])
    assert "chromium" in capsys.readouterr().err
