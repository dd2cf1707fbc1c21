"""Analyse which attributes matter, alone and together, by a model of recorded rewards (`sobol`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.errors import UserError
from experiments.config.jobs import LEAST
from experiments.tables import sobol
from experiments.tables.form import Report
from experiments.tables.recorded import Records
from experiments.tables.stats import bootstrap
from scene.attributes import SPACES, Attribute, space_of

FOLDS = 5
DRAWS = 2000
"""Number of models drawn from the posterior."""
POINTS = 41
"""Number of unit values at which main effects are reported."""
DRAW_SEED = 0
"""Seed of folds, draws and the bootstrap."""
NO_PREDICTION = 0.05
"""A model with a cross-validated R^2 below this predicts nothing."""


def enough(records: Records, origin: str) -> Records:
    """Return the records if they suffice for a model.

    Raises:
        UserError: there are too few, or all rewards are equal.
    """
    rows = np.concatenate([records.centre, records.width], axis=1)
    different = len(np.unique(rows, axis=0))
    if different < LEAST:
        raise UserError(
            f"{origin} holds rewards of {different} proposals; a model needs {LEAST} or more"
        )
    if np.ptp(records.rewards) == 0:
        raise UserError(f"{origin}: all {len(rows)} rewards are equal, so no attribute matters")
    return records


def summarize(records: Records) -> Report:
    """Make what ``sensitivity.json`` says about the records; shares of variance are in percent.

    Attributes with the same value in all records are left out.

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
    shares = sobol.shares(layout, fitted.weights, weights)
    totals = [sobol.totals(layout, part) for part in (shares.effects, shares.drawn)]
    grid = np.linspace(0, 1, POINTS)
    curves = sobol.curves(layout, weights, grid)
    attributes = [
        {
            "name": attribute.name,
            "share": _percent(shares.effects[k], shares.drawn[:, k]),
            "total": _percent(totals[0][k], totals[1][:, k]),
            **_best(attribute, curves[:, k], grid),
        }
        for k, attribute in enumerate(rows)
    ]
    pairs = [
        {
            "names": [rows[i].name, rows[j].name],
            "share": _percent(shares.effects[k], shares.drawn[:, k]),
        }
        for k, (i, j) in enumerate(layout.pairs, count)
    ]
    together = [part[..., count:].sum(axis=-1) for part in (shares.effects, shares.drawn)]
    signal = [np.array(shares.signal), shares.drawn_signal]
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
    """Compute R^2 on proposals that the model has not seen, over all records.

    1 - sum (r - prediction)^2 / sum (r - mean)^2, with the interval of the bootstrap over proposals.
    """
    # All rewards of a proposal are in one fold, since they are alike.
    places = np.random.default_rng(DRAW_SEED).permutation(proposals.max() + 1)
    predictions = sobol.cross_validated(layout, x, rewards, places[proposals] % FOLDS)
    misfit = (rewards - predictions) ** 2

    records_of = np.split(
        np.argsort(proposals, kind="stable"), np.cumsum(np.bincount(proposals))[:-1]
    )

    def r2(resampled: np.ndarray) -> float:
        records = np.concatenate([records_of[k] for k in resampled])
        sample = rewards[records]
        square = ((sample - sample.mean()) ** 2).sum()
        return float(1 - misfit[records].sum() / square) if square > 0 else np.nan

    value, ci95 = bootstrap((len(records_of),), r2, DRAW_SEED)
    error = _round(np.sqrt(misfit.mean()))
    return {"value": value, "ci95": ci95, "error": error, "folds": FOLDS}


def _repeats(rewards: np.ndarray, proposals: np.ndarray) -> Report:
    """Compute the noise of proposals that were evaluated more than once, and its degrees of freedom."""
    counts = np.bincount(proposals)
    degrees = int((counts - 1).sum())
    if degrees == 0:
        return {"repeats": None, "degrees": 0}
    means = np.bincount(proposals, rewards) / counts
    square = float(((rewards - means[proposals]) ** 2).sum())
    return {"repeats": _round(np.sqrt(square / degrees)), "degrees": degrees}


def _best(attribute: Attribute, curves: np.ndarray, grid: np.ndarray) -> Report:
    """Find the maximum of a main effect f64[draws, points], and its range of rewards."""
    mean = curves.mean(axis=0)
    peaks = np.quantile(grid[curves.argmax(axis=1)], [0.05, 0.95])
    return {
        "best": _round(attribute.physical(float(grid[mean.argmax()]))),
        "range90": _rounded([attribute.physical(float(u)) for u in peaks]),
        "unit": attribute.unit,
        "worth": _round(np.ptp(mean)),
    }


def _percent(value: Any, samples: np.ndarray) -> Report:
    """Return a share and its 95 % interval in percent; the interval starts at 0 where the share may be 0."""
    ends = np.quantile(samples, [0.025, 0.975]).clip(0, 1)  # samples may lie outside [0, 1]
    return {"value": _round(100 * value), "ci95": _rounded(100 * ends)}


def _round(value: Any) -> float:
    return round(float(value), 4)


def _rounded(values: Any) -> list[float]:
    return [_round(value) for value in values]


def verdict(r2: Report) -> str:
    """Say what the cross-validated R^2 means for the other numbers."""
    if r2["value"] is None or r2["value"] < NO_PREDICTION:
        return (
            "**The model cannot predict rewards that it has not seen (R² near zero): these records "
            "say nothing about any attribute, and the ranking below is noise.**"
        )
    if r2["ci95"] is not None and r2["ci95"][0] < 0:
        return "The interval of R² contains zero: the ranking below is a guess."
    return "Shares are of what the model explains, without the noise."
