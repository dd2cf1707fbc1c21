"""Measures a cheap reward: its ranking of attributes against that of the full size, its noise and its cost.

    sdr-jax study fidelity --target camvid --data DIR --holdout 0006R0
    sdr-jax study fidelity --target twin --preset smoke                  # about a minute
    sdr-jax study fidelity --target twin --reward-kind mmd               # without labels
    sdr-jax study fidelity --rungs 1 --require-signal 2 --reward.train.net fcn8s && ...  # then search

Proposals with random bins, the hand-set street and random attributes are evaluated at three sizes, the
rungs, from the reward's to the final one, some of them with several seeds. The same
command continues a killed run.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from common.errors import UserError
from experiments.config import (
    Fidelity,
    RewardKind,
)
from experiments.config.cli import Unmet, command
from experiments.config.jobs import MOST_REPEATS, FidelityConfig
from experiments.evaluation.job import REWARD_NAMES
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.tables.bins import random_bins
from experiments.tables.form import Column, Form, Report, about, interval, number, starts, table
from experiments.tables.nets import by_row, jobs_of
from experiments.tables.skeleton import Study, do
from experiments.tables.stats import bootstrap, pairing, signal_to_noise, spearman
from scene.proposal import Proposal
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
    kind: RewardKind


def rungs(config: FidelityConfig) -> list[Rung]:
    """The rungs from the reward's size to the final one; -MMD^2 is compared with mIoU there."""
    kind = config.reward_kind
    low, high = config.reward, config.final
    steps = tuple(dict.fromkeys((low, middle(low, high), high)))[: config.rungs]
    found = [Rung(f"rung {k}", fidelity, kind) for k, fidelity in enumerate(steps, 1)]
    if kind != "miou" and config.rungs is None:
        found.append(Rung("final nets", config.final, "miou"))
    return found


def middle(low: Fidelity, high: Fidelity) -> Fidelity:
    """The fidelity half way between two on a logarithmic scale, with net and rays of the higher one."""

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


def proposals(config: FidelityConfig) -> dict[str, Proposal]:
    """The hand-set street, random attributes, and draws with random bins, by name."""
    added = (config.streets(name) for name in ADDED)
    drawn = enumerate(random_bins(config, config.proposals), 1)
    return {**dict(zip(ADDED, added, strict=True)), **{f"draw-{k}": own for k, own in drawn}}


def plan(config: FidelityConfig, _: Any = None) -> list[Work]:
    """The nets of every proposal on every rung."""
    nets = config.proposals + len(ADDED) + config.repeated * (config.repeats - 1)
    return [Work.at(rung.name, nets, rung.fidelity) for rung in rungs(config)]


def scores(run: Session[FidelityConfig], _: Any) -> Report:
    """Make all measurements, or the rest of them."""
    config, chosen, steps = run.config, proposals(run.config), rungs(run.config)
    return {
        **about(run, steps[-1].fidelity),
        "seeds": config.repeats,
        "required_signal": config.require_signal,
        "proposals": len(chosen),
        "repeated": config.repeated,
        "rungs": [_score(run, number, rung, chosen) for number, rung in enumerate(steps)],
    }


def _score(
    run: Session[FidelityConfig], number: int, rung: Rung, chosen: dict[str, Proposal]
) -> Report:
    """Rewards of every proposal on one rung, in the order of the seeds, which all proposals share."""
    (name, fidelity, kind), config = rung, run.config
    # Each rung has other seeds: shared noise would look like agreement.
    first = FIDELITY_SEED + MOST_REPEATS * number + config.seed
    seeds = range(first, first + config.repeats)
    once = list(chosen)[config.repeated :]
    recipe = run.recipe(fidelity)
    jobs = jobs_of(name, chosen, recipe, seeds, side="reward", kind=kind, once=once)
    found = by_row(jobs, run.runner.test(jobs))
    unit = 100 if kind == "miou" else 1
    return {
        "rung": name,
        "reward": REWARD_NAMES[kind],
        "size": fidelity.size,
        "images": fidelity.images,
        "steps": fidelity.train.steps if kind == "miou" else None,
        "rewards": {
            name: [None if o.failed else unit * o.reward for o in outcomes]
            for name, outcomes in found.items()
        },
        "core_seconds": float(np.median([o.seconds for own in found.values() for o in own])),
    }


def derive(report: Report) -> Report:
    """Add statistics of every rung's rewards, and a verdict on the first one's signal, to the report.

    The others are compared with the last rung; the signal is measured among proposals with random bins.
    Rewards are mIoU in percent, or -MMD^2 as it is.
    """
    rungs = [_derived(report, rung) for rung in report["rungs"]]
    found, required = rungs[0]["signal_to_noise"]["value"], report.get("required_signal")
    fit = None if required is None else found is not None and found >= required
    return {**report, "rungs": rungs, "fit": fit}


