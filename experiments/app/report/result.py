"""How the result of a finished run is shown, whichever kind of run it is: as text, and on its page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from common.errors import counted
from experiments.tables import compared
from experiments.tables.form import Report, cells, markdown, number, starts
from experiments.tables.row_names import SHORT, trained_on

CARDS = 3
"""The largest number of gains that the page shows first."""


class Kind(NamedTuple):
    """What a kind of run says about its derived report."""

    verdict: Callable[[Report], str]  # the result in one sentence
    main_rows: Callable[[Report], tuple[str, ...]]  # whose mIoU the page shows first
    gains: Callable[[Report], Mapping[str, Report]]  # by their name, the most important first
    folds: Callable[[Report], Mapping[str, compared.Folds]]  # the networks of each row
    note: Callable[[Report], str]  # sentences on the rows
    class_note: Callable[[Report], str]  # a sentence on the classes, or none
    settings: Callable[[Any], list[tuple[str, str]]]  # of a `RunFolder`
    following: Callable[[Any], list[tuple[str, str]]]  # next commands, each with what it does


Table = tuple[list[str], list[list[str]]]
"""The head and the lines of a table."""


def ordered(report: Report) -> list[str]:
    """The rows in the order of the page: rows with the labelled subset first, if there is one."""
    rows = [row for row in SHORT if row in report["rows"]]
    return sorted(rows, key=lambda row: not row.startswith("few"))


def tables(kind: Kind, report: Report) -> tuple[Table, Table]:
    """The tables of all rows and of all gains."""
    rows, gains = report["rows"], kind.gains(report)
    lines = [[trained_on(report, row), *cells(rows[row])] for row in ordered(report)]
    gain_lines = [[name, *cells(gain, "+.1f")] for name, gain in gains.items()]
    return (
        (["trained on", "mIoU, %", "95 % interval"], lines),
        (["gain", "points of mIoU", "95 % interval"], gain_lines),
    )


def text(kind: Kind, report: Report) -> str:
    """The result in Markdown."""
    paragraphs = [kind.verdict(report), kind.note(report) + starts(report)]
    paragraphs += ["\n".join(markdown(*table)) for table in tables(kind, report)]
    paragraphs += [note] if (note := kind.class_note(report)) else []
    paragraphs += [f"Note: {note}." for note in report.get("notes", ())]
    if failed := report.get("failed"):
        verb = "is" if failed == 1 else "are"
        paragraphs.append(
            f"{counted(failed, 'evaluation')} failed in training and {verb} left out."
        )
    return "\n\n".join(paragraphs)


def on_page(kind: Kind, report: Report, trained: list[str]) -> dict[str, Any]:
    """The parts of the page of a finished run, of which these rows have trained networks."""
    rows, folds = report["rows"], kind.folds(report)
    cards = [
        (number(rows[row]["mean"]), "% mIoU", trained_on(report, row), rows[row])
        for row in kind.main_rows(report)
        if row in rows
    ]
    cards += [
        (number(gain["mean"], "+.1f"), "points", name, gain)
        for name, gain in list(kind.gains(report).items())[:CARDS]
    ]
    return {
        "verdict": kind.verdict(report),
        "cards": cards,
        "tables": tables(kind, report),
        "result_note": kind.note(report),
        "class_note": f"Mean IoU of each class with 95 % intervals. {kind.class_note(report)}",
        "by_class": {row: compared.by_class(folds[row], len(report["classes"])) for row in trained},
    }
