"""The comparison in figures: ``compare.json``, ``compare.md`` and ``compare.png``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import sdr_jax
from experiments.compare_config import RANDOM, CompareConfig, subset_title
from experiments.compare_picture import picture
from experiments.compare_search import Found, Name
from experiments.config import Stage
from experiments.folder import write_atomically, write_json
from experiments.outcome import Outcome
from experiments.stats import mean_ci95, paired_gain
from experiments.targets import Target
from scene.attributes import NAMES

HEAD = (
    "attributes", "method", "mIoU, %", "95 % interval", "gain over random", "95 % interval",
    "rewards", "reward, first third", "last third", "rewards, core s", "wall s",
    "method, CPU s", "wall s",
)  # fmt: skip


def write(report: dict[str, Any], folder: Path) -> None:
    """Write all three files into the folder."""
    write_atomically(folder / "compare.md", text(report) + "\n")
    write_atomically(folder / "compare.png", picture(report))
    write_json(folder / "compare.json", report)


def summarize(
    config: CompareConfig,
    target: Target,
    rows: Sequence[Name],
    found: dict[Name, Found],
    scores: Sequence[tuple[Stage, dict[Name, list[Outcome]]]],
) -> dict[str, Any]:
    """What ``compare.json`` holds.

    Args:
        config: what was compared.
        target: what the nets must be good on.
        rows: methods and subsets, in the order of the table.
        found: every search; random attributes need none.
        scores: nets of every row, paired, at each budget, the final one last; empty without finals.
    """
    workers = max(config.workers, 1)

    def at(nets: dict[Name, list[Outcome]], name: Name) -> dict[str, Any]:
        return _nets(nets[name], nets.get((RANDOM, name[1])))

    return {
        "target": target.name,
        "real": target.real,
        "note": target.title,
        "preset": config.preset,
        "evaluations": config.evaluations,
        "workers": workers,
        "rewards_at": f"{config.reward.width}x{config.reward.height}",
        "scored_at": f"{config.final.width}x{config.final.height}",
        "seeds": config.seeds if config.finals else 0,
        "budgets": [_budget(stage) for stage, _ in scores],
        "rows": [
            {
                "attributes": len(name[1]),
                "subset": subset_title(name[1]),
                "method": name[0],
                "search": _search(found.get(name), name[1], workers),
                "final": at(scores[-1][1], name) if scores else None,
                "budgets": [at(nets, name) for _, nets in scores],
            }
            for name in rows
        ],
    }


def _search(found: Found | None, subset: Sequence[str], workers: int) -> dict[str, Any] | None:
    """One search; rewards in percent, None where they failed."""
    if found is None:
        return None
    rewards = [None if o.failed else 100 * o.reward for o in found.outcomes]
    third = max(len(rewards) // 3, 1)
    core = sum(o.seconds for o in found.outcomes)
    return {
        "evaluations": len(rewards),
        "failed": sum(r is None for r in rewards),
        "rewards": rewards,
        "first_third": _mean(rewards[:third]),
        "last_third": _mean(rewards[-third:]),
        # A worker has one core of its own; what another run had scored counts as if done here.
        "reward_seconds": {"core": round(core, 2), "wall": round(core / workers, 2)},
        "method_seconds": {
            "cpu": round(found.cpu_seconds, 2),
            "wall": round(found.wall_seconds, 2),
        },
        "solution": _solution(found.solution, subset),
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


def _solution(proposal: sdr_jax.Proposal, subset: Sequence[str]) -> dict[str, dict[str, float]]:
    where = {name: NAMES.index(name) for name in subset}
    return {
        name: {
            "centre": round(float(proposal.centre[k]), 6),
            "width": round(float(proposal.width[k]), 6),
        }
        for name, k in where.items()
    }


def _budget(stage: Stage) -> str:
    """A stage in a few words."""
    return f"{stage.width}x{stage.height}, {stage.images} images, {stage.train.steps} steps"


def _nets(ours: list[Outcome], random: list[Outcome] | None) -> dict[str, Any]:
    """Nets at one budget, in percent; a seed whose net failed is left out of what it enters."""
    miou = [None if o.failed else 100 * o.reward for o in ours]
    known = [v for v in miou if v is not None]
    mean, ci95 = mean_ci95(known) if known else (None, None)
    gain = None
    if random is not None:
        pairs = [
            (100 * a.reward, 100 * b.reward)
            for a, b in zip(ours, random, strict=True)
            if not (a.failed or b.failed)
        ]
        if pairs:
            value, interval = paired_gain([a for a, _ in pairs], [b for _, b in pairs])
            gain = {"mean": value, "ci95": interval}
    return {"miou": miou, "mean": mean, "ci95": ci95, "gain": gain}


def _interval(ci95: Sequence[float] | None) -> str:
    return "" if ci95 is None else f"{ci95[0]:.1f} to {ci95[1]:.1f}"


def _number(value: float | None, form: str = ".1f") -> str:
    return "" if value is None else format(value, form)


def _cells(row: dict[str, Any]) -> list[str]:
    search, final = row["search"] or {}, row["final"] or {}
    gain = (final.get("gain") or {}) if row["method"] != RANDOM else {}
    rewards, method = search.get("reward_seconds", {}), search.get("method_seconds", {})
    return [
        str(row["attributes"]),
        row["method"].replace("_", " "),
        _number(final.get("mean")),
        _interval(final.get("ci95")),
        _number(gain.get("mean"), "+.1f"),
        _interval(gain.get("ci95")),
        str(search.get("evaluations", 0)),
        _number(search.get("first_third")),
        _number(search.get("last_third")),
        _number(rewards.get("core"), ".0f"),
        _number(rewards.get("wall"), ".0f"),
        _number(method.get("cpu")),
        _number(method.get("wall")),
    ]


def _budgets(report: dict[str, Any]) -> list[str]:
    """How the gain over random attributes behaves from the cheapest to the final budget."""
    rows = [row for row in report["rows"] if row["method"] != RANDOM]
    if len(report["budgets"]) < 2 or not any(b["gain"] for row in rows for b in row["budgets"]):
        return []
    head = ("attributes", "method", *report["budgets"])
    lines = [
        "",
        "Gain over random attributes on the test images, with the 95 % interval, from the reward's budget "
        "to the final one:",
        "",
        "| " + " | ".join(head) + " |",
        "| " + " | ".join("---" for _ in head) + " |",
    ]
    for row in rows:
        gains = [budget["gain"] or {} for budget in row["budgets"]]
        cells = [f"{_number(g.get('mean'), '+.1f')} ({_interval(g.get('ci95'))})" for g in gains]
        names = [str(row["attributes"]), row["method"].replace("_", " ")]
        lines.append("| " + " | ".join([*names, *cells]) + " |")
    return lines


def text(report: dict[str, Any]) -> str:
    """The table, in Markdown."""
    lines = [
        f"Target: {report['note']}. Rewards are mIoU at {report['rewards_at']} on the reward images; "
        f"final nets are scored at {report['scored_at']} on the test images, {report['seeds']} "
        "paired seeds.",
        "Each search ran once, and intervals are over seeds of the final nets. Rewards take a core of "
        f"a worker each; their wall time is that over {report['workers']} worker(s). "
        "A method's own time includes compiling it.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "| " + " | ".join("---" for _ in HEAD) + " |",
    ]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in report["rows"]]
    lines += _budgets(report)
    failed = sum((row["search"] or {}).get("failed", 0) for row in report["rows"])
    if failed:
        lines += [
            "",
            f"{failed} evaluations failed; methods were told their update's lowest reward.",
        ]
    return "\n".join(lines)
