"""Rough treatment: five programs, what must be equal after it, and one table of what was survived.

``ROBUST_TIMES`` says how often each fault is tried; `make robust` says 20.
"""

import atexit
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any, NamedTuple

import pytest

from common.workers.pool import WorkerPool
from scene.dataset.render import compile_first
from tests.conftest import ROOT
from tests.experiments.conftest import (  # noqa: F401
    TINY,
    camvid,
    command,
    scored_by,
    within_this_process,
)
from tests.experiments.test_main_job import SCORES, files_of
from tests.layouts import write

TIMES = int(os.environ.get("ROBUST_TIMES", "2"))
EXAMPLE = ROOT / "examples" / "tune"
NAMES = ("run", "trainers", "export", "tune", "fit")


@dataclass
class Tally:
    """How often a fault was tried, and what became of it."""

    fault: str
    tried: int = 0
    survived: int = 0
    lost: Counter[str] = field(default_factory=Counter)

    @contextmanager
    def attempt(self) -> Iterator[None]:
        """One time; survived if nothing is raised inside."""
        self.tried += 1
        yield
        self.survived += 1


LEDGER: dict[str, Tally] = {}


@pytest.fixture
def tally() -> Callable[[str], Tally]:
    """The line of a fault in the table."""
    return lambda fault: LEDGER.setdefault(fault, Tally(fault))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """The table."""
    if not LEDGER:
        return
    terminalreporter.section("rough treatment")
    rows = ["fault | tried | survived | data lost", "--- | --- | --- | ---"]
    for own in LEDGER.values():
        lost = ", ".join(f"{count} {what}" for what, count in (+own.lost).items()) or "none"
        rows.append(f"{own.fault} | {own.tried} | {own.survived} | {lost}")
    for row in rows:
        terminalreporter.write_line(f"| {row} |")
    bad = [own.fault for own in LEDGER.values() if own.survived < own.tried]
    terminalreporter.write_line(f"not survived: {', '.join(bad)}" if bad else "all survived")


class Program(NamedTuple):
    """A command that may be killed and continued."""

    name: str
    command: list[str]
    log: str  # a file, or files, that grow while it works

    def start(self, out: Path, most: int | None = None) -> Popen:
        """In a process group of its own; no file may grow beyond ``most`` bytes."""
        words = [word.replace("OUT", str(out)).replace("DATA", data()) for word in self.command]
        words = [sys.executable, *words]
        limit = [] if most is None else ["prlimit", f"--fsize={most}:{most}"]
        # An entry that does not fit is left cut short, and JAX warns of it in every process after.
        absent = {"CAMVID_DIR"} if most is None else {"CAMVID_DIR", "JAX_COMPILATION_CACHE_DIR"}
        environment = {k: v for k, v in os.environ.items() if k not in absent}
        own = {"cwd": ROOT, "env": environment, "start_new_session": True, "text": True}
        return Popen([*limit, *words], stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE, **own)

    def finish(self, out: Path, most: int | None = None) -> tuple[int, str]:
        """Exit code and standard error."""
        process = self.start(out, most)
        error = process.communicate(timeout=900)[1]
        return process.returncode, error

    def kept(self, out: Path) -> set[str] | set[bytes]:
        """What is finished and must not be lost: whole lines of logs, records of streets."""
        if (out / "dataset.json").exists():  # of an export: all streets
            return {f"{street:06d}.json" for street in range(4)}
        paths = out.glob(self.log)
        if self.name == "export":
            return {path.name for path in paths}
        return {line for path in paths for line in path.read_bytes().split(b"\n")[:-1]}

    def answer(self, out: Path) -> Any:
        """All that must be the same however it came about."""
        if self.name == "export":
            return files_of(out)
        if self.name == "tune":
            return (out / "answer.json").read_bytes()
        summary = json.loads((out / "summary.json").read_text())
        if self.name == "fit":
            return summary["nets"], (out / "model" / "weights.safetensors").read_bytes()
        own = [(out / f).read_bytes() for f in ("attributes.json", "pictures/probabilities.npy")]
        return {name: summary[name] for name in SCORES}, own, files_of(out / "dataset")


@cache
def data() -> str:
    """A folder in CamVid's layout, which is there as long as the tests."""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    return str(write("camvid", Path(folder)))


SIMULATOR = [sys.executable, str(EXAMPLE / "simulator.py"), "{attributes.json}"]
PROGRAMS = {
    "run": Program("run", ["-m", "experiments.cityscapes", *TINY, "--out", "OUT"], "*.jsonl"),
    "trainers": Program(
        "trainers",
        ["-m", "experiments.cityscapes", *TINY, "--workers", "2", "--trainers", "1", "--out", "OUT"],
        "*.jsonl",
    ),
    "export": Program(
        "export",
        "-m scene.render --images 8 --size 96x64 --shots 2 --workers 2 --seed 3 --out OUT".split(),
        ".export/streets/*.json",
    ),
    "tune": Program(
        "tune",
        ["-m", "sdr_jax.tune", str(EXAMPLE / "space.toml"), "--out", "OUT", "--method", "gaussian",
         "--evaluations", "32", "--workers", "2", "--", *SIMULATOR],
        "*.jsonl",
    ),
    "fit": Program(
        "fit",
        "-m experiments fit DATA --target camvid --preset smoke --seeds 2 --size 64x48 --workers 2 "
        "--out OUT".split(),
        "*.jsonl",
    ),
}  # fmt: skip


class Whole(NamedTuple):
    """An undisturbed run of a program."""

    program: Program
    answer: Any
    seconds: float
    size: int  # bytes of its folder
    largest: int  # of its largest file


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Whole]:
    """The undisturbed run of a program by its name; done once."""

    @cache
    def made(name: str) -> Whole:
        program, out = PROGRAMS[name], tmp_path_factory.mktemp(name) / "whole"
        compile_first(WorkerPool(0), "embree")  # once per installation, and it says so
        started = time.monotonic()
        assert program.finish(out) == (0, "")
        seconds = time.monotonic() - started
        if name == "trainers":  # the same as where workers render and train
            assert program.answer(out) == made("run").answer
        sizes = [path.stat().st_size for path in out.rglob("*") if path.is_file()]
        return Whole(program, program.answer(out), seconds, sum(sizes), max(sizes))

    return made


def end(process: Popen) -> None:
    """Kill what is left of a program's group."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stderr.close()
