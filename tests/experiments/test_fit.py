"""`sdr-jax fit`: folds by group, what renders add, and a net from a folder of one's own."""

import json
import re
import shlex
from base64 import b64encode
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from safetensors.numpy import save_file

import experiments
from common import folder as run_folder
from common.errors import UserError
from common.files import read_json, write_json
from common.files import write as write_file
from common.labels.target_file import find_target
from common.progress import Progress
from common.workers.pool import WorkerPool, Workers
from experiments.app.evaluate import evaluate, labelled
from experiments.app.fit import config as fit_config
from experiments.app.fit import job as fit_job
from experiments.app.fit import streets as fit_streets
from experiments.app.fit.command import main
from experiments.app.fit.config import FitConfig, configured, planned
from experiments.app.fit.job import FORM, fit, with_labels
from experiments.app.report import fit_table, live
from experiments.app.report import page as page_of_runs
from experiments.app.report.command import main as make_report
from experiments.app.report.fit_table import derive, text, verdict
from experiments.config import Fidelity, parsers
from experiments.config import trainers as training
from experiments.config.limits import training_bytes
from experiments.evaluation.cache import Cache
from experiments.evaluation.job import Recipe, Source
from experiments.evaluation.made_with import made_with
from experiments.evaluation.pace import Pace
from experiments.evaluation.runner import Runner
from experiments.session import session
from experiments.tables.compared import by_class
from experiments.tables.form import Report
from experiments.tables.stats import TOO_FEW
from experiments.targets.few import share_of
from experiments.targets.folder import FOLDS, cut, fold_targets, parts_of, reader
from experiments.targets.sizes import Choice, choose, suitable_size
from scene.assets.catalogue import AssetPool
from scene.held import hold, read_fixed
from scene.proposal import Streets, describe, draw, streets_named
from scene.version import ENGINE
from seg.data import LabelledImages
from seg.inference import variable_shapes
from seg.mixing import TrainingSet
from seg.model import Model, label_classes, load_model
from seg.settings import TrainSettings
from tests.layouts import save, write

from .conftest import Page, config_of, never

