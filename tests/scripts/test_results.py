"""All results from one commit: every part is a valid command, runs once, and is recorded with its origin."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from subprocess import run

import pytest

from common.errors import UserError
from common.files import read_json, write, write_json
from experiments.config import presets
from experiments.config.jobs import defaults_of
from experiments.tables.form import interval, miou
from experiments.tables.skeleton import check
from experiments.tables.stats import gain
from scene.version import ENGINE
from scripts.results import __main__ as command
from scripts.results import making, page
from scripts.results import parts as results
from scripts.results.claims import TARGETS, Claims, signed
from seg.recipes import RECIPES
from tests.conftest import ROOT
from tests.experiments.conftest import job_of, parsed

SOME = [
    results.Part(name, "labels", "some", ("--data", "/mine", "--learnt", "/mine"))
    for name in ("one", "two")
]
EVERYTHING = results.Data(Path("CAMVID"), Path("FACADES"))


def configured(part, learnt_file):
    """The configuration of a part's command, and its job."""
    job = job_of(part.study)
    flags = [str(learnt_file) if flag.endswith("-0.json") else flag for flag in part.flags]
    target, preset = (flags[flags.index(name) + 1] for name in ("--target", "--preset"))
    space = "extended" if "--space" in flags else "scenex"
    return parsed(presets.in_space(defaults_of(part.study, target, preset), space), flags), job


@pytest.mark.parametrize("preset", ["smoke", "quick"])
def test_every_part_is_a_valid_command(preset, learnt_file, tmp_path):
    parts = results.parts(EVERYTHING, tmp_path, preset)
    assert len({part.name for part in parts}) == len(parts)
    for part in parts:
        config, job = configured(part, learnt_file)
        assert config.preset == preset
        if not hasattr(config, "learnt"):
            check(job.STUDY, config)


def test_the_paper_has_300_rewards_and_the_paper_s_attributes_with_every_method(
    learnt_file, tmp_path
):
    rewards = {}
    for part in results.parts(EVERYTHING, tmp_path, "quick"):
        if part.section == "paper":
            config, job = configured(part, learnt_file)
            assert (config.space, config.search.bins, config.holdout) == ("scenex", 10, None)
            plans = {
                (one.search.method, job.plan_of(one, name).evaluations)
                for name, one in job.configure_all(config).items()
            }
            rewards[part.name] = plans, len(config.groups), config.search.relaxation
    assert rewards == {
        "paper-sdr": ({("sdr", 300)}, 6, 0.1),
        "paper-random_search": ({("random_search", 300)}, 6, 0.1),
        "paper-attribute_descent": ({("attribute_descent", 300)}, 6, 0.1),
        "paper-no-relaxation": ({("sdr", 300)}, 6, 0.0),
        "paper-no-groups": ({("sdr", 300)}, 1, 0.1),
        "paper-squared-reward": ({("sdr", 300)}, 6, 0.1),
        "paper-3000-rewards": ({("sdr", 3000)}, 6, 0.1),
    }


def test_labels_plus_renders_are_trained_as_fit_trains(tmp_path):
    parts = results.parts(EVERYTHING, tmp_path, "quick")
    for part in parts:
        if part.section == "labels":
            values = vars(making.cli.parser("labels").parse_args(list(part.flags)))
            del values["debug"]
            config = making.cli.configured("labels", values)
            assert config.final.train == RECIPES["lite0-heads"] and config.final.size == "480x360"
            assert config.few_share is None and config.final.images == 400


def test_parts_without_their_data_are_left_out(tmp_path):
    twins = results.parts(results.Data(), tmp_path, "quick")
    assert {part.flags[1] for part in twins} == {"twin"} and len(twins) == 5
    with_camvid = results.parts(results.Data(camvid=Path("DIR")), tmp_path, "quick")
    assert {part.flags[1] for part in with_camvid} == {"twin", "camvid"}


