"""The recorded results: reports and plots of all parts, with their commands and commits."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from common.files import read_json, write_json
from experiments.evaluation.store import LOGS, read, result_of
from scene.version import ENGINE
from scripts.results.parts import Part

RECORDS = "parts.json"
"""File in the folder of reports: what made each of them."""


def record(part: Part, run: Path, commit: str, docs: Path) -> None:
    """Copy the report and plot of a finished part to the pages, and note what made them.

    Args:
        part: the part.
        run: its folder.
        commit: commit of the program.
        docs: folder of the pages; reports and plots go into ``results/``.
    """
    folder = docs / "results"
    folder.mkdir(parents=True, exist_ok=True)
    for suffix in ("json", "png"):
        shutil.copyfile(run / f"{part.study}.{suffix}", folder / f"{part.name}.{suffix}")
    file = folder / RECORDS
    records: dict[str, Any] = read_json(file) if file.exists() else {}
    evaluations = read(run) if any((run / log).exists() for log in LOGS) else {}
    records[part.name] = {
        "command": part.shown,
        "commit": commit,
        "engine": ENGINE,
        "evaluations": len(evaluations),
        "core_seconds": round(sum(result_of(line).seconds for line, _ in evaluations.values())),
    }
    write_json(file, records)
