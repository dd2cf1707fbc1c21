"""Rough treatment: three programs, what must be equal after it, and one table of what was survived.

``ROBUST_TIMES`` says how often each fault is tried; `make robust` says 20.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import ROOT
from tests.experiments.conftest import TINY, camvid, command, scored_by  # noqa: F401
from tests.experiments.test_main_job import SCORES, files_of

TIMES = int(os.environ.get("ROBUST_TIMES", "2"))
EXAMPLE = ROOT / "examples" / "tune"
NAMES = ("run", "export", "tune")


@dataclass
class Tally:
    """How often a fault was tried, and what became of it."""

    fault: str
    tried: int = 0
    survived: int = 0
    lost: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def attempt(self) -> Iterator[None]:
        """One time; survived if nothing is raised inside."""
        self.tried += 1
        yield
        self.survived += 1

    def lose(self, what: str, count: int) -> None:
        """Note what a fault has cost."""
        if count:
            self.lost[what] = self.lost.get(what, 0) + count


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
    rows = [("fault", "tried", "survived", "data lost")]
    for own in LEDGER.values():
        lost = ", ".join(f"{count} {what}" for what, count in own.lost.items()) or "none"
        rows.append((own.fault, str(own.tried), str(own.survived), lost))
    for row in (rows[0], ("---",) * 4, *rows[1:]):
        terminalreporter.write_line(f"| {' | '.join(row)} |")
    bad = [own.fault for own in LEDGER.values() if own.survived < own.tried]
    terminalreporter.write_line(f"not survived: {', '.join(bad)}" if bad else "all survived")


@dataclass
class Program:
    """A command that may be killed and continued."""

    name: str
    command: list[str]
    log: str  # a file, or files, that grow while it works

    def start(self, out: Path, *flags: str, most: int | None = None) -> subprocess.Popen:
        """In a process group of its own; no file may grow beyond ``most`` bytes."""
        words = [sys.executable, *(word.replace("OUT", str(out)) for word in self.command)]
        split = words.index("--") if "--" in words else len(words)
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        limit = [] if most is None else ["prlimit", f"--fsize={most}:{most}"]
        whole = [*limit, *words[:split], *flags, *words[split:]]
        environment = {k: v for k, v in os.environ.items() if k != "CAMVID_DIR"}
        return subprocess.Popen(
            whole,
            cwd=ROOT,
            env=environment,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            **pipes,
        )

    def finish(self, out: Path, *flags: str, most: int | None = None) -> tuple[int, str]:
        """Exit code and standard error."""
        process = self.start(out, *flags, most=most)
        error = process.communicate(timeout=900)[1]
        return process.returncode, error

    def kept(self, out: Path) -> set[bytes]:
        """What is finished and must not be lost: whole lines of logs, records of streets."""
        if (out / "dataset.json").exists():  # of an export: all streets
            return {f"{street:06d}.json".encode() for street in range(4)}
        found: set[bytes] = set()
        for path in out.glob(self.log):
            data = path.read_bytes()
            found |= (
                set(data.split(b"\n")[:-1]) if path.suffix == ".jsonl" else {path.name.encode()}
            )
        return found

    def answer(self, out: Path) -> Any:
        """All that must be the same however it came about."""
        if self.name == "run":
            summary = json.loads((out / "summary.json").read_text())
            probabilities = np.load(out / "pictures" / "probabilities.npy").tobytes()
            own = {name: summary[name] for name in SCORES}
            return (
                own,
                (out / "attributes.json").read_bytes(),
                probabilities,
                files_of(out / "dataset"),
            )
        return files_of(out) if self.name == "export" else (out / "answer.json").read_bytes()


SIMULATOR = [sys.executable, str(EXAMPLE / "simulator.py"), "{attributes.json}"]
PROGRAMS = {
    "run": Program("run", ["-m", "experiments.cityscapes", *TINY, "--out", "OUT"], "*.jsonl"),
    "export": Program(
        "export",
        "-m scene.render --images 8 --size 96x64 --shots 2 --workers 2 --seed 3 --out OUT".split(),
        ".export/streets/*.json",
    ),
    "tune": Program(
        "tune",
        ["-m", "sdr_jax.tune", str(EXAMPLE / "space.toml"), "--out", "OUT", "--method", "pbil",
         "--evaluations", "32", "--workers", "2", "--", *SIMULATOR],
        "*.jsonl",
    ),
}  # fmt: skip


@dataclass
class Whole:
    """An undisturbed run of a program."""

    program: Program
    answer: Any
    seconds: float
    size: int  # bytes of its folder
    largest: int  # of its largest file


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Whole]:
    """The undisturbed run of a program by its name; done once."""
    known: dict[str, Whole] = {}

    def made(name: str) -> Whole:
        if name not in known:
            program, out = PROGRAMS[name], tmp_path_factory.mktemp(name) / "whole"
            started = time.monotonic()
            assert program.finish(out) == (0, "")
            seconds = time.monotonic() - started
            sizes = [path.stat().st_size for path in out.rglob("*") if path.is_file()]
            answer = program.answer(out)
            known[name] = Whole(program, answer, seconds, sum(sizes), max(sizes))
        return known[name]

    return made


def end(process: subprocess.Popen) -> None:
    """Kill what is left of a program's group."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
    if process.stderr is not None:
        process.stderr.close()
