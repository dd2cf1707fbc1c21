"""The names under which people read training sets; files keep the keys, such as ``learnt``."""

from __future__ import annotations

from typing import Any

SUBSET = "the labelled subset"
"""The few labelled images; with their number in place of these words, see `trained_on`."""
FEW = "few"
"""The row of networks trained on the labelled subset alone; ``few+ROW`` adds the images of ROW."""
FEW_ROWS = (FEW, f"{FEW}+random", f"{FEW}+default", f"{FEW}+learnt")
"""All rows with the labelled subset."""
TRAINED_ON = {
    "random": "random streets",
    "default": "default streets",
    "mixed": "half random, half default streets",
    "learnt": "optimised streets",
    "few": f"{SUBSET} alone",
    "few+random": f"{SUBSET} + random streets",
    "few+default": f"{SUBSET} + default streets",
    "few+learnt": f"{SUBSET} + optimised streets",
    "real": "labelled target images",
    "labels": "your labels alone",
    "labels+renders": "your labels + renders",
    "renders": "renders alone",
    "labels+learnt": "your labels + optimised streets",
}
"""Training sets in tables and sentences."""
SHORT = {
    "random": "random",
    "default": "default",
    "learnt": "optimised",
    "few": "labels",
    "few+random": "labels + random",
    "few+default": "labels + default",
    "few+learnt": "labels + optimised",
    "real": "target images",
    "labels": "your labels",
    "labels+renders": "labels + renders",
    "labels+learnt": "labels + optimised",
    "renders": "renders",
}
"""The rows of a run in plots and heads of columns, in the order of the page."""


def trained_on(report: dict[str, Any], row: str) -> str:
    """The training set of a row of a report, with the size of the labelled subset if there is one."""
    subset = len(report.get("few_images", ()))
    if subset and row == "real":
        return f"all {report['reward_images'] + subset} labelled images"
    name = TRAINED_ON[row]
    return name.replace(SUBSET, f"{subset} labelled images", 1) if subset else name
