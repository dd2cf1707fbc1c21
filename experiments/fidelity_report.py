"""The fidelity of the rungs in figures: ``fidelity.json`` and ``fidelity.md``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from experiments.config import Stage
from experiments.fidelity_stats import Estimate, bootstrap, pairing, signal_to_noise, spearman
from experiments.folder import write_atomically, write_json
from experiments.outcome import Outcome
from experiments.reward import REWARD_NAMES
from experiments.targets import Target

HEAD = (
    "rung", "size", "images", "steps", "reward", "core s", "rank correlation with the top",
    "95 % interval", "noise (s.d.)", "signal / noise", "95 % interval", "var independent / common seeds",
)  # fmt: skip
BOOTSTRAP_SEED = 0


class Level(NamedTuple):
    """One rung, and the reward that is measured on it."""

    name: str
    stage: Stage
    kind: Literal["miou", "mmd"]


def summarize(
    target: Target,
    preset: str,
    levels: Sequence[Level],
    names: Sequence[str],
    drawn: Sequence[str],
    repeated: Sequence[str],
    outcomes: Sequence[Mapping[str, Sequence[Outcome]]],
    required: float | None = None,
) -> dict[str, Any]:
    """What ``fidelity.json`` holds; mIoU in percent, -MMD^2 as it is.

    Args:
        target: what the nets must be good on.
        preset: where the sizes come from.
        levels: the rungs; the last is what the others are compared with.
        names: of all proposals.
        drawn: those with random bins, among which the signal is measured.
        repeated: those that were scored with more seeds than one.
        outcomes: of every level, by proposal, in the order of the seeds.
        required: how many times its noise the first rung's signal must be; ``fit`` then says whether it is.
    """
    first = [
        np.array([_value(level, found[name][0]) for name in names])
        for level, found in zip(levels, outcomes, strict=True)
    ]
    rungs = [
        _rung(level, found, firsts, first[-1], names, drawn, repeated)
        for level, found, firsts in zip(levels, outcomes, first, strict=True)
    ]
    found = rungs[0]["signal_to_noise"]["value"]
    return {
        "required_signal": required,
        "fit": None if required is None else found is not None and found >= required,
        "target": target.name,
        "real": target.real,
        "note": target.title,
        "preset": preset,
        "proposals": len(names),
        "repeated": len(repeated),
        "seeds": max(len(outcomes[0][name]) for name in names),
        "rungs": rungs,
    }


def _value(level: Level, outcome: Outcome) -> float:
    return outcome.reward * (100 if level.kind == "miou" else 1)


def _rung(
    level: Level,
    found: Mapping[str, Sequence[Outcome]],
    first: np.ndarray,
    top: np.ndarray,
    names: Sequence[str],
    drawn: Sequence[str],
    repeated: Sequence[str],
) -> dict[str, Any]:
    known = np.flatnonzero(np.isfinite(first) & np.isfinite(top))
    rank = bootstrap(
        (len(known),), lambda k: spearman(first[known[k]], top[known[k]]), BOOTSTRAP_SEED
    )
    table = np.array([[_value(level, o) for o in found[name]] for name in repeated])
    table = table[np.isfinite(table).all(axis=1)].reshape(-1, table.shape[1])
    own = np.array([first[names.index(name)] for name in drawn])
    snr = signal_to_noise(own[np.isfinite(own)], table, BOOTSTRAP_SEED)
    pairs = pairing(table)
    every = [outcome for name in names for outcome in found[name]]
    return {
        "rung": level.name,
        "reward": REWARD_NAMES[level.kind],
        "size": f"{level.stage.width}x{level.stage.height}",
        "images": level.stage.images,
        "steps": level.stage.train.steps if level.kind == "miou" else None,
        "core_seconds": float(np.median([o.seconds for o in every])),
        "failed": sum(o.failed is not None for o in every),
        "rank_correlation": _estimate(rank),
        "noise": None if pairs is None else float(np.sqrt(pairs.independent / 2)),
        "signal_to_noise": _estimate(snr),
        "common_seeds": None
        if pairs is None
        else {
            "variance_common": pairs.common,
            "variance_independent": pairs.independent,
            "ratio": pairs.independent / pairs.common if pairs.common > 0 else None,
            "p_value": pairs.p_value if np.isfinite(pairs.p_value) else None,
        },
        "rewards": {
            name: [None if o.failed else _value(level, o) for o in found[name]] for name in names
        },
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "ci95": estimate.ci95}


def _number(value: float | None, form: str = ".2f") -> str:
    return "" if value is None else format(value, form)


def _interval(ci95: Sequence[float] | None) -> str:
    return "" if ci95 is None else f"{ci95[0]:.2f} to {ci95[1]:.2f}"


def _cells(rung: dict[str, Any]) -> list[str]:
    rank, snr, pairs = rung["rank_correlation"], rung["signal_to_noise"], rung["common_seeds"]
    return [
        rung["rung"],
        rung["size"],
        str(rung["images"]),
        "" if rung["steps"] is None else str(rung["steps"]),
        rung["reward"],
        _number(rung["core_seconds"], ".1f"),
        _number(rank["value"]),
        _interval(rank["ci95"]),
        _number(rung["noise"], ".3g"),
        _number(snr["value"]),
        _interval(snr["ci95"]),
        "" if pairs is None else _number(pairs["ratio"]),
    ]


def _sentences(rung: dict[str, Any]) -> list[str]:
    """What a rung's figures say."""
    said = []
    interval = rung["signal_to_noise"]["ci95"]
    if interval is not None:
        said.append(
            f"{rung['rung']}: the reward's signal is at least {interval[0]:.1f} times its noise."
        )
    pairs = rung["common_seeds"]
    if pairs is not None and pairs["ratio"] is not None and pairs["p_value"] is not None:
        verdict = "pay" if pairs["p_value"] < 0.05 else "do not surely pay"
        said.append(
            f"{rung['rung']}: common random numbers {verdict}: differences vary {pairs['ratio']:.2f} "
            f"times as much with independent seeds (F test, p = {pairs['p_value']:.2g})."
        )
    return said


def text(report: dict[str, Any]) -> str:
    """The table, in Markdown."""
    lines = [
        f"Target: {report['note']}. {report['proposals']} proposals, one net each on every rung; "
        f"{report['repeated']} of them {report['seeds']}.",
        "Noise and signal are standard deviations of one reward, over seeds and over what proposals with "
        "random bins are worth; mIoU in percent.",
        "Rank correlations are between single rewards, so the noise of the top rung lowers them, too. "
        "Seconds are the median, on one core of a worker.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "| " + " | ".join("---" for _ in HEAD) + " |",
        *("| " + " | ".join(_cells(rung)) + " |" for rung in report["rungs"]),
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


def write(report: dict[str, Any], folder: Path) -> None:
    """Write both files into the folder."""
    write_atomically(folder / "fidelity.md", text(report) + "\n")
    write_json(folder / "fidelity.json", report)
