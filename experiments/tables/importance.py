"""Which attributes matter for recorded rewards, alone and together, by a model of the rewards (`sobol`)."""

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
NOTHING = 0.05
"""A cross-validated R^2 below this means no prediction."""


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
