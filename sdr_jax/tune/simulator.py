"""Run the simulator as a program in its own folder, with a time limit and retries, and read its score."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.errors import UserError
from common.progress import duration
from sdr_jax.ask_tell import Trial
from sdr_jax.rewards import LARGEST
from sdr_jax.tune.units import Attribute, describe

PLACEHOLDER = "{attributes.json}"
WANTED = 'a number or a JSON object with "score"'
TAIL = 65536
"""Bytes at the end of an output in which its last line is looked for."""
SILENCE = 60.0
"""Seconds without output after which a message says so."""
SUPERVISOR = """
import os, signal, sys
for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
running = set()
for line in sys.stdin:
    running ^= {int(line)}
for group in running:
    try: os.killpg(group, signal.SIGKILL)
    except OSError: pass
"""
"""The program of the supervisor, which outlives this process to end simulators that a kill leaves running.

It reads the number of each process group when the group starts, and again when it has ended. When this
process ends, for any reason, the pipe closes, and the supervisor kills the groups that are left.
"""


class Outcome(NamedTuple):
    """The outcome of one evaluation."""

    score: float | None  # mean over the repeats, in the simulator's units; None if a repeat failed
    scores: list[float]  # of every repeat
    failures: list[str]  # reasons of failed attempts, in order
    seconds: float  # of the evaluation


class Stopped(Exception):
    """The run is ending; unfinished evaluations do not count."""


class _Failed(Exception):
    """One attempt without a score."""


def check_command(command: Sequence[str]) -> None:
    """Refuse a command that cannot work.

    Raises:
        UserError: no command, no placeholder in it, or a program that does not exist.
    """
    if not command:
        raise UserError(f"add the simulator at the end: -- ./my_simulator {PLACEHOLDER}")
    if not any(PLACEHOLDER in argument for argument in command):
        raise UserError(
            f"no argument of the simulator contains {PLACEHOLDER}, which stands for the path of its "
            f"input: -- {' '.join(command)} {PLACEHOLDER}"
        )
    program = command[0]
    if shutil.which(program) is None:
        if os.path.isfile(program):
            raise UserError(f"the simulator {program} is not executable; try chmod +x {program}")
        raise UserError(
            f"the simulator {program} does not exist; check its path, or add it to PATH"
        )


@dataclass
class Simulator:
    """Runs the program, in any number of threads at once."""

    command: Sequence[str]  # the program and its arguments
    attributes: Sequence[Attribute]  # in the order of the space
    folder: Path  # the parent of every evaluation's folder
    timeout: float  # of one run, in seconds
    retries: int  # further attempts at a failed run, each with another seed
    repeats: int  # runs per evaluation
    say: Callable[[str], None] = print  # prints a message, from any thread
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _running: set[subprocess.Popen] = field(default_factory=set)
    _stopped: bool = False

    def __post_init__(self) -> None:
        self._supervisor: subprocess.Popen | None = None
        if hasattr(os, "killpg"):  # Windows has no process groups
            self._supervisor = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", SUPERVISOR],
                stdin=subprocess.PIPE, bufsize=0, start_new_session=True,
            )  # fmt: skip

    def evaluate(self, trial: Trial) -> Outcome:
        """Evaluate one trial; its seeds depend on the trial's seed alone.

        Raises:
            Stopped: `stop` was called.
            OSError: the folder cannot be written.
        """
        started = time.monotonic()
        trial_folder = self.folder / f"{trial.id:06d}"
        if trial_folder.exists():  # a killed session left it unfinished, or it is repeated
            shutil.rmtree(trial_folder)
        scores: list[float] = []
        failures: list[str] = []
        for repeat in range(self.repeats):
            for attempt in range(self.retries + 1):
                folder = trial_folder / f"run-{repeat}-{attempt}"
                seeds = np.random.SeedSequence([trial.seed, repeat, attempt])
                try:
                    scores.append(self._run(trial, folder, int(seeds.generate_state(1)[0])))
                    break
                except _Failed as failure:
                    failures.append(str(failure))
            else:
                break  # one failed repeat fails the evaluation
        score = math.fsum(scores) / self.repeats if len(scores) == self.repeats else None
        return Outcome(score, scores, failures, time.monotonic() - started)

    def stop(self) -> None:
        """Kill all running simulators and prevent new ones."""
        with self._lock:
            self._stopped = True
            running = list(self._running)
        for process in running:
            _kill(process)
        if self._supervisor is not None:
            self._supervisor.communicate()  # closes its pipe, and waits

    def _run(self, trial: Trial, folder: Path, seed: int) -> float:
        folder.mkdir(parents=True)
        path = folder.resolve() / "attributes.json"
        attributes = describe(self.attributes, trial.proposal)
        content = {"evaluation": trial.id, "seed": seed, "attributes": attributes}
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        command = [argument.replace(PLACEHOLDER, str(path)) for argument in self.command]
        out, err = folder / "stdout.txt", folder / "stderr.txt"
        with open(out, "wb") as stdout, open(err, "wb") as stderr:
            process = self._start(command, stdout=stdout, stderr=stderr)
            try:
                code = self._wait(process, trial.id, (stdout.fileno(), stderr.fileno()))
            finally:
                _kill(process)  # with its background processes
                with self._lock:
                    self._running.discard(process)
                    if self._stopped:
                        raise Stopped
                    self._note(process)
        if code != 0:
            message = _last_line(err)
            raise _Failed(_exit_reason(code) + (f": {message}" if message else ""))
        return parse_score(_last_line(out))

    def _start(self, command: list[str], **streams: Any) -> subprocess.Popen:
        with self._lock:
            if self._stopped:
                raise Stopped
            try:
                # In a process group of its own, its children end with it, and Ctrl-C reaches only us.
                process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, start_new_session=True, **streams
                )
            except OSError as error:
                raise _Failed(f"cannot start: {error.strerror or error}") from None
            self._running.add(process)
            self._note(process)
            return process

    def _note(self, process: subprocess.Popen) -> None:
        """Tell the supervisor that a simulator has started, or has ended."""
        if self._supervisor is not None and self._supervisor.stdin is not None:
            with suppress(BrokenPipeError):  # the search continues if the supervisor was killed
                self._supervisor.stdin.write(f"{process.pid}\n".encode())

    def _wait(self, process: subprocess.Popen, id: int, outputs: Sequence[int]) -> int:
        """Wait for the exit code; report when the outputs (file descriptors) stop growing."""
        started, size = time.monotonic(), 0
        while (left := started + self.timeout - time.monotonic()) > 0:
            with suppress(subprocess.TimeoutExpired):
                return process.wait(min(left, SILENCE))
            before, size = size, sum(os.fstat(output).st_size for output in outputs)
            ran = time.monotonic() - started
            if size == before and ran < self.timeout:
                self.say(
                    f"evaluation {id} has run for {duration(ran)} and printed nothing in the last "
                    f"{duration(SILENCE)}"
                )
        raise _Failed(f"no score after {self.timeout:g} s")


def parse_score(line: str) -> float:
    """Read the score in a simulator's last line: a number, or a JSON object with `score`.

    Args:
        line: the last non-empty line of its output; '' if there is none.

    Returns:
        The score, finite and within the range of rewards.
    """
    if not line:
        raise _Failed(f"printed nothing; the last line must be {WANTED}")
    shown = repr(line if len(line) <= 60 else line[:57] + "...")
    score: Any
    try:
        score = float(line)
    except ValueError:
        try:
            parsed = json.loads(line)
        except (ValueError, RecursionError):
            parsed = None
        score = parsed.get("score") if isinstance(parsed, dict) else None
        if isinstance(score, bool) or not isinstance(score, int | float):
            raise _Failed(f"the last line printed is {shown}, but must be {WANTED}") from None
    if not abs(score) <= LARGEST:  # NaN included
        raise _Failed(
            f"the last line printed is {shown}, but a score must be finite, within +-{LARGEST:g}"
        )
    return float(score)


def _last_line(path: Path) -> str:
    with open(path, "rb") as file:
        file.seek(max(path.stat().st_size - TAIL, 0))
        lines = file.read().decode(errors="replace").splitlines()
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def _exit_reason(code: int) -> str:
    if code > 0:
        return f"exit code {code}"
    with suppress(ValueError):
        return f"killed by {signal.Signals(-code).name}"
    return f"killed by signal {-code}"


def _kill(process: subprocess.Popen) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except AttributeError:  # not on Windows
        process.kill()
    except (ProcessLookupError, PermissionError):  # it has just ended
        pass
    process.wait()
