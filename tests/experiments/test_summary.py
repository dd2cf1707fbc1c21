"""The answer in figures: keys that scripts rely on, percent, physical values."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sdr_jax
from experiments.config import cityscapes_config
from experiments.folder import write_json
from experiments.report import html
from experiments.summary import attributes, summarize, text
from experiments.targets import Target
from experiments.twin import twin_world
from scene.attributes import ATTRIBUTES, BY_NAME, NAMES
from seg.classes import class_table

CLASSES = len(class_table("cityscapes").classes)
ROW_MIOU = {"random": [0.1, 0.2], "default": [0.2, 0.3], "learnt": [0.3, 0.5], "real": [0.6, 0.6]}


def record(miou: float) -> dict:
    """IoU of road = miou, of the rest 0; the last class never occurs."""
    class_iou = [miou] + [0.0] * (CLASSES - 2) + [None]
    return {"miou": miou, "class_iou": class_iou, "render_seconds": 2.0, "train_seconds": 3.0}


def made(seeds: int = 2, real: bool = False) -> dict:
    target = Target(
        "cityscapes" if real else "twin", real, "cityscapes", "the title", ("a", "b", "c"),
        ("d",), lambda height, width: None, None if real else twin_world(0),
    )  # fmt: skip
    rows = {row: [record(m) for m in values[:seeds]] for row, values in ROW_MIOU.items()}
    logged = [record(m) for values in ROW_MIOU.values() for m in values]
    folder = SimpleNamespace(
        evaluations=SimpleNamespace(lines=logged[:3]), finals=SimpleNamespace(lines=logged[3:])
    )
    learnt = sdr_jax.Proposal(np.full(23, 0.5, np.float32), np.full(23, 0.1, np.float32))
    config = replace(cityscapes_config("smoke"), seeds=seeds)
    scores = {"argmax": [0.2], "spread": [0.25]}
    return summarize(config, target, folder, rows, "spread", scores, learnt, 99.25)


def test_keys_are_those_that_scripts_rely_on(tmp_path):
    summary = made()
    write_json(tmp_path / "summary.json", summary)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["target"] == "twin" and summary["real"] is False
    assert summary["preset"] == "smoke"
    assert (summary["reward_images"], summary["test_images"]) == (3, 1)
    assert summary["evaluations"] == 3
    assert summary["seconds"] == {"render": 16.0, "train": 24.0, "total": 99.2}
    assert set(summary["rows"]) == {"random", "default", "learnt", "real"}
    for row in ("random", "default", "learnt"):
        assert summary[row] == summary["rows"][row]
    for entry in summary["rows"].values():
        assert set(entry) == {"miou", "mean", "ci95", "per_class"}
        assert len(entry["miou"]) == 2 and len(entry["ci95"]) == 2
        assert set(entry["per_class"]) == set(class_table("cityscapes").classes)
    assert set(summary["gain"]) == {"mean", "ci95"}


def test_figures_by_hand():
    summary = made()
    assert summary["random"]["miou"] == pytest.approx([10, 20])
    assert summary["random"]["mean"] == pytest.approx(15)
    assert summary["random"]["ci95"] == pytest.approx([15 - 63.53, 15 + 63.53], abs=0.01)
    # Differences by seed: 20 and 30; t(0.975, 1) = 12.706.
    assert summary["gain"]["mean"] == pytest.approx(25)
    assert summary["gain"]["ci95"] == pytest.approx([25 - 63.53, 25 + 63.53], abs=0.01)
    assert summary["learnt"]["per_class"]["road"] == pytest.approx(40)
    assert summary["learnt"]["per_class"]["bicycle"] is None
    assert summary["classes_absent_from_truth"] == ["bicycle"]
    assert summary["candidates"]["spread"] == [25] and summary["chosen_candidate"] == "spread"
    assert summary["recovery"]["learnt_error"] == summary["recovery"]["centre_error"]


def test_one_seed_has_no_interval():
    summary = made(seeds=1)
    assert summary["random"]["ci95"] is None and summary["gain"]["ci95"] is None
    assert "one seed" in text(summary)


def test_real_data_has_no_recovery_and_says_real():
    summary = made(real=True)
    assert summary["real"] is True and "recovery" not in summary
    assert "(real images)" in text(summary).splitlines()[0]


def test_the_table_of_the_twin_says_that_it_is_not_real():
    table = text(made())
    assert "the twin, NOT real data" in table.splitlines()[0]
    for row, mean in (
        ("random", "15.0"),
        ("default", "25.0"),
        ("learnt", "40.0"),
        ("real", "60.0"),
    ):
        assert any(line.split()[:2] == [row, mean] for line in table.splitlines())
    assert "+25.0" in table and "bicycle" in table.splitlines()[-1]


def test_physical_values_by_hand():
    centre = np.full(23, 0.5, np.float32)
    width = np.full(23, 0.2, np.float32)
    found = attributes(sdr_jax.Proposal(centre, width))
    assert list(found) == list(NAMES)
    # Linear: -12..20 deg. Logarithmic: 5..50 m, whose middle is 5 sqrt(10).
    pitch, cars = found["camera_rotation_x"], found["car_interval"]
    assert pitch["unit"] == {"centre": 0.5, "width": 0.2}
    assert pitch["physical"] == {
        "centre": pytest.approx(4), "low": pytest.approx(0.8), "high": pytest.approx(7.2), "unit": "deg"
    }  # fmt: skip
    assert cars["physical"]["centre"] == pytest.approx(5 * math.sqrt(10), abs=1e-4)
    assert cars["physical"]["low"] == pytest.approx(5 * 10**0.4, abs=1e-4)
    assert cars["physical"]["high"] == pytest.approx(5 * 10**0.6, abs=1e-4)


@given(
    st.lists(st.floats(0, 1, width=32), min_size=23, max_size=23),
    st.lists(st.floats(0, 1, width=32), min_size=23, max_size=23),
)
def test_physical_values_stay_in_the_table(centre, width):
    found = attributes(sdr_jax.Proposal(np.float32(centre), np.float32(width)))
    for attribute in ATTRIBUTES:
        physical = found[attribute.name]["physical"]
        assert physical["unit"] == BY_NAME[attribute.name].unit
        low, middle, high = physical["low"], physical["centre"], physical["high"]
        assert attribute.low - 1e-3 <= low <= middle <= high <= attribute.high + 1e-3


def test_the_report_shows_the_figures_and_says_that_the_twin_is_not_real():
    learnt = sdr_jax.Proposal(np.full(23, 0.5, np.float32), np.full(23, 0.1, np.float32))
    page = html(made(), attributes(learnt))
    assert "not a result on real data" in page and "not a result" not in html(
        made(real=True), attributes(learnt)
    )
    parser = ElementTree.fromstring(
        page.split("<body>")[1].join(["<body>", ""]).split("</html>")[0]
    )
    cells = [[c.text for c in row] for row in parser.iter("tr")]
    assert ["learnt attributes", "40.0", "-87.1 to 167.1"] in cells
    assert ["gain, learnt minus random", "+25.0", "-38.5 to 88.5"] in cells
    assert ["car position", "7.5", "6.85", "8.15", "m"] in [row[:5] for row in cells]
    absent = class_table("cityscapes").classes[-1]
    assert [absent] + ["not in the truth"] * 4 in cells


def test_the_report_escapes_what_it_is_told():
    learnt = sdr_jax.Proposal(np.full(23, 0.5, np.float32), np.full(23, 0.1, np.float32))
    page = html(made() | {"note": "<script>"}, attributes(learnt))
    assert "<script>" not in page and "&lt;script&gt;" in page
