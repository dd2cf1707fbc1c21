"""Measure how well cheap rewards rank streets, compared with the full size, and their noise and cost.

    sdr-jax study fidelity --target camvid --data DIR --holdout 0006R0
    sdr-jax study fidelity --target twin --preset smoke                  # about a minute
    sdr-jax study fidelity --rungs 1 --require-signal 2 --reward.train.net fcn8s && ...  # then search

Proposals with random bins, the default street and random streets are evaluated at three sizes (rungs), from
the reward's to the final one, some of them with several seeds. The same command resumes a killed run.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from common.errors import UserError
from experiments.config import Fidelity
from experiments.config.cli import Unmet, command
from experiments.config.jobs import MOST_REPEATS, FidelityConfig
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.tables.bins import random_bins
from experiments.tables.form import (
    Column,
    Form,
    Report,
    about,
    estimate,
    interval,
    number,
    starts,
    table,
)
from experiments.tables.nets import by_row, jobs_of
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.skeleton import Study, do
from experiments.tables.stats import bootstrap, pairing, signal_to_noise, spearman
from scene.proposal import Streets
from seg.recipes import with_steps

FIDELITY_SEED = 10_000_000
"""The first seed, above those of a run's rows."""
ADDED = ("default", "random")
"""Proposals before those with random bins."""
BOOTSTRAP_SEED = 0
"""Seed of the intervals."""


