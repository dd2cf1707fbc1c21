"""The whole job from the command line: what it leaves, and that kills do not change the answer."""

import os
import signal
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.files import read_json
from experiments.app.report.summary import ROWS
from experiments.evaluation.store import LOGS
from scene.attributes import NAMES
from scene.dataset.export import read_dataset
from scene.dataset.render import COMPILING
from scene.render.__main__ import main as scene_render
from seg.classes import CITYSCAPES_19
from seg.data import read_split
from tests.conftest import gone, wait_for_lines
from tests.guard_files import as_recorded

from .conftest import TINY, lines, main_job

SCORES = ("rows", "gains")


def children(pid: int) -> list[int]:
    """Processes that any thread of a process started, as Linux tells; none elsewhere."""
    paths = Path(f"/proc/{pid}/task").glob("*/children")
    with suppress(OSError):  # a thread has ended
        return [int(child) for path in paths for child in path.read_text().split()]
    return []


def test_the_run_folder_is_complete(unbroken):
    out, stdout = unbroken
    printed = stdout.splitlines()
    assert printed[0].startswith("Target: the twin 0") and "NOT real data" in printed[0]
    assert any("the twin, NOT real data" in line for line in printed[1:])
    assert "not real data" in printed[-1] and "summary.json" in printed[-1]
    progress = [line for line in printed if line.startswith("[")]
    assert len(progress) == 6 + 8 and all("mIoU" in line and " left" in line for line in progress)
    assert all("best" in line for line in progress[:6])
    assert not any("baseline" in line or "nan" in line for line in progress)  # the default has none
    assert all("twin, not real" in line for line in progress)
    assert {p.name for p in out.iterdir()} == {
        "attributes.json", "config.json", "dataset", "evaluations.jsonl", "finals.jsonl", "lock",
        "nets", "pictures", "report.html", "shared", "start.jpg", "summary.json", "summary.md",
    }  # fmt: skip
    pictures = [*out.glob("pictures/*.png"), *out.glob("pictures/*.jpg")]
    assert len(pictures) == 4 * 6 * 2 + 6 * (2 + 4) and len([*out.glob("nets/*.npz")]) == 4 * 2
    assert {Image.open(path).size for path in pictures} == {(64, 32)}
    kept = {p.name for p in (out / "pictures").iterdir()} - {p.name for p in pictures}
    assert kept == {"expected.npy", "matters.json", "probabilities.npy", "seen.json"}
    found, rendered = (
        read_split("cityscapes", out / "dataset", "train"),
        read_dataset(out / "dataset"),
    )
    assert found.images.shape == (6, 32, 64, 3) and found.names[0] == "scenex_000000_000000"
    np.testing.assert_array_equal(found.images, rendered.images)
    np.testing.assert_array_equal(found.labels, CITYSCAPES_19.from_train_id[rendered.labels])
    assert [len(lines(out / log)) for log in LOGS] == [12, 4 * 2]
    as_recorded("cityscapes", out)
    summary = read_json(out / "summary.json")
    assert (summary["reward_images"], summary["test_images"]) == (8, 8)
    assert summary["evaluations"] == 12 and set(summary["rows"]) == set(ROWS)
    for entry in summary["rows"].values():
        assert len(entry["miou"]) == 2 and len(entry["per_class"]) == 19
        low, high = entry["ci95"] or (0, 100)  # two nets may be too few for an interval
        assert low <= entry["mean"] <= high
        assert all(0 <= miou <= 100 for miou in entry["miou"])
    differences = np.subtract(summary["rows"]["learnt"]["miou"], summary["rows"]["random"]["miou"])
    assert summary["gains"]["learnt"]["random"]["mean"] == pytest.approx(differences.mean())
    assert set(summary["recovery"]["by_attribute"]) == set(NAMES)
    rows = read_json(out / "attributes.json")["components"]
    assert sum(row["share"] for row in rows) == 1
    assert all(list(row["attributes"]) == list(NAMES) for row in rows)


@pytest.mark.slow
def test_a_run_on_photographs_with_labels_in_colours(start_job, labelmefacade, tmp_path):
    flags = ("--data", str(labelmefacade), *TINY, "--seeds", "1", "--search.updates-per-group", "1")
    job = start_job(tmp_path / "run", *flags, experiment="labelmefacade")
    code, stdout, stderr = job.finish()
    assert code == 0, stderr
    assert stdout.startswith("Target: labelmefacade, 4 images for the search, tested on split test")
    summary = read_json(tmp_path / "run" / "summary.json")
    assert (summary["reward_images"], summary["test_images"]) == (4, 2)
    assert set(summary["rows"]) == set(ROWS)
    assert all(len(row["per_class"]) == 6 for row in summary["rows"].values())


