"""``report.html``: a run on one page that works offline. Its numbers come from the summary and the logs.

``page.html`` lays out what is computed here; ``figures`` makes its plots.
"""

from __future__ import annotations

import json
import mimetypes
import shlex
from base64 import b64encode
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from plotly.offline import get_plotlyjs

from common.errors import counted
from common.files import read_bytes
from common.interrupt import PROGRAM
from common.progress import duration
from experiments.app.report import figures, fit_table
from experiments.app.report.figures import STAGES
from experiments.app.report.folder import RunFolder, read
from experiments.app.report.matters import matters
from experiments.app.report.pictures import PICTURES
from experiments.app.report.summary import advice
from experiments.evaluation.store import first_of_each
from experiments.tables.form import Report, cells, number, starts, words
from experiments.tables.row_names import SHORT, TRAINED_ON, trained_on
from experiments.tables.stats import TOO_FEW
from scene.held import hold
from scene.proposal import default_proposal, describe

HERE = Path(__file__).parent
FIRST = 15
"""The number of attributes whose importance is drawn."""
IMAGES = 1000
"""The number of images in the command that renders more of the optimised streets."""
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
    order = figures.ordered(report) if finished else []
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
    if fit_table.is_fit(report):
        content = fit_table.content(report, run.path, run.config, finished)
    else:
        content = _content(run, order, trained, finished)
    parts = {
        "so_far": so_far(run) if status else None,
        "search": search_note(run),
        "classes": class_table(report, trained) if trained else None,
        "cost": cost(run),
        "made": True,
        **content.pop("parts"),
    }
    title = report["note"][0].upper() + report["note"][1:]
    defaults: dict[str, Any] = {
        "verdict": "This run is not finished yet",
        "following": [],
        "cards": [],
        "notes": [],
        "confusion": None,
    }
    page = environment.get_template("page.html").render(
        run=run, report=report, index=run.images, order=order, trained=trained, figures=figures,
        parts=defaultdict(lambda: None, parts), SHORT=SHORT, FIRST=FIRST, EVERY=EVERY, status=status,
        title=title, starts=starts(report), policy=figures.policy(run),
        versions=versions.items(), settings=json.dumps(config, indent=2),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        code=(HERE / "page.js").read_text(encoding="utf-8"), plotly=get_plotlyjs(),
        **defaults | content,
    )  # fmt: skip
    return page + "\n"


def _content(
    run: RunFolder, order: list[str], trained: list[str], finished: bool
) -> dict[str, Any]:
    """The parts of the page that only the main job has."""
    report, index = run.summary, run.images
    shown: dict[str, Any] = {
        "settings_in_words": settings_in_words(run),
        "parts": {
            "streets": index and index["streets"],
            "worst": index and index["worst"] and index["worst"]["images"] and index["worst"],
        },
    }
    if not finished:
        return shown
    optimised_first = sorted(trained, key=lambda row: row != "learnt")
    return {
        **shown,
        "verdict": verdict(report),
        "following": following(run),
        "cards": cards(report),
        "result_note": result_note(report),
        "class_note": "Mean IoU of each class with 95 % intervals over seeds.",
        "by_class": {
            row: figures.by_class(report["nets"][row], report["classes"]) for row in trained
        },
        "confusion": None if index is None else figures.confusion(index, optimised_first),
        "parts": {
            **shown["parts"],
            "result": results(report, order),
            "attributes": attributes(run),
            "importance": importance(run),
        },
    }


def verdict(report: Report) -> str:
    """The result in one sentence."""
    with_few = report.get("gain_beside_few")
    row = "few+learnt" if with_few else "learnt"
    streets, miou = trained_on(report, row), report["rows"][row]["mean"]
    where = "" if report["real"] else "On the twin, which is not real data, "
    if miou is None:
        sentence = f"{where}training failed for all networks on {streets}"
        return sentence[0].upper() + sentence[1:]
    gains = with_few or {"default": report["gain_over_default"], "random": report["gain"]}
    shown = [other for other in ("few", "few+default", "default", "random") if other in gains]
    compared = [_compared(gains[other], trained_on(report, other)) for other in shown]
    sentence = (
        f"{where}networks trained on {streets} reach {miou:.1f} % mIoU: {' and '.join(compared)}"
    )
    return sentence[0].upper() + sentence[1:]


