"""Which attributes matter, in figures: ``sensitivity.json``, ``.md`` and ``.png``."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.sensitivity import model
from experiments.sensitivity.picture import picture
from experiments.sensitivity.records import Records
from experiments.study.form import Form, Report, interval, markdown, number, words
from experiments.study.stats import bootstrap
from scene.attributes import SPACES, Attribute, space_of

FOLDS = 5
DRAWS = 2000
"""Models drawn from the posterior."""
POINTS = 41
"""Unit values at which main effects are told."""
SEED = 0
"""Of folds, draws and the bootstrap."""
NOTHING = 0.05
"""A cross-validated R^2 below this is as good as none."""
HEAD = (
    "rank", "attribute", "share alone, %", "95 % interval", "with interactions, %", "95 % interval",
    "best value", "90 % range", "worth, mIoU points",
)  # fmt: skip
TOP_PAIRS = 10


def summarize(records: Records) -> Report:
    """What ``sensitivity.json`` says of the records; shares of variance in percent.

    Args:
        records: of one configuration; their rewards differ.
    """
    rows = SPACES[space_of(records.centre.shape[1])]
    count = len(rows)
    layout = model.lay_out(count)
    x = model.features(layout, records.centre, records.width)
    proposals = _proposals(records)
    fitted = model.fit(layout, x, records.rewards)
    weights = model.draw_weights(fitted, DRAWS, SEED)
    found = model.shares(layout, fitted.weights, weights)
    totals = [model.totals(layout, part) for part in (found.effects, found.drawn)]
    grid = np.linspace(0, 1, POINTS)
    curves = model.curves(layout, weights, grid)
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
    signal = [found.signal * part.sum(axis=-1) for part in (found.effects, found.drawn)]
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
    """A number i[n] for each record, the same for the same attributes."""
    rows = np.concatenate([records.centre, records.width], axis=1)
    return np.unique(rows, axis=0, return_inverse=True)[1].ravel()


def _cross_validated(
    layout: model.Layout, x: np.ndarray, rewards: np.ndarray, proposals: np.ndarray
) -> Report:
    """R^2 on proposals that the model has not seen, over the records as they lie.

    1 - sum (r - prediction)^2 / sum (r - mean)^2, with the interval of the bootstrap over records.
    """
    # All rewards of a proposal are in one fold: a model that has seen one of them knows the others.
    places = np.random.default_rng(SEED).permutation(proposals.max() + 1)
    predicted = model.cross_validated(layout, x, rewards, places[proposals] % FOLDS)
    misfit = (rewards - predicted) ** 2

    def r2(chosen: np.ndarray) -> float:
        own = rewards[chosen]
        square = ((own - own.mean()) ** 2).sum()
        return float(1 - misfit[chosen].sum() / square) if square > 0 else np.nan

    value, ci95 = bootstrap((len(rewards),), r2, SEED)
    error = _round(np.sqrt(misfit.mean()))
    return {"value": value, "ci95": ci95, "error": error, "folds": FOLDS}


def _repeats(rewards: np.ndarray, proposals: np.ndarray) -> Report:
    """The noise that proposals scored more than once show, and how many degrees of freedom it has."""
    counts = np.bincount(proposals)
    degrees = int((counts - 1).sum())
    if degrees == 0:
        return {"repeats": None, "degrees": 0}
    means = np.bincount(proposals, rewards) / counts
    square = float(((rewards - means[proposals]) ** 2).sum())
    return {"repeats": _round(np.sqrt(square / degrees)), "degrees": degrees}


def _best(attribute: Attribute, curves: np.ndarray, grid: np.ndarray) -> Report:
    """Where a main effect f64[draws, points] is highest, and how much it moves the reward."""
    mean = curves.mean(axis=0)
    peaks = np.quantile(grid[curves.argmax(axis=1)], [0.05, 0.95])
    return {
        "best": _round(attribute.physical(float(grid[mean.argmax()]))),
        "range90": _rounded([attribute.physical(float(u)) for u in peaks]),
        "unit": attribute.unit,
        "worth": _round(np.ptp(mean)),
    }


def _percent(value: Any, drawn: np.ndarray) -> Report:
    """A share and the 95 % interval of its draws, in percent; what cannot be told from 0 begins there."""
    ends = np.quantile(drawn, [0.025, 0.975]).clip(0, 1)  # draws scatter around the expected model
    return {"value": _round(100 * value), "ci95": _rounded(100 * ends)}


def _round(value: Any) -> float:
    return round(float(value), 4)


def _rounded(values: Any) -> list[float]:
    return [_round(value) for value in values]


def _share(share: Report) -> list[str]:
    return [number(share["value"]), interval(share["ci95"])]


def verdict(r2: Report) -> str:
    """What the cross-validated R^2 says about all the rest."""
    if r2["value"] is None or r2["value"] < NOTHING:
        return (
            "**The model predicts no reward that it has not seen (R² near zero): from these records "
            "nothing is known about any attribute, and the ranking below is one of chance.**"
        )
    if r2["ci95"] is not None and r2["ci95"][0] < 0:
        return "The interval of R² holds zero: take the ranking below for a guess."
    return "Shares tell apart what the model explains, not the noise."


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
    signal, interactions = _share(report["signal"]), _share(report["interactions"])
    lines = [
        f"Target: {report['note']}. {records['rewards']} rewards of {records['proposals']} proposals"
        f"{failed}, mean {records['mean']:.1f}, standard deviation {records['sd']:.2f} mIoU points: "
        f"{records['words']}.",
        *(f"Left aside: {aside}." for aside in records["left_aside"]),
        "",
        f"Cross-validated R²: {value}{between}, over {r2['folds']} folds. {verdict(r2)}",
        f"Noise of one reward (standard deviation, mIoU points): {noise['model']:.2f} by the model, which "
        f"is off by {r2['error']:.2f} on rewards that it has not seen; "
        f"{repeats}.",
        f"Were all attributes uniform over their ranges, the signal would be {signal[0]} % of the "
        f"rewards' variance ({signal[1]}), and interactions {interactions[0]} % of the signal "
        f"({interactions[1]}).",
        "",
        "Shares are Sobol indices of the expected model, their intervals those of its posterior: where one "
        "begins at 0.0, the attribute may do nothing. Best values are of the attribute alone, averaged "
        "over all others; what it is worth is the way from its worst to its best value.",
        "",
        *markdown(HEAD, [_attribute(k, row) for k, row in enumerate(report["attributes"], 1)]),
        "",
        f"The first {TOP_PAIRS} of {len(report['pairs'])} interactions:",
        "",
        *markdown(
            ("attributes", "share, %", "95 % interval"),
            [
                [" × ".join(map(words, row["names"])), *_share(row["share"])]
                for row in report["pairs"][:TOP_PAIRS]
            ],
        ),
    ]  # fmt: skip
    return "\n".join(lines)


def _attribute(rank: int, row: Report) -> list[str]:
    low, high = row["range90"]
    return [
        str(rank),
        words(row["name"]),
        *_share(row["share"]),
        *_share(row["total"]),
        f"{row['best']:.3g} {row['unit']}",
        f"{low:.3g} to {high:.3g}",
        f"{row['worth']:.1f}",
    ]


FORM = Form("sensitivity", lambda report: report, text, {"sensitivity.png": picture})
"""All that is told is in the JSON; the records themselves are not."""
