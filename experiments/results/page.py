"""The page of all results: every part's command, table and picture from its report."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.results.parts import Part
from scene.version import ENGINE
from shell import files
from shell.progress import duration

NAME = "results.md"


def write(
    parts: Sequence[Part], times: Mapping[str, float], origin: str, out: Path, docs: Path | None
) -> None:
    """Write the page into the folder of the runs and, with its pictures, into another.

    Args:
        parts: the parts in the order of the page.
        times: seconds of the finished parts by name.
        origin: commit of the program and the total time, as the end of a sentence.
        out: folder of all runs.
        docs: the other folder; its pictures and reports go into ``results/``.
    """
    files.write(out / NAME, text(parts, times, origin, out))
    if docs is None:
        return
    shown = docs / "results"
    shown.mkdir(parents=True, exist_ok=True)
    for part in parts:
        if part.name in times:
            for suffix in ("json", "png"):
                source = out / part.name / f"{part.study}.{suffix}"
                shutil.copyfile(source, shown / f"{part.name}.{suffix}")
    files.write(docs / NAME, text(parts, times, origin, out, "results"))


def text(
    parts: Sequence[Part],
    times: Mapping[str, float],
    origin: str,
    out: Path,
    shown: str | None = None,
) -> str:
    """The page, in Markdown; pictures from the runs' folders, or from another."""
    missing = [part.name for part in parts if part.name not in times]
    lines = [
        "# Results on real CamVid",
        "",
        f"Made by `make results` with engine {ENGINE}, at commit {origin}",
        *([f"Not made yet: {', '.join(missing)}."] if missing else []),
    ]
    for part in parts:
        if part.name in times:
            table = (out / part.name / f"{part.study}.md").read_text().strip()
            own = f"{part.name}/{part.study}.png"
            where = f"{shown}/{part.name}.png" if shown else own
            lines += [
                "", f"## {part.title}", part.asks, "",
                f"`{part.shown}`, {duration(times[part.name])}", "",
                table, "", f"![{part.title}]({where})",
            ]  # fmt: skip
    return "\n".join([*lines, ""])
