"""The benchmark of outlines: what its rules do to labels, and that finished networks are not made again."""

import json

import numpy as np
import pytest

from benchmarks.networks import NETWORKS, Recipe, Renders, real_images
from benchmarks.outlines import (
    EXACT,
    gain_rows,
    labels_of,
    main,
    shape_rows,
    with_outlines,
)
from common.labels.target_file import shipped
from scene.classes import TrainId
from seg.classes import CAMVID_11
from seg.pyramid import check_features

CAMVID = shipped("camvid")
TREE, SKY = int(TrainId.VEGETATION), int(TrainId.SKY)


def test_a_rule_is_the_outlines_of_a_target():
    assert with_outlines("fence=10%,tree=2.5%", CAMVID).outlines == {"fence": 0.1, "tree": 0.025}
    assert with_outlines(EXACT, CAMVID).outlines == {}
    label = np.full((1, 88, 120), SKY, np.uint8)
    label[:, 20:60, 30:90] = TREE
    label[:, 30:33, 40:43] = SKY
    depths = np.where(label == SKY, 0, 20).astype(np.float32)
    dataset = Renders(np.zeros((1, 88, 120, 3), np.uint8), label, depths)
    exact = labels_of(EXACT, dataset, CAMVID)
    np.testing.assert_array_equal(exact, CAMVID_11.from_train_id[label])
    whole = exact.copy()
    whole[:, 30:33, 40:43] = CAMVID_11.from_train_id[TREE]
    np.testing.assert_array_equal(labels_of("tree=4%", dataset, CAMVID), whole)
    np.testing.assert_array_equal(labels_of("fence=4%", dataset, CAMVID), exact)


def test_tables_by_hand():
    good, bad = np.diag([8, 8]), np.array([[4, 4], [0, 8]])
    exact, row = gain_rows({EXACT: {0: bad, 1: bad}, "a=3%": {0: good, 1: bad}}, ("a", "b"))
    assert exact["gain"] == "" and row["gain by seed"] == "+41.67 +0.00"
    assert row["gain"].startswith("+20.83 (") and row["classes"] == "a +25.0, b +16.7"
    labels = np.array([[[0, 0, 1, 0]]], np.uint8)
    assert [r["x"] for r in shape_rows({"x": labels}, ("a", "b", "c"))] == [
        "0.67; 2",
        "2.00; 1",
        "-",
    ]


def test_features_of_real_images_are_those_that_a_recipe_needs(camvid):
    recipe = Recipe(
        str(camvid), "camvid", "0006R0", width=32, height=32, few=1, training="lite0-heads"
    )
    settings = recipe.train
    assert settings.average_mirror
    real = real_images(recipe, with_features=True)
    check_features(real.few.features, real.few.images, settings, settings.views)
    for images in (real.development, real.reported):
        check_features(images.features, images.images, settings, 2)


FLAGS = (
    "--streets 2 --steps 2 --training compact --workers 0 --width 32 --height 32 --target camvid "
    "--holdout 0006R0 --data"
)


@pytest.mark.slow
def test_more_rules_and_seeds_add_to_what_is_done(camvid, tmp_path, capsys):
    command = [*FLAGS.split(), str(camvid), "--out", str(tmp_path / "out")]
    command += ["--json", str(tmp_path / "t.json"), "--rules", "tree=10%"]
    for flags, count in (
        (["--seeds", "1"], 2), (["--seeds", "1"], 2),
        (["--seeds", "2", "--rules", "tree=10%", "tree=5%,fence=2%"], 6), (["--seeds", "1", "--few", "1"], 8),
    ):  # fmt: skip
        assert main([*command, *flags]) == 0
        lines = (tmp_path / "out" / NETWORKS).read_text().splitlines()
        assert len(lines) == count
    keys = [json.loads(line)["key"] for line in lines]
    assert [key["rule"] for key in keys[:2]] == [EXACT, "tree=10%"] and keys[0]["outline"] is None
    tables = json.loads((tmp_path / "t.json").read_text())
    assert {"tested on development images", "tested on reported images"} < set(tables)
    assert (tmp_path / "out" / "sheet.png").stat().st_size > 1000
    assert "milliseconds per image" in capsys.readouterr().out


@pytest.mark.parametrize(("change", "complaint"), [
    (["--rules", "oak=3%"], "--rules oak=3%: no such class; choose from sky, building"),
    (["--rules", "tree=3"], "--rules tree=3: expected such as tree=3%, up to 10 % of the width"),
    (["--rules", "tree=3%,fence=11%"], "--rules fence=11%: expected such as tree=3%, up to 10 %"),
    (["--data", "nowhere"], "nowhere: no such folder"),
    (["--attributes", "nowhere"], "nowhere"), (["--few", "3"], "--few 3 leaves none of 3"),
])  # fmt: skip
def test_bad_input_is_one_error_and_exit_code_2(camvid, tmp_path, refused, change, complaint):
    command = [*FLAGS.split(), str(camvid), "--out", str(tmp_path / "out"), *change]
    refused(main, command, complaint)
    assert not (tmp_path / "out").exists()