@pytest.mark.slow  # and `make robust` kills a run twenty times; in one process test_study does
def test_stopped_and_killed_it_ends_as_an_unbroken_run(unbroken, start_job, tmp_path):
    out = tmp_path / "broken"

    job = start_job(out, *TINY)
    wait_for_lines(job.process, out / "evaluations.jsonl", 1)
    job.send(signal.SIGINT)  # as a terminal does, to the main process and to its workers
    code, _, stderr = job.finish()
    assert (code, stderr.strip()) == (130, "stopped; the same command resumes")

    job = start_job(out, *TINY)
    wait_for_lines(job.process, out / "evaluations.jsonl", 7)
    job.kill()
    job.finish()
    assert "This run is not finished yet" in (out / "report.html").read_text()
    with open(out / "evaluations.jsonl", "a") as log:
        log.write('{"update": 4, "data')  # as a kill within a write leaves it

    job = start_job(out, *TINY)
    wait_for_lines(job.process, out / "finals.jsonl", 3)
    workers = children(job.process.pid)
    os.kill(job.process.pid, signal.SIGKILL)  # the main process alone
    job.process.wait()
    assert all(gone(pid) for pid in workers)  # they do not outlive it
    job.finish()

    code, stdout, stderr = start_job(out, *TINY).finish()
    assert (code, stderr) == (0, "")
    continuing = next(line for line in stdout.splitlines() if line.startswith("Resuming"))
    assert "12 rewards" in continuing and "0 other networks" not in continuing

    whole, _ = unbroken
    assert (out / "attributes.json").read_bytes() == (whole / "attributes.json").read_bytes()
    found, wanted = (read_json(p / "summary.json") for p in (out, whole))
    assert {k: found[k] for k in SCORES} == {k: wanted[k] for k in SCORES}
    assert found.keys() == wanted.keys()
    assert files_of(out / "dataset") == files_of(whole / "dataset")
    file = Path("pictures") / "probabilities.npy"
    np.testing.assert_array_equal(np.load(out / file), np.load(whole / file))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no way to keep to one core")
def test_with_0_workers_one_starts_and_it_ends_on_one_core(unbroken, start_job, tmp_path):
    out, cores = tmp_path / "alone", os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # which the job inherits
    try:
        job = start_job(out, *TINY, "--workers", "0")
    finally:
        os.sched_setaffinity(0, cores)
    code, _, stderr = job.finish()
    assert (code, stderr) == (0, "")
    found, wanted = (read_json(p / "summary.json") for p in (out, unbroken[0]))
    assert {k: found[k] for k in SCORES} == {k: wanted[k] for k in SCORES}


def files_of(root: Path) -> dict[Path, bytes]:
    """All files of a folder."""
    return {p.relative_to(root): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_the_engine_alone_makes_the_runs_dataset_again(unbroken, tmp_path):
    """One draw: a run's attributes.json and seed are all that its dataset needs."""
    out, _ = unbroken
    config = read_json(out / "config.json")
    final = config["final"]
    code = scene_render([
        "--attributes", str(out / "attributes.json"), "--seed", str(config["seed"]),
        "--images", str(final["streets"] * final["shots"]), "--shots", str(final["shots"]),
        "--size", f"{final['width']}x{final['height']}", "--samples", str(final["samples"]),
        "--asset-count", str(config["asset_count"]), "--workers", "0", "--out", str(tmp_path / "again"),
    ])  # fmt: skip
    assert code == 0
    ours, theirs = files_of(out / "dataset"), files_of(tmp_path / "again")
    assert ours == theirs and len(ours) > 20


def test_smoke_run_on_real_camvid(camvid_dir, out, capsys):
    flags = [*TINY, "--workers", "0", "--seeds", "1", "--search.updates-per-group", "1"]
    flags += ["--data", str(camvid_dir), "--holdout", "0006R0", "--out", str(out)]
    assert main_job("camvid", *flags) == 0
    stdout, stderr = capsys.readouterr()
    assert stderr.replace(f"{COMPILING}\n", "") == ""
    first = stdout.splitlines()[0]
    assert first.startswith("Target: camvid") and "tested on sequence 0006R0" in first
    summary = read_json(out / "summary.json")
    assert (summary["target"], summary["real"]) == ("camvid", True)
    assert (summary["reward_images"], summary["test_images"]) == (8, 8)
    assert "recovery" not in summary
    assert all(0 < summary["rows"][row]["mean"] < 100 for row in ROWS) and "twin" not in stdout
