"""The page of all results: every part's command, table and picture from its report."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from common import files
from common.progress import duration
from experiments.evaluation.store import LOGS, read, result_of
from experiments.tables.form import ONE_SEARCH, Column, Report, estimate, table
from experiments.tables.row_names import SHORT
from experiments.tables.stats import bounded, estimated
from scene.version import ENGINE
from scripts.results.parts import GROUPS, Part

NAME = "results.md"
OTHERS = ("random", "default", "few", "real")
"""Rows of a report of searches that are no search."""


def write(
    parts: Sequence[Part], done: Collection[str], commit: str, out: Path, docs: Path | None
) -> None:
    """Write the page into the folder of the runs and, with its pictures, into another.

    Args:
        parts: the parts in the order of the page.
        done: names of the finished ones.
        commit: commit of the program.
        out: folder of all runs.
        docs: the other folder; its pictures and reports go into ``results/``.
    """
    files.write(out / NAME, text(parts, done, commit, out))
    if docs is None:
        return
    shown = docs / "results"
    shown.mkdir(parents=True, exist_ok=True)
    for part in parts:
        if part.name in done:
            for suffix in ("json",) if GROUPS[part.group].summed else ("json", "png"):
                source = out / part.name / f"{part.study}.{suffix}"
                shutil.copyfile(source, shown / f"{part.name}.{suffix}")
    files.write(docs / NAME, text(parts, done, commit, out, "results"))


def text(
    parts: Sequence[Part],
    done: Collection[str],
    commit: str,
    out: Path,
    shown: str | None = None,
) -> str:
    """The page, in Markdown; pictures from the runs' folders, or from another."""
    made = [part for part in parts if part.name in done]
    missing = [part.name for part in parts if part.name not in done]
    lines = [
        "# All results",
        "",
        f"Made by `make results` with engine {ENGINE}, at commit {commit}{_work(made, out)}.",
        *([f"Not made yet: {', '.join(missing)}."] if missing else []),
    ]
    for name, group in GROUPS.items():
        own = [part for part in made if part.group == name]
        if not own:
            continue
        lines += ["", f"## {group.title}", group.asks]
        if group.summed:
            lines += ["", *_summary(own, out, group.averaged), ONE_SEARCH, ""]
        for part in own:
            said = f"`{part.shown}`{_work([part], out)}"
            if group.summed:
                lines.append(f"- {part.name}: {said}")
                continue
            own_table = (out / part.name / f"{part.study}.md").read_text(encoding="utf-8").strip()
            picture = f"{shown}/{part.name}.png" if shown else f"{part.name}/{part.study}.png"
            lines += ["", said, "", own_table, "", f"![{part.name}]({picture})"]
    return "\n".join([*lines, ""])


def _work(parts: Sequence[Part], out: Path) -> str:
    """The core time of some parts' evaluations; what parts share counts once."""
    known = {}
    for part in parts:
        if any((out / part.name / log).exists() for log in LOGS):
            known.update(read(out / part.name))
    seconds = sum(result_of(record).seconds for record, _ in known.values())
    return f": {len(known)} evaluations that took a core {duration(seconds)}" if known else ""


def _summary(parts: Sequence[Part], out: Path, averaged: bool) -> list[str]:
    """A table with a row for each part's search, and the means of all of one kind."""
    rows = [_row(part, out) for part in parts]
    means = list(_means(rows)) if averaged else []
    return [*table(COLUMNS, [*rows, *means]), ""]


def _row(part: Part, out: Path) -> Report:
    """The rows of a report of searches, side by side."""
    report = files.read_json(out / part.name / f"{part.study}.json")
    found = {row["name"]: row for row in report["rows"]}
    (learnt,) = (row for name, row in found.items() if name not in OTHERS)
    return {
        "name": part.name,
        **{name: found[name] for name in OTHERS if name in found},
        "learnt": learnt,
        "over_random": learnt["gain_over_random"],
        "over_default": learnt["gain_over_default"],
    }


def _means(rows: Sequence[Report]) -> Iterator[Report]:
    """The means over parts whose names differ in the number at their end, with intervals over these."""
    kinds: dict[str, list[Report]] = {}
    for row in rows:
        kinds.setdefault(row["name"].rpartition("-")[0], []).append(row)
    for kind, own in kinds.items():
        if len(own) == 1:
            continue
        names = [name for name in own[0] if name != "name"]
        yield {
            "name": f"mean of {len(own)} {kind}",
            **{
                name: found if name.startswith("over") else bounded(found)
                for name in names
                for found in [estimated([row[name]["mean"] for row in own])]
            },
        }


def _mean(head: str, name: str) -> Column:
    return estimate(head, lambda row: row.get(name))[0]


COLUMNS: list[Column] = [
    ("target", lambda row: row["name"]),
    *(_mean(SHORT[name], name) for name in ("few", "random", "default", "learnt", "real")),
    *estimate("gain over random", lambda row: row["over_random"], "+.1f"),
    *estimate("gain over default", lambda row: row["over_default"], "+.1f"),
]
"""mIoU in percent; intervals of a part are over its networks, those of means over its parts."""
