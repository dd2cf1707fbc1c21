"""``report.html``: a run on one page that needs no network. Figures come from the summary and the logs."""

from __future__ import annotations

import json
from pathlib import Path

from experiments.main.summary import TRAINED_ON
from experiments.report import figures, searching, streets
from experiments.report.html import Section, document, facts, folded, missing, plot, table, text
from experiments.report.kept import Kept, read
from experiments.report.matters import matters
from experiments.run.few import words
from experiments.study.form import Report, cells, number, starts
from shell.progress import duration

FIRST = 15
"""Attributes whose importance is drawn."""


def html(report: Report, folder: Path) -> str:
    """The whole page of a run, from its derived summary and its folder."""
    run = read(folder, report)
    sections = (
        result(run),
        search(run),
        *streets.sections(run),
        classes(run),
        importance(run),
        cost(run),
        making(run),
    )
    return document(report["note"], head(run), sections)


def head(run: Kept) -> str:
    """What was asked, of which data."""
    report, config = run.summary, run.config
    fidelity, options = config.get("final", {}), config.get("search", {})
    train = fidelity.get("train", {})
    count = len(report.get("few_images", ()))
    asked = [
        ("Reward", f"{report['reward_images']} images, {len(run.evaluations)} evaluations"),
        ("Reported on", f"{report['test_images']} other images at {report['scored_at']}"),
        (
            "Labels beside renders",
            f"{count} images, {100 * report['few_share']:.0f} % of every batch",
        )
        if count
        else ("Labels beside renders", "none"),
        ("Search", f"{options.get('method', '?')}, space {config.get('space', 'scenex')}"),
        (
            "Nets",
            f"{train.get('net', '?')}, {train.get('steps', '?')} steps, {seeds(report)} seeds",
        ),
        ("Answer", f"candidate “{report['chosen_candidate']}”"),
        ("Took", f"{duration(report['seconds']['total'])}, preset {report['preset']}"),
    ]
    warning = "" if report["real"] else '<p class="twin">The twin: not a result on real data.</p>'
    gone = report["failed"]
    failed = f"<p>{gone} evaluations failed in training and are left out.</p>" if gone else ""
    question = (
        f"Which streets, rendered beside {count} labelled images, train the best net?"
        if count
        else "Which streets, rendered and labelled by the engine, train the best net?"
    )
    note = report["note"][0].upper() + report["note"][1:]
    return f"<h1>{question}</h1><p>{text(note)}.{text(starts(report))}</p>{warning}{failed}{facts(asked)}"


def seeds(report: Report) -> int:
    """Nets of every row."""
    return len(report["rows"]["random"]["miou"])


def result(run: Kept) -> Section:
    """The rows with their intervals, those beside a few labels first, and the gains."""
    report = run.summary
    order = figures.ordered(report)
    gains = [
        ("learnt minus random", report["gain"]),
        ("learnt minus by eye", report["gain_over_default"]),
    ]
    beside = report.get("gain_beside_few", {})
    gains = [(f"few + learnt minus {figures.NAMES[k]}", g) for k, g in beside.items()] + gains
    lines = [(words(report, row, TRAINED_ON), *cells(report["rows"][row])) for row in order]
    lines += [(name, *cells(gain, "+.1f")) for name, gain in gains]
    rows = [[text(cell) for cell in line] for line in lines]
    absent = ", ".join(report["classes_absent_from_truth"])
    also = f" Left out of the mean, for they never occur in the truth: {absent}." if absent else ""
    return Section(
        "result",
        "Result",
        _cards(run)
        + plot(figures.rows(report, order), 46 * len(order) + 60)
        + folded("As a table, with gains", table(("trained on", "mIoU, %", "95 % interval"), rows)),
        f"Mean IoU in percent on {report['test_images']} test images, {seeds(report)} paired seeds. Thick "
        f"lines are 95 % intervals over seeds, small marks single nets.{also}",
    )


def _cards(run: Kept) -> str:
    """The answer in a few figures."""
    report = run.summary
    rows, beside = report["rows"], report.get("gain_beside_few")
    if beside:
        shown = [("few+learnt", f"{len(report['few_images'])} labels and learnt streets")]
        gains = [
            (f"over {words(report, row, TRAINED_ON)}", beside[row])
            for row in ("few", "few+default")
        ]
    else:
        shown = [("learnt", "learnt streets")]
        gains = [
            ("over the street set by eye", report["gain_over_default"]),
            ("over random streets", report["gain"]),
        ]
    if "real" in rows:
        shown.append(("real", words(report, "real", TRAINED_ON)))
    told = [(number(rows[row]["mean"]), "% mIoU", what, rows[row]) for row, what in shown]
    told[1:1] = [(number(gain["mean"], "+.1f"), "points", what, gain) for what, gain in gains]
    return '<div class="cards">' + "".join(
        f'<div class="card"><b>{value or "–"} <small>{unit}</small></b><span>{text(what)}<br>'
        f"95 %: {figures.said(entry)}</span></div>"
        for value, unit, what, entry in told
    ) + "</div>"  # fmt: skip


def search(run: Kept) -> Section:
    """Rewards in the order in which they were made."""
    count = len(run.evaluations)
    if count == 0:
        return Section("search", "Search", missing("The run keeps no rewards of a search."))
    method = run.config.get("search", {}).get("method", "?")
    model = (
        " The line is what the method's model expected of each evaluation before it was made, its band one "
        "standard deviation."
        if run.expected is not None
        else ""
    )
    body = plot(searching.curve(run), 380) + _selection(run)
    note = f"{count} rewards of {method}, each of a fresh net on a dataset of its own.{model}"
    return Section("search", "Search", body, note)


