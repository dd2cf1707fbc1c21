"""The table: which sets nets are trained on, classes of other tables, and what is refused."""

from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from common.memory import refuse_larger
from experiments.config.jobs import defaults_of
from experiments.studies.table import FORM, PAPER, fidelity_of, subset_miou
from experiments.tables.nets import with_net
from experiments.tables.stats import mean_ci95, paired_gain
from seg.classes import CITYSCAPES_19, IGNORE_LABEL, SYNTHIA_13, SYNTHIA_16
from seg.data import LabelledImages
from seg.metrics import iou, mean_iou
from seg.mixing import TrainingSet
from seg.recipes import RECIPES

from .conftest import Counted, lines, never, write_pair

defaults = partial(defaults_of, "table")


@pytest.fixture
def gta5(tmp_path):
    """Seven images of GTA5, labels 0 to 33."""
    root = tmp_path / "gta5"
    for k in range(7):
        write_pair(root / "images" / f"{k:05d}.png", root / "labels" / f"{k:05d}.png", k, 33)
    return root


@pytest.fixture
def table(reported, learnt_file):
    """The table of given attributes, in figures and in words."""
    return partial(reported, "table", "--learnt", str(learnt_file))


def test_a_table_leaves_its_figures(table, out, learnt_file):
    report, text = table("--nets", "compact", "fcn8s")
    assert report["learnt_from"] == str(learnt_file)
    places = [(row["net"], row["trained_on"]) for row in report["rows"]]
    assert places == [*product(("compact", "fcn8s"), ("random", "default", "learnt", "real"))]
    assert [row["images"] for row in report["rows"][:4]] == [6, 6, 6, 4]
    random, eye, learnt, real = report["rows"][:4]
    optimised_miou, random_miou = ([net["miou"] for net in row["nets"]] for row in (learnt, random))
    assert (learnt["mean"], learnt["ci95"]) == mean_ci95(optimised_miou)
    by_eye = [net["miou"] for net in eye["nets"]]
    for name, baseline in (("gain", random_miou), ("gain_over_default", by_eye)):
        value, interval = paired_gain(optimised_miou, baseline)
        assert learnt[name] == {"mean": value, "ci95": interval}
    assert learnt["gain"]["mean"] > 0
    # 804 of 2000 pixels are right, 1196 of them taken for others, as many the other way round.
    assert real["nets"][0]["miou"] == pytest.approx(100 * 804 / (2000 + 1196))
    assert real["class_iou"]["sky"] == pytest.approx(real["mean"])
    assert learnt["over_classes"] == {} and len(real["nets"][0]["class_iou"]) == 11
    papers = {"trained_on": "learnt", "images": 450, "fcn8s": 29.6, "deeplabv2": 31.4}
    assert report["paper"]["rows"][-1] == papers
    assert "NOT of this run" in text and "| fcn8s | 64x48 | labelled target images | 4 |" in text
    assert len(lines(out / "finals.jsonl")) == 2 * 4 * 2
    assert lines(out / "evaluations.jsonl") == []  # the attributes are given


def test_data_sets_of_others_are_cut_and_told_in_the_target_s_classes(table, gta5, out):
    counted = Counted()
    *_, row, last = table("--gta5", str(gta5), evaluate=counted)[0]["rows"]
    assert (row["trained_on"], last["trained_on"]) == ("gta5", "real")
    gta = counted.calls[6][1]  # behind all that is rendered, which takes longer
    assert row["images"] == 6 and gta.images.shape == (6, 48, 64, 3)  # as of a rendered set
    assert set(np.unique(gta.labels).tolist()) <= {*range(11), IGNORE_LABEL}
    out.rename(out.with_name("cut"))
    assert table("--gta5", str(gta5), "--all-images")[0]["rows"][3]["images"] == 7


def test_data_sets_of_others_have_the_size_and_number_that_each_net_s_renders_have(table, gta5):
    counted = Counted()
    flags = ("--nets", "compact", "fcn8s", "--final.train.net", "fcn8s", "--gta5", str(gta5))
    small = ("--compact.width", "32", "--compact.height", "24", "--compact.streets", "2")
    rows = table(*flags, *small, evaluate=counted)[0]["rows"]
    sizes = {
        row["net"]: (row["size"], row["images"]) for row in rows if row["trained_on"] == "gta5"
    }
    assert sizes == {"compact": ("32x24", 4), "fcn8s": ("64x48", 6)}
    for recipe, source, _, truth, *_ in counted.calls:
        size = (recipe.fidelity.height, recipe.fidelity.width)
        assert truth.images.shape[1:3] == size
        if isinstance(source, LabelledImages):
            assert source.images.shape[1:3] == source.labels.shape[1:3] == size
            assert len(source.images) in (4, recipe.fidelity.images)


def test_a_few_labelled_images_add_rows(table):
    counted = Counted()
    report, text = table("--few", "2", evaluate=counted)
    few = [(row["trained_on"], row["images"]) for row in report["rows"][3:]]
    mixed = [(f"few+{name}", 8) for name in ("random", "default", "learnt")]
    assert few == [("few", 2), *mixed, ("real", 4)]
    mixed = [source for _, source, *_ in counted.calls if isinstance(source, TrainingSet)]
    assert len(mixed) == 6 and {source.shares for source in mixed} == {(0.5, 0.5)}
    assert "| compact | 64x48 | the labelled subset + optimised streets | 8 |" in text


