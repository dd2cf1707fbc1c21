"""The fidelity of the rungs in figures: ``fidelity.json``, ``.md`` and ``.png``."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from experiments.fidelity.stats import pairing, signal_to_noise, spearman
from experiments.study.figure import plt, png
from experiments.study.form import Form, Report, interval, markdown, number, starts
from experiments.study.stats import bootstrap

ADDED = ("default", "random")
"""Proposals beside those with random bins; they come first."""
HEAD = (
    "rung", "size", "images", "steps", "reward", "core s", "rank correlation with the top",
    "95 % interval", "noise (s.d.)", "signal / noise", "95 % interval", "var independent / common seeds",
)  # fmt: skip
SEED = 0
"""Of the bootstrap."""


def derive(report: Report) -> Report:
    """The report with what every rung's rewards tell, and whether the first one's signal is enough.

    The last rung is what the others are compared with; the signal is measured among proposals with random
    bins. Rewards are mIoU in percent, or -MMD^2 as it is.
    """
    rungs = [_derived(report, rung) for rung in report["rungs"]]
    found, required = rungs[0]["signal_to_noise"]["value"], report.get("required_signal")
    fit = None if required is None else found is not None and found >= required
    return {**report, "rungs": rungs, "fit": fit}


def _derived(report: Report, rung: Report) -> Report:
    every = {name: np.array(own, float) for name, own in rung["rewards"].items()}  # None is NaN
    firsts, top = _firsts(rung), _firsts(report["rungs"][-1])
    known = np.flatnonzero(np.isfinite(firsts) & np.isfinite(top))
    rank = bootstrap((len(known),), lambda k: spearman(firsts[known[k]], top[known[k]]), SEED)
    table = np.array(list(every.values())[: report["repeated"]])
    table = table[np.isfinite(table).all(axis=1)]
    drawn = firsts[len(ADDED) :]
    signal = signal_to_noise(drawn[np.isfinite(drawn)], table, SEED)
    pairs = pairing(table)
    return {
        **rung,
        "failed": int(sum(np.isnan(own).sum() for own in every.values())),
        "rank_correlation": rank._asdict(),
        "noise": None if pairs is None else float(np.sqrt(pairs.independent / 2)),
        "signal_to_noise": signal._asdict(),
        "common_seeds": None
        if pairs is None
        else {
            "variance_common": pairs.common,
            "variance_independent": pairs.independent,
            "ratio": pairs.independent / pairs.common if pairs.common > 0 else None,
            "p_value": pairs.p_value if np.isfinite(pairs.p_value) else None,
        },
    }


def _firsts(rung: Report) -> np.ndarray:
    """Every proposal's reward with the first seed f64[proposals], NaN where it failed."""
    return np.array([own[0] for own in rung["rewards"].values()], float)


def text(report: Report) -> str:
    """The table, in Markdown."""
    lines = [
        f"Target: {report['note']}. {report['proposals']} proposals, one net each on every rung; "
        f"{report['repeated']} of them {report['seeds']}.{starts(report)}",
        "Noise and signal are standard deviations of one reward, over seeds and over what proposals with "
        "random bins are worth; mIoU in percent.",
        "Rank correlations are between single rewards, so the noise of the top rung lowers them, too. "
        "Seconds are the median, on one core of a worker.",
        "",
        *markdown(HEAD, [_cells(rung) for rung in report["rungs"]]),
        "",
        *(f"- {line}" for rung in report["rungs"] for line in _sentences(rung)),
    ]
    if report["fit"] is not None:
        verdict = "is" if report["fit"] else "is NOT"
        first, times = report["rungs"][0]["rung"], f"{report['required_signal']:g}"
        lines.append(
            f"- {first}: the signal {verdict} {times} times the noise or more, as was demanded."
        )
    failed = sum(rung["failed"] for rung in report["rungs"])
    if failed:
        lines.append(f"- {failed} evaluations failed and are left out.")
    return "\n".join(lines)


def _cells(rung: Report) -> list[str]:
    rank, signal, pairs = rung["rank_correlation"], rung["signal_to_noise"], rung["common_seeds"]
    return [
        rung["rung"],
        rung["size"],
        str(rung["images"]),
        number(rung["steps"], "d"),
        rung["reward"],
        number(rung["core_seconds"]),
        number(rank["value"], ".2f"),
        interval(rank["ci95"], ".2f"),
        number(rung["noise"], ".3g"),
        number(signal["value"], ".2f"),
        interval(signal["ci95"], ".2f"),
        "" if pairs is None else number(pairs["ratio"], ".2f"),
    ]


def _sentences(rung: Report) -> list[str]:
    """What a rung's figures say."""
    said = []
    ci95 = rung["signal_to_noise"]["ci95"]
    if ci95 is not None:
        said.append(
            f"{rung['rung']}: the reward's signal is at least {ci95[0]:.1f} times its noise."
        )
    pairs = rung["common_seeds"]
    if pairs is not None and pairs["ratio"] is not None and pairs["p_value"] is not None:
        verdict = "pay" if pairs["p_value"] < 0.05 else "do not surely pay"
        said.append(
            f"{rung['rung']}: common random numbers {verdict}: differences vary {pairs['ratio']:.2f} "
            f"times as much with independent seeds (F test, p = {pairs['p_value']:.2g})."
        )
    return said


def figure(report: Report) -> bytes:
    """Rewards on every rung against those on the top one; a lone rung stands against itself."""
    top = report["rungs"][-1]
    below = report["rungs"][:-1] or [top]
    whole, row = plt.subplots(
        1, len(below), figsize=(4.6 * len(below) + 0.4, 5), squeeze=False, layout="constrained"
    )
    for axis, rung in zip(row[0], below, strict=True):
        _panel(axis, rung, top)
    row[0, 0].legend(loc="best", fontsize=8)
    note = "" if report["real"] else " (not real data)"
    whole.suptitle(f"{report['target']}{note}: cheap rewards against those of the top", fontsize=11)
    return png(whole)


def _panel(axis: Axes, rung: Report, top: Report) -> None:
    """One point a proposal, the nets of the first seed; bars are the noise of one reward."""
    x, y = _firsts(top), _firsts(rung)
    noise = axis.errorbar(x, y, rung["noise"], top["noise"], "none", ecolor="0.8", elinewidth=0.8)
    noise.set_label("noise, 1 s.d.")
    axis.scatter(x[len(ADDED) :], y[len(ADDED) :], s=18, zorder=3, label="random bins")
    for k, (marker, label) in enumerate((("s", "set by eye"), ("D", "random attributes"))):
        axis.scatter(x[k], y[k], s=36, marker=marker, zorder=3, label=label)
    name, rank, signal = rung["rung"], rung["rank_correlation"], rung["signal_to_noise"]
    cost = f"{rung['images']} images, {rung['core_seconds']:.0f} s a net"
    axis.set_title(
        f"{name}, {rung['size']}, {cost}\n"
        f"rank correlation {_told(rank)}\nsignal / noise {_told(signal)}",
        fontsize=9,
    )
    axis.set(xlabel=f"{_unit(top)} on {top['rung']}", ylabel=f"{_unit(rung)} on {name}")


def _told(estimate: Report) -> str:
    ci95 = interval(estimate["ci95"], ".2f")
    return f"{number(estimate['value'], '.2f') or 'unknown'}{ci95 and f' ({ci95})'}"


def _unit(rung: Report) -> str:
    return f"{rung['reward']}, %" if rung["reward"] == "mIoU" else rung["reward"]


FORM = Form("fidelity", derive, text, {"fidelity.png": figure})