def _selection(run: Kept) -> str:
    """How the answer was chosen among the candidates; nothing of a run that used another rule."""
    report = run.summary
    found = report.get("selection")
    if found is None:
        return ""
    scale, form = (1, ".1f") if run.percent else (0.01, ".4f")

    def said(value: float | None) -> str:
        return number(None if value is None else scale * value, form)

    parts, unit = report["parts"], "%" if run.percent else "-MMD²"
    rows = []
    for name, mean in found["means"].items():
        mark = " ← answer" if name == report["chosen_candidate"] else ""
        by_part = report["candidate_parts"][name] or [None] * len(parts)
        t = number(found["t"].get(name), ".2f")
        rows.append([text(name + mark), said(mean), t, *map(said, by_part)])
    head = ["candidate", f"mean, {unit}", "t", *(f"{text(part)}, {unit}" for part in parts)]
    nets = max(map(len, report["candidates"].values()))
    bound = (
        "" if found["critical"] is None else f" The critical value of t is {found['critical']:.2f}."
    )
    verdict = text(found["verdict"][0].upper() + found["verdict"][1:])
    return (
        f"<h3>Model selection: candidates for the answer, {nets} paired seeds, on the reward images</h3>"
        f"<p>{verdict}.{bound} The parts of the reward images are only reported.</p>{table(head, rows)}"
    )


def classes(run: Kept) -> Section:
    """IoU of every class, who was taken for whom, and what the images hold."""
    report, seen = run.summary, run.seen
    order = [row for row in figures.ordered(report) if any(report["nets"][row])]
    body = plot(figures.classes(report, order), 430)
    values = [
        [text(name), *(number(report["rows"][row]["per_class"][name]) for row in order)]
        for name in report["rows"][order[0]]["per_class"]
    ]
    body += folded("As a table", table(("IoU, %", *(figures.NAMES[row] for row in order)), values))
    matrices = seen and figures.confusion(seen, sorted(order, key=lambda row: row != "learnt"))
    body += "<h3>Confusion: percent of each true class, by what it was taken for</h3>"
    if matrices:
        wide = len(report["classes"])
        body += plot(matrices, 26 * wide + 150)
    else:
        body += missing(
            "This run left no confusion matrices: they came later, or its nets came from a store."
        )
    body += "<h3>What the images hold: shares of classes, and where they lie</h3>"
    if seen:
        body += plot(figures.shares(seen), 21 * len(seen["classes"]) + 90)
    else:
        body += missing("This run did not record what its images hold.")
    return Section(
        "classes", "Classes", body, "Mean IoU of each class with 95 % intervals over seeds."
    )


def importance(run: Kept) -> Section:
    """Which attributes matter, by the model of ``experiments.sensitivity`` on the run's own rewards."""
    title = ("importance", "What matters")
    found = run.matters
    if found is None:
        found = matters(run.evaluations, run.summary["target"], run.config.get("space", "scenex"))
    if not found["attributes"]:
        return Section(*title, missing(found["said"]))
    body = plot(searching.importance(found["attributes"][:FIRST]), 24 * FIRST + 80)
    return Section(
        *title,
        body,
        f"Sobol indices of a Bayesian model of the {found['rewards']} rewards with 95 % intervals of its "
        f"posterior; the first {FIRST} attributes. {found['said']}",
    )


def cost(run: Kept) -> Section:
    """Where the time went."""
    stages = searching.costs(run)
    rows = [
        [
            text(stage),
            str(own["nets"]),
            *(f"{own[key] / 60:.1f}" for key in ("render", "train")),
            f"{(own['render'] + own['train']) / max(own['nets'], 1):.1f}",
        ]
        for stage, own in stages.items()
    ]
    total = {k: sum(own[k] for own in stages.values()) for k in ("nets", "render", "train")}
    spent = total["render"] + total["train"]
    each = spent / max(total["nets"], 1)
    rows.append(["all", f"{total['nets']:.0f}", f"{total['render'] / 60:.1f}", f"{total['train'] / 60:.1f}",
                 f"{each:.1f}"])  # fmt: skip
    clock = run.summary["seconds"]["total"]
    workers = run.config.get("workers", "?")
    return Section(
        "cost",
        "Time and cost",
        plot(searching.cost(stages), 44 * len(stages) + 90)
        + table(("stage", "nets", "rendering, min", "training, min", "seconds a net"), rows),
        f"{duration(spent)} of work on one core in {duration(clock)} by the clock, {workers} workers.",
    )


def making(run: Kept) -> Section:
    """The command, versions, and every setting."""
    config = dict(run.config)
    versions = config.pop("versions", {})
    command = run.summary.get("command")
    told = (
        f"<pre>{text(command)}</pre>" if command else missing("The run did not record its command.")
    )
    pairs = [("engine of scenes", str(config.get("engine", "?")))]
    pairs += (config.pop("made_with", {}) | versions).items()
    everything = json.dumps(config, indent=2)
    return Section(
        "made",
        "How it was made",
        told + facts(pairs) + folded("Every setting", f"<pre>{text(everything)}</pre>"),
        "The same command goes on with the run, or does it again in another --out.",
    )
