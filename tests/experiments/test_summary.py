"""The answer in figures: keys that scripts rely on, percent, physical values."""

from types import SimpleNamespace

import numpy as np
import pytest

import experiments
from common.files import read_json, write_json
from experiments.app import main_job
from experiments.app.report.summary import derive, scores, text, verdict
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.job import Result
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.stats import TOO_FEW
from experiments.targets.base import Target
from experiments.targets.twin import twin_world
from scene.attributes import names
from scene.proposal import default_proposal, describe, slide
from seg.classes import class_table

CLASSES = class_table("cityscapes").classes
ROW_MIOU = {"random": [0.1, 0.2], "default": [0.2, 0.3], "learnt": [0.3, 0.5], "real": [0.6, 0.6]}


def outcome(miou: float, failed: str | None = None) -> Result:
    """IoU of road = miou, of the rest 0; the last class never occurs."""
    return Result(miou, [miou] + [0.0] * (len(CLASSES) - 2) + [None], 2.0, 3.0, failed)


def made(
    seeds: int = 2, real: bool = False, failed: bool = False, twin: str = "near", learnt: int = 23
) -> dict:
    target = Target(
        "cityscapes" if real else "twin", real, "cityscapes", "the title", ("a", "b", "c"),
        ("s", "s", "s"), ("d",), lambda height, width: None, None if real else twin_world(0, twin),
    )  # fmt: skip
    rows = {row: [outcome(m) for m in values[:seeds]] for row, values in ROW_MIOU.items()}
    if failed:
        rows["random"][0] = Result(float("nan"), [], 0.0, 1.0, "the loss is nan")
    line = {"failed": None, "render_seconds": 2.0, "train_seconds": 3.0}
    logs = [[{**line, "key": f"{log}{k}"} for k in range(n)] for log, n in (("e", 3), ("f", 4))]
    logs[1] += [{**logs[1][0], "row": "learnt"}]  # the same net in another row
    logs[1] += [{**line, "key": "failed", "failed": "the loss is nan"}] * 2 * failed
    config = defaults(MainConfig, "twin", "smoke", seeds=seeds)
    evaluations, finals = (SimpleNamespace(records=log) for log in logs)
    run = SimpleNamespace(
        config=config,
        target=target,
        evaluations=evaluations,
        finals=finals,
        progress=SimpleNamespace(elapsed=99.25),
    )
    return derive(scores(run, rows, slide(np.full(learnt, 0.5), 0.1)))


def test_keys_are_those_that_scripts_rely_on(tmp_path):
    write_json(tmp_path / "summary.json", made())
    summary = read_json(tmp_path / "summary.json")
    assert (summary["target"], summary["real"], summary["preset"]) == ("twin", False, "smoke")
    counts = [summary[name] for name in ("reward_images", "test_images", "evaluations")]
    assert (counts, set(summary["rows"])) == ([3, 1, 3], set(ROW_MIOU))
    assert summary["seconds"] == {"render": 14.0, "train": 21.0, "total": 99.2}
    for entry in summary["rows"].values():
        assert set(entry) == {"miou", "mean", "ci95", "folds", "per_class"}
        assert len(entry["miou"]) == 2
        assert set(entry["per_class"]) == set(CLASSES)
    assert set(summary["gains"]) == {"learnt"}
    assert set(summary["gains"]["learnt"]) == {"random", "default"}
    for gain in summary["gains"]["learnt"].values():
        assert set(gain) == {"mean", "ci95", "folds"}


def test_figures_by_hand():
    summary = made()
    random, gain = summary["rows"]["random"], summary["gains"]["learnt"]["random"]
    assert [*random["miou"], random["mean"]] == pytest.approx([10, 20, 15])
    assert random["ci95"] == pytest.approx([0, 15 + 63.53], abs=0.01)  # cut at 0
    # Differences by seed: 20 and 30; t(0.975, 1) = 12.706.
    assert [gain["mean"], *gain["ci95"]] == pytest.approx([25, 25 - 63.53, 25 + 63.53], abs=0.01)
    assert summary["rows"]["learnt"]["per_class"]["road"] == pytest.approx(40)
    assert summary["rows"]["learnt"]["per_class"]["bicycle"] is None
    assert summary["classes_absent_from_truth"] == ["bicycle"]
    assert [row["share"] for row in summary["components"]] == [1.0]
    assert summary["recovery"]["learnt_error"] == summary["recovery"]["centre_error"]
    one = made(seeds=1)
    assert one["rows"]["random"]["ci95"] is None
    assert one["gains"]["learnt"]["random"]["ci95"] is None
    assert TOO_FEW in text(one)


def gain(mean, *ci95):
    return {"mean": mean, "ci95": [*ci95] or None}


