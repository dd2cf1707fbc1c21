"""Find which attributes matter, alone and together, from recorded rewards.

    sdr-jax study sensitivity --target camvid --records docs/results/store.jsonl
    sdr-jax study sensitivity --target camvid --data DIR --holdout 0006R0 --store FILE
    sdr-jax study sensitivity --target twin --preset smoke                # a minute or two

With --records nothing is rendered, and no data are needed. Otherwise rewards come from the store and the run
folder, after missing ones have been made. The same command resumes a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.figure import Figure, SubFigure

from common import folder
from common.command import say
from experiments.config.cli import command
from experiments.config.jobs import SensitivityConfig
from experiments.evaluation.cost import cost_of
from experiments.evaluation.job import Job, Result
from experiments.evaluation.job import verdict as outcome
from experiments.evaluation.runner import refuse_failed
from experiments.session.session import FREE_FIELDS, PACKAGES, Session, Work
from experiments.studies.figure import plt, png
from experiments.tables.bins import random_bins
from experiments.tables.form import (
    Column,
    Form,
    Report,
    cells,
    estimate,
    interval,
    number,
    starts,
    table,
    words,
    write_report,
)
from experiments.tables.importance import enough, summarize, verdict
from experiments.tables.recorded import Records, choose, holds, in_space, read
from experiments.tables.skeleton import Study, do
from experiments.tables.skeleton import check as check_all
from scene.held import in_words
from scene.version import ENGINE

SENSITIVITY_SEED = 20_000_000
"""The first seed, above those of a run's rows and of the study of fidelity."""
TOP_PAIRS = 10
ACROSS = 6
"""Number of panels in a row."""


