"""``report.html``: a run on one page that works offline. Its numbers come from the summary and the logs.

``page.html`` lays out what is computed here; ``figures`` makes its plots.
"""

from __future__ import annotations

import json
import mimetypes
from base64 import b64encode
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from plotly.offline import get_plotlyjs

from common.errors import counted
from common.files import read_bytes
from common.progress import duration
from experiments.app.report import figures, fit_table, summary
from experiments.app.report.figures import STAGES
from experiments.app.report.folder import RunFolder, read
from experiments.app.report.matters import matters
from experiments.app.report.pictures import PICTURES
from experiments.app.report.result import on_page, ordered
from experiments.evaluation.store import first_of_each
from experiments.tables.form import Report, number, starts, words
from experiments.tables.row_names import SHORT
from scene.held import hold
from scene.proposal import RELAXATION, default_proposal, describe

HERE = Path(__file__).parent
FIRST = 15
"""The number of attributes whose importance is drawn."""
EVERY = 15
"""Seconds after which the page of an unfinished run reloads."""


class Status(NamedTuple):
    """The progress of an unfinished run."""

    share: float  # of the work
    line: str  # the last line of its progress


def html(report: Report, folder: Path) -> str:
    """The page of a finished run, from its derived report and its folder."""
    return _page(read(folder, report), None)


def under_way(run: RunFolder, status: Status) -> str:
    """The page of an unfinished run: what is known so far."""
    return _page(run, status)


def _page(run: RunFolder, status: Status | None) -> str:
    """The page; sections with nothing to show are left out."""
    report, finished = run.summary, status is None
    order = ordered(report) if finished else []
    trained = [row for row in order if report["rows"][row]["mean"] is not None]

    def inline(name: str, folder: Path = run.path / PICTURES) -> str | None:
        """An image as a data URL; None if it is missing, or not an image in the run's folder."""
        path, kind = folder / name, mimetypes.guess_type(name)[0] or ""
        # A folder from someone else may name any file, also by a link.
        if not kind.startswith("image/") or not path.resolve().is_relative_to(run.path.resolve()):
            return None
        try:
            data = b64encode(read_bytes(path)).decode()
        except (OSError, ValueError):
            return None
        return f"data:{kind};base64,{data}"

    environment = Environment(
        loader=FileSystemLoader(HERE),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"inline": inline, "interval": figures.interval_text}
    config = dict(run.config)
    versions = {"engine of scenes": config.get("engine", "?")}
    versions |= config.pop("made_with", {}) | config.pop("versions", {})
    kind = fit_table.KIND if fit_table.is_fit(report) else summary.KIND
    settings = kind.settings(run)
    if "rows" in report and "seconds" in report:
        settings.append(("Time", duration(report["seconds"]["total"])))
    content = on_page(kind, report, trained) if finished else {}
    index = run.images
    tested = index and index["tested"]
    parts = {
        "so_far": so_far(run) if status else None,
        # Rewards of several folds are of different images: not one curve.
        "search": search_note(run) if report.get("folds", 1) == 1 else None,
        "result": finished,
        "classes": class_table(report, trained) if trained else None,
        "cost": cost(run),
        "made": True,
        "streets": index and index["streets"],
        "tested": tested and tested["images"] and tested,
    }
    if finished and kind is summary.KIND:
        parts |= {"attributes": attributes(run), "importance": importance(run)}
    optimised_first = sorted(trained, key=lambda row: row != "learnt")
    title = report["note"][0].upper() + report["note"][1:]
    defaults = {"verdict": "This run is not finished yet", "cards": []}
    page = environment.get_template("page.html").render(
        run=run, report=report, index=index, order=order, trained=trained, figures=figures,
        parts=defaultdict(lambda: None, parts), SHORT=SHORT, FIRST=FIRST, EVERY=EVERY, status=status,
        title=title, starts=starts(report), policy=figures.policy(run),
        settings_in_words=[*settings, ("Preset", report["preset"])], notes=report.get("notes", ()),
        following=kind.following(run) if finished else (),
        confusion=index and figures.confusion(index, optimised_first),
        versions=versions.items(), settings=json.dumps(config, indent=2),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        code=(HERE / "page.js").read_text(encoding="utf-8"), plotly=get_plotlyjs(),
        **defaults | content,
    )  # fmt: skip
    return page + "\n"


def so_far(run: RunFolder) -> list[list[str]]:
    """The finished networks that give no reward: their kind, number, and mean mIoU in percent."""
    scores: dict[tuple[str, str], list[float | None]] = {}
    for line in first_of_each(run.finals):
        scores.setdefault((line.get("nets", ""), line.get("row", "")), []).append(line["reward"])
    rows = []
    for (nets, row), values in scores.items():
        trained = [100 * value for value in values if value is not None]
        mean = number(sum(trained) / len(trained)) if trained else ""
        rows.append([f"{STAGES.get(nets, nets)}: {SHORT.get(row, row)}", str(len(values)), mean])
    return rows


