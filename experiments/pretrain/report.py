"""Pre-training in figures: ``pretrain.json``, ``pretrain.md`` and ``pretrain.png``."""

from __future__ import annotations

from itertools import product

from experiments.study.figure import curve, plt, png
from experiments.study.form import (
    Form,
    Report,
    cells,
    class_means,
    failures,
    introduction,
    markdown,
    miou,
    number,
    target_of,
)
from experiments.study.stats import holm, stars, statistics, welch

COMPARED = (
    ("learnt", "scratch"),
    ("random", "scratch"),
    ("learnt", "random"),
    ("learnt", "longer"),
    ("random", "longer"),
)
"""Which rows are tested against which."""
FIGURES = {
    "difference": ("difference", "+.1f"),
    "t": ("t", ".2f"),
    "degrees": ("degrees", ".1f"),
    "p": ("p_value", ".2g"),
    "of all tests": ("p_corrected", ".2g"),
}
"""Of a test: heads of the table, names in the report, and how they are written."""


def derive(report: Report) -> Report:
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
    for fraction, (ours, theirs) in product(dict.fromkeys(r["fraction"] for r in rows), COMPARED):
        if (ours, fraction) in known and (theirs, fraction) in known:
            found = welch(known[ours, fraction], known[theirs, fraction])
            test = {"fraction": fraction, "row": ours, "against": theirs}
            tests.append({**test, "stars": ""} if found is None else {**test, **found._asdict()})
    done = [test for test in tests if "p_value" in test]
    for test, p_value in zip(done, holm([test["p_value"] for test in done]), strict=True):
        test |= {"p_corrected": p_value, "stars": stars(p_value)}
    return {**report, "rows": rows, "tests": tests}


def named(report: Report) -> dict[str, str]:
    """What nets of each row begin with."""
    nothing = "ImageNet weights" if report["weights"] else "scratch"
    return {
        "scratch": nothing,
        "longer": f"{nothing}, as many steps",
        "random": "SceneX, random attributes",
        "learnt": "SceneX, learnt attributes",
    }


def text(report: Report) -> str:
    """The tables, in Markdown."""
    names, before, after = named(report), report["pretraining"], report["finetuning"]
    sharing = "all rows of a seed"
    if report.get("learn_on") == "share":
        sharing = "all rows and seeds; attributes are learnt with the labels of that share alone"
    head = ["begun with", "share of the images", "images", "mIoU", "95 % interval"]
    rows = [
        [names[r["row"]], f"{100 * r['fraction']:g} %", str(r["images"]), *cells(r)]
        for r in report["rows"]
    ]
    lines = [
        introduction(report),
        "",
        f"Nets ({report['net']}) are pre-trained with {before['steps']} steps on {before['images']} "
        f"rendered images, then fine-tuned with {after['steps']} steps (learning rate {after['lr']:.3g}) on "
        f"a share of the {report['reward_images']} reward images, the same for {sharing}. "
        f"Rows from {names['scratch']} get the steps of the fine-tuning only.",
        "",
        *markdown(head, rows),
    ]
    if report["tests"]:
        head = ["begun with", "against", "share", *FIGURES, ""]
        tests = [
            [
                names[test["row"]],
                names[test["against"]],
                f"{100 * test['fraction']:g} %",
                *(number(test.get(key), form) for key, form in FIGURES.values()),
                test["stars"].replace("*", r"\*"),
            ]
            for test in report["tests"]
        ]
        lines += [
            "",
            "Welch's t-test of the difference, two-sided; the last p is corrected for the number of tests, "
            "by Holm (* p < 0.05, ** p < 0.01):",
            "",
            *markdown(head, tests),
        ]
    return "\n".join([*lines, *failures(report["rows"])])


def picture(report: Report) -> bytes:
    """MIoU against the share of the real images, with intervals, as PNG."""
    names = named(report)
    rows = list(dict.fromkeys(row["row"] for row in report["rows"]))
    shares = sorted({(row["fraction"], row["images"]) for row in report["rows"]})
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for k, name in enumerate(rows):
        own = [row for row in report["rows"] if row["row"] == name]
        # Beside each other, lest the intervals lie on each other.
        aside = 0.05 * (k - (len(rows) - 1) / 2)
        places = [shares.index((row["fraction"], row["images"])) + aside for row in own]
        curve(axis, places, own, names[name])
    axis.set_xticks(
        range(len(shares)), [f"{100 * share:g} %\n{images} images" for share, images in shares]
    )
    axis.set(xlabel="reward images for the fine-tuning", ylabel="mIoU on the test images, %")
    axis.legend(fontsize=8)
    axis.set_title(f"{target_of(report)}, {report['net']}, {report['seeds']} nets each")
    return png(figure)


FORM = Form("pretrain", derive, text, {"pretrain.png": picture})
"""The report of ``python -m experiments.pretrain``."""