def _derived(report: Report, rung: Report) -> Report:
    every = {name: np.array(own, float) for name, own in rung["rewards"].items()}  # None is NaN
    firsts, top = _firsts(rung), _firsts(report["rungs"][-1])
    known = np.flatnonzero(np.isfinite(firsts) & np.isfinite(top))
    rank = bootstrap(
        (len(known),), lambda k: spearman(firsts[known[k]], top[known[k]]), BOOTSTRAP_SEED
    )
    table = np.array(list(every.values())[: report["repeated"]])
    table = table[np.isfinite(table).all(axis=1)]
    drawn = firsts[len(ADDED) :]
    signal = signal_to_noise(drawn[np.isfinite(drawn)], table, BOOTSTRAP_SEED)
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
    """Every proposal's reward with the first seed f64[proposals], NaN if it failed."""
    return np.array([own[0] for own in rung["rewards"].values()], float)


def _value(row: Report, estimate: str) -> str:
    return number(row[estimate]["value"], ".2f")


def _interval(row: Report, estimate: str) -> str:
    return interval(row[estimate]["ci95"], ".2f")


def _ratio(row: Report) -> str:
    pairs = row["common_seeds"]
    return "" if pairs is None else number(pairs["ratio"], ".2f")


COLUMNS: list[Column] = [
    ("rung", lambda rung: rung["rung"]),
    ("size", lambda rung: rung["size"]),
    ("images", lambda rung: str(rung["images"])),
    ("steps", lambda rung: number(rung["steps"], "d")),
    ("reward", lambda rung: rung["reward"]),
    ("core s", lambda rung: number(rung["core_seconds"])),
    ("rank correlation with the top", lambda rung: _value(rung, "rank_correlation")),
    ("95 % interval", lambda rung: _interval(rung, "rank_correlation")),
    ("noise (s.d.)", lambda rung: number(rung["noise"], ".3g")),
    ("signal / noise", lambda rung: _value(rung, "signal_to_noise")),
    ("95 % interval", lambda rung: _interval(rung, "signal_to_noise")),
    ("var independent / common seeds", _ratio),
]


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
        *table(COLUMNS, report["rungs"]),
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


def _sentences(rung: Report) -> list[str]:
    """Sentences on a rung's figures."""
    said = []
    ci95 = rung["signal_to_noise"]["ci95"]
    if ci95 is not None:
        said.append(
            f"{rung['rung']}: the reward's signal is at least {ci95[0]:.1f} times its noise."
        )
    pairs = rung["common_seeds"]
    if pairs is not None and pairs["ratio"] is not None and pairs["p_value"] is not None:
        verdict = "pay" if pairs["p_value"] < 0.05 else "do not pay for certain"
        said.append(
            f"{rung['rung']}: common random numbers {verdict}: differences vary {pairs['ratio']:.2f} "
            f"times as much with independent seeds (F test, p = {pairs['p_value']:.2g})."
        )
    return said


def picture(report: Report) -> bytes:
    """Draw rewards on every rung against those on the top one; a single rung is drawn against itself."""
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
    """Draw a point for each proposal with the first seed; bars are the noise of one reward."""
    x, y = _firsts(top), _firsts(rung)
    noise = axis.errorbar(x, y, rung["noise"], top["noise"], "none", ecolor="0.8", elinewidth=0.8)
    noise.set_label("noise, 1 s.d.")
    axis.scatter(x[len(ADDED) :], y[len(ADDED) :], s=18, zorder=3, label="random bins")
    for k, (marker, label) in enumerate((("s", "hand-set"), ("D", "random attributes"))):
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


FORM = Form("fidelity", derive, text, {"fidelity.png": picture})
STUDY = Study(FORM, plan, scores, check)


def measure(config: FidelityConfig) -> Report:
    """Do the whole study.

    Raises:
        UserError, DataError, WorkerError: as `do` does.
        Unmet: the signal is smaller than ``--require-signal`` demands.
    """
    report = do(STUDY, config)
    if report["fit"] is False:
        first, times = report["rungs"][0], f"{report['required_signal']:g}"
        found = first["signal_to_noise"]["value"]
        known = "not known" if found is None else f"{found:.2f} times its noise"
        raise Unmet(f"--require-signal {times}: the signal of {first['rung']} is {known}")
    return report


RUN = measure

if __name__ == "__main__":
    sys.exit(command("fidelity"))