def _compared(gain: Report, other: str) -> str:
    """A gain in words; if its interval contains zero, it is not called a gain."""
    mean, ci95 = gain["mean"], gain["ci95"]
    if mean is None:
        return f"not compared with {other}"
    difference = f"{abs(mean):.1f} points {'above' if mean >= 0 else 'below'} {other}"
    if ci95 is None:
        return f"{difference} ({TOO_FEW})"
    return difference if ci95[0] * ci95[1] > 0 else f"within noise of {other}"


def following(run: RunFolder) -> list[tuple[str, str]]:
    """The next commands, each with what it does."""
    out = Path(str(run.config.get("out", run.path)))
    words = [PROGRAM, "render", "--attributes", str(out / "attributes.json")]
    words += ["--images", str(IMAGES), "--out", str(out / "streets")]
    more = (f"Next: render {IMAGES:,} images of these streets", shlex.join(words))
    if run.summary["real"]:
        return [more]
    return [more, ("Or check your own labelled images", f"{PROGRAM} doctor DATA")]


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


def settings_in_words(run: RunFolder) -> list[tuple[str, str]]:
    """The main settings and the data of the run."""
    report, config = run.summary, run.config
    train, options = config.get("final", {}).get("train", {}), config.get("search", {})
    count = len(report.get("few_images", ()))
    few = f"{count} images, {100 * report['few_share']:.0f} % of every batch" if count else "none"
    net, steps = train.get("net", "?"), train.get("steps", "?")
    settings = [
        ("Rewards", f"{len(run.evaluations)}, measured on {report['reward_images']} images"),
        ("Tested on", f"{report['test_images']} other images at {report['scored_at']}"),
        ("Labels mixed with renders", few),
        ("Search", f"{options.get('method', '?')}, space {config.get('space', 'scenex')}"),
        ("Networks", f"{net}, {steps} steps, {report['seeds']} seeds"),
    ]
    if "rows" in report:
        settings.append(("Time", duration(report["seconds"]["total"])))
    return [*settings, ("Preset", report["preset"])]


def _seeds(report: Report) -> int:
    """The number of networks of every row."""
    return len(report["rows"]["random"]["miou"])


def cards(report: Report) -> list[tuple[str, str, str, Report]]:
    """The main numbers: each with its unit, its meaning and its interval."""
    rows, with_few = report["rows"], report.get("gain_beside_few")
    if with_few:
        answer, gains = "few+learnt", {row: with_few[row] for row in ("few", "few+default")}
    else:
        answer, gains = (
            "learnt",
            {"default": report["gain_over_default"], "random": report["gain"]},
        )
    scores = [
        (number(rows[row]["mean"]), "% mIoU", trained_on(report, row), rows[row])
        for row in (answer, "real")
        if row in rows
    ]
    scores[1:1] = [
        (number(gain["mean"], "+.1f"), "points", f"over {trained_on(report, row)}", gain)
        for row, gain in gains.items()
    ]
    return scores


def results(report: Report, order: list[str]) -> list[list[str]]:
    """The rows with their intervals, and the gains."""
    gains = {
        f"{trained_on(report, 'few+learnt')}, gain over {trained_on(report, other)}": gain
        for other, gain in report.get("gain_beside_few", {}).items()
    }
    for other, gain in (("random", report["gain"]), ("default", report["gain_over_default"])):
        gains[f"{TRAINED_ON['learnt']}, gain over {TRAINED_ON[other]}"] = gain
    lines = [[trained_on(report, row), *cells(report["rows"][row])] for row in order]
    return lines + [[name, *cells(gain, "+.1f")] for name, gain in gains.items()]


def result_note(report: Report) -> str:
    """Sentences on the rows."""
    absent = ", ".join(report["classes_absent_from_truth"])
    also = (
        f" No test image has these classes, so no mean includes them: {absent}." if absent else ""
    )
    return (
        f"{advice(report)} Mean IoU in percent on {report['test_images']} test images, {_seeds(report)} "
        f"paired seeds. Thick lines are 95 % intervals over seeds, small marks single networks.{also}"
    )


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
    usual = default_proposal(config.get("default_width", 0.15), config.get("space", "scenex"))
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
