"""The run's answer in figures: ``attributes.json`` and ``summary.json``, and the table that is printed."""

from __future__ import annotations

from typing import Any

import numpy as np

import sdr_jax
from experiments.config import Config
from experiments.finals import TRAINED_ON
from experiments.folder import RunFolder
from experiments.stats import mean_ci95, paired_gain
from experiments.targets import Target
from scene.attributes import ATTRIBUTES
from seg.classes import class_table


def attributes(proposal: sdr_jax.Proposal) -> dict[str, Any]:
    """Centre and interval of every attribute, in unit and physical values.

    Unit values are read back as the same float32: whoever trains on them draws the same streets.
    """
    rows = {}
    for attribute, centre, width in zip(
        ATTRIBUTES, proposal.centre.tolist(), proposal.width.tolist(), strict=True
    ):
        low, high = max(centre - width / 2, 0.0), min(centre + width / 2, 1.0)
        rows[attribute.name] = {
            "unit": {"centre": _float32(centre), "width": _float32(width)},
            "physical": {
                "centre": round(attribute.physical(centre), 4),
                "low": round(attribute.physical(low), 4),
                "high": round(attribute.physical(high), 4),
                "unit": attribute.unit,
            },
            "meaning": attribute.meaning,
        }
    return rows


def _float32(value: float) -> float:
    """The shortest number that is the same float32."""
    return float(str(np.float32(value)))


def _row(records: list[dict[str, Any]], table: str) -> dict[str, Any]:
    miou = [100 * r["miou"] for r in records]
    mean, ci95 = mean_ci95(miou)
    per_class = {}
    for index, name in enumerate(class_table(table).classes):
        values = [r["class_iou"][index] for r in records]
        known = [100 * v for v in values if v is not None]
        per_class[name] = round(float(np.mean(known)), 3) if known else None
    return {"miou": miou, "mean": mean, "ci95": ci95, "per_class": per_class}


def summarize(
    config: Config,
    target: Target,
    folder: RunFolder,
    rows: dict[str, list[dict[str, Any]]],
    chosen: str,
    candidates: dict[str, list[float]],
    learnt: sdr_jax.Proposal,
    total_seconds: float,
) -> dict[str, Any]:
    """Everything a script wants to know about a run; scores in percent.

    ``rows`` holds those of ``finals.rows_of``; ``random``, ``default`` and ``learnt`` also stand at the
    top, but not ``real``, which there says whether the target is real data.
    """
    lines = folder.evaluations.lines + folder.finals.lines
    table = {row: _row(records, target.table) for row, records in rows.items()}
    gain, gain_ci95 = paired_gain(table["learnt"]["miou"], table["random"]["miou"])
    absent = [name for name, value in table["random"]["per_class"].items() if value is None]
    summary = {
        "target": target.name,
        "real": target.real,
        "note": target.title,
        "preset": config.preset,
        "reward_images": len(target.reward_names),
        "test_images": len(target.test_names),
        "evaluations": len(folder.evaluations.lines),
        "seconds": {
            "render": round(sum(line["render_seconds"] for line in lines), 1),
            "train": round(sum(line["train_seconds"] for line in lines), 1),
            "total": round(total_seconds, 1),
        },
        "rows": table,
        # Scripts look the rendered rows up by name; the fourth shares its name with a flag above.
        **{row: table[row] for row in table if row != "real"},
        "gain": {"mean": gain, "ci95": gain_ci95},
        "scored_at": f"{config.final.width}x{config.final.height}",
        "classes_absent_from_truth": absent,
        "candidates": {name: [100 * v for v in values] for name, values in candidates.items()},
        "chosen_candidate": chosen,
    }
    if target.twin is not None:
        error = np.abs(learnt.centre - target.twin.centre)
        summary["recovery"] = {
            "learnt_error": round(float(error.mean()), 4),
            "centre_error": round(float(np.abs(0.5 - target.twin.centre).mean()), 4),
            "by_attribute": {
                a.name: round(float(e), 4) for a, e in zip(ATTRIBUTES, error, strict=True)
            },
        }
    return summary


def text(summary: dict[str, Any]) -> str:
    """The result as a small table for people."""
    kind = "real images" if summary["real"] else "the twin, NOT real data"
    lines = [
        f"mIoU in percent on {summary['test_images']} test images ({kind}), "
        f"{len(summary['random']['miou'])} paired seeds, scored at {summary['scored_at']}:"
    ]
    for row, entry in summary["rows"].items():
        said = f"{entry['mean']:5.1f}  {_interval(entry['ci95'])}  {TRAINED_ON[row]}"
        lines.append(f"  {row:8s} {said}")
    gain = summary["gain"]
    lines.append(f"  gain     {gain['mean']:+5.1f}  {_interval(gain['ci95'])}  learnt minus random")
    if summary["classes_absent_from_truth"]:
        absent = ", ".join(summary["classes_absent_from_truth"])
        lines.append(f"  left out of the mean, for they never occur in the truth: {absent}")
    return "\n".join(lines)


def _interval(ci95: list[float] | None) -> str:
    return "[    one seed   ]" if ci95 is None else f"[{ci95[0]:6.1f}, {ci95[1]:6.1f}]"
