"""The loop that makes the parts of the results, each once."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from experiments.evaluation.store import read, result_of
from experiments.results import page
from experiments.results.parts import Part
from scene.version import ENGINE
from shell import folder
from shell.errors import UserError
from shell.files import read_json, write_json
from shell.progress import duration

PARTS = "parts.json"
"""File with each part's seconds of all attempts, and whether it is done."""
TICK = 10.0
"""Seconds between two records of a command's time; a kill loses no more."""

Runner = Callable[[Sequence[str], Callable[[], None]], int]
"""Runs a command, calls the second argument regularly, and returns the exit code."""


def _run(command: Sequence[str], note: Callable[[], None]) -> int:
    with subprocess.Popen([sys.executable, *command[1:]]) as process:
        while True:
            with suppress(subprocess.TimeoutExpired):
                return process.wait(TICK)
            note()


def commit() -> str:
    """The commit of the program, with a word if it was changed since.

    Raises:
        UserError: there is no checkout, so the origin of figures would be unknown.
    """

    def git(*words: str) -> str:
        where = ["git", "-C", str(Path(__file__).parent), *words]
        return subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short", "HEAD") + (", changed" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        raise UserError("results are made in a git checkout: they name their commit") from None


def _work(store: Path) -> str:
    """The core time of the nets in a store, from all runs."""
    if not store.exists():
        return ""
    nets = [result_of(record) for record, _ in read(store).values()]
    seconds = sum(net.seconds for net in nets)
    return f", from {len(nets)} nets that took a core {duration(seconds)}, images included"


def make(
    wanted: Sequence[Part],
    out: Path,
    docs: Path | None = None,
    store: Path | None = None,
    run: Runner = _run,
) -> list[str]:
    """Make the missing parts one after the other; write the page after each.

    Args:
        wanted: the parts in order.
        out: folder of all runs.
        docs: second folder for the page with its pictures.
        store: store of evaluations instead of the folder's own; known evaluations are not made again.
        run: runs a part's command.

    Returns:
        The names of the finished parts.

    Raises:
        UserError: a part failed, or the folder is from another commit.
    """
    at = commit()
    shared = " What the shared store held took this run no time." if store else ""
    store = store or out / "store.jsonl"
    done: list[str] = []
    with ExitStack() as stack:
        stack.enter_context(folder.opened(out, {"commit": at, "engine": ENGINE}))
        known = read_json(out / PARTS) if (out / PARTS).exists() else {}

        def attempt(part: Part) -> int:
            """Run its command, and record its time in the file meanwhile."""
            started = time.perf_counter()
            before = known.get(part.name, {"seconds": 0.0})["seconds"]

            def note(done: bool = False) -> None:
                seconds = before + time.perf_counter() - started
                known[part.name] = {"seconds": seconds, "done": done}
                write_json(out / PARTS, known)

            code = run([*part.command, "--out", str(out / part.name), "--store", str(store)], note)
            note(code == 0)
            return code

        for number, part in enumerate(wanted, 1):
            if not known.get(part.name, {}).get("done"):
                print(f"\n== {number} of {len(wanted)}: {part.name} ==", flush=True)
                if (code := attempt(part)) != 0:
                    raise UserError(
                        f"{part.name} ended with exit code {code}; once that is put right, the same "
                        "command goes on"
                    )
            done.append(part.name)
            times = {name: own["seconds"] for name, own in known.items() if own["done"]}
            page.write(wanted, times, f"{at}{_work(store)}.{shared}", out, docs)
    took = duration(sum(known[name]["seconds"] for name in done))
    print(f"\nAll {len(done)} parts are done, in {took}: {out / page.NAME}", flush=True)
    return done