@given(st.integers(0, 2**32 - 1))
def test_miou_over_other_classes_is_that_of_the_metric(seed):
    rng = np.random.default_rng(seed)
    confusion = rng.integers(0, 50, (19, 19))
    confusion[rng.random(19) < 0.2] = 0
    confusion[0, 0] = 1  # the road is in all three sets
    present = confusion.sum(axis=1) > 0
    shares = [100 * v if p else None for v, p in zip(iou(confusion), present, strict=True)]
    for classes in (SYNTHIA_16, SYNTHIA_13):
        (miou,) = subset_miou([{"class_iou": shares}], classes)
        assert miou == pytest.approx(100 * mean_iou(confusion, classes))
    assert subset_miou([None], SYNTHIA_13) == [None]


def test_cityscapes_labels_are_scored_over_three_sets_of_classes():
    nets = [{"miou": 50.0, "class_iou": [100.0 * (k < 9) for k in range(19)]}]
    rows = [{"net": "compact", "trained_on": "random", "images": 1, "nets": nets}]
    classes = [*CITYSCAPES_19.classes]
    report = {"target": "cityscapes", "classes": classes, "scored_at": "64x32", "rows": rows}
    (row,) = FORM.derive(report)["rows"]
    # Of the first nine classes, wall, fence and pole are not among the 13.
    assert row["over_classes"]["16"]["mean"] == pytest.approx(100 * 9 / 16)
    assert row["over_classes"]["13"]["mean"] == pytest.approx(100 * 6 / 13)
    assert FORM.derive({**report, "target": "twin"})["paper"] is None
    assert set(PAPER["cityscapes"]) == {"synthia", "gta5", "random", "learnt"}


def test_every_net_gets_a_recipe_and_a_size_of_its_own():
    quick = defaults("camvid", "quick")
    lite0, compact, fcn8s = (fidelity_of(quick, name) for name in ("lite0", "compact", "fcn8s"))
    assert lite0 == quick.final and lite0.train == replace(
        RECIPES["lite0-frozen"], average_mirror=True
    )
    assert compact == quick.compact and compact.train == RECIPES["compact"]
    assert fcn8s == replace(quick.vgg, train=replace(RECIPES["scratch"], net="fcn8s", steps=150))
    with_weights = replace(quick, weights=Path("vgg16.npz"))
    train = fidelity_of(with_weights, "fcn8s").train
    assert train == replace(RECIPES["vgg-adam"], net="fcn8s", steps=150, weights="vgg16.npz")
    assert fidelity_of(with_weights, "lite0") == lite0  # its weights are its own
    # A net that is named as the final one has the final size.
    final = with_net(quick.final, "compact")
    assert final.train == replace(RECIPES["compact"], average_mirror=True)
    assert final == replace(quick.final, train=final.train)
    assert fidelity_of(replace(quick, final=final), "compact") == final
    assert with_net(with_net(final, "fcn8s", "vgg16.npz"), "lite0") == lite0
    half = replace(final, train=replace(final.train, steps=500, backbone="frozen"))
    assert with_net(half, "lite0").train.steps == 500  # it was not its recipe's number
    paper = defaults("camvid", "paper")
    assert paper.nets == ("fcn8s", "deeplabv2")
    for name in paper.nets:
        for weights in (None, "vgg16.npz"):
            train = replace(paper.final.train, net=name, weights=weights)
            assert with_net(paper.final, name, weights).train == train


def test_data_of_others_that_no_memory_holds_are_refused_before_they_are_read(
    command, gta5, out, error_line, monkeypatch
):
    """Under the preset paper all 24,966 images of GTA5 take part, 52 GB at 1024x512."""
    for path in gta5.rglob("*.png"):
        path.write_bytes(b"no image is read")
    monkeypatch.setattr("experiments.studies.table.refuse_larger", partial(small, monkeypatch))
    assert command("table", out, "--gta5", str(gta5), "--all-images", evaluate=never) == 2
    # 7 images of 64 x 48 pixels with 4 bytes are 86 kB, and 4 of them 49 kB.
    line = error_line()
    assert (
        "images of --gta5: 7 would take 86 kB" in line
        and "only 50 kB are available: use at most 4" in line
    )
    assert "(--no-all-images takes 6)" in line and not out.exists()


def small(monkeypatch, *asked):
    """Refuses what is larger than 50 kB."""
    with monkeypatch.context() as patch:
        patch.setattr("common.memory.memory", lambda: 50_000)
        refuse_larger(*asked)


def test_broken_data_of_others_show_before_anything_is_written(command, gta5, out, error_line):
    colours = np.full((12, 16, 3), (1, 2, 3), np.uint8)
    Image.fromarray(colours).save(gta5 / "labels" / "00003.png")
    assert command("table", out, "--gta5", str(gta5), "--all-images", evaluate=never) == 2
    assert "00003.png" in error_line() and not out.exists()