TARGET = """
images: images/{name}.png
labels: labels/{name}.png
group: "^[a-z]+"
void: [255]
classes:
  street: {ids: [7], renders: [road, sidewalk]}
  house: {ids: [11, 12], renders: [building, wall]}
  sky: {ids: [23], renders: [sky]}
  plant: {ids: [21], renders: [vegetation, terrain]}
  bench: {ids: [40]}
"""
IDS = np.array([7, 11, 12, 23, 21, 40, 255], np.uint8)
NAMES = ("park1", "park2", "mall1", "mall2", "mall3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Images of three shapes with labels in a palette of its own, in two groups."""
    root = tmp_path_factory.mktemp("own")
    (root / "target.yaml").write_text(TARGET)
    for k, name in enumerate(NAMES):
        rng = np.random.default_rng(k)
        shape = ((48, 64), (64, 48), (60, 90))[k % 3]
        save(root / "images" / f"{name}.png", rng.integers(0, 256, (*shape, 3)))
        ids = Image.fromarray(IDS[rng.integers(0, len(IDS), shape)], "P")
        ids.putpalette([value for entry in range(256) for value in (entry, 255 - entry, 9)])
        (root / "labels").mkdir(exist_ok=True)
        ids.save(root / "labels" / f"{name}.png")
    return root


@given(st.lists(st.sampled_from("abcdefg"), min_size=2, max_size=40))
def test_folds_hold_every_image_once_and_share_no_group(groups: list[str]) -> None:
    groups = sorted(groups)
    folds, note = cut(groups, Path("data"))
    assert sorted(index for fold in folds for index in fold) == list(range(len(groups)))
    if len(set(groups)) == 1:
        assert len(folds) == min(FOLDS, len(groups)) and "stretches of time" in note
        assert all(list(fold) == list(range(fold[0], fold[-1] + 1)) for fold in folds)
        return
    assert not note and len(folds) == min(FOLDS, len(set(groups)))
    sets = [{groups[index] for index in fold} for fold in folds]
    assert sum(map(len, sets)) == len(set(groups)) and all(sets)


@given(st.lists(st.tuples(st.sampled_from("abcd"), st.integers(0, 9)), min_size=2, max_size=30))
def test_no_two_folds_hold_copies_of_one_image(images: list[tuple[str, int]]) -> None:
    groups, contents = zip(*sorted(images), strict=True)
    first = [contents.index(content) for content in contents]
    if len(set(contents)) == 1:
        with pytest.raises(UserError, match=r"1 labelled image and (a copy|\d+ copies) of it; "):
            cut(groups, Path("data"), first)
        return
    folds, note = cut(groups, Path("data"), first)
    assert sorted(index for fold in folds for index in fold) == list(range(len(groups)))
    sets = [{contents[index] for index in fold} for fold in folds]
    assert len(folds) > 1 and all(sets) and sum(map(len, sets)) == len(set(contents))
    if not note:
        kinds = [{groups[index] for index in fold} for fold in folds]
        assert sum(map(len, kinds)) == len(set(groups))


def test_copies_stay_in_one_fold_and_are_counted(tmp_path: Path) -> None:
    (tmp_path / "target.yaml").write_text(TARGET.replace('group: "^[a-z]+"\n', ""))
    rng = np.random.default_rng(0)
    for name in "abcdef":
        save(tmp_path / "images" / f"{name}.png", rng.integers(0, 256, (8, 8, 3)))
        save(tmp_path / "labels" / f"{name}.png", np.full((8, 8), 7, np.uint8))
    for one, other in ("af", "be"):
        data = (tmp_path / "images" / f"{one}.png").read_bytes()
        (tmp_path / "images" / f"{other}.png").write_bytes(data)
    parts = parts_of(find_target(None, tmp_path), tmp_path)
    tests = [{parts.entries[k].name for k in fold} for _, fold in parts.folds]
    assert sorted(map(sorted, tests)) == [["a", "f"], ["b", "e"], ["c"], ["d"]]
    (note,) = parts.notes
    assert note == "2 images are copies of others, such as e of b: copies stay in one fold"


def test_a_single_image_cannot_be_tested_on() -> None:
    with pytest.raises(UserError, match=r"data: 1 labelled image; .*label one more, or use"):
        cut(["a"], Path("data"))


@pytest.mark.parametrize(("shape", "expected"), [
    ((480, 360), (240, 176)), ((2048, 1024), (288, 144)), ((100, 80), (96, 80)), ((4000, 100), (1296, 32)),
])  # fmt: skip
def test_a_size_for_nets(shape, expected) -> None:
    assert suitable_size(*shape) == expected


def test_the_largest_size_that_the_minutes_and_the_memory_allow() -> None:
    shape = (960, 720)

    def seconds(size):
        return size[0] * size[1] / 200

    assert choose(shape, "quick", seconds) == Choice((400, 296), 592.0, (240, 176), 211.2)
    whole = choose(shape, "quick", seconds, minutes=14.4)  # 480 x 360 / 200 = 864 seconds
    assert whole.size == (480, 360)
    assert choose(shape, "quick", seconds, minutes=3.52).size == (240, 176)
    times = "about 14 min on 2 workers; 240x176 would take 4 min"
    assert whole.text(2) == f"Images of 480x360, {times}"
    with pytest.raises(UserError, match=r"^--minutes 3\.5 .* 240x176, .* takes 3\.6 minutes here"):
        choose(shape, "quick", seconds, minutes=3.5)
    # Without --minutes the smallest size may take any time, and needs any memory: that is refused later.
    assert choose(shape, "quick", lambda size: 1e6).size == (240, 176)
    held = choose(shape, "quick", seconds, lambda size: size[0] <= 300)
    assert held.size == (296, 224)
    assert choose(shape, "quick", seconds, lambda size: False).size == (240, 176)
    # A size that is decided stays, and so do small photographs.
    assert choose(shape, "quick", seconds, size=(640, 480), minutes=0.1).seconds == 1536
    assert choose((120, 80), "quick", seconds).text(1) == "Images of 120x80, about 48 s on 1 worker"
    assert choose(shape, "smoke", lambda size: 1e6).size == (64, 48)


@given(st.integers(8, 4000), st.integers(8, 4000), st.floats(1e-5, 1e-1))
def test_no_larger_size_would_take_the_minutes(width: int, height: int, pace: float) -> None:
    sizes = {suitable_size(width, height, pixels) for pixels in np.linspace(42_240, 172_800, 64)}
    choice = choose((width, height), "quick", lambda size: pace * size[0] * size[1])
    larger = [w * h for w, h in sizes if w * h > choice.size[0] * choice.size[1]]
    assert choice.seconds <= 600 or choice.size == choice.smallest
    assert all(pace * pixels > 600 for pixels in larger)
    assert choice.smallest == suitable_size(width, height)


@pytest.fixture
def large(tmp_path: Path) -> Path:
    """Two labelled photographs of 800x600 pixels, one in each of two groups."""
    root = tmp_path / "large"
    root.mkdir()
    write_file(root / "target.yaml", TARGET)
    for grey, name in enumerate(("park1", "mall1")):
        save(root / "images" / f"{name}.png", np.full((600, 800, 3), grey, np.uint8))
        save(root / "labels" / f"{name}.png", np.full((600, 800), 7, np.uint8))
    return root


def test_fit_takes_the_size_that_this_machine_can_and_a_run_keeps_its_own(
    large: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    def size(**options) -> tuple[int, int]:
        final = config_of(large, tmp_path / "run", workers=2, **options).final
        return final.width, final.height

    said: list[str] = []
    monkeypatch.setattr(session.paces, "read", lambda kind: Pace(0.5, 0.5))
    fast = config_of(large, tmp_path / "run", workers=2, say=said.append)
    assert fast.final.size == fast.reward.size == "480x360"
    (line,) = said
    assert re.fullmatch(r"Images of 480x360, about .* on 2 workers; 240x176 would take .*", line)
    flags = parsers.Fit(data=large, out=tmp_path / "run", workers=2)
    longer = fit_config.config_of(flags, streets=4000, steps=10_000)
    assert (longer.final.streets, longer.final.train.steps) == (4000, 10_000)
    assert longer.final.width < 480  # the size is chosen for what is trained
    searching = config_of(large, tmp_path / "run", workers=2, search=True, size=(480, 360))
    assert (searching.reward.size, searching.final.size) == ("240x176", "480x360")
    # Twice as slow, it is a smaller size, unless the run in the folder has one, or minutes are allowed.
    monkeypatch.setattr(session.paces, "read", lambda kind: Pace(2.0, 2.0))
    slow = size()
    assert 240 <= slow[0] < 480
    assert size(minutes=1000.0) == (480, 360) and size(size=(320, 240)) == (320, 240)
    arguments = [str(large), "--out", str(tmp_path / "run"), "--workers", "2"]
    for words, message in (
        (
            ["--minutes", "0.5"],
            "--minutes 0.5 is too little: 240x176, the smallest size, takes ",
        ),
        (["--minutes", "nan"], "--minutes must be positive, not nan"),
        (["--minutes", "5", "--size", "320x240"], "--minutes has no effect with --size"),
    ):
        if "--size" in words:
            with pytest.raises(SystemExit):
                main([*arguments, *words])
        else:
            assert main([*arguments, *words]) == 2
        assert message in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "run").exists()
    recorded = {"engine": ENGINE, **asdict(fast)}
    with run_folder.opened(tmp_path / "run", recorded):
        pass
    assert size() == (480, 360)
    again = {"engine": ENGINE, **asdict(config_of(large, tmp_path / "run", workers=2))}
    run_folder.refuse_foreign(tmp_path / "run", again)
    other = {"engine": ENGINE, **asdict(config_of(large, tmp_path / "run", workers=2, minutes=9.0))}
    for damaged in ("", '{"final": 3}', '{"final": {"width": 0, "height": 1e999}}'):
        (tmp_path / "other").mkdir(exist_ok=True)
        write_file(tmp_path / "other" / run_folder.CONFIG, damaged)
        assert fit_config._size_of(tmp_path / "other") is None
    with pytest.raises(UserError, match=r"a run with minutes = null, not 9\.0"):
        run_folder.refuse_foreign(tmp_path / "run", other)


def test_an_unknown_pace_is_measured_where_it_decides(large: Path, tmp_path, monkeypatch) -> None:
    said: list[str] = []
    kept: list[Pace] = []
    monkeypatch.setattr(session.paces, "read", lambda kind: None)
    monkeypatch.setattr(session.paces, "keep", lambda kind, pace: kept.append(pace))
    monkeypatch.setattr(session.paces, "measured_by", lambda workers: Pace(1e3, 1e3))
    monkeypatch.setattr(session, "compile_first", lambda workers, name: None)
    monkeypatch.setattr(session, "workers_of", lambda *_, **__: nullcontext())
    options = {"workers": 2, "say": said.append}
    assert config_of(large, tmp_path / "run", **options).final.size == "240x176"
    assert kept == [Pace(1e3, 1e3)] and said[0].startswith("Measuring how fast") and len(said) == 2
    config_of(large, tmp_path / "run", size=(320, 240), **options)
    config_of(large, tmp_path / "run", preset="smoke", **options)
    assert len(kept) == 1


def test_sizes_that_need_too_much_memory_are_not_chosen(large, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(session.paces, "read", lambda kind: Pace(0.01, 0.01))
    monkeypatch.setattr(fit_config, "memory", lambda: 4_000_000_000)
    sizes = [config_of(large, tmp_path / "run", workers=n).final.width for n in (1, 2)]
    assert sizes[0] == 480 > sizes[1] > 240
    with pytest.raises(UserError, match=r"^--size 240x176 would take .* in 16 worker.* only 4 GB"):
        config_of(large, tmp_path / "run", workers=16)


def test_figures_come_from_the_published_split_a_group_or_folds(
    tmp_path: Path, folder: Path
) -> None:
    camvid = find_target("camvid")
    data = write("camvid", tmp_path)
    published = parts_of(camvid, data)
    assert len(published.entries) == 3 and [e.name for e in published.held_out] == ["Seq05VD_f4"]
    assert published.folds == (((0, 1, 2), (3,)),) and published.where == "split test"
    held = parts_of(camvid, data, holdout="0006R0")
    assert [e.name for e in held.entries] == ["0001TP_1"] and len(held.held_out) == 2
    assert held.all_labels and not parts_of(camvid, data, holdout="0006R0", few=1).all_labels
    own = parts_of(find_target(None, folder), folder)
    assert len(own.folds) == 2 and own.where == "2 folds in turn"
    for train, test in own.folds:
        groups = [{own.entries[k].sequence for k in side} for side in (train, test)]
        assert not groups[0] & groups[1] and len(train) + len(test) == len(NAMES)
    first, second = fold_targets(own, folder, reader(own))
    sides = first.at(48, 64)
    assert sides["reward"].images.shape == (len(first.reward_names), 48, 64, 3)
    assert set(first.test_names) == set(second.reward_names)
    for more, message in (
        (
            {"holdout": "town"},
            "--holdout town is not a group of the training images; the groups are mall, park",
        ),
        ({"few": 9}, "--few must be 1 to 5, .*, not 9"),
        ({"few": 0}, "--few must be 1 to 5, .*, not 0"),
    ):
        with pytest.raises(UserError, match=message):
            parts_of(find_target(None, folder), folder, **more)


def test_the_note_names_the_labels_of_folds_and_the_classes_that_a_fold_lacks() -> None:
    rows = {
        "labels": [
            [{"miou": 50.0, "class_iou": [50.0, None]}],
            [{"miou": 40.0, "class_iou": [30.0, 50.0]}],
        ]
    }
    report = {
        "nets": {**rows, "labels+renders": rows["labels"], "renders": rows["labels"]},
        "classes": ["road", "house"], "labels": 8, "fold_labels": [3, 7], "seeds": 1, "tested": 8,
        "scored_at": "64x48", "where": "2 folds in turn", "rendered_images": 8, "streets": "mixed",
        "few_share": 0.25, "not_rendered": [],
    }  # fmt: skip
    derived = derive(report)
    assert "Each fold trains on 3 to 7 of your 8 labels." in fit_table.note(derived)
    assert fit_table.class_note(derived).endswith("so mIoU is not the mean of classes: house.")


@pytest.mark.parametrize(("mean", "ci95", "expected"), [
    (4.6, (4.0, 5.3), "Renders add 4.6 points (4.0 to 5.3) to your 14 labels."),
    (0.4, (-0.3, 1.1), "Renders add 0.4 points (-0.3 to 1.1) to your 14 labels, which is within noise."),
    (-0.4, (-1.1, 0.3),
     "Renders change the mIoU of your 14 labels by -0.4 points (-1.1 to 0.3): within noise."),
    (-2.0, (-3.0, -1.0), "Renders cost 2.0 points (-3.0 to -1.0): use your 14 labels alone."),
    *((mean, None,
       f"Renders change the mIoU of your 14 labels by {mean:+.1f} points, measured with too few networks "
       "for an interval; use --seeds 3.") for mean in (1.0, -2.0)),
    (None, None, "Training failed for some networks, so the gain from renders is unknown."),
])  # fmt: skip
def test_the_verdict(mean, ci95, expected) -> None:
    assert verdict({"mean": mean, "ci95": ci95}, 14) == expected


def test_means_are_over_folds_and_seeds_and_a_net_that_failed_drops_its_seed() -> None:
    def net(miou: float):
        return {"miou": miou, "class_iou": [miou, None]}

    report = {
        "nets": {
            "labels": [[net(40.0), net(42.0), net(90.0)], [net(50.0), net(52.0), None]],
            "labels+renders": [[net(45.0), net(47.0), net(0.0)], [net(55.0), net(57.0), net(0.0)]],
            "renders": [[net(30.0)] * 3] * 2,
        },
        "classes": ["road", "sky"],
        "labels": 14,
    }  # fmt: skip
    found = derive(report)
    assert found["gains"]["labels+renders"]["folds"] == [5.0, 5.0]
    # Of two folds the interval is over nets alone: 45 and 47 are the means of its seeds.
    low, high = found["rows"]["labels"]["ci95"]
    assert high - low == pytest.approx(2 * 12.706, abs=0.01)
    assert found["rows"]["labels"]["mean"] == 46.0 and found["rows"]["renders"]["mean"] == 30.0
    assert found["gains"]["labels+renders"]["mean"] == 5.0 and found["recipe"] == "labels"
    assert found["rows"]["renders"]["per_class"] == {"road": 30.0, "sky": None}
    assert found["labels_add"]["mean"] == 4.0 and found["rows"]["labels"]["miou"][-1] is None
    assert "averaged" not in found["rows"]["labels"]
    report["averaged"] = {"labels": [50.0, 52.0], "labels+renders": [55.0, None], "renders": [None]}
    averaged = {row: own["averaged"] for row, own in derive(report)["rows"].items()}
    assert averaged == {"labels": 51.0, "labels+renders": 55.0, "renders": None}
    report["averaged"] = {"labels": [56.0, 52.0], "labels+renders": [53.0, 53.0]}
    assert derive(report)["recipe"] == "labels"  # as good as the saved model, which averages
    del report["averaged"]
    report["nets"] |= {"labels+learnt": [[net(60.0)] * 3] * 2, "renders": [[net(70.0)] * 3] * 2}
    assert derive(report)["recipe"] == "labels+learnt"


def test_a_class_counts_in_the_folds_that_have_it() -> None:
    folds = [
        [{"class_iou": [10.0, None]}, None],
        [{"class_iou": [20.0, 60.0]}, {"class_iou": [40.0, 70.0]}],
    ]
    road, sky, none = by_class(
        [[net and {"class_iou": [*net["class_iou"], None]} for net in own] for own in folds], 3
    )
    assert road["mean"] == 15.0 and road["ci95"] is None  # of the seed that no net failed
    assert sky["mean"] == 65.0 and none["mean"] is None


FIX = ["field_of_view=90"]


def test_from_a_folder_of_ones_own_to_a_net(folder, tmp_path, capsys, monkeypatch) -> None:
    pages: list[Page] = []

    def write_live(path: Path, text: str, **options) -> None:
        write_file(path, text, **options)
        pages.append(Page(path))

    drawn: list[Streets] = []

    def draw_kept(streets: Streets, *options) -> np.ndarray:
        drawn.append(streets)
        return draw(streets, *options)

    monkeypatch.setattr(live, "write", write_live)
    monkeypatch.setattr(fit_streets, "draw", draw_kept)
    monkeypatch.setattr(page_of_runs, "EVERY", 0)
    charges: list[float] = []
    begun: list[tuple[str, bool]] = []

    def begin(self: Workers, function: Callable, *task: object, behind: bool, split=None) -> None:
        if function is not made_with:
            begun.append((function.__name__, behind))

    monkeypatch.setattr(Workers, "begin", begin)

    class Charged(Progress):
        def advance(self, units: float = 1.0, **options: Any) -> None:
            charges.append(units)
            super().advance(units, **options)

    monkeypatch.setattr(session, "Progress", Charged)
    arguments = [str(folder), "--out", str(tmp_path / "run"), "--preset", "smoke", "--seeds", "1"]
    arguments += ["--size", "64x48", "--workers", "0", "--fix", "field_of_view=90"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith("Images of 64x48, about ")
    # All folds are begun at once, and the network to save before the last of them.
    in_order = ["attempt"] * 3 + ["trained_net"] + ["attempt"] * 3
    assert begun == [(name, False) for name in in_order]
    # The plan is the sum of what is charged, and the last piece of work completes it.
    config = json.loads((tmp_path / "run" / "config.json").read_bytes())
    work = planned(config_of(folder, tmp_path / "plan", preset="smoke", seeds=1, size=(64, 48)), 2)
    assert sum(charges) == pytest.approx(sum(stage.cost for stage in work))
    assert charges[-1] == pytest.approx(work[-1].cost) and min(charges[-7:]) > 0
    assert config["target"] == find_target(None, folder).name != "camvid"
    held = "Held in all streets: field_of_view 90 deg."
    assert (
        "By fold, renders add" in said
        and "measured with too few networks for an interval" in said
        and "Not in the renders, so trained on labels alone: bench." in said
    )
    assert "half default streets) are 75 % of the first batch and 0 % of the last." in said
    mixed = hold(streets_named("mixed", "extended"), read_fixed(FIX, "extended"))
    assert [*map(describe, drawn)] == [describe(mixed)]
    summary = json.loads((tmp_path / "run" / "summary.json").read_bytes())
    assert list(summary["rows"]) == ["labels", "labels+renders", "renders"]
    assert [len(fold) for fold in summary["nets"]["labels"]] == [1, 1]
    file = tmp_path / "run" / "report.html"
    page, seen = Page(file), read_json(tmp_path / "run" / "pictures" / "seen.json")
    assert seen["tested"]["by"] == "labels+renders" and list(seen["streets"]) == ["labels"]
    mious = [image["predictions"]["labels+renders"]["miou"] for image in seen["tested"]["images"]]
    assert mious == sorted(mious, reverse=True)
    # The networks of both folds, each tested on its own images.
    pixels = {row: np.array(of_row["pixels"]) for row, of_row in seen["confusion"].items()}
    assert {of_row["nets"] for of_row in seen["confusion"].values()} == {2}
    assert len({total.sum() for total in pixels.values()}) == 1
    names = [shown[kind] for kind in ("image", "labels") for shown in seen["streets"]["labels"]]
    for image in seen["tested"]["images"]:
        names += [image["image"], image["labels"]]
        names += [image["predictions"][row]["image"] for row in summary["rows"]]
    kinds = {".jpg": "jpeg", ".png": "png"}
    data = [
        f"data:image/{kinds[name[-4:]]};base64,"
        + b64encode((tmp_path / "run" / "pictures" / name).read_bytes()).decode()
        for name in names
    ]
    assert summary["seconds"]["streets"] > 0
    assert "streets, shared by networks" in [row[0] for row in page.rows]
    assert summary["verdict"] in page.texts and held in page.text
    assert held in said and [a["src"] for t, a in page.tags if t == "img"] == data
    predict, test, command = (text for text in page.texts if text.startswith("sdr-jax "))
    assert command == summary["command"] == shlex.join(["sdr-jax", "fit", *arguments])
    assert parsers.predict().parse_args(shlex.split(predict)[2:]).model == f"{tmp_path}/run/model"
    assert parsers.evaluate().parse_args(shlex.split(test)[2:]).json == Path("FILE")
    titles = [a["id"] for t, a in page.tags if t == "section"]
    assert titles == ["result", "streets", "tested", "classes", "cost", "made"]
    gained = f"{summary['labels_add']['mean']:+.1f}"
    assert ["your labels add to renders", gained, TOO_FEW] in page.rows
    assert "so trained on labels alone: bench." in page.text and "by fold" in page.text.lower()
    # While it went on, the page had the nets so far.
    early = pages[0]
    assert "This run is not finished yet" in early.text and "5 labelled, 5 classes" in early.text
    assert ["fold 1: labels + renders", "1"] in [row[:2] for row in pages[-1].rows]
    before = file.read_bytes()
    file.unlink()
    assert make_report([str(tmp_path / "run")]) == 0 and file.read_bytes() == before
    capsys.readouterr()
    model = load_model(tmp_path / "run" / "model")
    assert model.names == ("street", "house", "sky", "plant", "bench")
    assert [own.id for own in model.classes] == [7, 11, 23, 21, 40] and model.size == (48, 64)
    assert model.notes["labelled_images"] == 5 and model.notes["verdict"] == summary["verdict"]
    test = evaluate(model, labelled(find_target(None, folder), folder))
    assert test["trained_on"] == test["images"] == 5
    front = (tmp_path / "run" / "model" / "README.md").read_text().split("---\n")[1]
    [told] = yaml.safe_load(front)["model-index"][0]["results"]
    assert told["metrics"][0]["value"] == round(summary["rows"][summary["recipe"]]["mean"], 2)
    (labels,) = model.predict([np.zeros((30, 70, 3), np.uint8)])
    assert labels.shape == (30, 70)
    with pytest.raises(UserError, match=re.escape(f"whose model is {tmp_path / 'run' / 'model'}")):
        load_model(tmp_path / "run")
    options = {"seeds": 1, "size": (64, 48), "workers": 0, "fix": FIX}
    with pytest.raises(UserError, match="started with --preset smoke"):
        fit(config_of(folder, tmp_path / "run", **options))
    # Again: everything is known, nothing is rendered or trained, and the answer is the same.
    charges.clear()
    with monkeypatch.context() as patch:
        patch.setattr(Cache, "streets", never)
        patch.setattr(Runner, "train", never)
        fitted = experiments.fit(folder, tmp_path / "run", preset="smoke", **options)
    assert len(begun) == len(in_order)
    again = fitted.summary
    assert sum(charges) == pytest.approx(sum(stage.cost for stage in work))
    assert again["seconds"]["streets"] == summary["seconds"]["streets"] and again["command"] is None
    assert fitted.model.digest == model.digest
    assert again["nets"] == summary["nets"] and text(again) == str(fitted) and str(fitted) in said
    assert fitted.verdict in capsys.readouterr().out and fitted.verdict in fitted._repr_html_()
    assert fitted.report.is_file() and list(fitted.miou) == list(summary["rows"])
    assert fitted.miou["labels"] == (summary["rows"]["labels"]["mean"], None)
    gain = fitted.miou["labels+renders"].mean - fitted.miou["labels"].mean
    assert fitted.gain.mean == pytest.approx(gain)
    # Labels were added: the net that is left starts from the model before.
    config = config_of(
        folder, tmp_path / "next", preset="smoke", seeds=2, size=(64, 48), workers=0,
        init=tmp_path / "run" / "model", fix=FIX,
    )  # fmt: skip
    found = fit(config)["nets"]  # a first head trains as if it were alone
    first = {row: [heads[:1] for heads in folds] for row, folds in found.items()}
    assert first == summary["nets"]
    other = load_model(tmp_path / "next" / "model")
    assert other.digest != model.digest
    assert (model.settings.heads, other.settings.heads) == (1, 2)  # the head begins both
    report = read_json(tmp_path / "next" / "summary.json")
    assert {len(own) for own in report["averaged"].values()} == {2}  # folds
    gained = report["over_images"]["labels+renders"]
    rows = (report["averaged"][row] for row in ("labels+renders", "labels"))
    assert gained["units"] == "5 images of 2 groups, too narrow for other groups"
    assert gained["ci95"] is None
    assert np.isfinite(gained["value"]) and all(0 <= v <= 100 for row in rows for v in row)
    assert other.notes["miou"] == report["rows"][report["recipe"]]["averaged"]


@pytest.mark.slow
def test_with_a_search_the_net_that_is_left_may_be_of_learnt_streets(folder, tmp_path, monkeypatch):
    taken = []

    def record_renders(config: FitConfig, renders: Source, labels: LabelledImages) -> TrainingSet:
        taken.append(renders)
        return with_labels(config, renders, labels)

    def learnt_is_best(report: Report) -> Report:
        return {**derive(report), "recipe": "labels+learnt"}

    monkeypatch.setattr(fit_job, "with_labels", record_renders)
    monkeypatch.setattr(fit_job, "derive", learnt_is_best)
    size = (64, 48)
    options = {"preset": "smoke", "seeds": 1, "size": size, "workers": 1, "search": True}
    fit(config_of(folder, tmp_path / "run", **options))
    # Each of two folds has networks on mixed and on optimised streets; then one is begun, and another saved.
    assert taken[0] == taken[2] == taken[4] and taken[5] == taken[1] and len(set(taken)) == 3
    notes = load_model(tmp_path / "run" / "model").notes
    assert notes["trained_on"] == "labels+learnt"


def test_a_gpu_takes_the_full_preset_and_a_cpu_takes_it_on_request(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(session.paces, "read", lambda kind: Pace(1.0, 1.0))
    lines: list[str] = []
    usual = config_of(folder, tmp_path / "run")
    asked = config_of(folder, tmp_path / "run", preset="full", say=lines.append)
    monkeypatch.setattr(fit_config, "usable_gpus", lambda: ["0"])
    on_gpu = config_of(folder, tmp_path / "run")
    assert (usual.preset, usual.final.train.backbone) == ("quick", "frozen")
    assert (asked.preset, on_gpu.preset) == ("full", "full")
    train = asked.final.train
    assert (train.backbone, train.steps, train.batch, train.dtype) == ("tuned", 2000, 16, "float32")
    assert on_gpu.final.train == replace(train, dtype="bfloat16")
    assert (asked.final.streets, asked.few_share, len(asked.trainings)) == (800, 0.25, 3)
    assert asked.final.size == "64x48"  # the images' own
    assert re.fullmatch(r"Images of 64x48, about .* on \d+ workers?", lines[-1])
    assert configured((960, 720), "full").reward.size == "960x720"
    assert share_of(100, "full") == 0.25 and share_of(100) == 0.5
    dinov2 = configured((64, 48), "full", "dinov2").final
    assert (dinov2.train.backbone, dinov2.streets) == ("frozen", 800)
    again = config_of(folder, tmp_path / "run", preset="full", backbone="frozen")
    assert (again.final.train.backbone, again.final.train.heads) == ("frozen", 3)


@pytest.mark.slow
def test_the_full_preset_trains_the_backbone_and_saves_a_model(folder, tmp_path):
    out = tmp_path / "run"
    steps = {"preset": "full", "steps": 3, "streets": 4, "seeds": 1, "size": (64, 48), "workers": 1}
    result = experiments.fit(folder, out, **steps)
    assert set(result.miou) == {"labels", "labels+renders", "renders"}
    settings = result.model.settings
    assert (settings.backbone, settings.steps, settings.average_mirror) == ("tuned", 3, True)
    predicted = result.model.predict(np.zeros((1, 48, 64, 3), np.uint8))
    assert predicted.shape == (1, 48, 64)


@pytest.mark.slow
def test_a_tuned_net_of_another_name_is_fitted_and_its_model_has_all_of_it(folder, tmp_path):
    own = ["--preset", "smoke", "--seeds", "1", "--size", "64x48", "--workers", "1"]
    out = tmp_path / "run"
    assert (
        main([str(folder), "--out", str(out), *own, "--net", "lite2", "--backbone", "tuned"]) == 0
    )
    model = load_model(out / "model")
    assert (model.settings.net, model.settings.backbone) == ("lite2", "tuned")
    assert "block20" in model.variables["params"]["backbone"]
    with pytest.raises(UserError, match="a model with --net lite2, not lite0"):
        fit(config_of(folder, tmp_path / "next", preset="smoke", init=out / "model"))


def test_what_cannot_be_fitted_is_one_line(
    folder: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    out = ["--out", str(tmp_path / "run"), "--preset", "smoke"]
    (tmp_path / "empty").mkdir()
    bare, bad = tmp_path / "bare.yaml", tmp_path / "model.safetensors"
    bare.write_text(re.sub(r", renders: \[.*?\]", "", (folder / "target.yaml").read_text()))
    save_file({"embeddings.cls_token": np.zeros((1, 1, 384), np.float32)}, bad)
    dinov2 = [str(folder), *out, "--net", "dinov2", "--weights", str(bad)]
    for arguments, message in (
        ([str(tmp_path / "none"), *out], "none: no such folder"),
        ([str(tmp_path / "empty"), *out], "empty has no target.yaml"),
        ([str(bare), *out], "bare.yaml: not a folder; expected one with images and target.yaml"),
        ([str(folder), *out, "--target", str(bare)], "bare.yaml: no class has 'renders', so"),
        ([str(folder), *out, "--few", "9"], "--few must be 1 to 5"),
        ([str(folder), *out, "--size", "60x48"], "--size must be two multiples of 8, 32 or more"),
        ([str(folder), *out, "--seeds", "0"], "--seeds must be"),
        ([str(folder), *out, "--init", str(tmp_path)], "is not a model"),
        (
            [str(folder), *out, "--net", "dinov2"],
            "--net: dinov2 needs weights, the .safetensors file of its backbone",
        ),
        ([str(folder), *out, "--weights", "x"], "--weights x is for --net dinov2; those of lite0"),
        ([*dinov2, "--backbone", "tuned"], '"tuned", but the backbone of dinov2 stays frozen'),
        (
            [*dinov2],
            f"{bad}: embeddings.position_embeddings is missing; expected all of DINOv2 ViT-S",
        ),
        ([*dinov2[:-1], str(folder / "target.yaml")], "target.yaml: no file of weights"),
        ([str(folder), *out, "--fix", "field_of_view=9"], "from 30 to 110 (deg)"),
    ):
        assert main(arguments) == 2
        assert message in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "run").exists()
    with monkeypatch.context() as patch:
        patch.setattr("experiments.app.fit.config.pace_here", never)  # it takes seconds
        assert main([str(folder), "--out", str(folder), "--preset", "quick"]) == 2
    assert "contains other files and no run" in capsys.readouterr().err
    letter = tmp_path / "run" / "model" / "letter.txt"  # told before hours of training, not after
    letter.parent.mkdir(parents=True)
    write_file(letter, "")
    assert main([str(folder), *out]) == 2
    assert "contains other files and no run" in capsys.readouterr().err
    write_json(tmp_path / "run" / "config.json", {})
    assert main([str(folder), *out]) == 2
    assert "holds other files, such as letter.txt" in capsys.readouterr().err.splitlines()[-1]
    assert {path.name for path in (tmp_path / "run").rglob("*.*")} == {"config.json", "letter.txt"}


def test_streets_that_a_stopped_run_has_rendered_are_counted_and_removed(tmp_path: Path) -> None:
    final = Fidelity(64, 48, 2, 1, samples=1, train=TrainSettings())
    run = SimpleNamespace(
        config=SimpleNamespace(final=final, out=tmp_path),
        recipe=lambda fidelity: Recipe(fidelity, "camvid", "embree", AssetPool(0, 2)),
        progress=Progress(1.0),
        runner=SimpleNamespace(cache=Cache(WorkerPool(0), tmp_path)),
    )
    pools = [fit_streets.pool_of(run, streets_named("default", "extended"), 0)]
    fit_streets.RenderedStreets(run, pools).render()
    [about] = (tmp_path / "shared").glob("*/about.json")
    write_json(about, read_json(about) | {"seconds": 12.5})
    assert run.progress._worked > 0
    run.progress = Progress(1.0)
    resumed = fit_streets.RenderedStreets(run, pools)  # all networks are tested: it renders nothing
    resumed.render()
    assert run.progress._worked == 0 < run.progress._done  # streets of an earlier call have no pace
    assert resumed.seconds(FORM) == 12.5
    resumed.remove_files()
    assert not [*(tmp_path / "shared").iterdir()] and resumed.seconds(FORM) == 0


@pytest.mark.parametrize("size", [(800, 8000), (80_000, 8000), (8 * 10**400, 64)])
def test_a_size_that_does_not_fit_is_refused_with_flags_of_fit(folder, tmp_path, monkeypatch, size):
    monkeypatch.setattr(fit_config, "memory", lambda: 24_000_000_000)
    with pytest.raises(UserError, match=r"^--size .*(use --size \d+x\d+ or less|pixels)") as error:
        config_of(folder, tmp_path / "run", size=size, workers=2)
    assert (
        set(re.findall(r"--[a-z.-]+", str(error.value)))
        <= parsers.fit()._option_string_actions.keys()
    )


def test_memory_counts_every_worker_and_both_copies_of_a_training_set(
    folder, tmp_path, monkeypatch
):
    size = (240, 176)
    final = configured(size).final
    features = final.images * final.train.views * size[0] * size[1] * 3.5
    monkeypatch.setattr(fit_config, "memory", lambda: int(6 * features))
    config_of(folder, tmp_path / "run", size=size, workers=1)
    with pytest.raises(UserError, match="in 4 worker"):
        config_of(folder, tmp_path / "run", size=size, workers=4)


def test_init_takes_the_width_of_the_model_and_names_what_differs(
    folder, tmp_path, monkeypatch
) -> None:
    classes = label_classes(find_target(None, folder).class_names)
    train = configured((64, 48), "smoke").final.train
    for changes, message in (
        ({"head_width": 8}, None),
        ({"backbone": "tuned", "heads": 1}, "a model with --backbone tuned, not frozen"),
    ):
        settings = replace(train, **changes)
        shapes = jax.tree.map(
            lambda leaf: np.zeros(leaf.shape, leaf.dtype), variable_shapes(settings, 5)
        )
        Model(settings, shapes, (48, 64), classes).save(tmp_path / "model")
        config = config_of(folder, tmp_path / "run", preset="smoke", init=tmp_path / "model")
        if message is None:
            assert config.final.train.head_width == 8
            continue
        with pytest.raises(UserError, match=message):
            fit(config)
    Model(train, jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), variable_shapes(train, 5)),
          (48, 64), classes).save(tmp_path / "model")  # fmt: skip
    config = config_of(folder, tmp_path / "run", preset="smoke", init=tmp_path / "model")
    monkeypatch.setattr(
        fit_job, "backbone_of", lambda settings: SimpleNamespace(source=id(settings))
    )
    with pytest.raises(UserError, match="its head was trained on other weights of the backbone"):
        fit(config)


def test_smoke_nets_end_their_warm_up_before_they_end() -> None:
    for net in ("lite0", "dinov2"):
        config = configured((64, 48), "smoke", net)
        for fidelity in (config.reward, config.final):
            assert fidelity.train.warmup <= fidelity.train.steps / 4


@pytest.mark.parametrize("trainers", [None, 1])
def test_memory_counts_the_processes_that_train(folder, monkeypatch, tmp_path, trainers):
    monkeypatch.setattr(session.paces, "read", lambda kind: Pace(1.0, 1.0))
    config = config_of(folder, tmp_path / "run", workers=4, trainers=trainers)
    each = training_bytes(config.final, 5)
    assert fit_config._memory(config, 5) // each == (trainers or 4)
    for module in (fit_config, training):
        monkeypatch.setattr(module, "usable_gpus", lambda: ["0", "1"])
    assert fit_config._memory(config, 5) // each == (trainers or 2)
    with pytest.raises(UserError, match="--trainers 3: this machine has 2 GPUs"):
        config_of(folder, tmp_path / "run", trainers=3)
