"""Finds from recorded rewards which of the 23 attributes matter, and which of them together.

    sdr-jax study sensitivity --target camvid --records benchmarks/data/camvid.jsonl
    sdr-jax study sensitivity --target camvid --data DIR --holdout 0006R0 --store FILE
    sdr-jax study sensitivity --target twin --preset smoke                # a minute or two

With --records nothing is rendered and no data are needed. Otherwise rewards come from the store and the run
folder, and missing ones are made first. The same command continues a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.figure import Figure, SubFigure

from common import folder
from common.errors import UserError
from experiments.config.cli import command
from experiments.config.studies import LEAST, SensitivityConfig
from experiments.evaluation.cost import cost_of
from experiments.evaluation.job import Job, Result
from experiments.evaluation.job import verdict as told
from experiments.evaluation.runner import refuse_failed
from experiments.run.context import FREE_FIELDS, PACKAGES, Run, Work
from experiments.study import sobol
from experiments.study.bins import random_bins
from experiments.study.figure import plt, png
from experiments.study.form import (
    Column,
    Form,
    Report,
    interval,
    number,
    starts,
    table,
    words,
    write_report,
)
from experiments.study.records import Records, choose, holds, read
from experiments.study.skeleton import Study, do
from experiments.study.skeleton import check as check_all
from experiments.study.stats import bootstrap
from scene.attributes import SPACES, Attribute, space_of
from scene.held import in_words
from scene.version import ENGINE

SENSITIVITY_SEED = 20_000_000
"""The first seed, above those of a run's rows and of the measurement of fidelity."""
FOLDS = 5
DRAWS = 2000
"""Number of models drawn from the posterior."""
POINTS = 41
"""Number of unit values at which main effects are reported."""
DRAW_SEED = 0
"""Seed of folds, draws and the bootstrap."""
NOTHING = 0.05
"""A cross-validated R^2 below this means no prediction."""
TOP_PAIRS = 10
ACROSS = 6
"""Number of panels in a row."""


