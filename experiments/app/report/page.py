"""``report.html``: a run on one page that needs no network. Figures come from the summary and the logs.

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

from plotly.offline import get_plotlyjs

from common.files import read_bytes
from common.interrupt import PROGRAM
from common.progress import duration
from experiments.app.report import figures, fit_table
from experiments.app.report.figures import NAMES, STAGES
from experiments.app.report.folder import RunFolder, read
from experiments.app.report.matters import matters
from experiments.app.report.pictures import PICTURES
from experiments.app.report.summary import TRAINED_ON, advice
from experiments.app.report.templates import templates
from experiments.evaluation.store import each
from experiments.tables import few_rows
from experiments.tables.form import Report, cells, number, starts, words
from experiments.tables.stats import TOO_FEW
from scene.held import hold
from scene.proposal import default_proposal, describe

HERE = Path(__file__).parent
FIRST = 15
"""The number of attributes whose importance is drawn."""
IMAGES = 1000
"""The number of images in the command that renders more streets like the answer."""
EVERY = 15
"""Seconds after which the page of an unfinished run is loaded again."""


class Status(NamedTuple):
    """The progress of an unfinished run."""

    share: float  # of the work
    said: str  # the last line of its progress


def html(report: Report, folder: Path) -> str:
    """The page of a finished run, from its derived report and its folder."""
    return _page(read(folder, report), None)


def under_way(run: RunFolder, status: Status) -> str:
    """The page of an unfinished run: what is known so far."""
    return _page(run, status)


def _page(run: RunFolder, status: Status | None) -> str:
    """The page; sections with nothing to show are left out."""
    report, over = run.summary, status is None
    order = figures.ordered(report) if over else []
    trained = [row for row in order if report["rows"][row]["mean"] is not None]

    def inline(name: str, folder: Path = run.path / PICTURES) -> str | None:
        """A picture as a data URL; None if it is missing, or no picture in the run's folder."""
        path, kind = folder / name, mimetypes.guess_type(name)[0] or ""
        # A folder from someone else may name any file, also by a link.
        if not kind.startswith("image/") or not path.resolve().is_relative_to(run.path.resolve()):
            return None
        try:
            data = b64encode(read_bytes(path)).decode()
        except (OSError, ValueError):
            return None
        return f"data:{kind};base64,{data}"

    environment = templates()
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"inline": inline, "said": figures.said}
    config = dict(run.config)
    versions = {"engine of scenes": config.get("engine", "?")}
    versions |= config.pop("made_with", {}) | config.pop("versions", {})
    if fit_table.is_fit(report):
        content = fit_table.content(report, run.path, run.config, over)
    else:
        content = _content(run, order, trained, over)
    parts = {
        "so_far": so_far(run) if status else None,
        "search": search_note(run),
        "classes": class_table(report, trained) if trained else None,
        "cost": cost(run),
        "made": True,
        **content.pop("parts"),
    }
    title = report["note"][0].upper() + report["note"][1:]
    usual: dict[str, Any] = {
        "verdict": "This run is under way",
        "following": [],
        "cards": [],
        "notes": [],
        "confusion": None,
    }
    page = environment.get_template("page.html").render(
        run=run, report=report, seen=run.seen, order=order, trained=trained, figures=figures,
        parts=defaultdict(lambda: None, parts), NAMES=NAMES, FIRST=FIRST, EVERY=EVERY, status=status,
        title=title, starts=starts(report), policy=figures.policy(run),
        versions=versions.items(), settings=json.dumps(config, indent=2),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        code=(HERE / "page.js").read_text(encoding="utf-8"), plotly=get_plotlyjs(),
        **usual | content,
    )  # fmt: skip
    return page + "\n"


def _content(run: RunFolder, order: list[str], trained: list[str], over: bool) -> dict[str, Any]:
    """The parts of the page that only the main job has."""
    report, seen = run.summary, run.seen
    shown: dict[str, Any] = {
        "asked": asked(run),
        "parts": {
            "streets": seen and seen["streets"],
            "worst": seen and seen["worst"] and seen["worst"]["images"] and seen["worst"],
        },
    }
    if not over:
        return shown
    learnt_first = sorted(trained, key=lambda row: row != "learnt")
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
        "confusion": None if seen is None else figures.confusion(seen, learnt_first),
        "parts": {
            **shown["parts"],
            "result": results(report, order),
            "attributes": attributes(run),
            "importance": importance(run),
        },
    }


