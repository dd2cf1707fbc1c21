"""The files of a job: ``NAME.json``, ``NAME.md`` and its plot, all from the scores of single networks.

The JSON holds the mIoU and class IoU of every network, so that table and plot can be derived from it without
rendering: `sdr-jax study NAME --rederive FILE.json --out DIR`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from common.errors import UserError
from common.files import naming, read_json, write, write_json
from common.folder import CONFIG
from experiments.config import Fidelity, NetsConfig
from experiments.evaluation.job import Result
from experiments.session.session import Session
from experiments.tables.stats import TOO_FEW, mean
from scene.held import in_words
from seg.classes import class_table
from seg.weights import described

Report = dict[str, Any]

INCOMPLETE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""The errors that a report causes in which fields are missing or of another type."""
ONE_SEARCH = "Intervals of one search are over its networks; another search may find other streets."


class Form(NamedTuple):
    """How a job's report is made from its scores."""

    name: str  # of the job and of its files
    derive: Callable[[Report], Report]  # adds what follows from the scores; idempotent
    text: Callable[[Report], str]  # the table, in Markdown
    figures: Mapping[str, Callable[[Report], bytes | str]]  # by file name
    pages: Mapping[str, Callable[[Report, Path], str]] = {}  # made from other files as well


def write_report(form: Form, scores: Report, folder: Path) -> Report:
    """Derive the report and write its files; the JSON comes last, since it marks the others as complete."""
    return _write(form, *_contents(form, scores, folder), folder)


Files = dict[str, bytes | str]
"""Contents by the name of their file."""


def _contents(form: Form, scores: Report, folder: Path) -> tuple[Report, Files]:
    """Derive the report, and make the contents of all files but the JSON."""
    report = form.derive({"study": form.name, **scores})
    files: Files = {f"{form.name}.md": form.text(report) + "\n"}
    files |= {name: draw(report) for name, draw in form.figures.items()}
    return report, files | {name: lay_out(report, folder) for name, lay_out in form.pages.items()}


def _write(form: Form, report: Report, files: Files, folder: Path) -> Report:
    for name, content in files.items():
        write(folder / name, content)
    write_json(folder / f"{form.name}.json", report)
    return report


def rewrite(form: Form, file: Path, folder: Path) -> Report:
    """Derive the report from the scores in an earlier one, and write its files.

    Raises:
        UserError: the file is missing, or is another report, or the folder holds another run.
    """
    if (folder / CONFIG).exists() and folder.resolve() != file.resolve().parent:
        raise UserError(
            f"--out {folder} holds another run, whose report --rederive would replace; name another folder"
        )
    try:
        scores = read_json(file)
    except OSError as error:
        raise UserError(
            f"--rederive {file}: {error.strerror}; expected the {form.name}.json of a run"
        ) from None
    except UserError as error:
        raise UserError(f"--rederive: {error}") from None
    if not isinstance(scores, dict) or scores.get("study", form.name) != form.name:
        raise UserError(f"--rederive {file} is not a report of the study {form.name}")
    try:
        report, files = _contents(form, scores, folder)
    except INCOMPLETE as error:
        raise UserError(
            f"--rederive {file} is not a complete report of the study {form.name} ({error!r})"
        ) from None
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return _write(form, report, files, folder)


def about(run: Session[Any], fidelity: Fidelity) -> Report:
    """Make the first fields of every report.

    Args:
        run: the finished run.
        fidelity: the fidelity of its tested networks.
    """
    config, target = run.config, run.target
    few_images = list(target.few_names)
    return {
        "target": target.name,
        "real": target.real,
        "note": target.title,
        "preset": config.preset,
        "reward_images": len(target.reward_names),
        "test_images": len(target.test_names),
        "seeds": config.seeds if isinstance(config, NetsConfig) else None,
        "scored_at": fidelity.size,
        "starts": [start] if (start := described(fidelity.train)) else [],
        "held": in_words(config.held),
        "classes": list(class_table(target.table).classes),
        **({"few_images": few_images, "few_share": config.few_share} if few_images else {}),
    }


def nets(results: Sequence[Result], heads: int = 1) -> list[Report | None]:
    """Return scores of single networks in percent, in the order of the seeds; None if training failed.

    Args:
        results: the networks.
        heads: with more than one, the scores are those of each head alone.
    """
    scored: list[Report | None] = []
    for result in results:
        if result.failed:
            scored += [None] * heads
        elif heads > 1:
            scored += [_net(mean(class_iou), class_iou) for class_iou in result.heads]
        else:
            scored.append(_net(result.reward, result.class_iou))
    return scored