def search_note(run: RunFolder) -> str:
    """Sentences on the rewards."""
    if not run.evaluations:
        return ""
    method = run.config.get("search", {}).get("method", "?")
    model = (
        " The line is the reward that the method's model predicted before each evaluation; the band is one "
        "standard deviation."
        if run.expected is not None
        else ""
    )
    return (
        f"{len(run.evaluations)} rewards of {method}. Each comes from a new network, trained on its own "
        f"rendered dataset.{model}"
    )


def attributes(run: RunFolder) -> Report:
    """The optimised and the default interval of each attribute, as CSS styles within its range."""
    report, config = run.summary, run.config
    hidden = report["hidden_centres"]
    usual = default_proposal(RELAXATION, config.get("space", "scenex"))
    defaults = describe(hold(usual, run.held))["components"][0]["attributes"]
    rows = []
    for k, (name, optimised) in enumerate(report["components"][0]["attributes"].items()):
        default = defaults.get(name)
        # A near twin has hidden values for the attributes of the smaller space only.
        centre = hidden[k] if hidden is not None and k < len(hidden) else None
        rows.append(
            {
                "name": words(name) + (", held" if name in run.held else ""),
                "optimised": _bar(optimised),
                "default": None if default is None else _bar(default),
                "hidden": None if centre is None else f"left:{100 * centre:.1f}%",
                "cells": [
                    _range(optimised),
                    "" if default is None else _range(default),
                    optimised["physical"]["unit"],
                    optimised["meaning"],
                ],
            }
        )
    return {
        "note": f"Each street draws its attributes from these intervals.{_recovered(report)}",
        "hidden": hidden is not None,
        "rows": rows,
    }


def _recovered(report: Report) -> str:
    errors = report.get("recovery")
    if errors is None:
        return ""
    return (
        f" Their centres are {errors['learnt_error']:.2f} of the range away from the twin's hidden ones, on "
        f"average; the middle of every range would be {errors['centre_error']:.2f} away."
    )


def _bar(entry: Report) -> str:
    """An interval within the whole range, as a CSS style."""
    centre, width = entry["unit"]["centre"], entry["unit"]["width"]
    low, high = max(centre - width / 2, 0.0), min(centre + width / 2, 1.0)
    return f"left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%"


def _range(entry: Report) -> str:
    ends = [f"{entry['physical'][key]:.3g}" for key in ("low", "high")]
    return " – ".join(dict.fromkeys(ends))


def class_table(report: Report, order: list[str]) -> dict[str, Any]:
    """The IoU of each class by row, as text."""
    rows = report["rows"]
    return {
        "head": ["IoU, %", *(SHORT[row] for row in order)],
        "rows": [
            [name, *(number(rows[row]["per_class"][name]) for row in order)]
            for name in rows[order[0]]["per_class"]
        ],
    }


def importance(run: RunFolder) -> dict[str, Any] | None:
    """Which attributes matter, by the model of `sdr-jax study sensitivity` on the run's rewards.

    None if the rewards do not tell.
    """
    result = run.matters
    if result is None:
        result = matters(run.evaluations, run.summary["target"], run.config.get("space", "scenex"))
    note = (
        f"Sobol indices of a Bayesian model of the {result['rewards']} rewards, with 95 % intervals of its "
        f"posterior; the first {FIRST} attributes. {result['said']}"
    )
    shown = result["attributes"][:FIRST]
    return {"shown": shown, "note": note} if shown else None


def cost(run: RunFolder) -> dict[str, Any] | None:
    """The time of each stage; None before any work is done."""
    stages = figures.costs(run)
    if not stages:
        return None
    keys = ("nets", "render", "train")
    total = {key: sum(spent[key] for spent in stages.values()) for key in keys}
    rows = []
    for stage, spent in {**stages, "all": total}.items():
        per_network = (spent["render"] + spent["train"]) / max(spent["nets"], 1)
        minutes = [f"{spent[key] / 60:.1f}" for key in keys[1:]]
        rows.append([stage, f"{spent['nets']:.0f}", *minutes, f"{per_network:.1f}"])
    cpu_time = duration(total["render"] + total["train"])
    workers = max(run.config.get("workers", 1), 1)  # with 0, one process does it all
    elapsed = run.summary.get("seconds", {}).get("total")
    by_clock = "" if elapsed is None else f", {duration(elapsed)} by the clock"
    return {
        "stages": stages,
        "rows": rows,
        "note": f"{cpu_time} of one core{by_clock} with {counted(workers, 'worker')}.",
    }
