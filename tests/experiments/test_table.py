"""The table: which sets nets are trained on, classes of other tables, kills, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.errors import UserError
from experiments.stats import mean_ci95, paired_gain
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from experiments import study_nets
from experiments.reward import Evaluation
from experiments.store import Store
from experiments.table_job import check, main, stage_of, table_config
from experiments.table_report import FORM, PAPER, subset_miou
from seg.classes import CITYSCAPES_19, IGNORE_LABEL, SYNTHIA_13, SYNTHIA_16
from seg.metrics import mean_iou
from seg.recipes import RECIPES

from .conftest import Killed, formula, formula_real, lines, never, write_pair

FILES = ("table.json", "table.md", "table.png")


@pytest.fixture
def gta5(tmp_path):
    """Seven images of GTA5, labels 0 to 33."""
    root = tmp_path / "gta5"
    for k in range(7):
        write_pair(root / "images" / f"{k:05d}.png", root / "labels" / f"{k:05d}.png", k, 33)
    return root


@pytest.fixture
def table(camvid, learnt_file, monkeypatch):
    """Makes a table on tiny CamVid with formulas in the place of nets; returns the exit code."""

    def start(out, *flags, evaluate=formula, real=formula_real):
        monkeypatch.setattr(study_nets, "evaluate", evaluate)
        monkeypatch.setattr(study_nets, "evaluate_real", real)
        fixed = ("--target", "camvid", "--preset", "smoke", "--data", str(camvid), "--workers", "0")
        return main("", [*fixed, "--learnt", str(learnt_file), "--out", str(out), *flags])

    return start


def report_of(out) -> dict:
    return json.loads((out / "table.json").read_text())


def test_a_table_leaves_its_figures(table, tmp_path, capsys):
    out = tmp_path / "run"
    assert table(out, "--nets", "compact", "fcn8s") == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[1] == "Plan, in CPU seconds:" and " left" in printed
    report = report_of(out)
    assert [(row["net"], row["trained_on"]) for row in report["rows"]] == [
        (net, row)
        for net in ("compact", "fcn8s")
        for row in ("random", "default", "learnt", "real")
    ]
    assert [row["images"] for row in report["rows"][:4]] == [6, 6, 6, 4]
    random, _, learnt, real = report["rows"][:4]
    ours = [net["miou"] for net in learnt["nets"]]
    theirs = [net["miou"] for net in random["nets"]]
    assert (learnt["mean"], learnt["ci95"]) == mean_ci95(ours)
    value, interval = paired_gain(ours, theirs)
    assert learnt["gain"] == {"mean": value, "ci95": interval} and value > 0
    # 804 of 2000 pixels are right, 1196 of them taken for others, as many the other way round.
    assert real["nets"][0]["miou"] == pytest.approx(100 * 804 / (2000 + 1196))
    assert real["class_iou"]["sky"] == pytest.approx(real["mean"])
    assert learnt["over_classes"] == {} and len(real["nets"][0]["class_iou"]) == 11
    assert report["paper"]["rows"][-1] == {
        "trained_on": "learnt", "images": 450, "fcn8s": 29.6, "deeplabv2": 31.4,
    }  # fmt: skip
    text = (out / "table.md").read_text()
    assert "NOT of this run" in text and "| fcn8s | the reward images (upper bound) | 4 |" in text
    assert min(Image.open(out / "table.png").size) > 200
    assert len(Store(out / "store.jsonl")) == 2 * 3 * 2 and len(lines(out / "finals.jsonl")) == 4


def test_killed_it_goes_on_and_ends_the_same(table, tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert table(whole) == 0

    def dying(function, left):
        def call(*task):
            if left.pop():
                raise Killed
            return function(*task)

        return call

    with pytest.raises(Killed):
        table(broken, evaluate=dying(formula, [True, False, False]))
    assert len(Store(broken / "store.jsonl")) == 2
    with pytest.raises(Killed):
        table(broken, real=dying(formula_real, [True, False]))
    assert len(lines(broken / "finals.jsonl")) == 1
    assert table(broken) == 0
    assert [(broken / f).read_bytes() for f in FILES] == [(whole / f).read_bytes() for f in FILES]
    assert table(broken, evaluate=never, real=never) == 0  # what is finished is not redone


def test_a_table_is_derived_anew(table, tmp_path, capsys):
    out, again = tmp_path / "run", tmp_path / "again"
    assert table(out) == 0
    assert main("", ["--rederive", str(out / "table.json"), "--out", str(again)]) == 0
    assert [(again / f).read_bytes() for f in FILES] == [(out / f).read_bytes() for f in FILES]


def test_data_sets_of_others_are_cut_to_size_and_told_in_the_target_s_classes(
    table, gta5, tmp_path
):
    seen = []

    def real(stage, name, images, labels, seed, truth):
        seen.append((images.shape, set(np.unique(labels).tolist())))
        return formula_real(stage, name, images, labels, seed, truth)

    assert table(tmp_path / "run", "--gta5", str(gta5), real=real) == 0
    report = report_of(tmp_path / "run")
    assert [row["trained_on"] for row in report["rows"]][3:] == ["gta5", "real"]
    assert report["rows"][3]["images"] == 6  # as many as a rendered set has
    assert seen[0][0] == (6, 48, 64, 3)
    assert seen[0][1] <= {*range(11), IGNORE_LABEL}
    assert table(tmp_path / "all", "--gta5", str(gta5), "--all-images") == 0
    assert report_of(tmp_path / "all")["rows"][3]["images"] == 7


@given(st.integers(0, 2**32 - 1))
def test_miou_over_other_classes_is_that_of_the_metric(seed):
    rng = np.random.default_rng(seed)
    confusion = rng.integers(0, 50, (19, 19))
    confusion[rng.random(19) < 0.2] = 0
    confusion[0, 0] = 1  # the road is in all three sets
    evaluation = Evaluation(confusion, 0.0, 0.0)
    scored = {"class_iou": [None if v is None else 100 * v for v in evaluation.class_iou]}
    for classes in (SYNTHIA_16, SYNTHIA_13):
        (found,) = subset_miou([scored], classes)
        assert found == pytest.approx(100 * mean_iou(confusion, classes))
    assert subset_miou([None], SYNTHIA_13) == [None]


def test_cityscapes_labels_are_scored_over_three_sets_of_classes():
    nets = [{"miou": 50.0, "class_iou": [100.0 * (k < 9) for k in range(19)]}]
    rows = [{"net": "compact", "trained_on": "random", "images": 1, "nets": nets}]
    report = {"target": "cityscapes", "classes": list(CITYSCAPES_19.classes), "rows": rows}
    (row,) = FORM.derive(report)["rows"]
    # Of the first nine classes, wall, fence and pole are not among the 13.
    assert row["over_classes"]["16"]["mean"] == pytest.approx(100 * 9 / 16)
    assert row["over_classes"]["13"]["mean"] == pytest.approx(100 * 6 / 13)
    assert FORM.derive({**report, "target": "twin"})["paper"] is None
    assert set(PAPER["cityscapes"]) == {"synthia", "gta5", "random", "learnt"}


def test_vgg_nets_get_a_recipe_of_their_own(tmp_path):
    config = table_config("camvid", "quick")
    assert stage_of(config, "compact") == config.final
    train = stage_of(config, "fcn8s").train
    assert train == replace(RECIPES["scratch"], net="fcn8s", steps=1000, table="camvid")
    given = replace(config, weights=tmp_path / "vgg16.npz")
    train = stage_of(given, "fcn8s").train
    assert train.optimizer == "sgd" and train.weights == str(tmp_path / "vgg16.npz")
    assert stage_of(given, "compact").train.weights is None
    paper = table_config("camvid", "paper")
    assert paper.nets == ("fcn8s", "deeplabv2")
    for name in paper.nets:
        assert stage_of(paper, name).train == replace(paper.final.train, net=name)


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--nets", "resnet"), "--nets: unknown net 'resnet'"),
        (("--nets", "compact", "compact"), "names one of them twice"),
        (("--gta5", "/nowhere"), "/nowhere/images: no such folder; expected GTA5"),
        (("--synthia", "/nowhere"), "/nowhere/RGB: no such folder"),
        (("--kitti", "/nowhere"), "/nowhere/training/image_2: no such folder"),
        (("--weights", "/nowhere.npz"), "--weights are for VGG nets"),
        (("--weights", "/nowhere.npz", "--nets", "fcn8s"), "/nowhere.npz: No such file"),
        (("--learnt", "/nowhere.json"), "--learnt /nowhere.json: No such file"),
        (("--rederive", "/nowhere.json"), "--rederive /nowhere.json: No such file"),
        (("--seeds", "0"), "--seeds must be 1 or more"),
        (("--data", "/nowhere"), "/nowhere"),
        (("--target", "mars"), "--target 'mars' is unknown"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, complaint, table, tmp_path, error_line):
    assert table(tmp_path / "run", *flags, evaluate=never, real=never) == 2
    assert complaint in error_line()
    assert not (tmp_path / "run").exists()


def test_broken_data_of_others_show_before_anything_is_written(table, gta5, tmp_path, error_line):
    Image.fromarray(np.zeros((12, 16, 3), np.uint8)).save(gta5 / "labels" / "00003.png")
    assert table(tmp_path / "run", "--gta5", str(gta5), "--all-images", evaluate=never) == 2
    assert "00003.png" in error_line() and not (tmp_path / "run").exists()


def test_labels_are_needed(tmp_path):
    config = replace(
        table_config("camvid", "smoke"), reward_kind="mmd", unlabelled=tmp_path, nets=("compact",)
    )
    with pytest.raises(UserError, match="--unlabelled"):
        check(config)


@pytest.mark.slow
def test_smoke_on_the_twin_with_nets(tmp_path, capsys):
    out = tmp_path / "run"
    assert main("", ["--preset", "smoke", "--workers", "1", "--out", str(out)]) == 0
    assert "NOT real data" in capsys.readouterr().out
    report = report_of(out)
    assert report["real"] is False and report["paper"] is None
    assert all(0 < row["mean"] < 100 for row in report["rows"])
    assert {"16", "13"} == set(report["rows"][0]["over_classes"])
    assert (out / "attributes.json").exists()