def check(config: FidelityConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    most = config.proposals + len(ADDED)
    if config.repeated > most:
        raise UserError(
            f"--repeated must be {most} or less, the number of proposals, not {config.repeated}"
        )


class Rung(NamedTuple):
    """A measured reward."""

    name: str
    fidelity: Fidelity


def rungs(config: FidelityConfig) -> list[Rung]:
    """List the rungs from the reward's size to the final one."""
    low, high = config.reward, config.final
    sizes = tuple(dict.fromkeys((low, middle(low, high), high)))[: config.rungs]
    return [Rung(f"rung {k}", fidelity) for k, fidelity in enumerate(sizes, 1)]


def middle(low: Fidelity, high: Fidelity) -> Fidelity:
    """Return the fidelity halfway between two on a log scale, with network and rays of the higher one."""

    def between(a: int, b: int, unit: int = 1) -> int:
        return max(round(math.sqrt(a * b) / unit), 1) * unit

    return replace(
        high,
        width=between(low.width, high.width, 8),
        height=between(low.height, high.height, 8),
        streets=between(low.streets, high.streets),
        shots=between(low.shots, high.shots),
        train=with_steps(high.train, between(low.train.steps, high.train.steps)),
    )


def proposals(config: FidelityConfig) -> dict[str, Streets]:
    """Make the default street, random streets, and proposals with random bins, by name."""
    sampled = random_bins(config, config.proposals)
    return {
        **{name: config.streets(name) for name in ADDED},
        **{f"draw-{k}": proposal for k, proposal in enumerate(sampled, 1)},
    }


def plan(config: FidelityConfig, _: Any = None) -> list[Work]:
    """Plan the networks of every proposal on every rung."""
    nets = config.proposals + len(ADDED) + config.repeated * (config.repeats - 1)
    return [Work.at(rung.name, nets, rung.fidelity) for rung in rungs(config)]


def scores(run: Session[FidelityConfig], _: Any) -> Report:
    """Make all measurements, or the rest of them."""
    config, sources, ladder = run.config, proposals(run.config), rungs(run.config)
    return {
        **about(run, ladder[-1].fidelity),
        "seeds": config.repeats,
        "required_signal": config.require_signal,
        "proposals": len(sources),
        "repeated": config.repeated,
        "rungs": [_score(run, number, rung, sources) for number, rung in enumerate(ladder)],
    }


def _score(
    run: Session[FidelityConfig], number: int, rung: Rung, sources: dict[str, Streets]
) -> Report:
    """Score every proposal on one rung, in the order of the seeds, which all proposals share."""
    (name, fidelity), config = rung, run.config
    # Each rung has its own seeds: shared noise would look like agreement.
    first = FIDELITY_SEED + MOST_REPEATS * number + config.seed
    seeds = range(first, first + config.repeats)
    once = list(sources)[config.repeated :]
    recipe = run.recipe(fidelity)
    jobs = jobs_of(name, sources, recipe, seeds, side="reward", once=once)
    results = by_row(jobs, run.runner.test(jobs))
    return {
        "rung": name,
        "size": fidelity.size,
        "images": fidelity.images,
        "steps": fidelity.train.steps,
        "rewards": {
            name: [None if result.failed else 100 * result.reward for result in row]
            for name, row in results.items()
        },
        "core_seconds": float(np.median([r.seconds for row in results.values() for r in row])),
    }


def derive(report: Report) -> Report:
    """Add statistics of every rung's rewards, and a verdict on the first one's signal, to the report.

    The others are compared with the last rung; the signal is measured among proposals with random bins.
    Rewards are mIoU in percent.
    """
    rungs = [_derived(report, rung) for rung in report["rungs"]]
    signal, required = rungs[0]["signal_to_noise"]["value"], report.get("required_signal")
    fit = None if required is None else signal is not None and signal >= required
    return {**report, "rungs": rungs, "fit": fit}


def _derived(report: Report, rung: Report) -> Report:
    rewards = [np.array(values, float) for values in rung["rewards"].values()]  # None is NaN
    firsts, top = _firsts(rung), _firsts(report["rungs"][-1])
    valid = np.flatnonzero(np.isfinite(firsts) & np.isfinite(top))
    rank = bootstrap(
        (len(valid),), lambda k: spearman(firsts[valid[k]], top[valid[k]]), BOOTSTRAP_SEED
    )
    table = np.array(rewards[: report["repeated"]])
    table = table[np.isfinite(table).all(axis=1)]
    sampled = firsts[len(ADDED) :]
    signal = signal_to_noise(sampled[np.isfinite(sampled)], table, BOOTSTRAP_SEED)
    pairs = pairing(table)
    return {
        **rung,
        "failed": int(sum(np.isnan(values).sum() for values in rewards)),
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
    """Return every proposal's reward with the first seed f64[proposals], NaN if it failed."""
    return np.array([values[0] for values in rung["rewards"].values()], float)


def _ratio(row: Report) -> str:
    pairs = row["common_seeds"]
    return "" if pairs is None else number(pairs["ratio"], ".2f")


COLUMNS: list[Column] = [
    ("rung", lambda rung: rung["rung"]),
    ("size", lambda rung: rung["size"]),
    ("images", lambda rung: str(rung["images"])),
    ("steps", lambda rung: number(rung["steps"], "d")),
    ("core s", lambda rung: number(rung["core_seconds"])),
    *estimate(
        "rank correlation with the top", lambda rung: rung["rank_correlation"], ".2f", "value"
    ),
    ("noise (s.d.)", lambda rung: number(rung["noise"], ".3g")),
    *estimate("signal / noise", lambda rung: rung["signal_to_noise"], ".2f", "value"),
    ("var independent / common seeds", _ratio),
]


def text(report: Report) -> str:
    """Write the table in Markdown."""
    lines = [
        f"Target: {report['note']}. {report['proposals']} proposals, one network each on every rung; "
        f"{report['repeated']} of them {report['seeds']}.{starts(report)}",
        "Noise and signal are standard deviations of one reward over seeds, and of the true values of "
        "proposals with random bins; mIoU in percent.",
        "Rank correlations are between single rewards, so the noise of the top rung also lowers them. "
        "Seconds are the median, on one core of a worker.",
        "",
        *table(COLUMNS, report["rungs"]),
        "",
        *(f"- {line}" for rung in report["rungs"] for line in _sentences(rung)),
    ]
    if report["fit"] is not None:
        verdict = "is" if report["fit"] else "is NOT"
        first, times = report["rungs"][0]["rung"], f"{report['required_signal']:g}"
        lines.append(
            f"- {first}: the signal {verdict} at least {times} times the noise, as required."
        )
    failed = sum(rung["failed"] for rung in report["rungs"])
    if failed:
        lines.append(f"- Evaluations left out because they failed: {failed}.")
    return "\n".join(lines)


def _sentences(rung: Report) -> list[str]:
    """Write sentences on a rung's numbers."""
    sentences = []
    ci95 = rung["signal_to_noise"]["ci95"]
    if ci95 is not None:
        sentences.append(
            f"{rung['rung']}: the reward's signal is at least {ci95[0]:.1f} times its noise."
        )
    pairs = rung["common_seeds"]
    if pairs is not None and pairs["ratio"] is not None and pairs["p_value"] is not None:
        verdict = "help" if pairs["p_value"] < 0.05 else "do not help significantly"
        sentences.append(
            f"{rung['rung']}: common random numbers {verdict}: differences vary {pairs['ratio']:.2f} "
            f"times as much with independent seeds (F test, p = {pairs['p_value']:.2g})."
        )
    return sentences


def picture(report: Report) -> bytes:
    """Plot rewards on every rung against those on the top one; a single rung against itself."""
    top = report["rungs"][-1]
    below = report["rungs"][:-1] or [top]
    figure, axes = plt.subplots(
        1, len(below), figsize=(4.6 * len(below) + 0.4, 5), squeeze=False, layout="constrained"
    )
    for axis, rung in zip(axes[0], below, strict=True):
        _panel(axis, rung, top)
    axes[0, 0].legend(loc="best", fontsize=8)
    note = "" if report["real"] else " (not real data)"
    figure.suptitle(f"{report['target']}{note}: cheap rewards against the top rung's", fontsize=11)
    return png(figure)


def _panel(axis: Axes, rung: Report, top: Report) -> None:
    """Plot a point for each proposal with the first seed; bars are the noise of one reward."""
    x, y = _firsts(top), _firsts(rung)
    noise = axis.errorbar(x, y, rung["noise"], top["noise"], "none", ecolor="0.8", elinewidth=0.8)
    noise.set_label("noise, 1 s.d.")
    axis.scatter(x[len(ADDED) :], y[len(ADDED) :], s=18, zorder=3, label="random bins")
    for k, (marker, added) in enumerate(zip("sD", ADDED, strict=True)):
        axis.scatter(x[k], y[k], s=36, marker=marker, zorder=3, label=TRAINED_ON[added])
    name, rank, signal = rung["rung"], rung["rank_correlation"], rung["signal_to_noise"]
    cost = f"{rung['images']} images, {rung['core_seconds']:.0f} s a network"
    axis.set_title(
        f"{name}, {rung['size']}, {cost}\n"
        f"rank correlation {_with_interval(rank)}\nsignal / noise {_with_interval(signal)}",
        fontsize=9,
    )
    axis.set(xlabel=f"mIoU, % on {top['rung']}", ylabel=f"mIoU, % on {name}")


def _with_interval(measured: Report) -> str:
    ci95 = interval(measured["ci95"], ".2f")
    return f"{number(measured['value'], '.2f') or 'unknown'}{ci95 and f' ({ci95})'}"


FORM = Form("fidelity", derive, text, {"fidelity.png": picture})
STUDY = Study(FORM, plan, scores, check)


def measure(config: FidelityConfig) -> Report:
    """Do the whole study.

    Raises:
        UserError, DataError, WorkerError: as `do` does.
        Unmet: the signal is smaller than ``--require-signal``.
    """
    report = do(STUDY, config)
    if report["fit"] is False:
        first, times = report["rungs"][0], f"{report['required_signal']:g}"
        value = first["signal_to_noise"]["value"]
        signal = "unknown" if value is None else f"{value:.2f} times its noise"
        raise Unmet(f"--require-signal {times}: the signal of {first['rung']} is {signal}")
    return report


if __name__ == "__main__":
    sys.exit(command("fidelity"))
