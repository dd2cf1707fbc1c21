"""Logs that lost their end, or hold half a line: the same answer, or one error that names the place."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sdr_jax
from common.errors import UserError
from sdr_jax.registry import make
from tests.robustness.conftest import TIMES

pytestmark = pytest.mark.robust
LOGS = ("evaluations.jsonl", "finals.jsonl", "store.jsonl")
FAULTS = ("cut at any byte", "half a line within")


@pytest.fixture
def job(command) -> Callable[[Path], int]:
    """Searches and final nets by formula, with a store beside the folder; the exit code."""

    def run(out: Path) -> int:
        flags = ("--methods", "random_search", "--searches", "1", "--core-minutes", "0.05")
        return command("searches", out, *flags, "--store", str(out.with_name("store.jsonl")))

    return run


def answer(out: Path) -> dict[str, Any]:
    """The report."""
    report: dict[str, Any] = json.loads((out / "searches.json").read_text())
    return report


def halved(lines: list[bytes], number: int) -> bytes:
    """Lines of a log, but only half of one of them."""
    half = lines[number][: len(lines[number]) // 2] + b"\n"
    return b"".join([*lines[:number], half, *lines[number + 1 :]])


@pytest.mark.parametrize("log", LOGS)
def test_a_log_is_cut_anywhere_or_has_half_a_line(log, job, tally, tmp_path, capsys):
    whole, rng = tmp_path / "whole", np.random.default_rng(3)
    whole.mkdir()
    assert job(whole / "run") == 0
    name = log if log == "store.jsonl" else f"run/{log}"
    data = (whole / name).read_bytes()
    cut, half = (tally(f"{what}: {log}") for what in FAULTS)
    for number, size in enumerate(rng.integers(0, len(data), TIMES)):
        out = tmp_path / f"cut{number}"
        shutil.copytree(whole, out)
        (out / name).write_bytes(data[:size])
        with cut.attempt():
            assert job(out / "run") == 0
            assert answer(out / "run") == answer(whole / "run")
            cut.lost["lines that were cut off"] += data[size:].count(b"\n")
    lines = data.splitlines(keepends=True)
    for number in rng.integers(0, len(lines) - 1, TIMES):
        out, broken = tmp_path / "half", halved(lines, number)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(whole, out)
        (out / name).write_bytes(broken)
        capsys.readouterr()
        with half.attempt():
            assert job(out / "run") == 2
            error = capsys.readouterr().err
            assert error.count("\n") == 1 and f"{name}: line {number + 1} " in error, error
            assert (out / name).read_bytes() == broken


def test_a_history_is_cut_anywhere_or_has_half_a_line(tally, tmp_path):
    space, rng = sdr_jax.space(["a", "b"], bins=4), np.random.default_rng(4)

    def search(path: Path) -> bytes:
        own = sdr_jax.AskTell(space, make("gaussian", space), n=4, seed=0, path=path)
        while own.updates < 4:
            for trial in own.ask():
                own.tell(trial.id, float(trial.proposal.centre.sum()))
        return path.read_bytes()

    path, data = tmp_path / "cut.jsonl", search(tmp_path / "whole.jsonl")
    cut, half = (tally(f"{what}: ask and tell") for what in FAULTS)
    lines = data.splitlines(keepends=True)
    for size, number in rng.integers(0, (len(data), len(lines) - 1), (TIMES, 2)):
        with cut.attempt():
            path.write_bytes(data[:size])
            assert search(path) == data
            cut.lost["lines that were cut off"] += data[size:].count(b"\n")
        path.write_bytes(halved(lines, number))
        complaint = rf"cut\.jsonl: line {number + 1} is not JSON; remove"
        with half.attempt(), pytest.raises(UserError, match=complaint):
            search(path)
