"""The comparison in figures: ``compare.json``, ``compare.md`` and ``compare.png``."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.compare.picture import picture
from experiments.study.form import Form, Report, cells, failures, markdown, number, starts, words
from experiments.study.searches import failed_evaluations, thirds
from experiments.study.stats import statistics
from sdr_jax.registry import MethodName

RANDOM: MethodName = "random_attributes"
"""The row that gains are measured from; it asks for no evaluation."""
HEAD = (
    "attributes", "method", "mIoU, %", "95 % interval", "gain over random", "95 % interval",
    "rewards", "reward, first third", "last third", "rewards, core s", "wall s",
    "method, CPU s", "wall s",
)  # fmt: skip


def derive(report: Report) -> Report:
    """The report with means, intervals and gains of its nets, and what its rewards come to."""
    random = {row["subset"]: row["budgets"] for row in report["rows"] if row["method"] == RANDOM}
    return {**report, "rows": [_row(row, random.get(row["subset"])) for row in report["rows"]]}


def _row(row: Report, random: Sequence[Report] | None) -> Report:
    baselines = [None] * len(row["budgets"]) if random is None else [at["miou"] for at in random]
    budgets = [
        {"miou": at["miou"], **statistics(at["miou"], baseline)}
        for at, baseline in zip(row["budgets"], baselines, strict=True)
    ]
    search = row["search"]
    if search is not None:
        rewards = search["rewards"]
        first, last = thirds(rewards)
        search = {
            **search,
            "evaluations": len(rewards),
            "failed": rewards.count(None),
            "first_third": first,
            "last_third": last,
        }
    final = budgets[-1] if budgets else None
    return {**row, "search": search, "final": final, "budgets": budgets}


def text(report: Report) -> str:
    """The tables, in Markdown."""
    lines = [
        f"Target: {report['note']}. Rewards are mIoU at {report['rewards_at']} on the reward images; "
        f"final nets are scored at {report['scored_at']} on the test images, {report['seeds']} "
        f"paired seeds.{starts(report)}",
        "Each search ran once, and intervals are over seeds of the final nets. Rewards take a core of "
        f"a worker each; their wall time is that over {report['workers']} worker(s). "
        "A method's own time includes compiling it.",
        "",
        *markdown(HEAD, [_cells(row) for row in report["rows"]]),
        *_budgets(report),
    ]
    searches = [row["search"]["rewards"] for row in report["rows"] if row["search"] is not None]
    random = [row for row in report["rows"] if row["method"] == RANDOM]
    # Random attributes are the same nets on every subset.
    trained = [row for row in report["rows"] if row["method"] != RANDOM] + random[:1]
    nets = [{"nets": at["miou"]} for row in trained for at in row["budgets"]]
    return "\n".join([*lines, *failed_evaluations(searches), *failures(nets)])


def _cells(row: Report) -> list[str]:
    search, final = row["search"] or {}, row["final"] or {}
    gain = final.get("gain") if row["method"] != RANDOM else None
    rewards, method = search.get("reward_seconds", {}), search.get("method_seconds", {})
    return [
        str(row["attributes"]),
        words(row["method"]),
        *cells(row["final"]),
        *cells(gain, "+.1f"),
        str(search.get("evaluations", 0)),
        number(search.get("first_third")),
        number(search.get("last_third")),
        number(rewards.get("core"), ".0f"),
        number(rewards.get("wall"), ".0f"),
        number(method.get("cpu")),
        number(method.get("wall")),
    ]


def _budgets(report: Report) -> list[str]:
    """How the gain over random attributes behaves from the cheapest to the final budget."""
    rows = [row for row in report["rows"] if row["method"] != RANDOM]
    if len(report["budgets"]) < 2 or not any(at["gain"] for row in rows for at in row["budgets"]):
        return []
    lines = []
    for row in rows:
        gains = ["{} ({})".format(*cells(at["gain"], "+.1f")) for at in row["budgets"]]
        lines.append([str(row["attributes"]), words(row["method"]), *gains])
    return [
        "",
        "Gain over random attributes on the test images, with the 95 % interval, from the reward's budget "
        "to the final one:",
        "",
        *markdown(("attributes", "method", *report["budgets"]), lines),
    ]


FORM = Form("compare", derive, text, {"compare.png": picture})
"""The report of ``python -m experiments.compare``."""