def verdict(report: Report) -> str:
    """The result in one sentence."""
    rows, beside = report["rows"], report.get("gain_beside_few")
    where = "" if report["real"] else "On the twin, which is not real data, "
    own = rows["few+learnt" if beside else "learnt"]["mean"]
    if own is None:
        said = "no net on learnt streets could be trained"
        return where + said if where else said[0].upper() + said[1:]
    what = "learnt streets"
    what += f" beside {len(report['few_images'])} labelled images" if beside else ""
    if beside:
        gains = {
            "the labels alone": beside["few"],
            "hand-set streets beside them": beside["few+default"],
        }
    else:
        gains = {
            "the hand-set street": report["gain_over_default"],
            "random streets": report["gain"],
        }
    said = f"{where}{what} train nets of {own:.1f} % mIoU: "
    said += " and ".join(_compared(gain, other) for other, gain in gains.items())
    return said[0].upper() + said[1:]


def _compared(gain: Report, other: str) -> str:
    """A gain over something else in words; if its interval contains zero, it is not called a gain."""
    mean, ci95 = gain["mean"], gain["ci95"]
    if mean is None:
        return f"not compared with {other}"
    apart = f"{abs(mean):.1f} points {'above' if mean >= 0 else 'below'} {other}"
    if ci95 is None:
        return f"{apart} ({TOO_FEW})"
    return apart if ci95[0] * ci95[1] > 0 else f"not clearly different from {other}"


def following(run: RunFolder) -> list[tuple[str, str]]:
    """The next commands, each with what it does."""
    out = Path(str(run.config.get("out", run.path)))
    words = [PROGRAM, "render", "--attributes", str(out / "attributes.json")]
    words += ["--images", str(IMAGES), "--out", str(out / "streets")]
    more = (f"Next: render {IMAGES:,} images of these streets", shlex.join(words))
    if run.summary["real"]:
        return [more]
    return [more, ("Or find out what your own labelled images need", f"{PROGRAM} doctor DATA")]


def so_far(run: RunFolder) -> list[list[str]]:
    """The nets so far that give no reward: their kind, their number, and their mean mIoU or reward."""
    found: dict[tuple[str, str], list[float | None]] = {}
    for line in each(run.finals):
        found.setdefault((line.get("nets", ""), line.get("row", "")), []).append(line["reward"])
    rows = []
    for (nets, row), values in found.items():
        percent = run.percent or nets == "final"
        known = [value * (100 if percent else 1) for value in values if value is not None]
        mean = number(sum(known) / len(known), ".1f" if percent else ".4f") if known else ""
        rows.append([f"{STAGES.get(nets, nets)}: {NAMES.get(row, row)}", str(len(values)), mean])
    return rows


def asked(run: RunFolder) -> list[tuple[str, str]]:
    """The settings and the data of the run, in words."""
    report, config = run.summary, run.config
    train, options = config.get("final", {}).get("train", {}), config.get("search", {})
    count = len(report.get("few_images", ()))
    beside = (
        f"{count} images, {100 * report['few_share']:.0f} % of every batch" if count else "none"
    )
    net, steps = train.get("net", "?"), train.get("steps", "?")
    told = [
        ("Reward", f"{report['reward_images']} images, {len(run.evaluations)} evaluations"),
        ("Reported on", f"{report['test_images']} other images at {report['scored_at']}"),
        ("Labels beside renders", beside),
        ("Search", f"{options.get('method', '?')}, space {config.get('space', 'scenex')}"),
        ("Nets", f"{net}, {steps} steps, {report['seeds']} seeds"),
    ]
    if "rows" in report:
        told.append(("Took", duration(report["seconds"]["total"])))
    return [*told, ("Preset", report["preset"])]


def _seeds(report: Report) -> int:
    """The number of nets of every row."""
    return len(report["rows"]["random"]["miou"])


def cards(report: Report) -> list[tuple[str, str, str, Report]]:
    """The main figures: each with its unit, its meaning and its interval."""
    rows, beside = report["rows"], report.get("gain_beside_few")
    if beside:
        answer = ("few+learnt", f"{len(report['few_images'])} labels and learnt streets")
        gains = [
            (f"over {few_rows.words(report, row, TRAINED_ON)}", beside[row])
            for row in ("few", "few+default")
        ]
    else:
        answer = ("learnt", "learnt streets")
        gains = [
            ("over the hand-set street", report["gain_over_default"]),
            ("over random streets", report["gain"]),
        ]
    real = [("real", few_rows.words(report, "real", TRAINED_ON))] if "real" in rows else []
    told = [(number(rows[row]["mean"]), "% mIoU", what, rows[row]) for row, what in (answer, *real)]
    told[1:1] = [(number(gain["mean"], "+.1f"), "points", what, gain) for what, gain in gains]
    return told