def _net(reward: float | None, class_iou: Sequence[float | None]) -> Report | None:
    """Return the scores of a network in percent."""
    if reward is None:
        return None
    return {
        "miou": 100 * reward,
        "class_iou": [None if value is None else 100 * value for value in class_iou],
    }


def miou(scored: Sequence[Report | None]) -> list[float | None]:
    """Return every network's mIoU in percent."""
    return [None if net is None else net["miou"] for net in scored]


def class_means(scored: Sequence[Report | None], classes: Sequence[str]) -> dict[str, float | None]:
    """Return the mean IoU of each class in percent; None for classes absent from the ground truth."""
    return {
        name: mean([net["class_iou"][index] for net in scored if net is not None])
        for index, name in enumerate(classes)
    }


def number(value: float | None, form: str = ".1f") -> str:
    """Format a number of a table; empty for None."""
    return "" if value is None else format(value, form)


def interval(ci95: Sequence[float] | None, form: str = ".1f") -> str:
    """Format an interval of a table; empty for None."""
    return "" if ci95 is None else f"{ci95[0]:{form}} to {ci95[1]:{form}}"


def open_interval(low: float | None, high: float | None) -> str:
    """Write an interval; an end that is None is open."""
    if low is None:
        return "open at both ends" if high is None else f"at most {high:.0f}"
    return f"at least {low:.0f}" if high is None else f"{low:.0f} to {high:.0f}"


def cells(entry: Report | None, form: str = ".1f", key: str = "mean") -> list[str]:
    """Format an estimate, such as a mean, and its interval as two cells; only the estimate has a sign."""
    if entry is None or entry[key] is None:
        return ["", ""]
    return [number(entry[key], form), interval(entry["ci95"], form.lstrip("+")) or TOO_FEW]


def error_bars(rows: Sequence[Report]) -> tuple[list[float], list[float]]:
    """Return how far the intervals of rows reach below and above their means; 0 without an interval."""
    below = [row["mean"] - row["ci95"][0] if row["ci95"] else 0.0 for row in rows]
    above = [row["ci95"][1] - row["mean"] if row["ci95"] else 0.0 for row in rows]
    return below, above


def words(name: str) -> str:
    """Write the name of an attribute, method or variant in words."""
    return name.replace("_", " ")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


Column = tuple[str, Callable[[Report], str]]
"""A column of a table: its head, and the cell of a row."""


def estimate(
    head: str,
    part: Callable[[Report], Report | None] = lambda row: row,
    form: str = ".1f",
    key: str = "mean",
) -> list[Column]:
    """Make two columns: the estimate and interval of a row or of a part of it."""
    return [
        (head, lambda row: cells(part(row), form, key)[0]),
        ("95 % interval", lambda row: cells(part(row), form, key)[1]),
    ]


def table(columns: Sequence[Column], rows: Sequence[Report]) -> list[str]:
    """Return the lines of a table in Markdown, one for each row of a report."""
    lines = [[cell(row) for _, cell in columns] for row in rows]
    return markdown([head for head, _ in columns], lines)


def failures(rows: Sequence[Report]) -> list[str]:
    """Return a sentence on the failed networks of all rows, if there are any."""
    failed = sum(net is None for row in rows for net in row["nets"])
    return ["", f"Networks left out because their training failed: {failed}."] if failed else []


def introduction(report: Report) -> str:
    """Write the first sentences of a report: the target, the test images and the intervals."""
    origin = report.get("learnt_from")
    return (
        f"Target: {report['note']}. mIoU in percent at {report['scored_at']} on {report['test_images']} "
        f"test images, {report['seeds']} paired seeds, 95 % intervals by Student's t."
        + ("" if origin is None else f" Optimised streets are from {origin}.")
        + starts(report)
    )


def starts(report: Report) -> str:
    """Write sentences on the weights from which networks start, and on held attributes, if there are any."""
    held = report.get("held")
    sentences = [*report.get("starts", ()), *([f"Held in all streets: {held}"] if held else [])]
    return "".join(f" {sentence}." for sentence in sentences)


def target_of(report: Report) -> str:
    """Write the target for the title of a plot."""
    return report["target"] + ("" if report["real"] else " (not real data)")