def analyse(config: SensitivityConfig) -> Report:
    """Do the whole study; with ``--records`` without a target or workers.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    if not config.records or config.rederive is not None:
        return do(STUDY, config)
    check_all(STUDY, config)
    origin = ", ".join(map(str, config.records))
    records = read(config.records, config, config.target_name, config.records_config)
    records = enough(records, origin)
    real = config.target != "twin"
    target = config.target if real else f"the {config.target_name}, NOT real data"
    settings = {"engine": ENGINE, **asdict(config)}
    with folder.opened(config.out, settings, free=FREE_FIELDS, packages=PACKAGES):
        scores = _report(config, real, f"{target}, recorded in {origin}", records)
        report = write_report(FORM, scores, config.out)
    say(f"{FORM.text(report)}\n{config.out / 'sensitivity.md'}")
    return report


def _report(config: SensitivityConfig, real: bool, note: str, records: Records) -> Report:
    about = {"target": config.target_name, "real": real, "note": note, "preset": config.preset}
    return {**about, "held": in_words(config.held), **summarize(records)}


def plan(config: SensitivityConfig, _: Any = None) -> list[Work]:
    """Plan all rewards; the store may already have some."""
    return [Work.at("rewards of random streets, at most", config.evaluations, config.reward)]


def scores(run: Session[SensitivityConfig], _: Any) -> Report:
    """Make the missing rewards, and analyse all of them."""
    records = enough(record(run), str(run.config.out if run.store is None else run.store.path))
    return _report(run.config, run.target.real, run.target.title, records)


def record(run: Session[SensitivityConfig]) -> Records:
    """Make the missing rewards; return all at the reward's fidelity in the run's store and folder."""
    config = run.config
    recipe, first = run.recipe(config.reward), SENSITIVITY_SEED + config.seed
    jobs = [
        Job(recipe, proposal, first + k, {"nets": "sensitivity"}, "reward")
        for k, proposal in enumerate(random_bins(config, config.evaluations))
    ]
    # Rewards of other runs at this fidelity count, too.
    name = run.runner.about(jobs[0])["config"]
    job_keys = {run.runner.key(job) for job in jobs}
    others = sum(
        line["config"] == name and line["reward"] is not None and in_space(line, config.space)
        for key, line in _records(run).items()
        if key not in job_keys
    )
    missing = jobs[: max(config.evaluations - others, 0)]
    run.progress.advance(cost_of(config.reward) * (len(jobs) - len(missing)), replayed=True)

    def progress_line(index: int, result: Result) -> str:
        return f"reward {index + 1}/{len(missing)} | {outcome(result)}"

    refuse_failed(run.runner.run(missing, say=progress_line), len(missing))
    return choose(_records(run).values(), run.target.name, config.space, name, str(config.out))


def _records(run: Session[SensitivityConfig]) -> dict[str, dict[str, Any]]:
    """Return the evaluations of store and run by key."""
    stored = [] if run.store is None else run.store.records
    lines = (*stored, *run.finals.records)
    return {line["key"]: line for line in lines if holds(line, run.config)}


COLUMNS: list[Column] = [
    ("rank", lambda row: str(row["rank"])),
    ("attribute", lambda row: words(row["name"])),
    *estimate("share alone, %", lambda row: row["share"], key="value"),
    *estimate("with interactions, %", lambda row: row["total"], key="value"),
    ("best value", lambda row: f"{row['best']:.3g} {row['unit']}"),
    ("90 % range", lambda row: "{:.3g} to {:.3g}".format(*row["range90"])),
    ("gain, mIoU points", lambda row: f"{row['worth']:.1f}"),
]
PAIRS: list[Column] = [
    ("attributes", lambda row: " × ".join(map(words, row["names"]))),
    *estimate("share, %", lambda row: row["share"], key="value"),
]


def text(report: Report) -> str:
    """Write the tables in Markdown."""
    records, r2, noise = report["records"], report["r2"], report["noise"]
    failed = f", {records['failed']} failed ones left out" if records["failed"] else ""
    value, ci95 = number(r2["value"], ".2f") or "undefined", interval(r2["ci95"], ".2f")
    range_ = ci95 and f" (95 % interval {ci95})"
    repeats = "no proposal was evaluated twice"
    if noise["repeats"] is not None:
        repeats = (
            f"{noise['repeats']:.2f} from proposals evaluated more than once ({noise['degrees']} degrees "
            "of freedom)"
        )
    signal, signal_range = cells(report["signal"], key="value")
    interactions, interactions_range = cells(report["interactions"], key="value")
    ranked = [{"rank": k, **row} for k, row in enumerate(report["attributes"], 1)]
    lines = [
        f"Target: {report['note']}. {records['rewards']} rewards of {records['proposals']} proposals"
        f"{failed}, mean {records['mean']:.1f}, standard deviation {records['sd']:.2f} mIoU points: "
        f"{records['words']}.",
        *(f"Not analysed: {aside}." for aside in records["left_aside"]),
        *([starts(report).strip()] if starts(report) else []),
        "",
        f"Cross-validated R²: {value}{range_}, over {r2['folds']} folds. {verdict(r2)}",
        f"Noise of one reward (standard deviation, mIoU points): {noise['model']:.2f} from the model, whose "
        f"error is {r2['error']:.2f} on rewards that it has not seen; {repeats}.",
        "If all attributes were uniform over their ranges, the signal would be "
        f"{signal} % of the rewards' variance ({signal_range}), and interactions {interactions} % of the "
        f"signal ({interactions_range}).",
        "",
        "Shares are Sobol indices of the expected model with intervals of its posterior: an attribute whose "
        "interval starts at 0.0 may have no effect. Best value and gain (from the worst to the best value) "
        "are those of the attribute alone, averaged over all others.",
        "",
        *table(COLUMNS, ranked),
        "",
        f"The first {TOP_PAIRS} of {len(report['pairs'])} interactions:",
        "",
        *table(PAIRS, report["pairs"][:TOP_PAIRS]),
    ]  # fmt: skip
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Plot shares and main effects of all attributes, as PNG."""
    rows = report["attributes"]
    down = -(-len(rows) // ACROSS)
    # Margins are fixed, since an automatic layout takes ten seconds for so many axes.
    figure = plt.figure(figsize=(20, 2.5 * down + 0.8))
    left, right = figure.subfigures(1, 2, width_ratios=(1, 2.6), squeeze=False)[0]
    _bars(left, rows)
    _curves(right, report, down)
    note = "" if report["real"] else " (not real data)"
    r2 = number(report["r2"]["value"], ".2f") or "undefined"
    rewards = report["records"]["rewards"]
    figure.suptitle(f"{report['target']}{note}, {rewards} rewards, cross-validated R² {r2}")
    return png(figure, dpi=90)


def _bars(figure: Figure | SubFigure, rows: list[Report]) -> None:
    """Plot shares alone and with interactions, with their intervals, the largest on top."""
    axis = figure.subplots(gridspec_kw={"left": 0.36, "right": 0.97, "bottom": 0.07, "top": 0.92})
    places = np.arange(len(rows))
    for offset, kind, label in ((-0.2, "share", "alone"), (0.2, "total", "with interactions")):
        values = np.array([row[kind]["value"] for row in rows])
        ends = np.array([row[kind]["ci95"] for row in rows]).T
        # The mean of a skewed posterior may lie outside its interval.
        wings = np.maximum([values - ends[0], ends[1] - values], 0)
        axis.barh(places + offset, values, 0.4, xerr=wings, label=label, error_kw={"lw": 0.8})
    axis.set_yticks(places, [words(row["name"]) for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set(xlabel="share of the reward's signal, %, 95 % intervals")
    axis.set_xlim(left=0)
    axis.legend(fontsize=8, loc="lower right")


def _curves(figure: Figure | SubFigure, report: Report, down: int) -> None:
    """Plot main effects of all attributes, in the order of the bars, on one scale of rewards."""
    margins = {"left": 0.05, "right": 0.99, "bottom": 0.05, "top": 0.92}
    spaces = {"hspace": 0.4, "wspace": 0.08}
    axes = figure.subplots(down, ACROSS, sharey=True, gridspec_kw=margins | spaces).ravel()
    for axis in axes[len(report["attributes"]) :]:
        axis.set_axis_off()
    unit = report["curves"]["unit"]
    for row, axis in zip(report["attributes"], axes, strict=False):
        curve = report["curves"][row["name"]]
        axis.fill_between(unit, curve["low"], curve["high"], alpha=0.3, lw=0)
        axis.plot(unit, curve["mean"])
        axis.axhline(0, color="0.7", lw=0.6)
        # Ticks are even in unit values and labelled in physical ones: some scales are logarithmic.
        ticks = [0, len(unit) // 2, len(unit) - 1]
        axis.set_xticks([unit[k] for k in ticks], [f"{curve['physical'][k]:.3g}" for k in ticks])
        axis.tick_params(labelsize=6)
        axis.set_title(f"{words(row['name'])}, {row['unit']}", fontsize=7)
    figure.supylabel("effect on mIoU, points, mean and 90 % band", fontsize=8)


FORM = Form("sensitivity", lambda report: report, text, {"sensitivity.png": picture})
"""The JSON holds all figures, but not the records."""
STUDY = Study(FORM, plan, scores)

if __name__ == "__main__":
    sys.exit(command("sensitivity"))
