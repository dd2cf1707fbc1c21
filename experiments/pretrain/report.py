"""Pre-training in figures: ``pretrain.json``, ``pretrain.md`` and ``pretrain.png``."""

from __future__ import annotations

from typing import Any

from experiments.figure import plt, png
from experiments.stats import welch
from experiments.study_report import (
    Form,
    class_means,
    interval,
    introduction,
    markdown,
    miou,
    number,
    statistics,
)

COMPARED = (
    ("learnt", "scratch"),
    ("random", "scratch"),
    ("learnt", "random"),
    ("learnt", "longer"),
    ("random", "longer"),
)
"""Which rows are tested against which."""


def derive(report: dict[str, Any]) -> dict[str, Any]:
    """The report with means, intervals and tests of its nets' scores."""
    rows = [
        {
            **row,
            **statistics(miou(row["nets"])),
            "class_iou": class_means(row["nets"], report["classes"]),
        }
        for row in report["rows"]
    ]
    known = {
        (row["row"], row["fraction"]): [v for v in miou(row["nets"]) if v is not None]
        for row in report["rows"]
    }
    tests = []
    for fraction in dict.fromkeys(row["fraction"] for row in rows):
        for ours, theirs in COMPARED:
            if (ours, fraction) in known and (theirs, fraction) in known:
                found = welch(known[ours, fraction], known[theirs, fraction])
                tests.append(
                    {
                        "fraction": fraction,
                        "row": ours,
                        "against": theirs,
                        **(found._asdict() if found else {}),
                        "stars": found.stars if found else "",
                    }
                )
    return {**report, "rows": rows, "tests": tests}


def named(report: dict[str, Any]) -> dict[str, str]:
    """What nets of each row begin with."""
    nothing = "ImageNet weights" if report["weights"] else "scratch"
    return {
        "scratch": nothing,
        "longer": f"{nothing}, as many steps",
        "random": "SceneX, random attributes",
        "learnt": "SceneX, learnt attributes",
    }


def text(report: dict[str, Any]) -> str:
    """The tables, in Markdown."""
    names, before, after = named(report), report["pretraining"], report["finetuning"]
    lines = [
        introduction(report),
        "",
        f"Nets ({report['net']}) are pre-trained with {before['steps']} steps on {before['images']} "
        f"rendered images, then fine-tuned with {after['steps']} steps (learning rate {after['lr']:.3g}) on "
        f"a share of the {report['reward_images']} reward images, the same for all rows of a seed. "
        f"Rows from {names['scratch']} get the steps of the fine-tuning only.",
        "",
        *markdown(
            ["begun with", "share of the images", "images", "mIoU", "95 % interval"],
            [
                [
                    names[row["row"]],
                    f"{100 * row['fraction']:g} %",
                    str(row["images"]),
                    number(row["mean"]),
                    interval(row["ci95"]),
                ]
                for row in report["rows"]
            ],
        ),
    ]
    if report["tests"]:
        lines += [
            "",
            "Welch's t-test of the difference, two-sided, not corrected for the number of tests "
            "(* p < 0.05, ** p < 0.01):",
            "",
            *markdown(
                ["begun with", "against", "share", "difference", "t", "degrees", "p", ""],
                [
                    [
                        names[test["row"]],
                        names[test["against"]],
                        f"{100 * test['fraction']:g} %",
                        number(test.get("difference"), "+.1f"),
                        number(test.get("t"), ".2f"),
                        number(test.get("degrees"), ".1f"),
                        number(test.get("p_value"), ".2g"),
                        test["stars"].replace("*", r"\*"),
                    ]
                    for test in report["tests"]
                ],
            ),
        ]
    failed = sum(net is None for row in report["rows"] for net in row["nets"])
    if failed:
        lines += ["", f"{failed} nets failed in training and are left out."]
    return "\n".join(lines)


def picture(report: dict[str, Any]) -> bytes:
    """MIoU against the share of the real images, with intervals, as PNG."""
    names = named(report)
    rows = list(dict.fromkeys(row["row"] for row in report["rows"]))
    shares = sorted({(row["fraction"], row["images"]) for row in report["rows"]})
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for k, name in enumerate(rows):
        offset = 0.05 * (k - (len(rows) - 1) / 2)  # lest the intervals lie on each other
        points = sorted(
            (
                shares.index((row["fraction"], row["images"])) + offset,
                row["mean"],
                row["mean"] - row["ci95"][0] if row["ci95"] else 0.0,
            )
            for row in report["rows"]
            if row["row"] == name and row["mean"] is not None
        )
        if points:
            x, y, half = zip(*points, strict=True)
            axis.errorbar(x, y, yerr=half, fmt="o-", ms=4, capsize=3, label=names[name])
    axis.set_xticks(
        range(len(shares)), [f"{100 * share:g} %\n{images} images" for share, images in shares]
    )
    axis.set(xlabel="reward images for the fine-tuning", ylabel="mIoU on the test images, %")
    axis.legend(fontsize=8)
    note = "" if report["real"] else " (not real data)"
    axis.set_title(f"{report['target']}{note}, {report['net']}, {report['seeds']} nets each")
    return png(figure)


FORM = Form("pretrain", derive, text, picture)
"""The report of ``python -m experiments.pretrain``."""
