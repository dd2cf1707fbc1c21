"""The page of all results: command, table and plot of every part, from its report."""

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
"""Rows of a report of searches that are not searches."""


def write(
    parts: Sequence[Part], done: Collection[str], commit: str, out: Path, docs: Path | None
) -> None:
    """Write the page into the folder of the runs and, with its plots, into another.

    Args:
        parts: the parts in the order of the page.
        done: names of the finished ones.
        commit: commit of the program.
        out: folder of all runs.
        docs: the other folder; plots and reports go into ``results/``.
    """
    files.write(out / NAME, text(parts, done, commit, out))
    if docs is None:
        return
    folder = docs / "results"
    folder.mkdir(parents=True, exist_ok=True)
    for part in parts:
        if part.name in done:
            for suffix in ("json",) if GROUPS[part.group].summed else ("json", "png"):
                source = out / part.name / f"{part.study}.{suffix}"
                shutil.copyfile(source, folder / f"{part.name}.{suffix}")
    files.write(docs / NAME, text(parts, done, commit, out, "results"))


def text(
    parts: Sequence[Part],
    done: Collection[str],
    commit: str,
    out: Path,
    plots: str | None = None,
) -> str:
    """Write the page in Markdown; plots are from the folders of the runs, or from another."""
    finished = [part for part in parts if part.name in done]
    missing = [part.name for part in parts if part.name not in done]
    lines = [
        "# All results",
        "",
        f"Made by `make results` with engine {ENGINE}, at commit {commit}{_work(finished, out)}.",
        *([f"Not made yet: {', '.join(missing)}."] if missing else []),
    ]
    for name, group in GROUPS.items():
        members = [part for part in finished if part.group == name]
        if not members:
            continue
        lines += ["", f"## {group.title}", group.asks]
        if group.summed:
            lines += ["", *_summary(members, out, group.averaged), ONE_SEARCH, ""]
        for part in members:
            command = f"`{part.shown}`{_work([part], out)}"
            if group.summed:
                lines.append(f"- {part.name}: {command}")
                continue
            tables = (out / part.name / f"{part.study}.md").read_text(encoding="utf-8").strip()
            plot = f"{plots}/{part.name}.png" if plots else f"{part.name}/{part.study}.png"
            lines += ["", command, "", tables, "", f"![{part.name}]({plot})"]
    return "\n".join([*lines, ""])


def _work(parts: Sequence[Part], out: Path) -> str:
    """Describe the core time of the evaluations of parts; those that parts share count once."""
    evaluations = {}
    for part in parts:
        if any((out / part.name / log).exists() for log in LOGS):
            evaluations.update(read(out / part.name))
    seconds = sum(result_of(record).seconds for record, _ in evaluations.values())
    return (
        f": {len(evaluations)} evaluations that took a core {duration(seconds)}"
        if evaluations
        else ""
    )


def _summary(parts: Sequence[Part], out: Path, averaged: bool) -> list[str]:
    """Make a table with a row per part, and the means of all parts of one kind."""
    rows = [_row(part, out) for part in parts]
    means = list(_means(rows)) if averaged else []
    return [*table(COLUMNS, [*rows, *means]), ""]


def _row(part: Part, out: Path) -> Report:
    """Combine the rows of a report of searches into one."""
    report = files.read_json(out / part.name / f"{part.study}.json")
    rows = {row["name"]: row for row in report["rows"]}
    (optimised,) = (row for name, row in rows.items() if name not in OTHERS)
    return {
        "name": part.name,
        **{name: rows[name] for name in OTHERS if name in rows},
        "learnt": optimised,
        "over_random": optimised["gain_over_random"],
        "over_default": optimised["gain_over_default"],
    }


def _means(rows: Sequence[Report]) -> Iterator[Report]:
    """Yield the means over parts whose names differ only in the number at the end, with intervals."""
    kinds: dict[str, list[Report]] = {}
    for row in rows:
        kinds.setdefault(row["name"].rpartition("-")[0], []).append(row)
    for kind, members in kinds.items():
        if len(members) == 1:
            continue
        names = [name for name in members[0] if name != "name"]
        yield {
            "name": f"mean of {len(members)} {kind}",
            **{
                name: mean if name.startswith("over") else bounded(mean)
                for name in names
                for mean in [estimated([row[name]["mean"] for row in members])]
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
