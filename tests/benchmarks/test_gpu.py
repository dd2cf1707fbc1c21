"""The check of a machine with a GPU, in its small form."""

import json

import pytest

from benchmarks import gpu


@pytest.mark.slow
def test_the_small_form_does_all_of_it(tmp_path, capsys):
    out = tmp_path / "gpu.json"
    flags = ["--small", "--tests", "--nets", "compact", "--renderers", "embree", "--json", str(out)]
    assert gpu.main(flags) == 0
    found = json.loads(out.read_text())
    assert [(row["what"], row["dtype"]) for row in found["rows"]] == [
        ("image", ""),
        ("first 50", "float32"), ("update", "float32"), ("prediction", "float32"),
        ("first 50", "bfloat16"), ("update", "bfloat16"), ("prediction", "bfloat16"),
    ]  # fmt: skip
    assert min(row["ms"] for row in found["rows"]) > 0
    assert " passed" in found["tests"][0]["said"] and "the_paper" in capsys.readouterr().out


def test_a_search_of_the_papers_size_is_projected():
    own = {"render_s": 30.0, "train_s": 60.0}
    serial = gpu.projected(300, own, 1)
    assert (serial["hours_one_by_one"], serial["hours_rendering_beside"]) == (7.5, 5.0)
    assert gpu.projected(300, {**own, "render_s": 600.0}, 6)["first_to_saturate"] == "rendering"
