"""The benchmark of recipes: fields are changed by name, and finished networks are not made again."""

import json

import numpy as np
import pytest

from benchmarks.networks import NETWORKS, Recipe, _digest
from benchmarks.recipes import gain_rows, key, main, settings_of
from seg.recipes import RECIPES


def test_a_recipe_is_one_of_ours_with_changes():
    assert settings_of("lite0-heads") == RECIPES["lite0-heads"]
    changed = settings_of("lite0-frozen:heads=2,jaccard=0.5,last_share=None,average_mirror=True")
    assert (changed.heads, changed.jaccard, changed.last_share) == (2, 0.5, None)
    assert changed.average_mirror and changed.steps == RECIPES["lite0-frozen"].steps


def test_a_network_depends_on_the_images_and_on_how_many_are_tested(camvid):
    recipe, settings = Recipe(str(camvid), "camvid", "0006R0"), settings_of("lite0-heads")
    keys = [key(recipe, settings, "all", 0, tested) for tested in (2, 3)]
    label = camvid / "trainannot" / "0001TP_1.png"
    label.write_bytes((camvid / "valannot" / "0016E5_0.png").read_bytes())
    _digest.cache_clear()
    keys.append(key(recipe, settings, "all", 0, 3))
    assert len({json.dumps(one) for one in keys}) == 3


def test_gains_are_paired_by_seed():
    good, bad = np.diag([8, 8]).tolist(), [[4, 4], [0, 8]]
    lines = {
        ("all", name, seed): {"scores": {"reported": matrix}, "heads": {"reported": [0.5, 0.6]}, "seconds": 3}
        for name, every in {"a": (bad, bad), "b": (good, bad)}.items()
        for seed, matrix in enumerate(every)
    }  # fmt: skip
    first, second = gain_rows(lines, "all", ["a", "b"], (0, 1), "reported")
    assert first["mIoU"] == "58.3" and first["gain"] == "" and first["one head"] == "55.0"
    assert second["gain"].startswith("+20.83 (") and second["by seed"] == "100.0 58.3"


FLAGS = (
    "--streets 2 --few 1 --workers 0 --width 32 --height 32 --target camvid --holdout 0006R0 "
    "--recipes lite0-frozen:steps=2,warmup=0,head_width=8 "
    "lite0-heads:steps=2,warmup=0,heads=2,head_width=8 --data"
)


@pytest.mark.slow
def test_more_training_sets_and_seeds_add_to_what_is_done(camvid, tmp_path, capsys):
    command = [*FLAGS.split(), str(camvid), "--out", str(tmp_path / "out")]
    command += ["--json", str(tmp_path / "t.json")]
    every = ["labels", "labels+renders", "renders", "all"]
    for flags, count in (
        (["--seeds", "1"], 2), (["--seeds", "1"], 2), (["--seeds", "2", "--on", *every], 16),
    ):  # fmt: skip
        assert main([*command, *flags]) == 0
        lines = (tmp_path / "out" / NETWORKS).read_text().splitlines()
        assert len(lines) == count
    heads = [json.loads(line)["heads"]["reported"] for line in lines]
    assert {len(mious) for mious in heads} == {1, 2}
    tables = json.loads((tmp_path / "t.json").read_text())
    assert "trained on all, tested on reported images" in tables
    assert "trained on all, tested on development images" not in tables
    assert "CPU s" in capsys.readouterr().out


@pytest.mark.parametrize(("change", "complaint"), [
    (["--recipes", "lite9"], "--recipes lite9: no such recipe; choose from compact, paper"),
    (["--recipes", "lite0-heads:hats=3"], "--recipes lite0-heads:hats=3: recipes have no field hats"),
    (["--recipes", "lite0-heads:heads=0"], "heads must be 1 or more, not 0"),
    (["--recipes", "lite0-tuned"], "features are shared, so the backbone must be frozen"),
    (["--few", "3"], "--few 3 leaves none of 3"),
])  # fmt: skip
def test_bad_input_is_one_error_and_exit_code_2(camvid, tmp_path, refused, change, complaint):
    command = [*FLAGS.split(), str(camvid), "--out", str(tmp_path / "out"), *change]
    refused(main, command, complaint)
    assert not (tmp_path / "out").exists()
