"""The page of all results: every part's command, table and picture, from its own report."""

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
    """Write the page into the folder of the runs and, with what it shows, into another.

    Args:
        parts: in the order of the page.
        times: seconds that the finished ones took, by name.
        origin: commit of the program, and what all of it took; ends a sentence.
        out: folder of all runs.
        docs: where else; pictures and reports go into ``results/`` there.
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