def results(report: Report, order: list[str]) -> list[list[str]]:
    """The rows with their intervals, and the gains."""
    gains = {
        f"few + learnt minus {NAMES[k]}": g for k, g in report.get("gain_beside_few", {}).items()
    }
    gains |= {
        "learnt minus random": report["gain"],
        "learnt minus hand-set": report["gain_over_default"],
    }
    lines = [
        [few_rows.words(report, row, TRAINED_ON), *cells(report["rows"][row])] for row in order
    ]
    return lines + [[name, *cells(gain, "+.1f")] for name, gain in gains.items()]


def result_note(report: Report) -> str:
    """A sentence on the rows."""
    absent = ", ".join(report["classes_absent_from_truth"])
    also = f" Left out of the mean, since no test image has them: {absent}." if absent else ""
    return (
        f"{advice(report)} Mean IoU in percent on {report['test_images']} test images, {_seeds(report)} "
        f"paired seeds. Thick lines are 95 % intervals over seeds, small marks single nets.{also}"
    )


def search_note(run: RunFolder) -> str:
    """A sentence on the rewards."""
    if not run.evaluations:
        return ""
    method = run.config.get("search", {}).get("method", "?")
    model = (
        " The line is what the method's model expected of each evaluation before it was made; the band is "
        "one standard deviation."
        if run.expected is not None
        else ""
    )
    return f"{len(run.evaluations)} rewards of {method}, each of a fresh net on a dataset of its own.{model}"


def attributes(run: RunFolder) -> Report:
    """The learnt interval of each attribute, beside the hand-set one, as CSS styles within its range."""
    report, config = run.summary, run.config
    hidden = report["hidden_centres"]
    by_hand = default_proposal(config.get("default_width", 0.15), config.get("space", "scenex"))
    hand_set = describe(hold(by_hand, run.held))["components"][0]["attributes"]
    rows = []
    for k, (name, own) in enumerate(report["components"][0]["attributes"].items()):
        other = hand_set.get(name)
        # A near twin has hidden values for the attributes of the smaller space only.
        centre = hidden[k] if hidden is not None and k < len(hidden) else None
        rows.append(
            {
                "name": words(name) + (", held" if name in run.held else ""),
                "learnt": _bar(own),
                "hand_set": None if other is None else _bar(other),
                "hidden": None if centre is None else f"left:{100 * centre:.1f}%",
                "cells": [
                    _range(own),
                    "" if other is None else _range(other),
                    own["physical"]["unit"],
                    own["meaning"],
                ],
            }
        )
    return {
        "note": f"Each street draws its attributes from these intervals.{_recovered(report)}",
        "hidden": hidden is not None,
        "rows": rows,
    }


def _recovered(report: Report) -> str:
    found = report.get("recovery")
    if found is None:
        return ""
    return (
        f" They lie {found['learnt_error']:.2f} of their range from the twin's hidden ones on average; all "
        f"centres at one half would lie {found['centre_error']:.2f}."
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
        "head": ["IoU, %", *(NAMES[row] for row in order)],
        "rows": [
            [name, *(number(rows[row]["per_class"][name]) for row in order)]
            for name in rows[order[0]]["per_class"]
        ],
    }


def importance(run: RunFolder) -> dict[str, Any] | None:
    """Which attributes matter, according to the model of `sdr-jax study sensitivity` on the run's rewards.

    None if the rewards say nothing.
    """
    found = run.matters
    if found is None:
        found = matters(run.evaluations, run.summary["target"], run.config.get("space", "scenex"))
    note = (
        f"Sobol indices of a Bayesian model of the {found['rewards']} rewards with 95 % intervals of its "
        f"posterior; the first {FIRST} attributes. {found['said']}"
    )
    shown = found["attributes"][:FIRST]
    return {"shown": shown, "note": note} if shown else None


def cost(run: RunFolder) -> dict[str, Any] | None:
    """The time of each stage; None before any work is done."""
    stages = figures.costs(run)
    if not stages:
        return None
    keys = ("nets", "render", "train")
    total = {key: sum(own[key] for own in stages.values()) for key in keys}
    rows = []
    for stage, own in {**stages, "all": total}.items():
        each = (own["render"] + own["train"]) / max(own["nets"], 1)
        minutes = [f"{own[key] / 60:.1f}" for key in keys[1:]]
        rows.append([stage, f"{own['nets']:.0f}", *minutes, f"{each:.1f}"])
    workers, spent = run.config.get("workers", "?"), duration(total["render"] + total["train"])
    clock = run.summary.get("seconds", {}).get("total")
    by_clock = "" if clock is None else f" in {duration(clock)} by the clock"
    return {
        "stages": stages,
        "rows": rows,
        "note": f"{spent} of work on one core{by_clock}, {workers} worker{'' if workers == 1 else 's'}.",
    }
