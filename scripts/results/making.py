"""The loop that makes the parts of the results, each once."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path

from common import folder
from common.errors import UserError
from common.files import read_json, write_json
from common.progress import duration
from common.workers.pool import WorkerPool
from experiments.config import cli
from experiments.config.jobs import STUDIES
from experiments.session.session import pace_here, set_up_process, total_of
from scene.version import ENGINE
from scripts.results import page
from scripts.results.claims import MEASURED
from scripts.results.parts import Part

PARTS = "parts.json"
"""File with the names of the finished parts."""
STORE = "store.jsonl"
"""File of all evaluations."""

Runner = Callable[[Sequence[str]], int]
"""Runs a command and returns the exit code."""


def run_part(command: Sequence[str]) -> int:
    """Run a part's command; a request to end (SIGTERM) ends it, too."""
    with subprocess.Popen([sys.executable, *command[1:]]) as process:
        before = signal.signal(signal.SIGTERM, lambda *_: process.terminate())
        try:
            return process.wait()
        finally:
            signal.signal(signal.SIGTERM, before)


def commit(checkout: Path = Path(__file__).parent) -> str:
    """Name the last commit that changed the program, and the changes since then by their SHA-256.

    Pages, which may change while results are made, are not part of the program.

    Args:
        checkout: a folder of the checkout.

    Raises:
        UserError: there is no checkout, so the origin of results would be unknown.
    """

    def git(*words: str) -> bytes:
        program = (":/", ":(top,exclude)docs", ":(top,exclude)*.md", ":(top,exclude)mkdocs.yml")
        command = ["git", "-C", str(checkout), *words, "--", *program]
        return subprocess.run(command, check=True, capture_output=True).stdout.strip()

    try:
        name = git("log", "-1", "--format=%h").decode()
        changes = git("diff", "--no-ext-diff", "--full-index", "HEAD")
        return f"{name}, changed {sha256(changes).hexdigest()[:8]}" if changes else name
    except (OSError, subprocess.CalledProcessError):
        raise UserError("results need a git checkout, since they name their commit") from None


def core_seconds(part: Part) -> float:
    """Estimate the core seconds of a part from scratch, as its own plan does."""
    values = vars(cli.parser(part.study).parse_args(list(part.flags)))
    values.pop("debug")
    config = cli.configured(part.study, values)
    study = cli.load(STUDIES[part.study].work)
    prepared = study.prepare(config, study.target(config, WorkerPool(0)))
    pace = pace_here(1, print, measure=False)
    return pace.seconds(total_of(study.plan(config, prepared)))


def plan_text(parts: Sequence[Part], cost: Callable[[Part], float] = core_seconds) -> str:
    """Write the core time of every part, and of all."""
    set_up_process()
    seconds = {part.name: cost(part) for part in parts}
    lines = [f"  {duration(value):>8}  {name}" for name, value in seconds.items()]
    return "\n".join(
        [
            "Plan, in time of one core:",
            *lines,
            f"At most {duration(sum(seconds.values()))} of a core for {len(parts)} part(s): networks that "
            "parts share or that the store has take no time.",
        ]
    )


def make(
    parts: Sequence[Part],
    out: Path,
    docs: Path | None = None,
    store: Path | None = None,
    only: Sequence[str] = (),
    run: Runner = run_part,
    cost: Callable[[Part], float] = core_seconds,
) -> list[str]:
    """Make the missing parts one after the other; record each of them, and write the page.

    Args:
        parts: every part in order.
        out: folder of all runs.
        docs: folder of the pages, for reports and plots; if it has all other reports, too, the page of
            results is written after each part.
        store: store of evaluations, none of which is repeated; by default in the folder of the
            reports, which are committed with it, so that any checkout resumes; without pages, in ``out``.
        only: names of the parts to make; by default all of them.
        run: runs a part's command.
        cost: estimates the core seconds of a part.

    Returns:
        The names of the finished parts.

    Raises:
        UserError: a part failed, or the folder is from another commit.
    """
    commit_name = commit()
    store = store or (out if docs is None else docs / "results") / STORE
    selected = [part for part in parts if not only or part.name in only]
    with ExitStack() as stack:
        stack.enter_context(folder.opened(out, {"commit": commit_name, "engine": ENGINE}))
        done: list[str] = read_json(out / PARTS) if (out / PARTS).exists() else []
        missing = [part for part in selected if part.name not in done]
        print(plan_text(missing, cost), flush=True)
        for number, part in enumerate(selected, 1):
            if part in missing:
                print(f"\n== {number} of {len(selected)}: {part.name} ==", flush=True)
                files = ("--out", str(out / part.name), "--store", str(store))
                if (code := run([*part.command, *files])) != 0:
                    raise UserError(
                        f"{part.name} ended with exit code {code}; once this is fixed, the same "
                        "command resumes"
                    )
                done.append(part.name)
                write_json(out / PARTS, done)
            if docs is not None:
                page.record(part, out / part.name, commit_name, docs)
                if (docs / "results" / MEASURED).exists():
                    page.write(docs)
    print(f"\nAll {len(selected)} parts are done: {out}", flush=True)
    return done