def check(config: SensitivityConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if config.records_config is not None and not config.records:
        raise UserError("--records-config needs --records")


def analyse(config: SensitivityConfig) -> Report:
    """Do the whole study; with ``--records`` without a target or workers.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    if not config.records or config.rederive is not None:
        return do(STUDY, config)
    check_all(STUDY, config)
    where = ", ".join(map(str, config.records))
    records = enough(read(config.records, config, config.target_name, config.records_config), where)
    real = config.target != "twin"
    words = config.target if real else f"the {config.target_name}, NOT real data"
    plain = {"engine": ENGINE, **asdict(config)}
    with folder.opened(config.out, plain, free=FREE_FIELDS, packages=PACKAGES):
        scores = _report(config, real, f"{words}, recorded in {where}", records)
        report = write_report(FORM, scores, config.out)
    print(f"{FORM.text(report)}\n{config.out / 'sensitivity.md'}", flush=True)
    return report


def _report(config: SensitivityConfig, real: bool, note: str, records: Records) -> Report:
    said = {"target": config.target_name, "real": real, "note": note, "preset": config.preset}
    return {**said, "held": in_words(config.held), **summarize(records)}


def enough(records: Records, where: str) -> Records:
    """Return the records if they suffice.

    Raises:
        UserError: there are too few to fit a model, or all rewards are equal.
    """
    rows = np.concatenate([records.centre, records.width], axis=1)
    different = len(np.unique(rows, axis=0))
    if different < LEAST:
        raise UserError(
            f"{where} holds rewards of {different} proposals; {LEAST} are the least to fit a model to"
        )
    if np.ptp(records.rewards) == 0:
        raise UserError(f"{where}: all {len(rows)} rewards are equal, so no attribute matters")
    return records


def plan(config: SensitivityConfig, _: Any = None) -> list[Work]:
    """Plan all rewards at most; the store may have some."""
    return [Work.at("rewards of random attributes at most", config.evaluations, config.reward)]


def scores(run: Run[SensitivityConfig], _: Any) -> Report:
    """Make the missing rewards, and analyse all of them."""
    records = enough(record(run), str(run.config.out if run.store is None else run.store.path))
    return _report(run.config, run.target.real, run.target.title, records)


def record(run: Run[SensitivityConfig]) -> Records:
    """Make the missing rewards; return all at the reward's fidelity in the run's store and folder."""
    config = run.config
    recipe, first = run.recipe(config.reward), SENSITIVITY_SEED + config.seed
    jobs = [
        Job(recipe, proposal, first + k, {"nets": "sensitivity"}, "reward")
        for k, proposal in enumerate(random_bins(config, config.evaluations))
    ]
    # Rewards of other runs at this fidelity count, too.
    own = run.runner.about(jobs[0])["config"]
    drawn = {run.runner.key(job) for job in jobs}
    others = sum(
        line["config"] == own and None not in (line["reward"], line["centre"])
        for key, line in _known(run).items()
        if key not in drawn
    )
    wanted = jobs[: max(config.evaluations - others, 0)]
    run.progress.advance(cost_of(config.reward) * (len(jobs) - len(wanted)), replayed=True)

    def said(index: int, result: Result) -> str:
        return f"reward {index + 1}/{len(wanted)} | {told(result)}"

    refuse_failed(run.runner.run(wanted, say=said), len(wanted))
    return choose(_known(run).values(), run.target.name, config.space, own, str(config.out))


def _known(run: Run[SensitivityConfig]) -> dict[str, dict[str, Any]]:
    """The evaluations of store and run by key."""
    stored = [] if run.store is None else run.store.records
    lines = (*stored, *run.finals.records)
    return {line["key"]: line for line in lines if holds(line, run.config)}


def summarize(records: Records) -> Report:
    """The content of ``sensitivity.json`` on the records; shares of variance in percent.

    Attributes with the same value in all of them are left out.

    Args:
        records: records of one configuration, whose rewards differ.
    """
    held = ~records.width.any(axis=0) & (np.ptp(records.centre, axis=0) == 0)
    rows = [a for a, k in zip(SPACES[space_of(len(held))], held, strict=True) if not k]
    count = len(rows)
    layout = sobol.lay_out(count)
    x = sobol.features(layout, records.centre[:, ~held], records.width[:, ~held])
    proposals = _proposals(records)
    fitted = sobol.fit(layout, x, records.rewards)
    weights = sobol.draw_weights(fitted, DRAWS, DRAW_SEED)
    found = sobol.shares(layout, fitted.weights, weights)
    totals = [sobol.totals(layout, part) for part in (found.effects, found.drawn)]
    grid = np.linspace(0, 1, POINTS)
    curves = sobol.curves(layout, weights, grid)
    attributes = [
        {
            "name": attribute.name,
            "share": _percent(found.effects[k], found.drawn[:, k]),
            "total": _percent(totals[0][k], totals[1][:, k]),
            **_best(attribute, curves[:, k], grid),
        }
        for k, attribute in enumerate(rows)
    ]
    pairs = [
        {
            "names": [rows[i].name, rows[j].name],
            "share": _percent(found.effects[k], found.drawn[:, k]),
        }
        for k, (i, j) in enumerate(layout.pairs, count)
    ]
    together = [part[..., count:].sum(axis=-1) for part in (found.effects, found.drawn)]
    signal = [np.array(found.signal), found.drawn_signal]
    return {
        "records": {
            "config": records.config,
            "words": records.words,
            "left_aside": list(records.aside),
            "rewards": len(records.rewards),
            "proposals": int(proposals.max()) + 1,
            "failed": records.failed,
            "mean": _round(records.rewards.mean()),
            "sd": _round(records.rewards.std(ddof=1)),
        },
        "r2": _cross_validated(layout, x, records.rewards, proposals),
        "noise": {"model": _round(fitted.noise), **_repeats(records.rewards, proposals)},
        "signal": _percent(*(part / (part + fitted.noise**2) for part in signal)),
        "interactions": _percent(*together),
        "attributes": sorted(attributes, key=lambda row: -row["total"]["value"]),
        "pairs": sorted(pairs, key=lambda row: -row["share"]["value"]),
        "curves": {
            "unit": _rounded(grid),
            **{
                attribute.name: {
                    "physical": _rounded([attribute.physical(u) for u in grid]),
                    "mean": _rounded(curves[:, k].mean(axis=0)),
                    "low": _rounded(np.quantile(curves[:, k], 0.05, axis=0)),
                    "high": _rounded(np.quantile(curves[:, k], 0.95, axis=0)),
                }
                for k, attribute in enumerate(rows)
            },
        },
    }


def _proposals(records: Records) -> np.ndarray:
    """Number the records i[n]; the same attributes have the same number."""
    rows = np.concatenate([records.centre, records.width], axis=1)
    return np.unique(rows, axis=0, return_inverse=True)[1].ravel()


def _cross_validated(
    layout: sobol.Layout, x: np.ndarray, rewards: np.ndarray, proposals: np.ndarray
) -> Report:
    """R^2 on proposals that the model has not seen, over all records.

    1 - sum (r - prediction)^2 / sum (r - mean)^2, with the interval of the bootstrap over proposals.
    """
    # All rewards of a proposal are in one fold, since they are alike.
    places = np.random.default_rng(DRAW_SEED).permutation(proposals.max() + 1)
    predicted = sobol.cross_validated(layout, x, rewards, places[proposals] % FOLDS)
    misfit = (rewards - predicted) ** 2

    of = np.split(np.argsort(proposals, kind="stable"), np.cumsum(np.bincount(proposals))[:-1])

    def r2(drawn: np.ndarray) -> float:
        chosen = np.concatenate([of[k] for k in drawn])
        own = rewards[chosen]
        square = ((own - own.mean()) ** 2).sum()
        return float(1 - misfit[chosen].sum() / square) if square > 0 else np.nan

    value, ci95 = bootstrap((len(of),), r2, DRAW_SEED)
    error = _round(np.sqrt(misfit.mean()))
    return {"value": value, "ci95": ci95, "error": error, "folds": FOLDS}


def _repeats(rewards: np.ndarray, proposals: np.ndarray) -> Report:
    """The noise of proposals that were evaluated more than once, and its degrees of freedom."""
    counts = np.bincount(proposals)
    degrees = int((counts - 1).sum())
    if degrees == 0:
        return {"repeats": None, "degrees": 0}
    means = np.bincount(proposals, rewards) / counts
    square = float(((rewards - means[proposals]) ** 2).sum())
    return {"repeats": _round(np.sqrt(square / degrees)), "degrees": degrees}


def _best(attribute: Attribute, curves: np.ndarray, grid: np.ndarray) -> Report:
    """The place of a main effect's maximum f64[draws, points], and its range of rewards."""
    mean = curves.mean(axis=0)
    peaks = np.quantile(grid[curves.argmax(axis=1)], [0.05, 0.95])
    return {
        "best": _round(attribute.physical(float(grid[mean.argmax()]))),
        "range90": _rounded([attribute.physical(float(u)) for u in peaks]),
        "unit": attribute.unit,
        "worth": _round(np.ptp(mean)),
    }


def _percent(value: Any, drawn: np.ndarray) -> Report:
    """A share and the 95 % interval of its draws in percent, which begins at 0 if the share may be 0."""
    ends = np.quantile(drawn, [0.025, 0.975]).clip(0, 1)  # draws may lie outside [0, 1]
    return {"value": _round(100 * value), "ci95": _rounded(100 * ends)}


def _round(value: Any) -> float:
    return round(float(value), 4)


def _rounded(values: Any) -> list[float]:
    return [_round(value) for value in values]


def verdict(r2: Report) -> str:
    """A sentence on what the cross-validated R^2 means for the other figures."""
    if r2["value"] is None or r2["value"] < NOTHING:
        return (
            "**The model predicts no reward that it has not seen (R² near zero): from these records "
            "nothing is known about any attribute, and the ranking below is one of chance.**"
        )
    if r2["ci95"] is not None and r2["ci95"][0] < 0:
        return "The interval of R² holds zero: take the ranking below for a guess."
    return "Shares tell apart what the model explains, not the noise."


def _value(share: Report) -> str:
    return number(share["value"])


def _interval(share: Report) -> str:
    return interval(share["ci95"])


COLUMNS: list[Column] = [
    ("rank", lambda row: str(row["rank"])),
    ("attribute", lambda row: words(row["name"])),
    ("share alone, %", lambda row: _value(row["share"])),
    ("95 % interval", lambda row: _interval(row["share"])),
    ("with interactions, %", lambda row: _value(row["total"])),
    ("95 % interval", lambda row: _interval(row["total"])),
    ("best value", lambda row: f"{row['best']:.3g} {row['unit']}"),
    ("90 % range", lambda row: "{:.3g} to {:.3g}".format(*row["range90"])),
    ("worth, mIoU points", lambda row: f"{row['worth']:.1f}"),
]
PAIRS: list[Column] = [
    ("attributes", lambda row: " × ".join(map(words, row["names"]))),
    ("share, %", lambda row: _value(row["share"])),
    ("95 % interval", lambda row: _interval(row["share"])),
]


def text(report: Report) -> str:
    """The tables, in Markdown."""
    records, r2, noise = report["records"], report["r2"], report["noise"]
    failed = f", {records['failed']} failed ones left out" if records["failed"] else ""
    value, ci95 = number(r2["value"], ".2f") or "undefined", interval(r2["ci95"], ".2f")
    between = ci95 and f" (95 % interval {ci95})"
    repeats = "no proposal was scored twice"
    if noise["repeats"] is not None:
        repeats = (
            f"{noise['repeats']:.2f} by proposals scored more than once ({noise['degrees']} degrees of "
            "freedom)"
        )
    signal, interactions = report["signal"], report["interactions"]
    ranked = [{"rank": k, **row} for k, row in enumerate(report["attributes"], 1)]
    lines = [
        f"Target: {report['note']}. {records['rewards']} rewards of {records['proposals']} proposals"
        f"{failed}, mean {records['mean']:.1f}, standard deviation {records['sd']:.2f} mIoU points: "
        f"{records['words']}.",
        *(f"Left aside: {aside}." for aside in records["left_aside"]),
        *([starts(report).strip()] if starts(report) else []),
        "",
        f"Cross-validated R²: {value}{between}, over {r2['folds']} folds. {verdict(r2)}",
        f"Noise of one reward (standard deviation, mIoU points): {noise['model']:.2f} by the model, which "
        f"is off by {r2['error']:.2f} on rewards that it has not seen; "
        f"{repeats}.",
        f"Were all attributes uniform over their ranges, the signal would be {_value(signal)} % of the "
        f"rewards' variance ({_interval(signal)}), and interactions {_value(interactions)} % of the signal "
        f"({_interval(interactions)}).",
        "",
        "Shares are Sobol indices of the expected model, their intervals those of its posterior: where one "
        "begins at 0.0, the attribute may do nothing. Best values are of the attribute alone, averaged "
        "over all others; what it is worth is the way from its worst to its best value.",
        "",
        *table(COLUMNS, ranked),
        "",
        f"The first {TOP_PAIRS} of {len(report['pairs'])} interactions:",
        "",
        *table(PAIRS, report["pairs"][:TOP_PAIRS]),
    ]  # fmt: skip
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Draw the picture as PNG."""
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
    """Draw shares alone and with interactions, with their intervals, the largest on top."""
    axis = figure.subplots(gridspec_kw={"left": 0.36, "right": 0.97, "bottom": 0.07, "top": 0.92})
    places = np.arange(len(rows))
    for offset, kind, label in ((-0.2, "share", "alone"), (0.2, "total", "with interactions")):
        values = np.array([row[kind]["value"] for row in rows])
        ends = np.array([row[kind]["ci95"] for row in rows]).T
        # The mean of a skew posterior may lie outside its interval.
        wings = np.maximum([values - ends[0], ends[1] - values], 0)
        axis.barh(places + offset, values, 0.4, xerr=wings, label=label, error_kw={"lw": 0.8})
    axis.set_yticks(places, [words(row["name"]) for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set(xlabel="share of the reward's signal, %, 95 % intervals")
    axis.set_xlim(left=0)
    axis.legend(fontsize=8, loc="lower right")


def _curves(figure: Figure | SubFigure, report: Report, down: int) -> None:
    """Draw main effects of all attributes, in the order of the bars, on one scale of rewards."""
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
STUDY = Study(FORM, plan, scores, check)
RUN = analyse

if __name__ == "__main__":
    sys.exit(command("sensitivity"))