def test_the_plan_adds_up_the_plans_of_studies(tmp_path):
    parts = results.parts(results.Data(), tmp_path, "smoke")[:2]
    each = making.core_seconds(parts[0])
    assert each > 0
    text = making.plan_text(parts)
    assert "  far-0\n" in text and "  far-1\n" in text and "for 2 part(s)" in text
    assert "At most 3.0 h of a core" in making.plan_text(SOME, cost=lambda part: 5400.0)


@pytest.mark.slow
def test_parts_read_what_other_parts_write(camvid_dir, tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    out, docs = tmp_path / "out", tmp_path / "docs"
    parts = results.parts(results.Data(camvid_dir), out, "smoke")
    names = ["fit-camvid-0006R0", "camvid-0006R0", "kinds-camvid-0006R0", "table-camvid-0006R0"]
    assert making.make(parts, out, docs, only=names) == names
    assert list(read_json(docs / "results" / "parts.json")) == names


NET = {
    "key": "0", "config": "1", "engine": 3, "centre": None, "width": None, "seed": 0, "reward": 0.4,
    "class_iou": [], "render_seconds": 3600.0, "train_seconds": 4 * 3600.0, "failed": None,
}  # fmt: skip


class Runs:
    """Stands for the commands of parts: writes their files, and fails at one of them."""

    def __init__(self, failing: str = "") -> None:
        self.failing, self.ran, self.stores = failing, [], set()

    def __call__(self, words) -> int:
        out = Path(words[words.index("--out") + 1])
        self.stores.add(Path(words[words.index("--store") + 1]))
        self.ran.append(out.name)
        out.mkdir(exist_ok=True)
        write(out / "some.png", b"picture")
        write_json(out / "some.json", {"study": "some"})
        write(out / "finals.jsonl", json.dumps(NET) + "\n")
        return 3 if out.name == self.failing else 0


def test_parts_run_once_and_are_recorded_with_their_origin(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    out, docs, store = tmp_path / "out", tmp_path / "docs", tmp_path / "shared.jsonl"

    def make(runs, **flags):
        return making.make(SOME, out, docs, store, run=runs, cost=lambda part: 60.0, **flags)

    broken = Runs("two")
    with pytest.raises(UserError, match="two ended with exit code 3"):
        make(broken)
    assert "At most 2 min of a core for 2 part(s)" in capsys.readouterr().out
    assert list(read_json(docs / "results" / "parts.json")) == ["one"]
    again = Runs()
    assert make(again) == ["one", "two"]
    assert (broken.ran, again.ran) == (["one", "two"], ["two"])
    assert "At most 60 s of a core for 1 part(s)" in capsys.readouterr().out
    origin = {
        "command": "sdr-jax study some --data DIR --learnt FILE", "commit": "abc", "engine": ENGINE,
        "evaluations": 1, "core_seconds": 5 * 3600,
    }  # fmt: skip
    assert read_json(docs / "results" / "parts.json") == {"one": origin, "two": origin}
    assert (docs / "results" / "two.png").read_bytes() == b"picture"
    assert make(Runs("one")) == ["one", "two"]
    monkeypatch.setattr(making, "commit", lambda: "def")
    with pytest.raises(UserError, match='commit = "abc", not "def"'):
        make(Runs())


def test_a_run_of_some_parts_leaves_the_records_of_others(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    out, docs, runs = tmp_path / "out", tmp_path / "docs", Runs()
    for name in ("two", "one"):
        making.make(SOME, out, docs, only=[name], run=runs, cost=lambda part: 0)
    assert list(read_json(docs / "results" / "parts.json")) == ["two", "one"]
    assert runs.stores == {docs / "results" / "store.jsonl"}  # committed with the reports


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM")
def test_a_request_to_end_reaches_the_part_that_runs():
    part = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    parent = f"from scripts.results.making import run_part; print(run_part(['', '-c', {part!r}]))"
    command = [sys.executable, "-c", parent]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        process.terminate()
        assert process.stdout.read().strip() == str(-signal.SIGTERM)
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_without_pages_the_store_is_with_the_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    runs = Runs()
    making.make(SOME, tmp_path / "out", run=runs, cost=lambda part: 0)
    assert runs.stores == {tmp_path / "out" / "store.jsonl"}


def test_the_page_is_written_after_each_part_if_all_other_reports_exist(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    docs, pages = tmp_path / "docs", []
    shutil.copytree(ROOT / "docs" / "results", docs / "results")
    monkeypatch.setattr(page, "write", lambda folder: pages.append(page.text(folder)))
    making.make(SOME, tmp_path / "out", docs, run=Runs(), cost=lambda part: 0)
    assert [f"[{name}](results/{name}.json)" in pages[0] for name in ("one", "two")] == [
        True,
        False,
    ]
    assert "[two](results/two.json)" in pages[1]


def test_changed_documentation_does_not_change_the_commit(tmp_path):
    def git(*words):
        who = ("-c", "user.name=any", "-c", "user.email=any")
        run(["git", "-C", tmp_path, *who, *words], check=True, capture_output=True)

    inside, page = tmp_path / "experiments", tmp_path / "docs" / "file"
    for folder in (inside, page.parent):
        folder.mkdir()
        (folder / "file").write_text("one")
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    first = making.commit(inside)
    page.write_text("two")
    assert making.commit(inside) == first
    (tmp_path / "README.md").write_text("new")
    git("add", ".")
    git("commit", "-m", "pages")
    assert making.commit(inside) == first
    (inside / "file").write_text("two")
    changed = making.commit(inside)
    assert changed.startswith(f"{first}, changed ") and making.commit(inside) == changed
    (inside / "file").write_bytes(b"three \xe9")
    assert making.commit(inside) not in (changed, first)
    git("commit", "-am", "program")
    assert not making.commit(inside).startswith(first)


@pytest.mark.parametrize(("flags", "complaint"), [
    (("--only", "table", "table"), "has a value twice"),
    (("--only", "tables"), "--only tables: no such part with this data; choose from fit-camvid-0006R0"),
])  # fmt: skip
def test_bad_flags_are_one_line(flags, complaint, error_line):
    assert command.main(["--data", "DIR", *flags]) == 2
    assert complaint in error_line()


RECORDED = Claims(ROOT / "docs" / "results")


def test_the_page_is_written_from_the_recorded_reports():
    assert (ROOT / "docs" / page.NAME).read_text(encoding="utf-8") == page.text(ROOT / "docs")


def test_the_page_has_parts_that_are_made_later(tmp_path):
    """Reports of other parts stand for those that may be missing."""
    folder = tmp_path / "results"
    shutil.copytree(ROOT / "docs" / "results", folder, ignore=shutil.ignore_patterns("*.png"))
    records = read_json(folder / "parts.json")
    stands_for = {"paper": "rivals-labelmefacade"}
    replaced = {"fit-camvid": "fit-labelmefacade"}
    for part in results.parts(EVERYTHING, tmp_path, "quick"):
        if other := stands_for.get(part.name.partition("-")[0], replaced.get(part.name)):
            records[part.name] = records[other] | {"commit": "abc", "engine": 10}
            shutil.copyfile(folder / f"{other}.json", folder / f"{part.name}.json")
    descent = folder / "paper-attribute_descent.json"
    descent.write_text(descent.read_text().replace('"random_search"', '"attribute_descent"'))
    records["labels-labelmefacade"]["engine"] = 10
    write_json(folder / "parts.json", records)
    text = page.text(tmp_path)
    assert "(50 updates a group), streets by `sdr` are within noise of random" in text
    assert (
        "With 3,000 rewards, one search, streets by `sdr` are within noise of random ones: -3.4"
        in text
    )
    assert "With as many rewards, `random_search` gains -1.5 (-2.7 to -0.3) and `attribute_" in text
    assert "Three searches each: `sdr` over `random_search` -1.9 (p = 0.55), over" in text
    assert "One search is one draw" not in text and "are not made yet" not in text
    assert "| CamVid, 300 rewards, no relaxation | 240x176 | sdr | 3 | 54.6 |" in text
    assert "| CamVid (100 labels, its test images) |" in text
    # Each target has the rows of its newest engine.
    assert "| LabelMeFacade (engine 10, 480x360) | 14 | 66.4 |  |  | 68.1 |  |  |  |" in text
    # Kinds of streets are compared with some numbers of labels.
    camvid = "| CamVid 0006R0 (engine 9, 480x360)"
    assert f"{camvid} | 67 | 47.0 |  |  | 49.9 |  |  |  |" in text
    gains = "+0.1 (-0.7 to 0.8) | +0.0 (-0.7 to 0.7)"
    assert f"{camvid} | 14 | 42.5 | 48.6 | 48.6 | 48.8 | 48.6 | {gains} |" in text
    assert "Engine 10, commit abc" in text


def test_readme_states_what_the_reports_say():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = RECORDED.what_to_expect()
    assert len(lines) >= 2 and set(lines) <= set(readme.splitlines())
    assert f"\n{RECORDED.example()}\n" in readme
    minutes = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    fit, demo = (
        minutes[round(run["minutes"]) - 2]
        for run in (RECORDED.measured["fit"]["camvid-0006R0"], RECORDED.measured["demo"])
    )
    assert f"it took {fit} minutes on two cores" in readme
    assert f"about {demo} minutes on two cores" in readme
    text = " ".join(readme.split())
    for target in ("camvid-0006R0", "labelmefacade"):
        gains = (RECORDED.gain(target, over=over) for over in ("random", "default"))
        assert "{} over random streets and {} over default ones".format(*gains) in text
    far = RECORDED.estimate("far", field="gain_over_default")
    assert "gained {:+.1f} points ({})".format(far["mean"], interval(far["ci95"])) in text
    over_random = RECORDED.estimate("far", field="gain_over_random")["mean"]
    assert f"and {over_random:+.1f} over random ones" in text
    limits = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
    verdict = RECORDED.verdict("camvid-0006R0", "intervals").removesuffix(" of")
    assert f"On a held-out sequence of CamVid they are {verdict} of random and of default" in limits
    assert "on LabelMeFacade and CamVid's test images, whose searches see" in limits
    for target in ("labelmefacade", "camvid"):  # better than default ones
        assert RECORDED.estimate(target, field="gain_over_default")["ci95"][0] > 0


def test_the_page_on_few_labels_states_what_the_reports_say():
    guide = (ROOT / "docs" / "howto" / "few_labels.md").read_text(encoding="utf-8")
    text = " ".join(guide.split())
    camvid, facades = (RECORDED.share(name, "both") for name in ("camvid-0006R0", "labelmefacade"))
    assert f"reach {camvid} % of the mIoU of all 266 labels" in text
    assert f"they reach {facades} % of that of all 100" in text
    few = ("few-14-camvid-0006R0", "few-14-labelmefacade")
    most = max(RECORDED.estimate(name, field="gain_over_default")["mean"] for name in few)
    assert f"they are [at most {most:.1f} points]" in text and "better than default ones" in text
    shares = {
        kind: round(RECORDED.row("kinds-labelmefacade", labels=14, renders=kind)["of_all"])
        for kind in ("learnt", "random", "default")
    }
    assert shares["random"] == shares["default"]
    assert (
        f"all 100 labels raise 14 labels to {shares['learnt']} % of the mIoU of all labels" in text
    )
    assert f"other streets to {shares['random']} %" in text
    gains = [
        RECORDED.kind_gain(name, 14, "learnt", "random")
        for name in ("camvid-0006R0", "labelmefacade")
    ]
    assert all(entry["ci95"][0] < 0 < entry["ci95"][1] for entry in gains)
    words = " and ".join(f"{entry['mean']:+.1f}" for entry in gains)
    guide = (ROOT / "docs" / "howto" / "own_images.md").read_text(encoding="utf-8")
    assert f"of random ones ({words} points)" in guide


def test_sentences_of_the_page_that_no_number_carries_are_true():
    """When one of them fails with new results, `page.md` needs other words."""
    for count in (14, 266):
        for pair in (("learnt", "random"), ("learnt", "default"), ("default", "random")):
            low, high = RECORDED.kind_gain("camvid-0006R0", count, *pair)["ci95"]
            assert low < 0 < high  # within noise of each other
    assert RECORDED.kind_gain("camvid-0006R0", 0, "default", "random")["ci95"][0] > 0
    assert RECORDED.kind_gain("labelmefacade", 0, "learnt", "random")["ci95"][0] > 0
    assert RECORDED.kind_gain("labelmefacade", 100, "learnt", "random")["ci95"][1] < 0  # worse
    far = {row: RECORDED.estimate("far", row)["mean"] for row in ("default", "random")}
    assert far["default"] < far["random"]
    assert RECORDED.above_default("labelmefacade", "camvid") == "10 of 10"
    assert RECORDED.above_default("camvid-0006R0") == "2 of 5"
    for name in ("camvid-0006R0", "small-camvid-0006R0", "large-rewards-camvid-0006R0"):
        row = RECORDED.estimate(name, "intervals", "gain_over_default")
        assert row["ci95"][0] < 0  # does not carry over
    rows = (RECORDED.fit_row("camvid-0006R0", name) for name in ("both", "all"))
    low, high = gain(*(miou(row["nets"]) for row in rows))["ci95"]
    assert low < 0 < high  # as good as
    for target in ("camvid-0006R0", "labelmefacade"):
        added = [
            row["renders_add"]["mean"]
            for row in RECORDED.reports[f"labels-{target}"]["rows"]
            if row.get("renders_add")
        ]
        assert len(added) == 5 and added == sorted(added, reverse=True)  # the fewer, the larger
    assert RECORDED.lead("sdr", "no-groups") == "+4.9 (p = 0.01)"  # groups carry the method
    best = RECORDED.estimate("rivals-labelmefacade", "intervals")
    for method in ("surrogate", "tpe", "gaussian_process"):
        row = RECORDED.estimate("rivals-labelmefacade", method)
        assert row["ci95"][0] < best["mean"] < row["ci95"][1]


@pytest.mark.parametrize(("lows", "sentence"), [
    ([1, 0, 1, 1], "on CamVid 0006R0, CamVid test images and far twins, not on LabelMeFacade"),
    ([-1, -1, 2, 1], "on CamVid test images and far twins, not on CamVid 0006R0 and LabelMeFacade"),
    ([-1, -1, -1, 1], "on far twins, not on CamVid 0006R0, LabelMeFacade and CamVid test images"),
    ([1, 1, 1, 1], "on CamVid 0006R0, LabelMeFacade, CamVid test images and far twins"),
    ([0, 0, 0, 0], "on no target"),
])  # fmt: skip
def test_targets_with_a_significant_gain_are_named(lows, sentence, monkeypatch):
    entries = dict(zip(TARGETS, lows, strict=True))
    monkeypatch.setattr(RECORDED, "estimate", lambda target, field: {"ci95": [entries[target], 9]})
    assert RECORDED.significant("random") == sentence


def searched(random, default, ours):
    """A report of searches: means and, for our method, gains with an interval of 1 point each way."""

    def within_one(mean):
        return {"mean": mean, "ci95": [mean - 1, mean + 1]}

    over = {
        f"gain_over_{name}": within_one(ours - mean)
        for name, mean in (("random", random), ("default", default))
    }
    rows = [
        {"name": name, "mean": mean, "ci95": None}
        for name, mean in (("random", random), ("default", default))
    ]
    return {"rows": [*rows, {"name": "intervals", "mean": ours, "ci95": None, **over}]}


@pytest.fixture
def claims(tmp_path):
    """Claims of a few small reports: a table of labels, searches on real images and on two twins."""
    places = ((0, "mixed", 42.0), (14, "none", 40.0), (14, "mixed", 48.0), (50, "none", 50.0))
    rows = [
        {"labels": labels, "renders": renders, "mean": mean, "of_all": 2 * mean}
        | {"renders_add": {"mean": 8.0, "ci95": [7.0, 9.0]} if mean == 48 else None}
        for labels, renders, mean in places
    ]
    reports = {
        "fit-labelmefacade": {"rows": rows, "reward_images": 50},
        "camvid": searched(20.0, 21.0, 26.0),
        "camvid-0006R0": searched(20.0, 24.0, 20.5),
        "labelmefacade": searched(30.0, 20.0, 28.0),
        "far-0": searched(10.0, 9.0, 12.0),
        "far-1": searched(10.0, 11.0, 14.0),
    }
    for name, report in reports.items():
        write_json(tmp_path / f"{name}.json", report)
    write_json(tmp_path / "parts.json", {name: {} for name in reports})
    renders_add = {"mean": 6.54, "ci95": [3.26, 9.71]}
    write_json(
        tmp_path / "measured.json",
        {
            "fit": {"camvid-0006R0": {"labels": 14, "gain": renders_add}},
            "model selection": {"gains": [0.5, 1.5]},
        },
    )
    return Claims(tmp_path)


def test_claims_by_hand(claims):
    assert claims.gain("camvid") == "+6.0 (5.0 to 7.0)"
    assert claims.gain("camvid-0006R0", over="default") == "-3.5 (-4.5 to -2.5)"
    assert claims.gain("far") == "+3.0 (-9.7 to 15.7)"  # Student's t of 2 and 4
    for target in ("camvid", "labelmefacade"):
        claims.reports[target]["searches"] = [{"learnt": 100.0}, {"learnt": 1.0}]
    assert claims.above_default("camvid", "labelmefacade") == "2 of 4"
    claims.parts = {name: {"engine": 9 - (name == "far-1")} for name in claims.parts}
    assert claims.engines("far-0", "camvid") == "engine 9"
    assert claims.engines("far-0", "far-1") == "engines 9 and 8"
    assert claims.miou("camvid", name="default") == "21.0"
    verdicts = [claims.verdict(name, "intervals") for name in page.SEARCHED]
    assert verdicts == ["better than", "within noise of", "worse than"]
    assert claims.share("labelmefacade", "both") == "96.0"
    cells = "40.0 | **48.0** | +8.0 (7.0 to 9.0) | 42.0 | 50.0"
    line = f"| LabelMeFacade (50 labels, photos by pedestrians) | {cells} |"
    assert claims.what_to_expect() == [line]
    assert claims.example() == "Renders add 6.5 points (3.3 to 9.7) to your 14 labels."
    claims.reports["labels-camvid"] = {
        "worth": [
            {"beside": 0, "labels": 9.4, "bound": "", "ci95": [4.6, 13.1]},
            {"beside": 1, "labels": 11.0, "bound": "", "ci95": [None, 13.1]},
            {"beside": 14, "labels": 266.0, "bound": "at least", "ci95": [63.5, None]},
        ]
    }
    assert claims.worth("camvid", 0) == "9 (interval 5 to 13)"
    assert claims.worth("camvid", 1) == "11 (interval at most 13)"
    assert claims.worth("camvid", 14) == "at least 266 (interval at least 64)"
    with pytest.raises(LookupError, match="what 7 labels are worth"):
        claims.worth("camvid", 7)
    assert claims.selection() == "+1.0 (-5.4 to 7.4)"
    assert signed(None) == signed({"mean": None, "ci95": None}) == ""
    assert signed({"mean": 1.0, "ci95": None}) == "+1.0"
    with pytest.raises(LookupError, match=r"camvid\.json has no row \{'name': 'sdr'\}"):
        claims.miou("camvid", name="sdr")


def test_aims_are_met_or_missed_by_hand(claims):
    aims = [[cell.strip() for cell in line.split("|")[2:6]] for line in claims.aims()[2:]]
    assert aims[0] == ["", "96.0 % **met**", "", ""] and aims[1][1] == "84.0 % **missed**"
    over_random, over_default, width = ([cell.split()[-1] for cell in row] for row in aims[2:])
    assert over_random == ["**missed**", "**missed**", "**met**", "**missed**"]
    assert over_default == ["**missed**", "**met**", "**met**", "**missed**"]
    assert width == ["**missed**", "**missed**", "**met**", "**missed**"]
