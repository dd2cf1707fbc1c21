"""The loop that makes the parts of the results, each once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from common import folder
from common.errors import UserError
from common.files import read_json, write_json
from scene.version import ENGINE
from scripts.results import page
from scripts.results.parts import Part

PARTS = "parts.json"
"""File with the names of the finished parts."""

Runner = Callable[[Sequence[str]], int]
"""Runs a command and returns the exit code."""


def _run(command: Sequence[str]) -> int:
    return subprocess.call([sys.executable, *command[1:]])


def commit(checkout: Path = Path(__file__).parent) -> str:
    """The commit of the program, with a word if more than its pages was changed since.

    Args:
        checkout: a folder of the checkout.

    Raises:
        UserError: there is no checkout, so the origin of figures would be unknown.
    """

    def git(*words: str) -> str:
        where = ["git", "-C", str(checkout), *words]
        return subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip()

    try:
        code = (":/", ":(top,exclude)docs")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", *code)
        return git("rev-parse", "--short", "HEAD") + (", changed" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        raise UserError("results are made in a git checkout: they name their commit") from None


def make(
    parts: Sequence[Part],
    out: Path,
    docs: Path | None = None,
    store: Path | None = None,
    only: Sequence[str] = (),
    run: Runner = _run,
) -> list[str]:
    """Make the missing parts one after the other; write the page after each.

    Args:
        parts: every part, in the order of the page, which says what is not made yet.
        out: folder of all runs.
        docs: second folder for the page with its pictures.
        store: store of evaluations instead of the folder's own; known evaluations are not made again.
        only: names of the parts to make; by default all of them.
        run: runs a part's command.

    Returns:
        The names of the finished parts.

    Raises:
        UserError: a part failed, or the folder is from another commit.
    """
    at = commit()
    store = store or out / "store.jsonl"
    wanted = [part for part in parts if not only or part.name in only]
    with ExitStack() as stack:
        stack.enter_context(folder.opened(out, {"commit": at, "engine": ENGINE}))
        done: list[str] = read_json(out / PARTS) if (out / PARTS).exists() else []
        for number, part in enumerate(wanted, 1):
            if part.name not in done:
                print(f"\n== {number} of {len(wanted)}: {part.name} ==", flush=True)
                own = ("--out", str(out / part.name), "--store", str(store))
                if (code := run([*part.command, *own])) != 0:
                    raise UserError(
                        f"{part.name} ended with exit code {code}; once that is put right, the same "
                        "command goes on"
                    )
                done.append(part.name)
                write_json(out / PARTS, done)
            page.write(parts, done, at, out, docs)
    print(f"\nAll {len(wanted)} parts are done: {out / page.NAME}", flush=True)
    return done
