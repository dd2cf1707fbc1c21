"""All results from one commit: every part is a valid command, runs once, and is on one page."""

import json
from pathlib import Path
from subprocess import run

import pytest

from common.errors import UserError
from common.files import write, write_json
from experiments.config import presets
from experiments.config.jobs import defaults_of
from experiments.studies.searches import OVER
from experiments.tables.skeleton import check
from scripts.results import __main__ as command
from scripts.results import making
from scripts.results import parts as results
from scripts.results.page import text
from tests.experiments.conftest import job_of, parsed

SOME = [
    results.Part(name, "main", "experiments.some", ("--data", "/mine", "--weights", "/mine"))
    for name in ("one", "two")
]
EVERYTHING = results.Data(Path("CAMVID"), Path("FACADES"), Path("/a.npz"))


@pytest.mark.parametrize("preset", ["smoke", "quick"])
def test_every_part_is_a_valid_command(preset, learnt_file, tmp_path):
    parts = results.parts(EVERYTHING, tmp_path, preset, 2, 2)
    names = [part.name for part in parts]
    assert len(set(names)) == len(names) and {part.group for part in parts} <= set(results.GROUPS)
    for part in parts:
        job = job_of(part.study)
        flags = [str(learnt_file) if flag.endswith("-0.json") else flag for flag in part.flags]
        target = flags[flags.index("--target") + 1]
        default = presets.in_space(defaults_of(part.study, target, preset), "extended")
        config = parsed(default, flags)
        assert config.target == target and config.preset == preset and config.space == "extended"
        if not hasattr(config, "learnt"):
            check(job.STUDY, config)


def test_parts_without_their_data_are_left_out(tmp_path):
    twins = results.parts(results.Data(), tmp_path, "quick", 1, 1)
    assert {part.flags[1] for part in twins} == {"twin"}
    with_camvid = results.parts(results.Data(camvid=Path("DIR")), tmp_path, "quick", 1, 1)
    assert {part.flags[1] for part in with_camvid} == {"twin", "camvid"}


@pytest.mark.slow
def test_parts_read_what_other_parts_write(camvid_dir, tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    parts = results.parts(results.Data(camvid_dir), tmp_path / "out", "smoke", 1, 2)
    names = ["camvid-0006R0", "far-0", "far-1", "table-camvid-0006R0", "table-far"]
    assert making.make(parts, tmp_path / "out", only=names) == names
    page = (tmp_path / "out" / "results.md").read_text()
    assert "mean of 2 far" in page and "Not made yet: camvid, near-0" in page


NET = {
    "key": "0", "config": "1", "engine": 3, "centre": None, "width": None, "seed": 0, "reward": 0.4,
    "class_iou": [], "render_seconds": 3600.0, "train_seconds": 4 * 3600.0, "failed": None,
}  # fmt: skip


class Runs:
    """Stands for the commands of parts: writes their files, and fails at one of them."""

    def __init__(self, failing: str = "") -> None:
        self.failing, self.ran = failing, []

    def __call__(self, words) -> int:
        out = Path(words[words.index("--out") + 1])
        self.ran.append(out.name)
        out.mkdir(exist_ok=True)
        write(out / "some.md", f"table of {out.name}")
        write(out / "some.png", b"picture")
        write_json(out / "some.json", {})
        write(out / "finals.jsonl", json.dumps(NET) + "\n")
        return 3 if out.name == self.failing else 0


def test_parts_run_once_and_are_on_one_page(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    out, docs, store = tmp_path / "out", tmp_path / "docs", tmp_path / "shared.jsonl"
    broken = Runs("two")
    with pytest.raises(UserError, match="two ended with exit code 3"):
        making.make(SOME, out, docs, store, run=broken)
    assert "Not made yet: two" in (docs / "results.md").read_text()
    again = Runs()
    assert making.make(SOME, out, docs, store, run=again) == ["one", "two"]
    assert (broken.ran, again.ran) == (["one", "two"], ["two"])
    page = (docs / "results.md").read_text()
    assert "commit abc: 1 evaluations that took a core 5.0 h." in page  # one net of two parts
    assert page.count(": 1 evaluations") == 3
    assert "table of one" in page and "table of two" in page
    assert "--data DIR --weights FILE" in page and "/mine" not in page
    assert (docs / "results" / "two.png").read_bytes() == b"picture"
    assert making.make(SOME, out, docs, store, run=Runs("one")) == ["one", "two"]
    monkeypatch.setattr(making, "commit", lambda: "def")
    with pytest.raises(UserError, match='commit = "abc", not "def"'):
        making.make(SOME, out, docs, store, run=Runs())


def test_a_changed_page_does_not_change_the_commit(tmp_path):
    def git(*words):
        who = ("-c", "user.name=any", "-c", "user.email=any")
        run(["git", "-C", tmp_path, *who, *words], check=True, capture_output=True)

    for name in ("docs", "experiments"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("one")
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    inside = tmp_path / "experiments"
    first = making.commit(inside)
    (tmp_path / "docs" / "file").write_text("two")
    assert making.commit(inside) == first
    (inside / "file").write_text("two")
    assert making.commit(inside) == f"{first}, changed"


def test_parts_of_one_kind_have_a_table_with_their_means(tmp_path):
    parts = [
        results.Part(name, "twins", "experiments.studies.searches", ())
        for name in ("far-0", "far-1", "near")
    ]
    for k, part in enumerate(parts):
        gains = {f"gain_over_{base}": {"mean": 2.0 * k, "ci95": None} for base in OVER}
        rows = [
            {"name": name, "mean": mean, "ci95": None, **gains}
            for name, mean in (
                ("random", 10.0), ("default", 20.0), ("intervals", 30.0 + k), ("real", 40.0),
            )
        ]  # fmt: skip
        (tmp_path / part.name).mkdir()
        write_json(tmp_path / part.name / "searches.json", {"rows": rows})
    page = text(parts, {part.name for part in parts}, "abc", tmp_path)
    none = "too few networks for an interval"
    assert f"| far-1 |  | 10.0 | 20.0 | 31.0 | 40.0 | +2.0 | {none} | +2.0 | {none} |" in page
    assert "| mean of 2 far |  | 10.0 | 20.0 | 30.5 | 40.0 | +1.0 | -11.7 to 13.7 | +1.0 |" in page
    assert "mean of 1" not in page and "- near: `sdr-jax study searches`" in page


def test_a_run_of_some_parts_adds_them_to_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "commit", lambda: "abc")
    for name, missing in (("two", "Not made yet: one."), ("one", "table of two")):
        making.make(SOME, tmp_path / "out", only=[name], run=Runs())
        assert missing in (tmp_path / "out" / "results.md").read_text()


@pytest.mark.parametrize(("flags", "complaint"), [
    (("--only", "table", "table"), "has a value twice"),
    (("--only", "tables"), "--only tables: no such part with this data; choose from camvid, camvid-0006R0"),
    (("--searches", "0"), "--searches must be 1 or more"),
])  # fmt: skip
def test_bad_flags_are_one_line(flags, complaint, error_line):
    assert command.main(["--data", "DIR", *flags]) == 2
    assert complaint in error_line()
