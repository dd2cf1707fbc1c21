"""The loop that makes the results: part after part, each once."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from experiments.results import page
from experiments.results.parts import Part
from experiments.reward.store import outcome_of, read
from scene.version import ENGINE
from shell import folder
from shell.errors import UserError
from shell.files import read_json, write_json
from shell.progress import duration

TIMES, SPENT = "times.json", "spent.json"
"""Seconds of the parts that are done, and of all attempts at any part."""

Runner = Callable[[Sequence[str]], int]
"""Runs a command; returns its exit code."""


def _run(command: Sequence[str]) -> int:
    return subprocess.run([sys.executable, *command[1:]], check=False).returncode


def commit() -> str:
    """The commit of the program, with a word where it was changed since.

    Raises:
        UserError: there is no checkout, so nothing could be said of where figures are from.
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
    """What the nets of a store took, whichever runs they are from."""
    if not store.exists():
        return ""
    nets = [outcome_of(record) for record, _ in read(store).values()]
    seconds = sum(net.seconds for net in nets)
    return f", from {len(nets)} nets that took a core {duration(seconds)}, images included"


def make(
    wanted: Sequence[Part],
    out: Path,
    docs: Path | None = None,
    store: Path | None = None,
    run: Runner = _run,
) -> list[str]:
    """Do parts that are not done, one after the other; write the page after each.

    Args:
        wanted: in this order.
        out: folder of all runs.
        docs: where else the page goes, with its pictures.
        store: of evaluations, in place of the folder's own; what it knows is not scored again.
        run: does one of their commands.

    Returns:
        The names of the parts that are done.

    Raises:
        UserError: a part failed, or the folder was begun at another commit.
    """
    at, store = commit(), store or out / "store.jsonl"
    done: list[str] = []
    with ExitStack() as stack:
        stack.enter_context(folder.opened(out, {"commit": at, "engine": ENGINE}))
        times, spent = (
            read_json(out / name) if (out / name).exists() else {} for name in (TIMES, SPENT)
        )
        for number, part in enumerate(wanted, 1):
            if part.name not in times:
                print(f"\n== {number} of {len(wanted)}: {part.title} ==", flush=True)
                started = time.perf_counter()
                where = ("--out", str(out / part.name), "--store", str(store))
                try:
                    code = run([*part.command, *where])
                finally:
                    spent[part.name] = spent.get(part.name, 0) + time.perf_counter() - started
                    write_json(out / SPENT, spent)
                if code != 0:
                    raise UserError(
                        f"{part.name} ended with exit code {code}; once that is put right, the same "
                        "command goes on"
                    )
                times[part.name] = round(spent[part.name])
                write_json(out / TIMES, times)
            done.append(part.name)
            page.write(wanted, times, f"{at}{_work(store)}", out, docs)
    took = duration(sum(times[name] for name in done))
    print(f"\nAll {len(done)} parts are done, in {took}: {out / page.NAME}", flush=True)
    return done