@pytest.mark.parametrize(("means", "over_default", "line"), [
    ((20.0, 30.0, 33.1), gain(3.1, 1.0, 5.2),
     "streets are significantly better than default streets, +3.1 points (1.0 to 5.2): use optimised "
     "streets."),
    ((20.0, 30.0, 30.4), gain(0.4, -1.0, 1.8),
     "streets are within noise of default streets, +0.4 points (-1.0 to 1.8): use optimised streets."),
    ((20.0, 30.0, 28.0), gain(-2.0, -3.0, -1.0),
     "streets are significantly worse than default streets, -2.0 points (-3.0 to -1.0): use default "
     "streets."),
    ((35.0, 30.0, 33.0), gain(3.0),
     f"minus default streets: +3.0 points ({TOO_FEW}): use random streets."),
    ((20.0, 30.0, None), gain(None),
     "and default streets cannot be compared, because training failed: use default streets."),
])  # fmt: skip
def test_a_line_says_which_streets_to_use(means, over_default, line):
    rows = {
        row: {"mean": mean}
        for row, mean in zip(("random", "default", "learnt"), means, strict=True)
    }
    gains = {"learnt": {"default": over_default}}
    assert verdict({"rows": rows, "gains": gains}) == f"Optimised {line}"
    # With a labelled subset, the rows with its labels count.
    with_few = {f"few+{row}": entry for row, entry in rows.items()} | {"learnt": {"mean": 99.0}}
    gains = {"few+learnt": {"few+default": over_default}, "learnt": {"default": gain(-50.0)}}
    report = {"rows": with_few, "gains": gains, "few_images": ["a"] * 14}
    assert verdict(report) == f"With 14 labelled images, optimised {line}"


@pytest.mark.parametrize("learnt", [23, 40])
@pytest.mark.parametrize(("twin", "hidden"), [("near", 23), ("far", 40)])
def test_recovery_is_about_the_attributes_that_twin_and_search_share(twin, hidden, learnt):
    recovery = made(twin=twin, learnt=learnt)["recovery"]
    shared = min(learnt, hidden)
    errors = np.abs(0.5 - twin_world(0, twin).centre[:shared])
    assert recovery["by_attribute"] == pytest.approx(
        dict(zip(names("extended"), errors, strict=False)), abs=1e-4
    )
    assert (
        recovery["learnt_error"]
        == recovery["centre_error"]
        == pytest.approx(errors.mean(), abs=1e-4)
    )


def test_the_table_says_whether_data_are_real():
    summary = made(real=True)
    assert summary["real"] is True and "recovery" not in summary
    assert "(real images)" in text(summary).split("\n\n")[1]
    table = text(made())
    first, note, *_ = table.split("\n\n")
    assert "the twin, NOT real data" in note and note.endswith("no mean includes them: bicycle.")
    for row, mean in zip(ROW_MIOU, ("15.0", "25.0", "40.0", "60.0"), strict=True):
        assert f"| {TRAINED_ON[row]} | {mean} | " in table
    assert "| optimised streets over random streets | +25.0 | -38.5 to 88.5 |" in table
    assert "| optimised streets over default streets | +15.0 | -48.5 to 78.5 |" in table
    assert first.startswith(
        "Optimised streets are within noise of default streets, +15.0 points (-48.5 to"
    )


def test_a_net_that_failed_is_left_out_and_told():
    summary = made(failed=True)
    random, gain = summary["rows"]["random"], summary["gains"]["learnt"]["random"]
    assert [*random["miou"], random["mean"]] == [None, pytest.approx(20), pytest.approx(20)]
    assert summary["failed"] == 1 and gain["mean"] == pytest.approx(30) and gain["ci95"] is None
    assert "1 evaluation failed in training and is left out" in text(summary)


def test_the_function_search_returns_scores_and_attributes(tmp_path, monkeypatch):
    configs = []

    def work(config):
        configs.append(config)
        write_json(config.out / "summary.json", made(seeds=2))
        write_json(config.out / "attributes.json", describe(default_proposal()))

    monkeypatch.setattr(main_job, "RUN", work)
    options = {"twin": "far", "search": {"datasets_per_update": 4}}
    found = experiments.search(out=tmp_path, space="extended", **options)
    (config,) = configs
    assert (config.target, config.twin, config.space) == ("twin", "far", "extended")
    assert config.search.datasets_per_update == 4 and config.out == tmp_path
    means = {row: score.mean for row, score in found.miou.items()}
    assert means == pytest.approx({row: 100 * np.mean(own) for row, own in ROW_MIOU.items()})
    assert found.miou["random"].ci95 == pytest.approx((0, 78.53), abs=0.01)
    assert np.array_equal(found.attributes.centre, default_proposal().centre)
    assert found.verdict in str(found) and found.verdict in found._repr_html_()
