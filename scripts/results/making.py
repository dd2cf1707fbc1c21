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
    """Name the commit of the program, and whether anything but its pages has changed since.

    Args:
        checkout: a folder of the checkout.

    Raises:
        UserError: there is no checkout, so the origin of results would be unknown.
    """

    def git(*words: str) -> str:
        command = ["git", "-C", str(checkout), *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    try:
        code = (":/", ":(top,exclude)docs")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", *code)
        return git("rev-parse", "--short", "HEAD") + (", changed" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        raise UserError("results need a git checkout, since they name their commit") from None


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
        parts: every part, in the order of the page, which lists missing parts.
        out: folder of all runs.
        docs: second folder for the page with its plots.
        store: store of evaluations instead of the folder's own; none of them is repeated.
        only: names of the parts to make; by default all of them.
        run: runs a part's command.

    Returns:
        The names of the finished parts.

    Raises:
        UserError: a part failed, or the folder is from another commit.
    """
    commit_name = commit()
    store = store or out / "store.jsonl"
    selected = [part for part in parts if not only or part.name in only]
    with ExitStack() as stack:
        stack.enter_context(folder.opened(out, {"commit": commit_name, "engine": ENGINE}))
        done: list[str] = read_json(out / PARTS) if (out / PARTS).exists() else []
        for number, part in enumerate(selected, 1):
            if part.name not in done:
                print(f"\n== {number} of {len(selected)}: {part.name} ==", flush=True)
                files = ("--out", str(out / part.name), "--store", str(store))
                if (code := run([*part.command, *files])) != 0:
                    raise UserError(
                        f"{part.name} ended with exit code {code}; once this is fixed, the same "
                        "command resumes"
                    )
                done.append(part.name)
                write_json(out / PARTS, done)
            page.write(parts, done, commit_name, out, docs)
    print(f"\nAll {len(selected)} parts are done: {out / page.NAME}", flush=True)
    return done
